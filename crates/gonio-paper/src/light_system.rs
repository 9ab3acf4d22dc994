//! Linear system of the light given all other unknowns.

use faer::{Accum, Mat, MatRef};
use gonio::lighting::{CoefficientPrior, Moments};
use gonio_linalg::{Cholesky, axpy, dispatch, multiply};

use super::ensemble::AllMoments;
use super::expectations::{columns_squared, expected_precision, prior_pull};
use super::grams::{Grams, symmetric_times};
use super::{Problem, VariationalParameters};

/// Distance from its threshold, in standard deviations, above which a rectified coefficient is
/// treated as a Gaussian one.
const INSIDE: f64 = 6.0;

/// Linear system of the light given all other unknowns: `C_KL` is quadratic in the means of the
/// light when the responsibilities are fixed.
pub(crate) struct LightSystem {
    /// `<b><g^2> ( B'B + sum_k vf_k A_k' A_k ) + diag d`, on and below the diagonal.
    curvature: Mat<f64>,
    /// `<b><g^2> S_m`, the contribution of the image to the diagonal of the curvature.
    image_curvature: Vec<f64>,
    /// `<b><g> B'I`, plus the pull of rectified priors.
    target: Vec<f64>,
    /// `d`: `sum_n r_n / s_n^2` for mixtures, `1 / s^2` for rectified Gaussians.
    priors: Vec<f64>,
    /// `B` (rows x M).
    b: Vec<f64>,
    /// See [`Self::is_excluded`].
    excluded: Vec<bool>,
    /// See [`Self::factor`].
    factor: Option<Cholesky>,
}

impl LightSystem {
    pub(crate) fn new(problem: &Problem<'_>, moments: &AllMoments, grams: &Grams) -> Self {
        let AllMoments { f, l, g, precision } = moments;
        let b = problem.bilinear.of_reflectance(&moments.f_means());
        let scale = precision * g.mean_square();
        let mut image_curvature = columns_squared(&b, problem.m());
        for (f, squares) in f.iter().zip(problem.bilinear.squares().chunks_exact(problem.m())) {
            image_curvature.iter_mut().zip(squares).for_each(|(s, w)| *s += f.variance * w);
        }
        image_curvature.iter_mut().for_each(|s| *s *= scale);
        let mut target = vec![0.0; problem.m()];
        dispatch(|| {
            for (row, i) in b.chunks_exact(problem.m()).zip(&problem.target) {
                axpy(precision * g.mean * i, row, &mut target);
            }
        });
        let mut priors = vec![0.0; problem.m()];
        for (m, prior) in (1..).zip(&problem.light) {
            match prior {
                CoefficientPrior::Mixture(mixture) => priors[m] = expected_precision(mixture, l[m].mean_square()),
                CoefficientPrior::Rectified(p) => {
                    priors[m] = 1.0 / p.variance;
                    target[m] += p.location / p.variance;
                }
            }
        }
        let curvature = grams.light_curvature(&b, f, scale, &priors);
        let means = moments.l_means();
        let mut system = Self { curvature, image_curvature, target, priors, b, excluded: Vec::new(), factor: None };
        system.excluded =
            (0..problem.m()).map(|m| m == 0 || system.is_cut(problem, m, means[m], l[m].variance)).collect();
        system.refactor();
        system
    }

    /// Whether the threshold of its prior cuts a rectified coefficient.
    fn is_cut(&self, problem: &Problem<'_>, m: usize, mean: f64, variance: f64) -> bool {
        match problem.light[m - 1] {
            CoefficientPrior::Mixture(_) => false,
            CoefficientPrior::Rectified(p) => mean - p.threshold <= INSIDE * variance.sqrt(),
        }
    }

    fn refactor(&mut self) {
        let mut system = self.curvature.clone();
        for m in (0..self.excluded.len()).filter(|&m| self.excluded[m]) {
            system.row_mut(m).fill(0.0);
            system.col_mut(m).fill(0.0);
            system[(m, m)] = 1.0;
        }
        self.factor = Cholesky::new(system);
    }

    /// Minus the gradient of the cost in the means.
    fn residual(&self, means: &[f64]) -> Vec<f64> {
        let present = symmetric_times(&self.curvature, means);
        self.target.iter().zip(&present).map(|(t, p)| t - p).collect()
    }

