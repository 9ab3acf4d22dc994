//! Exact minimisation over one block of variables at a time: steps that can never raise `C_KL`.
//!
//! A round makes two passes over the operator, and forms and factors the curvature in the light
//! (M x M) for the present reflectance.

use gonio::lighting::Moments;

use super::ensemble::AllMoments;
use super::expectations::Sums;
use super::grams::Grams;
use super::light_system::{LightSystem, minimise_coefficient};
use super::{Problem, VariationalParameters, newton};

/// Quadratic form of the residual in the reflectance coefficients, with the light marginalised
/// under q.
pub(crate) struct ReflectanceSystem {
    /// `sum_i [a_ik a_ij + sum_m vl_m A_imk A_imj]`, K x K.
    gram: Vec<f64>,
    /// `sum_i I_i a_ik`.
    target: Vec<f64>,
}

impl ReflectanceSystem {
    /// Builds the form for `a`, the images of the basis functions under the means of `l`
    /// (rows x K).
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

    /// Returns the form for basis images `a + alpha by`, as a function of `alpha`.
    pub(crate) fn moved(&self, problem: &Problem<'_>, a: &[f64], by: &[f64]) -> impl Fn(f64) -> Self + use<> {
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
        let start = Self { gram: self.gram.clone(), target: self.target.clone() };
        move |alpha| Self {
            gram: start
                .gram
                .iter()
                .zip(once.iter().zip(&twice))
                .map(|(g, (o, t))| g + alpha * (o + alpha * t))
                .collect(),
            target: start.target.iter().zip(&target).map(|(t, d)| t + alpha * d).collect(),
        }
    }

    pub(super) fn row(&self, x: usize) -> &[f64] {
        let k = self.target.len();
        &self.gram[x * k..][..k]
    }

    pub(super) fn target(&self) -> &[f64] {
        &self.target
    }

    /// Diagonal of the Gram matrix (K).
    #[cfg(test)]
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        let k = self.target.len();
        (0..k).map(|x| self.gram[x * k + x]).collect()
    }

    /// Returns the sums of the cost for given moments of the reflectance.
    pub(crate) fn sums(&self, f: &[Moments]) -> Sums {
        let iy = self.target.iter().zip(f).map(|(t, f)| t * f.mean).sum();
        let mut q = 0.0;
        for (x, row) in self.gram.chunks_exact(f.len()).enumerate() {
            q += f[x].mean * row.iter().zip(f).map(|(h, f)| h * f.mean).sum::<f64>() + f[x].variance * row[x];
        }
        Sums { iy, q }
    }

    /// Runs coordinate descent to convergence. `moments_of(k, u/w, 1/w)` returns the moments of
    /// coefficient `k` for these natural parameters.
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

/// State of q, with its basis images and residual.
pub(crate) struct Point {
    pub(crate) ensemble: VariationalParameters,
    /// Moments of the ensemble.
    pub(crate) moments: AllMoments,
    /// The image of each basis function under the light (rows x K).
    pub(crate) a: Vec<f64>,
    /// Quadratic form of the residual in the reflectance under this light.
    pub(crate) system: ReflectanceSystem,
}

impl Point {
    pub(crate) fn new(problem: &Problem<'_>, ensemble: VariationalParameters, grams: &Grams) -> Self {
        let moments = ensemble.moments(problem);
        let a = problem.bilinear.under_light(&moments.l_means());
        let system = ReflectanceSystem::new(problem, &a, &moments.l, grams);
        Self { ensemble, moments, a, system }
    }

    /// `C_KL`.
    pub(crate) fn cost(&self, problem: &Problem<'_>) -> f64 {
        self.system.sums(&self.moments.f).cost(problem, &self.moments)
    }

    /// Minimises exactly over reflectance and exposure in turn, over their common scale, and over
    /// the noise if `noise` is set.
    fn settle(&mut self, problem: &Problem<'_>, noise: bool) {
        let Self { ensemble, moments, system, .. } = self;
        moments.f = system.descend(problem, moments, |k, natural, precision| {
            ensemble.set_f(k, natural, precision);
            ensemble.f_moments(k)
        });
        let sums = system.sums(&moments.f);
        ensemble.set_g(moments.precision * sums.iy - problem.hyper.exposure_rate, moments.precision * sums.q);
        ensemble.rescale(best_scale(problem, ensemble));
        (moments.f, moments.g) = ((0..problem.k()).map(|k| ensemble.f_moments(k)).collect(), ensemble.g_moments());
        if noise {
            ensemble.set_log_noise(system.sums(&moments.f).best_log_noise(problem, &moments.g));
            moments.precision = (-ensemble.log_noise()).exp();
        }
    }
}

/// Minimises over the light given all else.
///
/// Returns the ensemble and the linear system of the light.
pub(super) fn minimise_light(
    problem: &Problem<'_>,
    ensemble: &VariationalParameters,
    grams: &Grams,
) -> (VariationalParameters, LightSystem) {
    let moments = ensemble.moments(problem);
    let mut next = ensemble.clone();
    let mut light = LightSystem::new(problem, &moments, grams);
    let (means, precisions) = light.minimise(problem, &moments, |m, curvature, push| {
        minimise_coefficient(problem, &mut next, m, (curvature, push), moments.l[m]).mean
    });
    for m in (1..problem.m()).filter(|&m| !light.is_excluded(m)) {
        next.set_l(m, means[m] * precisions[m], precisions[m]);
    }
    (next, light)
}

/// Runs one round, and returns the ensemble and its cost, which is never higher than before.
///
/// A round minimises over the light, takes a Newton step in all variables, and minimises over
/// reflectance and exposure given the light, and over the noise if `noise` is true.
pub(crate) fn round(
    problem: &Problem<'_>,
    ensemble: &VariationalParameters,
    grams: &Grams,
    noise: bool,
) -> (VariationalParameters, f64) {
    let mut point = if problem.m() > 1 {
        let (next, light) = minimise_light(problem, ensemble, grams);
        newton::advance(problem, Point::new(problem, next, grams), &light, noise)
    } else {
        Point::new(problem, ensemble.clone(), grams)
    };
    point.settle(problem, noise);
    let cost = point.cost(problem);
    (point.ensemble, cost)
}

/// Returns the factor `c` of the common scale that minimises the cost.
///
/// The image determines only the product of exposure and reflectance. Along `f -> c f, g -> g / c`,
/// the cost is
/// `c sum_k lambda_k <f_k> + lambda_g <g> / c - (K - 1) log c`, whose minimum has a closed form.
/// The other steps advance only slowly along this ridge.
fn best_scale(problem: &Problem<'_>, ensemble: &VariationalParameters) -> f64 {
    let f: f64 = problem.rates.iter().enumerate().map(|(k, rate)| rate * ensemble.f_moments(k).mean).sum();
    let g = problem.hyper.exposure_rate * ensemble.g_moments().mean;
    let others = problem.k() as f64 - 1.0;
    let c = (others + (others * others + 4.0 * f * g).sqrt()) / (2.0 * f);
    if c.is_finite() && c > 0.0 { c } else { 1.0 }
}
