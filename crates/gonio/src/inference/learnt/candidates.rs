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
/// of the posterior (eq. 3 with the sum over materials in place of the integral).
#[derive(Clone, Debug, PartialEq)]
pub struct Candidates {
    /// Position of each material in the [coordinates](crate::reflectance::LatentSpace).
    pub coordinates: Vec<Vec<f32>>,
    /// Embedding of each material, as long as that of an image.
    pub embeddings: Vec<Vec<f32>>,
}

impl Candidates {
    /// Computes the weights of the materials for the embedding of an image; their sum is one.
    ///
    /// # Panics
    /// If there are no materials, or the embeddings differ in length.
    pub fn weights(&self, image: &[f32]) -> Vec<f64> {
        assert!(!self.embeddings.is_empty(), "no materials");
        let product = |material: &Vec<f32>| {
            assert_eq!(material.len(), image.len());
            material.iter().zip(image).map(|(m, i)| f64::from(*m) * f64::from(*i)).sum::<f64>()
        };
        let logs: Vec<f64> = self.embeddings.iter().map(product).collect();
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = logs.iter().map(|l| (l - top).exp()).collect();
        let total: f64 = weights.iter().sum();
        weights.into_iter().map(|w| w / total).collect()
    }

    /// Draws `count` materials by these weights and returns their indices in ascending order.
    ///
    /// Each material occurs in proportion to its weight, to within less than one (systematic
    /// resampling). The same seed gives the same draws.
    pub(super) fn draw(weights: &[f64], count: usize, seed: u64) -> Vec<usize> {
        let start: f64 = Pcg64::seed_from_u64(seed).random_range(0.0..1.0);
        let (mut drawn, mut below) = (Vec::with_capacity(count), 0.0);
        for (at, weight) in weights.iter().enumerate() {
            below += weight * count as f64;
            while drawn.len() < count && start + (drawn.len() as f64) < below {
                drawn.push(at);
            }
        }
        // Round-off may leave the sum of the weights slightly below one.
        let last = weights.iter().rposition(|w| *w > 0.0).unwrap_or(0);
        drawn.resize(count, last);
        drawn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_ratios_of_likelihoods() {
        let embeddings = vec![vec![1.0, 0.0], vec![0.0, 2.0], vec![-1.0, 0.0]];
        let candidates = Candidates { coordinates: vec![vec![]; 3], embeddings };
        let weights = candidates.weights(&[3.0_f32.ln(), 0.5 * 6.0_f32.ln()]);
        for (got, want) in weights.iter().zip([3.0, 6.0, 1.0 / 3.0]) {
            assert!((got - want / (9.0 + 1.0 / 3.0)).abs() < 1e-6, "{weights:?}");
        }
        // The exponential of this product overflows.
        assert_eq!(candidates.weights(&[3000.0, 0.0]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn draws_occur_in_proportion_to_their_weights() {
        let weights = [0.1, 0.0, 0.55, 0.35];
        for seed in 0..20 {
            let drawn = Candidates::draw(&weights, 101, seed);
            assert_eq!(drawn.len(), 101);
            for (at, weight) in weights.iter().enumerate() {
                let count = drawn.iter().filter(|d| **d == at).count() as f64;
                assert!((count - 101.0 * weight).abs() < 1.0, "{count}");
            }
        }
    }
}
