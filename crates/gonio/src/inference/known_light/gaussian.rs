//! Gaussian posterior of the material without its scale, for draws, storage and products.

use faer::Mat;
use gonio_linalg::{Cholesky, product};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::learnt_likelihood::EncoderLikelihood;
use super::space::ParameterSpace;
use crate::parallel;
use crate::reflectance::{BivariateTable, LatentSpace};

/// Gaussian posterior of the coefficients of the logarithm of reflectance: first those of the
/// principal axes of the prior, of unit variance a priori, then those of splines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gaussian {
    mean: Vec<f64>,
    /// Lower triangle of the inverse covariance, row by row.
    precision: Vec<f64>,
    /// Prior standard deviation of the spline coefficients.
    deviation: f64,
}

impl Gaussian {
    /// Returns the marginal of the first `count` coefficients.
    ///
    /// `curvature` is the factor of the inverse covariance of all coefficients. Returns `None` if
    /// the marginal is not positive definite.
    pub(super) fn marginal(mean: &[f64], curvature: &Cholesky, count: usize, deviation: f64) -> Option<Self> {
        // The covariance of the marginal is the leading block of that of all coefficients.
        let inverse = curvature.inverse_of_lower();
        let part = inverse.submatrix(0, 0, mean.len(), count);
        let covariance = product(part.transpose(), part);
        let factor = Cholesky::new(covariance)?;
        let inverse = factor.inverse_of_lower();
        let precision = product(inverse.transpose(), inverse.as_ref());
        Some(Self { mean: mean[..count].to_vec(), precision: lower(&precision), deviation })
    }

    /// Whether the number of coefficients matches `coordinates`, and all numbers are valid.
    pub(crate) fn is_of(&self, coordinates: &LatentSpace) -> bool {
        let n = self.mean.len();
        n == ParameterSpace::free(coordinates.axes.len())
            && self.precision.len() == n * (n + 1) / 2
            && self.deviation > 0.0
            && self.mean.iter().chain(&self.precision).all(|v| v.is_finite())
    }

    /// Prior standard deviation of the spline coefficients.
    pub(crate) fn deviation(&self) -> f64 {
        self.deviation
    }

    fn matrix(&self) -> Mat<f64> {
        let n = self.mean.len();
        Mat::from_fn(n, n, |i, j| {
            let (i, j) = (i.max(j), i.min(j));
            self.precision[i * (i + 1) / 2 + j]
        })
    }

    /// Returns the prior precisions, with `deviation` for the splines.
    fn prior(&self, axes: usize, deviation: f64) -> impl Iterator<Item = f64> {
        (0..self.mean.len()).map(move |i| if i < axes { 1.0 } else { deviation.powi(-2) })
    }

    fn axes(&self) -> usize {
        self.mean.len() - ParameterSpace::free(0)
    }

    /// Returns inverse covariance, and its product with the mean, of all likelihoods and one prior.
    fn sums(all: &[&Self], deviation: f64) -> (Mat<f64>, Vec<f64>) {
        let n = all[0].mean.len();
        let (mut precision, mut information) = (Mat::zeros(n, n), vec![0.0; n]);
        for one in all {
            let own = one.matrix();
            information.iter_mut().zip(times(&own, &one.mean)).for_each(|(sum, of_one)| *sum += of_one);
            precision += own;
            one.prior(one.axes(), one.deviation).enumerate().for_each(|(i, p)| precision[(i, i)] -= p);
        }
        all[0].prior(all[0].axes(), deviation).enumerate().for_each(|(i, p)| precision[(i, i)] += p);
        (precision, information)
    }

    /// Returns the posterior with a hint as an additional likelihood.
    ///
    /// Returns `None` if it is not positive definite.
    ///
    /// # Panics
    /// If the hint has another number of axes.
    pub(crate) fn informed_by(&self, hint: &EncoderLikelihood) -> Option<Self> {
        assert_eq!(hint.vector.len(), self.axes());
        let mut precision = self.matrix();
        let mut information = times(&precision, &self.mean);
        for (i, of_hint) in hint.vector.iter().enumerate() {
            information[i] += of_hint;
            (0..hint.vector.len()).for_each(|j| precision[(i, j)] += hint.information[(i, j)]);
        }
        let mean = Cholesky::new(precision.clone())?.solve(&information);
        Some(Self { mean, precision: lower(&precision), ..*self })
    }

    /// Posterior given several photographs: the product of their likelihoods with one prior, whose
    /// splines have the largest standard deviation of all.
    pub(crate) fn product(all: &[&Self]) -> Option<Self> {
        let deviation = all.iter().map(|one| one.deviation).fold(0.0, f64::max);
        let (precision, information) = Self::sums(all, deviation);
        let mean = Cholesky::new(precision.clone())?.solve(&information);
        Some(Self { mean, precision: lower(&precision), deviation })
    }

    /// Returns the logarithm of the mean of the product of likelihoods over the prior.
    ///
    /// The result omits a constant, which is the sum of one constant for each likelihood.
    pub(crate) fn log_evidence(all: &[&Self], deviation: f64) -> Option<f64> {
        let (precision, information) = Self::sums(all, deviation);
        let factor = Cholesky::new(precision)?;
        let explained: f64 = factor.solve(&information).iter().zip(&information).map(|(m, h)| m * h).sum();
        let of_posterior: f64 = (0..information.len()).map(|i| 2.0 * factor.lower()[(i, i)].ln()).sum();
        let of_prior: f64 = all[0].prior(all[0].axes(), deviation).map(f64::ln).sum();
        Some(0.5 * (explained + of_prior - of_posterior))
    }