    /// Minimises over the light given all else: solves for the means of all coefficients at once,
    ///
    /// ```text
    /// ( <b><g^2> [ B'B + sum_k vf_k A_k'A_k ] + diag d ) l = <b><g> B'I
    /// ```
    ///
    /// and computes their precisions `1/w`. Coefficients that are alone are updated one after the
    /// other by `alone(m, 1/w, u/w)`, which receives the contributions of the image and returns the
    /// mean.
    pub(crate) fn minimise(
        &mut self,
        problem: &Problem<'_>,
        moments: &AllMoments,
        mut alone: impl FnMut(usize, f64, f64) -> f64,
    ) -> (Vec<f64>, Vec<f64>) {
        let precisions: Vec<f64> = self.image_curvature.iter().zip(&self.priors).map(|(s, d)| s + d).collect();
        let start = moments.l_means();
        let mut means = self.solved(&start);
        let cut = |m: &usize| !self.excluded[*m] && self.is_cut(problem, *m, means[*m], 1.0 / precisions[*m]);
        let cut: Vec<usize> = (1..means.len()).filter(cut).collect();
        if !cut.is_empty() {
            cut.into_iter().for_each(|m| self.excluded[m] = true);
            self.refactor();
            means = self.solved(&start);
        }
        for m in (1..means.len()).filter(|&m| self.excluded[m]) {
            let CoefficientPrior::Rectified(p) = problem.light[m - 1] else { continue };
            let push = self.residual(&means)[m] + precisions[m] * means[m] - p.location / p.variance;
            means[m] = alone(m, self.image_curvature[m], push);
        }
        (means, precisions)
    }

    /// Returns the means that solve the system.
    ///
    /// Means of coefficients that are alone stay unchanged; without a factor, all means do.
    fn solved(&self, from: &[f64]) -> Vec<f64> {
        let Some(factor) = &self.factor else { return from.to_vec() };
        let mut residual = self.residual(from);
        residual.iter_mut().zip(&self.excluded).filter(|(_, alone)| **alone).for_each(|(r, _)| *r = 0.0);
        from.iter().zip(factor.solve(&residual)).map(|(x, d)| x + d).collect()
    }

    /// Returns the Cholesky factor of the curvature among the coefficients that are not alone.
    ///
    /// Returns `None` if round-off is larger than every prior precision.
    pub(super) fn factor(&self) -> Option<&Cholesky> {
        self.factor.as_ref()
    }

    /// Whether a coefficient is left out of the system: DC, and rectified ones cut by their
    /// threshold.
    pub(super) fn is_excluded(&self, m: usize) -> bool {
        self.excluded[m]
    }

    /// Pull of the prior on a coefficient, `d_m (<l_m> - location)`, and `<b><g> B'I`, which image
    /// and prior together balance at the optimum.
    pub(super) fn balance(&self, problem: &Problem<'_>, m: usize, mean: f64) -> (f64, f64) {
        let location = match problem.light[m - 1] {
            CoefficientPrior::Mixture(_) => 0.0,
            CoefficientPrior::Rectified(p) => p.location,
        };
        (self.priors[m] * (mean - location), self.target[m] - self.priors[m] * location)
    }

    /// `scale B'a` (M x K).
    pub(super) fn images(&self, a: &[f64], k: usize, scale: f64) -> Mat<f64> {
        let (rows, m) = (a.len() / k, self.target.len());
        let mut out = Mat::zeros(m, k);
        let (b, a) = (MatRef::from_row_major_slice(&self.b, rows, m), MatRef::from_row_major_slice(a, rows, k));
        multiply(out.as_mut(), Accum::Replace, b.transpose(), a, scale);
        out
    }
}

/// Updates a single light coefficient exactly, responsibilities included, starting from its present
/// moments. The image contributes the precision `image_curvature` and the pull `push`.
pub(crate) fn minimise_coefficient(
    problem: &Problem<'_>,
    ensemble: &mut VariationalParameters,
    m: usize,
    (image_curvature, push): (f64, f64),
    mut moments: Moments,
) -> Moments {
    // The responsibilities depend on the coefficient's own moments. The fixed-point iteration never
    // raises the cost.
    for _ in 0..200 {
        let (natural, prior) = prior_pull(problem.light[m - 1], &moments);
        ensemble.set_l(m, push + natural, image_curvature + prior);
        let next = ensemble.l_moments(m, problem.light[m - 1]);
        let has_converged = (next.mean - moments.mean).abs() + (next.variance - moments.variance).abs() < 1e-16;
        moments = next;
        if has_converged {
            break;
        }
    }
    moments
}
