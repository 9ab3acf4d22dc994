//! Error model of the image: noise, texture and model error.

use faer::Mat;
use glam::DVec3;
use gonio_linalg::{Cholesky, eigenvectors};

use super::thinned;
use crate::statistics::median;

/// Distance of normals on the unit sphere over which the correlation of the discrepancy falls to
/// 1/e: 22 degrees, as measured on training materials in training lights (docs/trials.md).
const LENGTH: f64 = 0.38;

/// Smallest standard deviation of the noise.
const MIN_NOISE: f64 = 0.005;

/// Ratio of successive candidate standard deviations, and their number.
const LADDER: (f64, usize) = (1.25, 22);

/// Largest number of observations for the estimation of the standard deviations.
const SAMPLE: usize = 300;

/// Degrees of freedom of Student's distribution of the noise. Errors from shadows, reflections of
/// the surroundings and specks have heavier tails than a Gaussian.
const FREEDOM: f64 = 4.0;

/// Limit to which the estimation clips residuals, as a multiple of their median absolute value.
pub(super) const CUT: f64 = 4.0;

/// Error of the logarithm of the image: a smooth function of the normal, of exponential
/// correlation (the *discrepancy* of the model, Kennedy & O'Hagan 2001), plus independent noise
/// with heavy tails.
#[derive(Clone, Debug)]
pub(super) struct ErrorModel {
    /// Correlation of the discrepancy (N x N).
    correlation: Mat<f64>,
    /// Inverse variance of each value relative to the others.
    trust: Vec<f64>,
    /// Weights of Student's distribution.
    weights: Vec<f64>,
    /// Smallest standard deviation of the discrepancy.
    min_discrepancy: f64,
    /// Standard deviations of noise and discrepancy.
    pub(super) noise: f64,
    pub(super) discrepancy: f64,
}

impl ErrorModel {
    /// Creates a model with large initial errors. Values of low `trust` (0 to 1) have more noise.
    pub(super) fn new(normals: &[DVec3], trust: Vec<f64>, min_discrepancy: f64) -> Self {
        let n = normals.len();
        let correlation = Mat::from_fn(n, n, |i, j| (-normals[i].distance(normals[j]) / LENGTH).exp());
        Self { correlation, weights: vec![1.0; n], trust, min_discrepancy, noise: 0.1, discrepancy: 0.1 }
    }

    /// Returns the model of a subset of the rows.
    pub(super) fn of_rows(&self, rows: &[usize]) -> Self {
        let some = |values: &[f64]| rows.iter().map(|&at| values[at]).collect();
        Self {
            correlation: Mat::from_fn(rows.len(), rows.len(), |i, j| self.correlation[(rows[i], rows[j])]),
            trust: some(&self.trust),
            weights: some(&self.weights),
            ..*self
        }
    }

    /// Returns the factorised covariance.
    pub(super) fn factor(&self) -> Option<Cholesky> {
        let (n, square) = (self.trust.len(), self.discrepancy.powi(2));
        Cholesky::new(Mat::from_fn(n, n, |i, j| {
            let own = if i == j { self.variance(i) } else { 0.0 };
            square * self.correlation[(i, j)] + own
        }))
    }

    fn variance(&self, at: usize) -> f64 {
        self.noise.powi(2) / (self.weights[at] * self.trust[at])
    }

