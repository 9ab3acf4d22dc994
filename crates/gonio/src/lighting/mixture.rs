//! Zero-mean Gaussian scale mixtures in one dimension, and their fit by expectation maximisation.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// `p(x) = sum_n pi_n N(x; 0, s_n^2)`: the prior of a wavelet coefficient (eq. 5).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScaleMixture {
    /// Mixing weights `pi_n`, positive, summing to one.
    pub weights: Vec<f64>,
    /// Variances `s_n^2`, ascending.
    pub variances: Vec<f64>,
}

/// Settings of the fit of a mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MixtureSettings {
    /// Number of components, at least 1.
    pub components: usize,
    /// Number of starts; the result with the highest likelihood is kept.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for MixtureSettings {
    fn default() -> Self {
        Self { components: 2, starts: 8, seed: 1 }
    }
}

/// Largest number of iterations of each start.
const MAX_ITERATIONS: usize = 2000;

/// Increase of the mean log likelihood below which a start ends.
const TOLERANCE: f64 = 1e-10;

/// Number of samples above which runs of equal count of the sorted magnitudes are replaced by their
/// root mean squares. A zero-mean mixture depends only on magnitudes, and a run holds less than one
/// in four thousand of them.
const QUANTISED: usize = 4096;

impl ScaleMixture {
    /// Logarithm of the density at `x`.
    pub fn log_density(&self, x: f64) -> f64 {
        self.log_density_of_square(x * x)
    }

    /// Logarithm of the density for a given `x^2`. For an expected square `<x^2>`, it is the bound
    /// of `<log p>` with the optimal responsibilities.
    pub fn log_density_of_square(&self, x2: f64) -> f64 {
        self.log_joint(x2).fold(f64::NEG_INFINITY, log_add)
    }

    /// Variance `sum pi_n s_n^2`.
    pub fn variance(&self) -> f64 {
        self.weights.iter().zip(&self.variances).map(|(w, v)| w * v).sum()
    }

    /// `log pi_n + log N(x; 0, s_n^2)` of each component, given `x^2` (or its expectation).
    pub fn log_joint(&self, x2: f64) -> impl Iterator<Item = f64> + '_ {
        self.weights.iter().zip(&self.variances).map(move |(w, v)| w.ln() - 0.5 * ((TAU * v).ln() + x2 / v))
    }

    /// Fits from one start to samples given as squared magnitudes with weights. Returns the mean
    /// log likelihood and the mixture.
    fn fit_once(magnitudes: &[(f64, f64)], start: Self) -> (f64, Self) {
        let n = start.weights.len();
        let mean_square = magnitudes.iter().map(|(x2, w)| x2 * w).sum::<f64>();
        // Prevents a component from collapsing onto the samples nearest to zero.
        let floor = 1e-9 * mean_square;
        let (mut mixture, mut best) = (start, f64::NEG_INFINITY);
        for _ in 0..MAX_ITERATIONS {
            let (mut mass, mut spread, mut likelihood) = (vec![0.0; n], vec![0.0; n], 0.0);
            let constants: Vec<(f64, f64)> = (0..n)
                .map(|k| {
                    let v = mixture.variances[k];
                    (mixture.weights[k].ln() - 0.5 * (TAU * v).ln(), 0.5 / v)
                })
                .collect();
            let mut joint = vec![0.0; n];
            for &(x2, w) in magnitudes {
                for (j, (c, h)) in joint.iter_mut().zip(&constants) {
                    *j = c - h * x2;
                }
                let top = joint.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let total: f64 = joint
                    .iter_mut()
                    .map(|j| {
                        *j = (*j - top).exp();
                        *j
                    })
                    .sum();
                likelihood += w * (top + total.ln());
                for k in 0..n {
                    let r = w * joint[k] / total;
                    mass[k] += r;
                    spread[k] += r * x2;
                }
            }
            for k in 0..n {
                mixture.weights[k] = mass[k].max(1e-12);
                mixture.variances[k] = (spread[k] / mass[k].max(1e-300)).max(floor);
            }
            let total: f64 = mixture.weights.iter().sum();
            mixture.weights.iter_mut().for_each(|w| *w /= total);
            if likelihood - best < TOLERANCE {
                best = best.max(likelihood);
                break;
            }
            best = likelihood;
        }
        (best, mixture)
    }

    /// Fits a mixture to samples by maximum likelihood; deterministic for a seed.
    ///
    /// Returns `None` if no sample is finite and non-zero.
    pub fn fit(samples: &[f64], settings: &MixtureSettings) -> Option<Self> {
        let mut squares: Vec<f64> = samples.iter().map(|x| x * x).filter(|x| x.is_finite()).collect();
        squares.sort_by(f64::total_cmp);
        let magnitudes: Vec<(f64, f64)> = {
            let runs = squares.len().min(QUANTISED);
            (0..runs)
                .map(|r| {
                    let run = &squares[r * squares.len() / runs..(r + 1) * squares.len() / runs];
                    (run.iter().sum::<f64>() / run.len() as f64, run.len() as f64 / squares.len() as f64)
                })
                .collect()
        };
        if squares.last().is_none_or(|&x| x == 0.0) {
            return None;
        }
        let mut rng = rand_pcg::Pcg64::seed_from_u64(settings.seed);
        let n = settings.components.max(1);
        let smallest_positive = magnitudes.iter().find(|m| m.0 > 0.0).map_or(1.0, |m| m.0);
        let (_, mut best) = (0..settings.starts.max(1))
            .map(|restart| {
                // Variances start at evenly spread quantiles of the squares; later starts jitter
                // the quantiles.
                let mut variances: Vec<f64> = (0..n)
                    .map(|k| {
                        let jitter = if restart == 0 { 0.5 } else { rng.random_range(0.0..1.0) };
                        let q = (k as f64 + jitter) / n as f64;
                        magnitudes[((q * magnitudes.len() as f64) as usize).min(magnitudes.len() - 1)].0
                    })
                    .map(|v| v.max(smallest_positive))
                    .collect();
                // The tail lies far beyond the last quantile.
                variances[n - 1] *= if restart == 0 { 2.0 } else { rng.random_range(1.0..20.0) };
                let start = Self { weights: vec![1.0 / n as f64; n], variances };
                Self::fit_once(&magnitudes, start)
            })
            .reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| best.variances[a].total_cmp(&best.variances[b]));
        best = Self {
            weights: order.iter().map(|&k| best.weights[k]).collect(),
            variances: order.iter().map(|&k| best.variances[k]).collect(),
        };
        Some(best)
    }
}

