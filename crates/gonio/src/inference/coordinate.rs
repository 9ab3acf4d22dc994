//! Exact minimisation over one block of variables at a time: steps that can never raise `C_KL`.
//!
//! A round makes two passes over the operator, and forms and factors the curvature in the light (M x
//! M) for the present reflectance.

use faer::Mat;

use super::ensemble::AllMoments;
use super::expectations::{Sums, columns_squared, expected_precision, prior_pull};
use super::grams::{Grams, symmetric_times};
use super::marginal::Cholesky;
use super::{Ensemble, Problem};
use crate::lighting::{CoefficientPrior, Moments};
use crate::transfer::kernels::{axpy, dispatch};

/// The light given all else: `C_KL` is quadratic in its means, and quadratic with given
/// responsibilities in all.
pub(crate) struct LightSystem {
    /// `<b><g^2> ( B'B + sum_k vf_k A_k' A_k ) + diag d` with `d_m = sum_n r_n / s_n^2`, zero where
    /// the prior is no mixture; on and below the diagonal.
    curvature: Mat<f64>,
    /// `<b><g^2> S_m`, what the image adds to its diagonal.
    stiffness: Vec<f64>,
    /// `<b><g> B'I`.
    target: Vec<f64>,
    /// `d`.
    priors: Vec<f64>,
}

impl LightSystem {
    pub(crate) fn new(problem: &Problem<'_>, moments: &AllMoments, grams: &Grams) -> Self {
        let AllMoments { f, l, g, precision } = moments;
        let b = problem.bilinear.of_reflectance(&moments.f_means());
        let scale = precision * g.mean_square();
        let mut stiffness = columns_squared(&b, problem.m());
        for (f, squares) in f.iter().zip(problem.bilinear.squares().chunks_exact(problem.m())) {
            stiffness.iter_mut().zip(squares).for_each(|(s, w)| *s += f.variance * w);
        }
        stiffness.iter_mut().for_each(|s| *s *= scale);
        let mut target = vec![0.0; problem.m()];
        dispatch(|| {
            for (row, i) in b.chunks_exact(problem.m()).zip(&problem.target) {
                axpy(precision * g.mean * i, row, &mut target);
            }
        });
        let prior = |(prior, l): (&&CoefficientPrior, &Moments)| match prior {
            CoefficientPrior::Mixture(mixture) => expected_precision(mixture, l.mean_square()),
            CoefficientPrior::Rectified(_) => 0.0,
        };
        let priors: Vec<f64> = std::iter::once(0.0).chain(problem.light.iter().zip(&l[1..]).map(prior)).collect();
        Self { curvature: grams.light_curvature(&b, f, scale, &priors), stiffness, target, priors }
    }

    /// Minus the gradient of the cost in the means, without the priors that are no mixtures.
    fn residual(&self, means: &[f64]) -> Vec<f64> {
        let present = symmetric_times(&self.curvature, means);
        self.target.iter().zip(&present).map(|(t, p)| t - p).collect()
    }

    /// The means of all light coefficients with mixture priors at once, given all else:
    ///
    /// ```text
    /// ( <b><g^2> [ B'B + sum_k vf_k A_k'A_k ] + diag d ) l = <b><g> B'I
    /// ```
    ///
    /// Returns the means (DC and rectified coefficients unchanged) and the precisions `1/w` that go
    /// with them.
    pub(crate) fn means(&self, problem: &Problem<'_>, moments: &AllMoments) -> (Vec<f64>, Vec<f64>) {
        let mut means = moments.l_means();
        let mut residual = self.residual(&means);
        let mut system = self.curvature.clone();
        let fixed =
            (0..means.len()).filter(|&m| m == 0 || matches!(problem.light[m - 1], CoefficientPrior::Rectified(_)));
        for m in fixed {
            residual[m] = 0.0;
            system.row_mut(m).fill(0.0);
            system.col_mut(m).fill(0.0);
            system[(m, m)] = 1.0;
        }
        // Without a factor, which takes round-off larger than every prior precision, the light
        // stays.
        if let Some(factor) = Cholesky::new(system) {
            means.iter_mut().zip(factor.solve(&residual)).for_each(|(x, d)| *x += d);
        }
        let precisions = self.stiffness.iter().zip(&self.priors).map(|(s, d)| s + d).collect();
        (means, precisions)
    }

