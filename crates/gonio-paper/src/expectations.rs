//! Expected residuals under q, the cost `C_KL` (eq. 11), and the updates of Algorithm 1.
//!
//! Notation of the code: `a_i = A_i' <l>` (K), `b_i = A_i <f>` (M), `y_i = <l>' A_i <f>`, `v`
//! variances,
//! `Q_i = <(l' A_i f)^2>
//! = y_i^2 + sum_m vl_m b_im^2 + sum_k vf_k a_ik^2 + sum_mk vl_m vf_k A_imk^2`,
//! `E = sum_i I_i^2 - 2 <g> I_i y_i + <g^2> Q_i`.
//!
//! Every cross term factors through `a_i` and `b_i`; no pixel needs an M x M or K x K matrix.

use gonio::lighting::{CoefficientPrior, Moments, ScaleMixture};
use puruspe::ln_gamma;

use super::ensemble::AllMoments;
use super::{Problem, VariationalParameters};

/// Moments of q, and the expectations under q that determine the residual of eq. 9 and the cost.
#[derive(Clone, Debug)]
pub struct Expectations {
    pub(crate) moments: AllMoments,
    /// `a_ik` (rows x K).
    pub(crate) a: Vec<f64>,
    /// `b_im` (rows x M).
    pub(crate) b: Vec<f64>,
    pub(crate) y: Vec<f64>,
    /// `sum_i b_im^2`.
    pub(crate) b_square: Vec<f64>,
    /// `sum_i a_ik^2`.
    pub(crate) a_square: Vec<f64>,
    pub(crate) sums: Sums,
}

/// Sums over the pixels through which the cost depends on the image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums {
    /// `sum_i I_i y_i`.
    pub(crate) iy: f64,
    /// `sum_i Q_i`.
    pub(crate) q: f64,
}

impl Sums {
    /// `E`, the expected squared residual over all pixels, for these moments of the exposure.
    pub(crate) fn residual(self, problem: &Problem<'_>, g: &Moments) -> f64 {
        (problem.energy - 2.0 * g.mean * self.iy + g.mean_square() * self.q).max(0.0)
    }

    /// `Phi_5` that minimises the cost given all else: `log((b_0 + E/2) / a_p)`.
    pub(crate) fn best_log_noise(self, problem: &Problem<'_>, g: &Moments) -> f64 {
        ((problem.hyper.noise_rate + 0.5 * self.residual(problem, g)) / problem.noise_shape()).ln()
    }

    /// `C_KL` at these moments.
    pub(crate) fn cost(self, problem: &Problem<'_>, moments: &AllMoments) -> f64 {
        let reflectance: f64 =
            moments.f.iter().zip(&problem.rates).map(|(f, rate)| f.mean_log - rate.ln() + rate * f.mean).sum();
        let light: f64 =
            problem.light.iter().zip(&moments.l[1..]).map(|(prior, l)| l.mean_log - expected_log_prior(prior, l)).sum();
        let (g, rate) = (&moments.g, problem.hyper.exposure_rate);
        let exposure = g.mean_log - rate.ln() + rate * g.mean;
        reflectance + light + exposure + self.noise_cost(problem, moments)
    }

    /// Terms of the noise: `KL(q(b) || p(b)) - <log p(I | ...)>`. With `a_p = a_0 + N/2` fixed,
    /// digamma cancels.
    fn noise_cost(self, problem: &Problem<'_>, moments: &AllMoments) -> f64 {
        let (a0, b0, a) = (problem.hyper.noise_shape, problem.hyper.noise_rate, problem.noise_shape());
        let precision = moments.precision;
        let rate = a / precision;
        let half_n = 0.5 * problem.pixels;
        let divergence = ln_gamma(a0) - ln_gamma(a) + a * rate.ln() - a0 * b0.ln() + precision * (b0 - rate);
        let likelihood = half_n * std::f64::consts::TAU.ln() + 0.5 * precision * self.residual(problem, &moments.g);
        divergence + likelihood
    }
}

/// Gradient and diagonal curvature of the expected log likelihood in the light, without the factor
/// `<sigma^-2>`.
pub(crate) struct DataGradient {
    /// `sum_i { <g> I_i b_im - <g^2> [b_im y_i + sum_k vf_k A_imk a_ik] }`.
    pub(crate) light: Vec<f64>,
    /// `S_m = sum_i [b_im^2 + sum_k vf_k A_imk^2]`.
    pub(crate) curvature: Vec<f64>,
}

