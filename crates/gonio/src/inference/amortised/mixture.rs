//! A mixture of Gaussians whose numbers are a network's outputs (Bishop 1994), with the whole
//! precision of each.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Bound of the logarithms on the diagonal of the factors: components neither narrower nor wider
/// than `e^-4` to `e^4`.
pub const LARGEST_LOG: f32 = 4.0;

/// One Gaussian with precision `T' T`, `T` lower triangular with positive diagonal, and its share
/// of the mixture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Component {
    log_share: f64,
    mean: Vec<f64>,
    /// `T`, row by row, lower triangle only.
    factor: Vec<f64>,
}

/// A density over points of a space of a few dimensions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MixtureDensity {
    components: Vec<Component>,
}

impl Component {
    fn row(&self, i: usize) -> &[f64] {
        &self.factor[i * (i + 1) / 2..][..=i]
    }

    /// Logarithm of the share times the density.
    fn log_density(&self, z: &[f64]) -> f64 {
        let mut sum = self.log_share;
        for i in 0..self.mean.len() {
            let row = self.row(i);
            let whitened: f64 = row.iter().zip(z).zip(&self.mean).map(|((t, z), m)| t * (z - m)).sum();
            sum += row[i].ln() - 0.5 * whitened * whitened - 0.5 * std::f64::consts::TAU.ln();
        }
        sum
    }

    /// The mean plus the solution of `T x = white`.
    fn place(&self, white: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = Vec::with_capacity(white.len());
        for (i, w) in white.iter().enumerate() {
            let row = self.row(i);
            let known: f64 = row.iter().zip(&x).map(|(t, x)| t * x).sum();
            x.push((w - known) / row[i]);
        }
        x.iter().zip(&self.mean).map(|(x, m)| x + m).collect()
    }
}

/// Logarithm of the sum of exponentials.
fn log_sum_exp(values: &[f64]) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest.is_finite() { largest + values.iter().map(|v| (v - largest).exp()).sum::<f64>().ln() } else { largest }
}

impl MixtureDensity {
    /// How many outputs describe a mixture of `components` in `dimensions`: first the logarithms of
    /// all shares, up to a constant; then for each component its mean and the lower triangle of `T`
    /// row by row, with the logarithm of its diagonal.
    pub fn outputs(dimensions: usize, components: usize) -> usize {
        components * (1 + dimensions + dimensions * (dimensions + 1) / 2)
    }

    /// From a network's outputs.
    ///
    /// # Panics
    /// If there are not [`Self::outputs`] of them, or no components.
    pub fn of(outputs: &[f32], dimensions: usize, components: usize) -> Self {
        assert!(components > 0, "a mixture of nothing");
        assert_eq!(outputs.len(), Self::outputs(dimensions, components));
        let wide: Vec<f64> = outputs.iter().map(|v| f64::from(*v)).collect();
        let (logits, rest) = wide.split_at(components);
        let total = log_sum_exp(logits);
        let each = rest.len() / components;
        let components = logits
            .iter()
            .enumerate()
            .map(|(k, logit)| {
                let (mean, factor) = rest[k * each..][..each].split_at(dimensions);
                let mut factor = factor.to_vec();
                for i in 0..dimensions {
                    let bound = f64::from(LARGEST_LOG);
                    factor[diagonal(i)] = factor[diagonal(i)].clamp(-bound, bound).exp();
                }
                Component { log_share: logit - total, mean: mean.to_vec(), factor }
            })
            .collect();
        Self { components }
    }

    /// Number of dimensions.
    pub fn dimensions(&self) -> usize {
        self.components[0].mean.len()
    }

    /// Share and mean of each component.
    pub fn components(&self) -> impl Iterator<Item = (f64, &[f64])> {
        self.components.iter().map(|c| (c.log_share.exp(), c.mean.as_slice()))
    }

    /// Logarithm of the density at a point.
    ///
    /// # Panics
    /// If the point has not as many dimensions.
    pub fn log_density(&self, z: &[f64]) -> f64 {
        assert_eq!(z.len(), self.dimensions());
        log_sum_exp(&self.components.iter().map(|c| c.log_density(z)).collect::<Vec<_>>())
    }

    /// Mean of the whole.
    pub fn mean(&self) -> Vec<f64> {
        let mut sum = vec![0.0; self.dimensions()];
        for (share, mean) in self.components() {
            sum.iter_mut().zip(mean).for_each(|(s, m)| *s += share * m);
        }
        sum
    }

    /// A point drawn from the density.
    pub fn sample(&self, rng: &mut impl RngExt) -> Vec<f64> {
        let mut left: f64 = rng.random_range(0.0..1.0);
        let mut chosen = &self.components[0];
        for component in &self.components {
            let share = component.log_share.exp();
            if share > 0.0 {
                chosen = component;
                if left < share {
                    break;
                }
            }
            left -= share;
        }
        let white: Vec<f64> = (0..self.dimensions()).map(|_| StandardNormal.sample(rng)).collect();
        chosen.place(&white)
    }