    /// Precision `1/w` and `u/w` that the image gives the rectified coefficient `m`, all else
    /// given.
    pub(crate) fn push(&self, means: &[f64], m: usize) -> (f64, f64) {
        (self.stiffness[m], self.residual(means)[m] + self.stiffness[m] * means[m])
    }
}

/// Quadratic form of the residual in the reflectance coefficients, light marginalised under q.
pub(crate) struct ReflectanceSystem {
    /// `sum_i [a_ik a_ij + sum_m vl_m A_imk A_imj]`, K x K.
    gram: Vec<f64>,
    /// `sum_i I_i a_ik`.
    target: Vec<f64>,
}

impl ReflectanceSystem {
    /// `a` as under the means of `l` (rows x K).
    pub(crate) fn new(problem: &Problem<'_>, a: &[f64], l: &[Moments], grams: &Grams) -> Self {
        let (k, m) = (problem.k(), problem.m());
        let mut gram = vec![0.0; k * k];
        let mut target = vec![0.0; k];
        for (a, i) in a.chunks_exact(k).zip(&problem.target) {
            for x in 0..k {
                target[x] += i * a[x];
                for y in 0..=x {
                    gram[x * k + y] += a[x] * a[y];
                }
            }
        }
        for x in 0..k {
            for y in 0..=x {
                let spread: f64 =
                    grams.reflectance[(x * k + y) * m..][..m].iter().zip(l).map(|(g, l)| g * l.variance).sum();
                gram[x * k + y] += spread;
                gram[y * k + x] = gram[x * k + y];
            }
        }
        Self { gram, target }
    }

    /// With the image of each basis function changed from `a` to `a + alpha by`, for any `alpha`.
    pub(crate) fn moved(&self, problem: &Problem<'_>, a: &[f64], by: &[f64]) -> impl Fn(f64) -> Self + use<'_> {
        let k = problem.k();
        let (mut once, mut twice, mut target) = (vec![0.0; k * k], vec![0.0; k * k], vec![0.0; k]);
        for ((a, d), i) in a.chunks_exact(k).zip(by.chunks_exact(k)).zip(&problem.target) {
            for x in 0..k {
                target[x] += i * d[x];
                for y in 0..k {
                    once[x * k + y] += a[x] * d[y] + d[x] * a[y];
                    twice[x * k + y] += d[x] * d[y];
                }
            }
        }
        move |alpha| Self {
            gram: self
                .gram
                .iter()
                .zip(once.iter().zip(&twice))
                .map(|(g, (o, t))| g + alpha * (o + alpha * t))
                .collect(),
            target: self.target.iter().zip(&target).map(|(t, d)| t + alpha * d).collect(),
        }
    }

    /// Diagonal of the Gram matrix (K).
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        let k = self.target.len();
        (0..k).map(|x| self.gram[x * k + x]).collect()
    }

    /// The sums of the cost for a reflectance.
    pub(crate) fn sums(&self, f: &[Moments]) -> Sums {
        let iy = self.target.iter().zip(f).map(|(t, f)| t * f.mean).sum();
        let mut q = 0.0;
        for (x, row) in self.gram.chunks_exact(f.len()).enumerate() {
            q += f[x].mean * row.iter().zip(f).map(|(h, f)| h * f.mean).sum::<f64>() + f[x].variance * row[x];
        }
        Sums { iy, q }
    }

    /// Coordinate descent to convergence: `u/w` and `1/w` of every coefficient, with
    /// `moments_of(u/w, 1/w)` giving the moments that the coefficient has then.
    pub(crate) fn descend(
        &self,
        problem: &Problem<'_>,
        moments: &AllMoments,
        mut moments_of: impl FnMut(usize, f64, f64) -> Moments,
    ) -> Vec<Moments> {
        let k_count = problem.k();
        let (g1, g2) = (moments.g.mean, moments.g.mean_square());
        let mut f = moments.f.clone();
        for _ in 0..500 {
            let mut moved = 0.0_f64;
            for k in 0..k_count {
                let row = &self.gram[k * k_count..(k + 1) * k_count];
                let others: f64 = row.iter().zip(&f).map(|(h, f)| h * f.mean).sum::<f64>() - row[k] * f[k].mean;
                let natural = moments.precision * (g1 * self.target[k] - g2 * others) - problem.rates[k];
                let next = moments_of(k, natural, moments.precision * g2 * row[k]);
                moved = moved.max((next.mean - f[k].mean).abs() / (next.mean + next.variance.sqrt()).max(1e-300));
                f[k] = next;
            }
            if moved < 1e-9 {
                break;
            }
        }
        f
    }
}

