//! Exact minimisation over one block of variables at a time: steps that can never raise `C_KL`.
//!
//! A round makes two passes over the operator and the Gram matrix of what it is for the present
//! reflectance; everything else is as large as M x M or less.

use faer::Mat;

use super::ensemble::AllMoments;
use super::expectations::{Sums, columns_squared, prior_pull};
use super::grams::{Grams, symmetric_times};
use super::{Ensemble, Problem};
use crate::lighting::{CoefficientPrior, Moments};
use crate::transfer::kernels::{axpy, dispatch, dot};

/// Steps of conjugate gradients at most.
const LIGHT_STEPS: usize = 40;

/// Quadratic form of the residual in the light, reflectance marginalised under q.
pub(crate) struct LightSystem {
    /// `B'B + sum_k vf_k A_k' A_k` (M x M). Single precision moves its minimum by less than
    /// anything seen in the cost.
    curvature: Mat<f32>,
    /// Its diagonal `S_m`.
    stiffness: Vec<f64>,
    /// `B'I`.
    target: Vec<f64>,
}

impl LightSystem {
    pub(crate) fn new(problem: &Problem<'_>, f: &[Moments], grams: &Grams) -> Self {
        let means: Vec<f64> = f.iter().map(|f| f.mean).collect();
        let b = problem.bilinear.of_reflectance(&means);
        let mut stiffness = columns_squared(&b, problem.m());
        for (f, squares) in f.iter().zip(problem.bilinear.squares().chunks_exact(problem.m())) {
            stiffness.iter_mut().zip(squares).for_each(|(s, w)| *s += f.variance * w);
        }
        let mut target = vec![0.0; problem.m()];
        dispatch(|| {
            for (row, i) in b.chunks_exact(problem.m()).zip(&problem.target) {
                axpy(*i, row, &mut target);
            }
        });
        Self { curvature: grams.light_curvature(&b, f), stiffness, target }
    }

    /// The means of all light coefficients with mixture priors at once, given all else, by
    /// preconditioned conjugate gradients from their present values:
    ///
    /// ```text
    /// ( <b><g^2> [ B'B + sum_k vf_k A_k'A_k ] + diag d ) l = <b><g> B'I,    d_m = sum_n r_n / s_n^2
    /// ```
    ///
    /// Stopping early is safe: every step of conjugate gradients lowers the quadratic. Returns new
    /// means (DC and rectified coefficients unchanged) and the precisions `1/w` that go with them.
    pub(crate) fn means(&self, problem: &Problem<'_>, moments: &AllMoments) -> (Vec<f64>, Vec<f64>) {
        let AllMoments { l, g, precision, .. } = moments;
        let stiffness = precision * g.mean_square();
        let priors: Vec<f64> = std::iter::once(0.0)
            .chain(problem.light.iter().zip(&l[1..]).map(|(prior, l)| prior_pull(prior, l).1))
            .collect();
        let free: Vec<bool> = std::iter::once(false)
            .chain(problem.light.iter().map(|prior| matches!(prior, CoefficientPrior::Mixture(_))))
            .collect();
        let diagonal: Vec<f64> = self.stiffness.iter().zip(&priors).map(|(s, d)| stiffness * s + d).collect();
        let mask =
            |x: Vec<f64>| -> Vec<f64> { x.into_iter().zip(&free).map(|(x, f)| if *f { x } else { 0.0 }).collect() };
        let apply = |p: &[f64]| -> Vec<f64> {
            let out = symmetric_times(&self.curvature, p).into_iter().zip(p.iter().zip(&priors));
            out.map(|(s, (p, d))| stiffness * s + d * p).collect()
        };
        let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut means = moments.l_means();
        let present = apply(&means);
        let push = precision * g.mean;
        let mut residual = mask(self.target.iter().zip(&present).map(|(t, p)| push * t - p).collect());
        let precondition = |r: &[f64]| -> Vec<f64> { r.iter().zip(&diagonal).map(|(r, d)| r / d).collect() };
        let mut z = precondition(&residual);
        let mut p = z.clone();
        let mut rz = inner(&residual, &z);
        let start = rz;
        for _ in 0..LIGHT_STEPS {
            // Half of rz is about how much the cost can still fall.
            if rz <= 1e-8 * start || rz < 1e-9 {
                break;
            }
            let ap = mask(apply(&p));
            let alpha = rz / inner(&p, &ap);
            means.iter_mut().zip(&p).for_each(|(x, p)| *x += alpha * p);
            residual.iter_mut().zip(&ap).for_each(|(r, a)| *r -= alpha * a);
            z = precondition(&residual);
            let next = inner(&residual, &z);
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + next / rz * *p);
            rz = next;
        }
        (means, diagonal)
    }

    /// Precision `1/w` and `u/w` that the image gives coefficient `m`, all else given.
    pub(crate) fn push(&self, moments: &AllMoments, m: usize) -> (f64, f64) {
        let AllMoments { l, g, precision, .. } = moments;
        let column = self.curvature.col(m).try_as_col_major().expect("a matrix is stored by columns").as_slice();
        let along = dispatch(|| dot(column, &moments.l_means()));
        let stiffness = precision * g.mean_square() * self.stiffness[m];
        (stiffness, precision * (g.mean * self.target[m] - g.mean_square() * along) + stiffness * l[m].mean)
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
    pub(crate) fn new(problem: &Problem<'_>, l: &[Moments], grams: &Grams) -> Self {
        let (k, m) = (problem.k(), problem.m());
        let means: Vec<f64> = l.iter().map(|l| l.mean).collect();
        let a = problem.bilinear.under_light(&means);
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

/// One round of exact minimisation over light, reflectance and exposure in turn, and over the noise
/// if `noise`. Returns the ensemble and its cost.
pub(crate) fn round(problem: &Problem<'_>, ensemble: &Ensemble, grams: &Grams, noise: bool) -> (Ensemble, f64) {
    let mut next = ensemble.clone();
    let mut moments = ensemble.moments(problem);
    if problem.m() > 1 {
        let system = LightSystem::new(problem, &moments.f, grams);
        let (means, precisions) = system.means(problem, &moments);
        for m in 1..problem.m() {
            if matches!(problem.light[m - 1], CoefficientPrior::Mixture(_)) {
                next.set_l(m, means[m] * precisions[m], precisions[m]);
                moments.l[m] = Moments::gaussian(means[m], 1.0 / precisions[m]);
            }
        }
        for m in (1..problem.m()).filter(|&m| matches!(problem.light[m - 1], CoefficientPrior::Rectified(_))) {
            let push = system.push(&moments, m);
            moments.l[m] = settle_light(problem, &mut next, m, push, moments.l[m]);
        }
    }
    let system = ReflectanceSystem::new(problem, &moments.l, grams);
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
    let cost = sums.cost(problem, &moments);
    (next, cost)
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