    /// The same components with all standard deviations times a factor: less sure for one above 1.
    ///
    /// # Panics
    /// If the factor is not positive and finite.
    #[must_use]
    pub fn widened(&self, factor: f64) -> Self {
        assert!(factor > 0.0 && factor.is_finite(), "a width of {factor}");
        let mut wide = self.clone();
        for component in &mut wide.components {
            component.factor.iter_mut().for_each(|t| *t /= factor);
        }
        wide
    }
}

/// Place of a diagonal entry in the triangle.
fn diagonal(i: usize) -> usize {
    i * (i + 3) / 2
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    /// Two components in two dimensions, with shares 0.3 and 0.7.
    fn two() -> MixtureDensity {
        let outputs = [
            0.3_f32.ln() + 5.0,
            0.7_f32.ln() + 5.0,
            // Mean, then T = [2 0; 1 3].
            0.5,
            -1.0,
            2.0_f32.ln(),
            1.0,
            3.0_f32.ln(),
            // Mean, then T = [1 0; -0.5 1.5].
            -1.0,
            1.0,
            0.0,
            -0.5,
            1.5_f32.ln(),
        ];
        MixtureDensity::of(&outputs, 2, 2)
    }

    #[test]
    fn one_component_is_a_gaussian() {
        // T = [2 0; 1 3]: precision [5 3; 3 9], determinant 36. The logit says nothing.
        let density = MixtureDensity::of(&[7.0, 0.5, -1.0, 2.0_f32.ln(), 1.0, 3.0_f32.ln()], 2, 1);
        let (a, b) = (0.5, 2.0);
        let want = 0.5 * 36.0_f64.ln() - std::f64::consts::TAU.ln() - 0.5 * (5.0 * a * a + 6.0 * a * b + 9.0 * b * b);
        assert!((density.log_density(&[1.0, 1.0]) - want).abs() < 1e-6);
        assert_eq!(density.mean(), [0.5, -1.0]);
    }

    #[test]
    fn shares_weigh_the_components() {
        let both = two();
        let parts: f64 = [0.3, 0.7]
            .iter()
            .zip(&both.components)
            .map(|(share, c)| share * Component { log_share: 0.0, ..c.clone() }.log_density(&[0.2, 0.4]).exp())
            .sum();
        assert!((both.log_density(&[0.2, 0.4]).exp() - parts).abs() < 1e-6);
        let mean = both.mean();
        assert!((mean[0] - (0.15 - 0.7)).abs() < 1e-6 && (mean[1] - (-0.3 + 0.7)).abs() < 1e-6);
    }

    #[test]
    fn densities_sum_to_one() {
        let step = 0.02;
        let line = MixtureDensity::of(&[0.2, -0.4, 1.0, 0.7, -2.0, 1.3], 1, 2);
        let sum: f64 = (-1000..1000).map(|i| line.log_density(&[f64::from(i) * step]).exp() * step).sum();
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        for density in [two(), two().widened(1.7)] {
            let step = 0.05;
            let mut sum = [0.0; 3];
            for (i, j) in (-200..200).flat_map(|i| (-200..200).map(move |j| (i, j))) {
                let z = [f64::from(i) * step, f64::from(j) * step];
                let p = density.log_density(&z).exp() * step * step;
                sum.iter_mut().zip([1.0, z[0], z[1]]).for_each(|(s, f)| *s += p * f);
            }
            assert!((sum[0] - 1.0).abs() < 1e-6, "{sum:?}");
            let mean = density.mean();
            assert!((sum[1] - mean[0]).abs() < 1e-5 && (sum[2] - mean[1]).abs() < 1e-5);
        }
    }

    #[test]
    fn samples_have_the_moments_of_the_density() {
        for widening in [1.0, 2.0] {
            let density = two().widened(widening);
            let mut rng = Pcg64::seed_from_u64(5);
            let count = 200_000;
            let mut sums = [0.0; 5];
            for _ in 0..count {
                let z = density.sample(&mut rng);
                let terms = [z[0], z[1], z[0] * z[0], z[0] * z[1], z[1] * z[1]];
                sums.iter_mut().zip(terms).for_each(|(s, t)| *s += t / f64::from(count));
            }
            // Inverses of [5 3; 3 9] and [1.25 -0.75; -0.75 2.25].
            let covariances = [[9.0 / 36.0, -3.0 / 36.0, 5.0 / 36.0], [1.0, 1.0 / 3.0, 1.25 / 2.25]];
            let mut want = [0.0; 5];
            for ((share, m), c) in density.components().zip(covariances) {
                let w = widening * widening;
                let terms = [m[0], m[1], w * c[0] + m[0] * m[0], w * c[1] + m[0] * m[1], w * c[2] + m[1] * m[1]];
                want.iter_mut().zip(terms).for_each(|(s, t)| *s += share * t);
            }
            for (got, want) in sums.iter().zip(want) {
                assert!((got - want).abs() < 0.02 * (1.0 + widening * widening), "{sums:?} {want}");
            }
        }
    }

    #[test]
    fn extreme_outputs_stay_finite() {
        let density = MixtureDensity::of(&[1e30, -1e30, 0.0, 1e30, 0.0, -1e30], 1, 2);
        assert!(density.log_density(&[3.0]).is_finite());
        assert!(density.sample(&mut Pcg64::seed_from_u64(1))[0].abs() < 1.0);
    }
}