    /// Returns the most probable table, with a normal albedo of one.
    pub(crate) fn table(&self, coordinates: &LatentSpace) -> BivariateTable {
        ParameterSpace::new(coordinates).table(&self.whole(&self.mean)).with_normal_albedo(1.0).0
    }

    /// Returns the mean in the coordinates of the prior.
    pub(crate) fn coordinates(&self) -> &[f64] {
        &self.mean[..self.axes()]
    }

    /// Draws tables with a normal albedo of one; the same seed gives the same draws.
    ///
    /// Returns `None` if the inverse covariance is not positive definite.
    pub(crate) fn draws(&self, coordinates: &LatentSpace, count: usize, seed: u64) -> Option<Vec<BivariateTable>> {
        let (space, factor) = (ParameterSpace::new(coordinates), Cholesky::new(self.matrix())?);
        let mut rng = Pcg64::seed_from_u64(seed);
        let white: Vec<Vec<f64>> =
            (0..count).map(|_| self.mean.iter().map(|_| StandardNormal.sample(&mut rng)).collect()).collect();
        let table = |white: &Vec<f64>| {
            let step = factor.colour(white);
            let drawn: Vec<f64> = self.mean.iter().zip(&step).map(|(x, d)| x + d).collect();
            space.table(&self.whole(&drawn)).with_normal_albedo(1.0).0
        };
        Some(parallel::map(&white, table))
    }

    /// Returns all coefficients of the space, with zero for the scale.
    fn whole(&self, coefficients: &[f64]) -> Vec<f64> {
        coefficients.iter().copied().chain([0.0]).collect()
    }
}

/// Product of a square matrix with a vector.
pub(super) fn times(matrix: &Mat<f64>, vector: &[f64]) -> Vec<f64> {
    (0..vector.len()).map(|i| vector.iter().enumerate().map(|(j, x)| matrix[(i, j)] * x).sum()).collect()
}

/// Lower triangle of a symmetric matrix, row by row.
fn lower(matrix: &Mat<f64>) -> Vec<f64> {
    (0..matrix.nrows()).flat_map(|i| (0..=i).map(move |j| matrix[(i, j)])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian posterior with the likelihood `N(mean; precision)` on the first axis alone.
    fn observed(count: usize, mean: f64, precision: f64) -> Gaussian {
        let n = ParameterSpace::free(count);
        let own = Mat::from_fn(n, n, |i, j| match (i == j, i) {
            (false, _) => 0.0,
            (true, 0) => 1.0 + precision,
            (true, i) => {
                if i < count {
                    1.0
                } else {
                    25.0
                }
            }
        });
        let mut coordinates = vec![0.0; n];
        coordinates[0] = precision * mean / (1.0 + precision);
        Gaussian { mean: coordinates, precision: lower(&own), deviation: 0.2 }
    }

    #[test]
    fn products_follow_the_rule_of_gaussians() {
        let (a, b) = (observed(3, 1.0, 4.0), observed(3, 2.0, 5.0));
        let both = Gaussian::product(&[&a, &b]).unwrap();
        assert!((both.mean[0] - (4.0 + 10.0) / 10.0).abs() < 1e-12 && both.mean[1] == 0.0, "{:?}", both.mean);
        assert!((both.precision[0] - 10.0).abs() < 1e-12);
    }

    /// A hint acts like the likelihood of another photograph, and hardly moves a precise posterior.
    #[test]
    fn a_hint_acts_as_a_likelihood() {
        let information = Mat::from_fn(3, 3, |i, j| if i == 0 && j == 0 { 5.0 } else { 0.0 });
        let hint = EncoderLikelihood { information, vector: vec![5.0 * 2.0, 0.0, 0.0] };
        let (a, b) = (observed(3, 1.0, 4.0), observed(3, 2.0, 5.0));
        let (informed, both) = (a.informed_by(&hint).unwrap(), Gaussian::product(&[&a, &b]).unwrap());
        let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(same(&informed.mean, &both.mean) && same(&informed.precision, &both.precision));
        let sharp = observed(3, 1.0, 1e4);
        assert!((sharp.informed_by(&hint).unwrap().mean[0] - sharp.mean[0]).abs() < 1e-3);
    }

    /// The ratio is the density of one mean under the prediction from the other, over that under
    /// the prior.
    #[test]
    fn log_odds_match_the_predictive_densities() {
        let deviation = 0.2;
        for second in [0.9, 3.0] {
            let (a, b) = (observed(3, 1.0, 400.0), observed(3, second, 500.0));
            let evidence = |some: &[&Gaussian]| Gaussian::log_evidence(some, deviation).unwrap();
            let got = evidence(&[&a, &b]) - evidence(&[&a]) - evidence(&[&b]);
            let normal = |x: f64, variance: f64| -0.5 * (x * x / variance + (std::f64::consts::TAU * variance).ln());
            let predicted = (400.0 / 401.0, 1.0 / 401.0 + 1.0 / 500.0);
            let want = normal(second - predicted.0, predicted.1) - normal(second, 1.0 + 1.0 / 500.0);
            assert!((got - want).abs() < 1e-6 * (1.0 + want.abs()), "{got} {want}");
        }
    }
}
