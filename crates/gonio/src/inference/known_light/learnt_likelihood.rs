//! Learnt posterior of the same photograph, as a likelihood on the axes of the prior.
//!
//! The encoder was trained on photographs with texture, specks and wrong normals. The error model
//! of [`fit`](super::fit) describes these only by their magnitude, so it can mistake a bright patch
//! for a highlight. The errors of both are correlated, because they use the same photograph; the
//! encoder therefore has half weight, like a second photograph in
//! [`Likelihood`](crate::inference::Likelihood). For a clean photograph under a correct light, its
//! effect is small (docs/trials.md).

use faer::Mat;
use gonio_linalg::{Cholesky, eigenvectors, product};

use super::gaussian::times;
use crate::inference::learnt::LearntPosterior;

/// Share of the information that is used.
const POWER: f64 = 0.5;

/// Variance that is added to each coordinate. The weights of a finite number of materials can
/// concentrate on one of them, although the coordinates are less certain.
const MIN_VARIANCE: f64 = 0.02;

/// Gaussian likelihood of the coordinates of a material, up to a constant:
/// `exp(b' z - z' A z / 2)`.
#[derive(Clone, Debug)]
pub(crate) struct EncoderLikelihood {
    /// `A`, positive semidefinite.
    pub(super) information: Mat<f64>,
    /// `b`.
    pub(super) vector: Vec<f64>,
}

impl EncoderLikelihood {
    /// Computes the likelihood from an embedding of the photograph.
    ///
    /// It is the Gaussian that converts the moments of the prior to those of the posterior. Where
    /// the posterior is wider than the prior, it moves only the mean. Returns `None` if numbers are
    /// not finite.
    pub(crate) fn of(learnt: &LearntPosterior, embedding: &[f32]) -> Option<Self> {
        Self::of_weights(&learnt.prior.coordinates, &learnt.prior.likelihoods(embedding))
    }

    fn of_weights(materials: &[Vec<f32>], weights: &[f64]) -> Option<Self> {
        let (prior, from) = natural(materials, &vec![1.0; materials.len()])?;
        let (posterior, to) = natural(materials, weights)?;
        let (values, vectors) = eigenvectors((posterior - prior).as_ref());
        let n = to.len();
        let half = Mat::from_fn(n, n, |i, k| vectors[(i, k)] * (POWER * values[k].max(0.0)).sqrt());
        let vector = to.iter().zip(from).map(|(to, from)| POWER * (to - from)).collect();
        Some(Self { information: product(half.as_ref(), half.transpose()), vector })
    }
}

/// Returns the inverse covariance of weighted coordinates, and its product with their mean.
fn natural(materials: &[Vec<f32>], weights: &[f64]) -> Option<(Mat<f64>, Vec<f64>)> {
    let (n, total) = (materials[0].len(), weights.iter().sum::<f64>());
    let mut mean = vec![0.0; n];
    for (coordinates, weight) in materials.iter().zip(weights) {
        mean.iter_mut().zip(coordinates).for_each(|(sum, z)| *sum += weight / total * f64::from(*z));
    }
    let off =
        Mat::from_fn(materials.len(), n, |i, k| (weights[i] / total).sqrt() * (f64::from(materials[i][k]) - mean[k]));
    let mut covariance = product(off.transpose(), off.as_ref());
    (0..n).for_each(|k| covariance[(k, k)] += MIN_VARIANCE);
    let inverse = Cholesky::new(covariance)?.inverse_of_lower();
    let precision = product(inverse.transpose(), inverse.as_ref());
    let vector = times(&precision, &mean);
    Some((precision, vector))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    fn materials(count: usize) -> Vec<Vec<f32>> {
        let mut rng = Pcg64::seed_from_u64(4);
        (0..count).map(|_| (0..3).map(|_| StandardNormal.sample(&mut rng)).collect()).collect()
    }

    /// Recovers half of the Gaussian likelihood that determines the weights.
    #[test]
    fn recovers_a_gaussian_likelihood() {
        let (materials, at, deviations) = (materials(200_000), [0.5, -0.3, 0.2], [0.5, 0.8, 1e3]);
        let weight = |coordinates: &Vec<f32>| {
            let off = (0..3).map(|k| ((f64::from(coordinates[k]) - at[k]) / deviations[k]).powi(2));
            (-0.5 * off.sum::<f64>()).exp()
        };
        let hint =
            EncoderLikelihood::of_weights(&materials, &materials.iter().map(weight).collect::<Vec<f64>>()).unwrap();
        for k in 0..3 {
            let want = POWER / deviations[k].powi(2);
            let found = hint.information[(k, k)];
            assert!((found - want).abs() < 0.1 * want + 0.02, "{k}: {found} {want}");
            assert!((hint.vector[k] - want * at[k]).abs() < 0.1 * want + 0.02, "{k}: {}", hint.vector[k]);
        }
    }

    /// Equal weights contain no information.
    #[test]
    fn equal_weights_give_an_empty_hint() {
        let hint = EncoderLikelihood::of_weights(&materials(500), &[0.7; 500]).unwrap();
        assert!((0..9).all(|i| hint.information[(i / 3, i % 3)].abs() < 1e-9));
        assert!(hint.vector.iter().all(|b| b.abs() < 1e-9));
    }
}