impl Expectations {
    /// Computes the expectations under the moments of an ensemble, in two passes over the operator.
    pub fn new(problem: &Problem<'_>, ensemble: &VariationalParameters) -> Self {
        Self::of_moments(problem, ensemble.moments(problem))
    }

    fn of_moments(problem: &Problem<'_>, moments: AllMoments) -> Self {
        let a = problem.bilinear.under_light(&moments.l_means());
        let b = problem.bilinear.of_reflectance(&moments.f_means());
        Self::with(problem, moments, a, b)
    }

    /// Recomputes the expectations under the moments of another ensemble: one pass for the means of
    /// light, one for those of reflectance, and none for means that have not changed.
    pub(crate) fn after(self, problem: &Problem<'_>, ensemble: &VariationalParameters) -> Self {
        let moments = ensemble.moments(problem);
        let (mf, ml) = (moments.f_means(), moments.l_means());
        let a = if ml == self.moments.l_means() { self.a } else { problem.bilinear.under_light(&ml) };
        if mf == self.moments.f_means() {
            return Self::with_squares(problem, moments, a, self.b, self.b_square);
        }
        Self::with(problem, moments, a, problem.bilinear.of_reflectance(&mf))
    }

    fn with(problem: &Problem<'_>, moments: AllMoments, a: Vec<f64>, b: Vec<f64>) -> Self {
        let b_square = columns_squared(&b, problem.m());
        Self::with_squares(problem, moments, a, b, b_square)
    }

    fn with_squares(problem: &Problem<'_>, moments: AllMoments, a: Vec<f64>, b: Vec<f64>, b_square: Vec<f64>) -> Self {
        let (op, k, m) = (problem.bilinear, problem.k(), problem.m());
        let y: Vec<f64> = a.chunks_exact(k).map(|a| a.iter().zip(&moments.f).map(|(a, f)| a * f.mean).sum()).collect();
        let a_square = columns_squared(&a, k);
        let iy = problem.target.iter().zip(&y).map(|(i, y)| i * y).sum();
        let mut q: f64 = y.iter().map(|y| y * y).sum();
        q += b_square.iter().zip(&moments.l).map(|(s, l)| s * l.variance).sum::<f64>();
        q += a_square.iter().zip(&moments.f).map(|(s, f)| s * f.variance).sum::<f64>();
        for (w, f) in op.squares().chunks_exact(m).zip(&moments.f) {
            q += f.variance * w.iter().zip(&moments.l).map(|(w, l)| w * l.variance).sum::<f64>();
        }
        Self { moments, a, b, y, b_square, a_square, sums: Sums { iy, q } }
    }

    /// `C_KL` of eq. 11. Its difference to minus the log evidence is the divergence of q from the
    /// posterior.
    pub fn cost(&self, problem: &Problem<'_>) -> f64 {
        self.sums.cost(problem, &self.moments)
    }

    /// `Phi*`: every parameter updated from the present state (Algorithm 1, "Update").
    pub fn update(&self, problem: &Problem<'_>, ensemble: &VariationalParameters) -> VariationalParameters {
        let (k_count, m_count) = (problem.k(), problem.m());
        let mut next = ensemble.clone();
        let AllMoments { f, l, g, precision } = &self.moments;
        let g2 = g.mean_square();
        let (pull, weights) = (self.pull(problem), self.weights(problem));
        let with_b = problem.bilinear.contract_light(&self.b);
        for (k, f) in f.iter().enumerate() {
            let row = k * m_count..(k + 1) * m_count;
            let s = self.a_square[k] + dot_variance(&problem.bilinear.squares()[row.clone()], l);
            let along: f64 = weights.iter().zip(self.a.iter().skip(k).step_by(k_count)).map(|(w, a)| w * a).sum();
            let natural = precision * (along - g2 * dot_variance(&with_b[row], l) + g2 * s * f.mean);
            next.set_f(k, natural - problem.rates[k], precision * g2 * s);
        }
        for (m, l) in l.iter().enumerate().skip(1) {
            let (prior_natural, prior_precision) = prior_pull(problem.light[m - 1], l);
            let natural = precision * (pull.light[m] + g2 * pull.curvature[m] * l.mean) + prior_natural;
            next.set_l(m, natural, precision * g2 * pull.curvature[m] + prior_precision);
        }
        next.set_g(precision * self.sums.iy - problem.hyper.exposure_rate, precision * self.sums.q);
        next.set_log_noise(self.sums.best_log_noise(problem, g));
        next
    }