/// One exact update of a single light coefficient to which the image gives precision `stiffness`
/// and pull `push`, responsibilities included, from the moments that it has.
pub(crate) fn settle_light(
    problem: &Problem<'_>,
    ensemble: &mut Ensemble,
    m: usize,
    (stiffness, push): (f64, f64),
    mut moments: Moments,
) -> Moments {
    // The responsibilities depend on the coefficient's own moments: a fixed point, monotone in the
    // cost.
    for _ in 0..200 {
        let (natural, prior) = prior_pull(problem.light[m - 1], &moments);
        ensemble.set_l(m, push + natural, stiffness + prior);
        let next = ensemble.l_moments(m, problem.light[m - 1]);
        let settled = (next.mean - moments.mean).abs() + (next.variance - moments.variance).abs() < 1e-16;
        moments = next;
        if settled {
            break;
        }
    }
    moments
}

/// Where a round ends.
pub(crate) struct Round {
    pub(crate) ensemble: Ensemble,
    pub(crate) cost: f64,
    /// The image of each basis function under the light (rows x K).
    pub(crate) a: Vec<f64>,
    /// The residual in the reflectance under this light.
    pub(crate) system: ReflectanceSystem,
}

/// One round of exact minimisation over light, reflectance and exposure in turn, and over the noise
/// if `noise`.
pub(crate) fn round(problem: &Problem<'_>, ensemble: &Ensemble, grams: &Grams, noise: bool) -> Round {
    let mut next = ensemble.clone();
    let mut moments = ensemble.moments(problem);
    if problem.m() > 1 {
        let system = LightSystem::new(problem, &moments, grams);
        let (means, precisions) = system.means(problem, &moments);
        for m in 1..problem.m() {
            if matches!(problem.light[m - 1], CoefficientPrior::Mixture(_)) {
                next.set_l(m, means[m] * precisions[m], precisions[m]);
                moments.l[m] = Moments::gaussian(means[m], 1.0 / precisions[m]);
            }
        }
        for m in (1..problem.m()).filter(|&m| matches!(problem.light[m - 1], CoefficientPrior::Rectified(_))) {
            let push = system.push(&moments.l_means(), m);
            moments.l[m] = settle_light(problem, &mut next, m, push, moments.l[m]);
        }
    }
    let a = problem.bilinear.under_light(&moments.l_means());
    let system = ReflectanceSystem::new(problem, &a, &moments.l, grams);
    moments.f = system.descend(problem, &moments, |k, natural, precision| {
        next.set_f(k, natural, precision);
        next.f_moments(k)
    });
    let sums = system.sums(&moments.f);
    next.set_g(moments.precision * sums.iy - problem.hyper.exposure_rate, moments.precision * sums.q);
    next.rescale(best_scale(problem, &next));
    (moments.f, moments.g) = ((0..problem.k()).map(|k| next.f_moments(k)).collect(), next.g_moments());
    let sums = system.sums(&moments.f);
    if noise {
        next.set_log_noise(sums.best_log_noise(problem, &moments.g));
        moments.precision = (-next.log_noise()).exp();
    }
    Round { cost: sums.cost(problem, &moments), ensemble: next, a, system }
}

/// The image sees only the product of exposure and reflectance. Along `f -> c f, g -> g / c` the
/// cost is `c sum_k lambda_k <f_k> + lambda_g <g> / c - (K - 1) log c`, whose minimum has a closed
/// form; the other steps would creep along that ridge.
fn best_scale(problem: &Problem<'_>, ensemble: &Ensemble) -> f64 {
    let f: f64 = problem.rates.iter().enumerate().map(|(k, rate)| rate * ensemble.f_moments(k).mean).sum();
    let g = problem.hyper.exposure_rate * ensemble.g_moments().mean;
    let others = problem.k() as f64 - 1.0;
    let c = (others + (others * others + 4.0 * f * g).sqrt()) / (2.0 * f);
    if c.is_finite() && c > 0.0 { c } else { 1.0 }
}
