//! Materials drawn from the prior, weighted by an image.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Materials with their embeddings.
///
/// The dot product of the embeddings of an image and of a material is, up to a constant of the
/// image, the logarithm of `p(I | F) / p(I)`. This ratio compares the likelihood of the image given
/// the material with its mean over all materials.
///
/// For materials drawn from the prior, the exponentials of these products are therefore the weights
/// of the posterior (eq. 3 with the sum over materials in place of the integral). Materials drawn
/// from another distribution are weighted by their density in the prior over that in this
/// distribution (importance sampling).
#[derive(Clone, Debug, PartialEq)]
pub struct Candidates {
    /// Position of each material in the [coordinates](crate::reflectance::LatentSpace).
    pub coordinates: Vec<Vec<f32>>,
    /// Embedding of each material, as long as that of an image.
    pub embeddings: Vec<Vec<f32>>,
    /// Logarithm of the importance weight of each material, up to a constant.
    pub log_importance: Vec<f32>,
}

impl Candidates {
    /// Creates candidates that were drawn from the prior itself, so that all importance weights are
    /// one.
    pub fn of_prior(coordinates: Vec<Vec<f32>>, embeddings: Vec<Vec<f32>>) -> Self {
        Self { log_importance: vec![0.0; coordinates.len()], coordinates, embeddings }
    }

    /// Computes the weights of the materials for the embedding of an image; their sum is one.
    ///
    /// # Panics
    /// If there are no materials, or the embeddings differ in length.
    pub fn weights(&self, image: &[f32]) -> Vec<f64> {
        normalised(self.log_weights(image))
    }

    /// Computes the likelihoods of the materials without their importance; their sum is one.
    ///
    /// # Panics
    /// If there are no materials, or the embeddings differ in length.
    pub(in crate::inference) fn likelihoods(&self, image: &[f32]) -> Vec<f64> {
        normalised(self.log_likelihoods(image).collect())
    }

    /// Computes the logarithm of the mean over the prior of the likelihood of an image, up to a
    /// constant of the image.
    ///
    /// # Panics
    /// If there are no materials, or the embeddings differ in length.
    pub(in crate::inference) fn log_evidence(&self, image: &[f32]) -> f64 {
        let importance: Vec<f64> = self.log_importance.iter().map(|log| f64::from(*log)).collect();
        log_sum(&self.log_weights(image)) - log_sum(&importance)
    }

    fn log_weights(&self, image: &[f32]) -> Vec<f64> {
        let importance = self.log_importance.iter().map(|log| f64::from(*log));
        self.log_likelihoods(image).zip(importance).map(|(likelihood, importance)| likelihood + importance).collect()
    }

    fn log_likelihoods(&self, image: &[f32]) -> impl Iterator<Item = f64> {
        assert!(!self.embeddings.is_empty(), "no materials");
        self.embeddings.iter().map(move |material| {
            assert_eq!(material.len(), image.len());
            material.iter().zip(image).map(|(m, i)| f64::from(*m) * f64::from(*i)).sum()
        })
    }

    /// Draws `count` materials by these weights and returns their indices, ordered by their first
    /// coordinate.
    ///
    /// Each material occurs in proportion to its weight, to within less than one (systematic
    /// resampling). The order stratifies the draws along the first axis, so that their quantiles
    /// change little if the weights change little. The same seed gives the same draws.
    pub(super) fn draw(&self, weights: &[f64], count: usize, seed: u64) -> Vec<usize> {
        let start: f64 = Pcg64::seed_from_u64(seed).random_range(0.0..1.0);
        let mut order: Vec<usize> = (0..weights.len()).collect();
        let first = |at: usize| self.coordinates[at].first().copied().unwrap_or(0.0);
        order.sort_by(|a, b| first(*a).total_cmp(&first(*b)));
        let (mut drawn, mut below) = (Vec::with_capacity(count), 0.0);
        for &at in &order {
            below += weights[at] * count as f64;
            while drawn.len() < count && start + (drawn.len() as f64) < below {
                drawn.push(at);
            }
        }
        // Round-off may leave the sum of the weights slightly below one.
        let last = order.iter().rfind(|at| weights[**at] > 0.0).copied().unwrap_or(0);
        drawn.resize(count, last);
        drawn
    }
}

/// Computes the exponentials of finite logarithms over their sum.
fn normalised(logs: Vec<f64>) -> Vec<f64> {
    let total = log_sum(&logs);
    logs.into_iter().map(|log| (log - total).exp()).collect()
}

/// Computes the logarithm of the sum of the exponentials of finite logarithms.
fn log_sum(logs: &[f64]) -> f64 {
    let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    top + logs.iter().map(|log| (log - top).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_ratios_of_likelihoods() {
        let embeddings = vec![vec![1.0, 0.0], vec![0.0, 2.0], vec![-1.0, 0.0]];
        let candidates = Candidates::of_prior(vec![vec![]; 3], embeddings);
        let weights = candidates.weights(&[3.0_f32.ln(), 0.5 * 6.0_f32.ln()]);
        for (got, want) in weights.iter().zip([3.0, 6.0, 1.0 / 3.0]) {
            assert!((got - want / (9.0 + 1.0 / 3.0)).abs() < 1e-6, "{weights:?}");
        }
        // The exponential of this product overflows.
        assert_eq!(candidates.weights(&[3000.0, 0.0]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn a_material_of_importance_two_counts_as_two_materials() {
        let twice = Candidates {
            log_importance: vec![1.0, 1.0 + 2.0_f32.ln()],
            ..Candidates::of_prior(vec![vec![0.0], vec![1.0]], vec![vec![1.0], vec![-0.5]])
        };
        let again =
            Candidates::of_prior(vec![vec![0.0], vec![1.0], vec![1.0]], vec![vec![1.0], vec![-0.5], vec![-0.5]]);
        let (got, want) = (twice.weights(&[0.7]), again.weights(&[0.7]));
        assert!((got[0] - want[0]).abs() < 1e-7 && (got[1] - want[1] - want[2]).abs() < 1e-7, "{got:?} {want:?}");
        let mean = ((0.7_f64.exp() + 2.0 * (-0.35_f64).exp()) / 3.0).ln();
        for candidates in [&twice, &again] {
            assert!((candidates.log_evidence(&[0.7]) - mean).abs() < 1e-6);
        }
        let likelihoods = twice.likelihoods(&[0.7]);
        assert!((likelihoods[0] / likelihoods[1] - 1.05_f64.exp()).abs() < 1e-6, "{likelihoods:?}");
    }

    #[test]
    fn draws_occur_in_proportion_to_their_weights() {
        let weights = [0.1, 0.0, 0.55, 0.35];
        let coordinates = [2.0, 3.0, -1.0, 0.5].map(|z| vec![z]).to_vec();
        let candidates = Candidates::of_prior(coordinates, vec![vec![0.0]; 4]);
        for seed in 0..20 {
            let drawn = candidates.draw(&weights, 101, seed);
            assert_eq!(drawn.len(), 101);
            assert!(drawn.is_sorted_by_key(|at| [3, 4, 1, 2][*at]), "{drawn:?}");
            for (at, weight) in weights.iter().enumerate() {
                let count = drawn.iter().filter(|d| **d == at).count() as f64;
                assert!((count - 101.0 * weight).abs() < 1.0, "{count}");
            }
        }
    }
}