    /// Gradient and curvature of the data term in the light, given all else: one pass over the
    /// operator.
    pub(crate) fn pull(&self, problem: &Problem<'_>) -> DataGradient {
        let k_count = problem.k();
        let AllMoments { f, g, .. } = &self.moments;
        let weights = self.weights(problem);
        // sum_k A_imk ( f_k (<g> I_i - <g^2> y_i) - <g^2> vf_k a_ik )
        let g2 = g.mean_square();
        let mut x = self.a.clone();
        for (x, w) in x.chunks_exact_mut(k_count).zip(&weights) {
            x.iter_mut().zip(f).for_each(|(x, f)| *x = f.mean * w - g2 * f.variance * *x);
        }
        let light = problem.bilinear.light_adjoint(&x);
        DataGradient { light, curvature: self.stiffness(problem) }
    }

    /// `S_m` of [`DataGradient`], without a pass over the operator.
    pub(crate) fn stiffness(&self, problem: &Problem<'_>) -> Vec<f64> {
        let mut stiffness = self.b_square.clone();
        for (f, squares) in self.moments.f.iter().zip(problem.bilinear.squares().chunks_exact(problem.m())) {
            stiffness.iter_mut().zip(squares).for_each(|(s, w)| *s += f.variance * w);
        }
        stiffness
    }

    /// `<g> I_i - <g^2> y_i`.
    fn weights(&self, problem: &Problem<'_>) -> Vec<f64> {
        let g = &self.moments.g;
        problem.target.iter().zip(&self.y).map(|(i, y)| g.mean * i - g.mean_square() * y).collect()
    }
}

fn dot_variance(x: &[f64], l: &[Moments]) -> f64 {
    x.iter().zip(l).map(|(x, l)| x * l.variance).sum()
}

/// Sum of squares of each column of a row-major matrix.
pub(crate) fn columns_squared(x: &[f64], columns: usize) -> Vec<f64> {
    let mut sum = vec![0.0; columns];
    for row in x.chunks_exact(columns) {
        for (s, x) in sum.iter_mut().zip(row) {
            *s += x * x;
        }
    }
    sum
}

/// Responsibilities `r_n` of the components for a coefficient of expected square `<l^2>`.
fn responsibilities(mixture: &ScaleMixture, mean_square: f64) -> impl Iterator<Item = f64> + '_ {
    let top = mixture.log_joint(mean_square).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = mixture.log_joint(mean_square).map(|j| (j - top).exp()).sum();
    mixture.log_joint(mean_square).map(move |j| (j - top).exp() / total)
}

/// `sum_n r_n / s_n^2` for a coefficient of expected square `<l^2>`.
pub(crate) fn expected_precision(mixture: &ScaleMixture, mean_square: f64) -> f64 {
    responsibilities(mixture, mean_square).zip(&mixture.variances).map(|(r, v)| r / v).sum()
}

/// Contribution of the prior to `u/w` and `1/w` of a light coefficient.
pub(crate) fn prior_pull(prior: &CoefficientPrior, l: &Moments) -> (f64, f64) {
    match prior {
        CoefficientPrior::Mixture(mixture) => (0.0, expected_precision(mixture, l.mean_square())),
        CoefficientPrior::Rectified(p) => (p.location / p.variance, 1.0 / p.variance),
    }
}

/// `<log p(l_m)>`, for mixtures its variational bound with the optimal responsibilities:
/// `-sum_n r_n (log r_n - log pi_n + log(2 pi s_n^2)/2 + <l^2>/(2 s_n^2))
/// = log sum_n pi_n N(<l^2>; 0, s_n^2)`.
pub(crate) fn expected_log_prior(prior: &CoefficientPrior, l: &Moments) -> f64 {
    match prior {
        CoefficientPrior::Mixture(mixture) => mixture.log_density_of_square(l.mean_square()),
        CoefficientPrior::Rectified(p) => {
            let square = l.variance + (l.mean - p.location).powi(2);
            -0.5 * ((std::f64::consts::TAU * p.variance).ln() + square / p.variance) - p.log_mass()
        }
    }
}