/// `log(exp(a) + exp(b))`.
fn log_add(a: f64, b: f64) -> f64 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if high == f64::NEG_INFINITY { high } else { high + (low - high).exp().ln_1p() }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    fn sample(mixture: &ScaleMixture, n: usize) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        (0..n)
            .map(|_| {
                let mut u: f64 = rng.random_range(0.0..1.0);
                let k = mixture.weights.iter().position(|w| {
                    u -= w;
                    u < 0.0
                });
                let z: f64 = StandardNormal.sample(&mut rng);
                z * mixture.variances[k.unwrap_or(0)].sqrt()
            })
            .collect()
    }

    #[test]
    fn a_planted_mixture_is_recovered() {
        let planted = ScaleMixture { weights: vec![0.7, 0.3], variances: vec![0.01, 4.0] };
        let fit = ScaleMixture::fit(&sample(&planted, 40_000), &MixtureSettings::default()).unwrap();
        for k in 0..2 {
            assert!((fit.weights[k] - planted.weights[k]).abs() < 0.01, "{fit:?}");
            assert!((fit.variances[k] / planted.variances[k] - 1.0).abs() < 0.03, "{fit:?}");
        }
    }

    #[test]
    fn one_component_is_the_mean_square() {
        let x = [1.0, -2.0, 3.0];
        let fit = ScaleMixture::fit(&x, &MixtureSettings { components: 1, ..Default::default() }).unwrap();
        assert!((fit.variances[0] - 14.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn more_components_never_fit_worse() {
        let planted = ScaleMixture { weights: vec![0.5, 0.3, 0.2], variances: vec![0.01, 0.5, 9.0] };
        let x = sample(&planted, 3_000);
        let likelihood = |components| {
            let fit = ScaleMixture::fit(&x, &MixtureSettings { components, ..Default::default() }).unwrap();
            x.iter().map(|&x| fit.log_density(x)).sum::<f64>()
        };
        let all = [1, 2, 3, 4].map(likelihood);
        assert!(all.windows(2).all(|w| w[1] > w[0] - 1e-3), "{all:?}");
    }

    #[test]
    fn the_density_integrates_to_one() {
        let m = ScaleMixture { weights: vec![0.4, 0.6], variances: vec![0.1, 2.0] };
        let step = 1e-3;
        let total: f64 = (-20_000..20_000).map(|i| m.log_density(f64::from(i) * step).exp() * step).sum();
        assert!((total - 1.0).abs() < 1e-9);
    }

    #[test]
    fn returns_none_without_nonzero_samples() {
        assert_eq!(ScaleMixture::fit(&[0.0, 0.0], &MixtureSettings::default()), None);
        assert_eq!(ScaleMixture::fit(&[], &MixtureSettings::default()), None);
    }
}