    /// Estimates both standard deviations from residuals by maximum likelihood.
    ///
    /// Uses an evenly spaced sample of the observations.
    pub(super) fn estimate(&mut self, residuals: &[f64]) {
        let n = residuals.len();
        let sample = thinned(n, SAMPLE);
        let cut = CUT * median(residuals.iter().map(|r| r.abs())).unwrap_or(0.0).max(MIN_NOISE);
        let m = sample.len();
        let correlation = Mat::from_fn(m, m, |i, j| self.correlation[(sample[i], sample[j])]);
        let (values, vectors) = eigenvectors(correlation.as_ref());
        let squares: Vec<f64> = (0..m)
            .map(|k| sample.iter().enumerate().map(|(i, &at)| vectors[(i, k)] * residuals[at].clamp(-cut, cut)).sum())
            .map(|x: f64| x * x)
            .collect();
        let cost = |noise: f64, discrepancy: f64| -> f64 {
            let variance = |value: &f64| discrepancy.powi(2) * value.max(0.0) + noise.powi(2);
            values.iter().zip(&squares).map(|(value, x)| x / variance(value) + variance(value).ln()).sum()
        };
        let ladder = |least: f64| (0..LADDER.1).map(move |i| least * LADDER.0.powi(i as i32));
        let pairs = ladder(MIN_NOISE).flat_map(|noise| ladder(self.min_discrepancy).map(move |d| (noise, d)));
        let best = pairs.min_by(|a, b| cost(a.0, a.1).total_cmp(&cost(b.0, b.1)));
        (self.noise, self.discrepancy) = best.expect("the ladder is not empty");
    }

    /// Updates the weights of Student's distribution from residuals.
    ///
    /// `factor` is the factorised covariance. A weight depends on the part of the residual that is
    /// noise rather than discrepancy.
    pub(super) fn reweigh(&mut self, residuals: &[f64], factor: &Cholesky) {
        let solved = factor.solve(residuals);
        let weights: Vec<f64> = (0..residuals.len())
            .map(|i| {
                let relative = (self.variance(i) * solved[i]).powi(2) * self.trust[i] / self.noise.powi(2);
                (FREEDOM + 1.0) / (FREEDOM + relative)
            })
            .collect();
        self.weights = weights;
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::sphere::fibonacci_hemisphere;

    /// Separates noise and discrepancy drawn from the model.
    #[test]
    fn planted_errors_are_recovered() {
        let normals: Vec<DVec3> = fibonacci_hemisphere(600).collect();
        let mut rng = Pcg64::seed_from_u64(2);
        for (noise, discrepancy) in [(0.06, 0.15), (0.2, 0.06)] {
            let mut model = ErrorModel::new(&normals, vec![1.0; 600], 0.045);
            (model.noise, model.discrepancy) = (1e-6, discrepancy);
            let factor = model.factor().unwrap();
            let white: Vec<f64> = (0..600).map(|_| StandardNormal.sample(&mut rng)).collect();
            let residual: Vec<f64> = (0..600)
                .map(|i| {
                    let smooth: f64 = (0..=i).map(|j| factor.lower()[(i, j)] * white[j]).sum();
                    let draw: f64 = StandardNormal.sample(&mut rng);
                    smooth + noise * draw
                })
                .collect();
            model.estimate(&residual);
            assert!((model.noise / noise).ln().abs() < 0.3, "{} {noise}", model.noise);
            assert!((model.discrepancy / discrepancy).ln().abs() < 0.4, "{} {discrepancy}", model.discrepancy);
        }
    }

    #[test]
    fn an_outlier_loses_its_weight() {
        let normals: Vec<DVec3> = fibonacci_hemisphere(200).collect();
        let mut model = ErrorModel::new(&normals, vec![1.0; 200], 0.045);
        (model.noise, model.discrepancy) = (0.02, 0.05);
        let mut residuals: Vec<f64> = (0..200).map(|i| 0.01 * (f64::from(i) * 1.7).sin()).collect();
        residuals[50] = -1.0;
        model.reweigh(&residuals, &model.factor().unwrap());
        assert!(model.weights[50] < 0.05, "{}", model.weights[50]);
        let least = model.weights.iter().enumerate().filter(|(i, _)| *i != 50).map(|w| *w.1).fold(2.0, f64::min);
        // The smooth part follows the outlier slightly, so its neighbours lose some weight.
        assert!(least > 0.25 && median(model.weights.clone()) > Some(1.1), "{least}");
    }
}
