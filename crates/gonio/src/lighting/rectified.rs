//! Gaussian rectified at a threshold: `N(x; u, w)` truncated below `T` and renormalised.
//!
//! It is the prior of the coarsest vertical wavelet (paper 3.1, `T < 0`) and the posterior of every
//! variable that is bounded below (eqs. 12 to 14, `T = 0` or that of the prior).

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_2_PI, TAU};

use puruspe::{erfc, erfcx};
use serde::{Deserialize, Serialize};

/// `N(x; u, w)` on `x >= threshold`, renormalised.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RectifiedGaussian {
    /// `u`, the mean before rectification.
    pub location: f64,
    /// `w`, the variance before rectification; positive.
    pub variance: f64,
    /// `T`, the smallest possible value.
    pub threshold: f64,
}

/// Moments of a density on the line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// `<x>`.
    pub mean: f64,
    /// `<x^2> - <x>^2`, stored separately because the difference cancels.
    pub variance: f64,
    /// `<log q(x)>`, the negative entropy.
    pub mean_log: f64,
}

impl Moments {
    /// Moments of a Gaussian.
    pub fn gaussian(mean: f64, variance: f64) -> Self {
        Self { mean, variance, mean_log: -0.5 * ((TAU * variance).ln() + 1.0) }
    }

    /// `<x^2>`.
    pub fn mean_square(&self) -> f64 {
        self.variance + self.mean * self.mean
    }
}

/// Number of standard deviations between location and threshold beyond which the tail series is
/// exact to round-off.
const SERIES_FROM: f64 = 60.0;

/// `log(erfc(x))` without underflow.
fn log_erfc(x: f64) -> f64 {
    if x < 0.5 { erfc(x).ln() } else { erfcx(x).ln() - x * x }
}

impl RectifiedGaussian {
    /// `alpha = (T - u) / sqrt(w)`.
    fn standard_threshold(&self) -> f64 {
        (self.threshold - self.location) / self.variance.sqrt()
    }

    /// Logarithm of the mass `P(x > T)` of the Gaussian before rectification.
    pub fn log_mass(&self) -> f64 {
        log_erfc(self.standard_threshold() * FRAC_1_SQRT_2) - std::f64::consts::LN_2
    }

    /// Logarithm of the density at `x`; minus infinity below the threshold.
    pub fn log_density(&self, x: f64) -> f64 {
        if x < self.threshold {
            return f64::NEG_INFINITY;
        }
        let z2 = (x - self.location).powi(2) / self.variance;
        -0.5 * ((TAU * self.variance).ln() + z2) - self.log_mass()
    }

    /// Mean, variance and negative entropy.
    ///
    /// With `alpha = (T - u)/sqrt(w)` and the hazard `lambda = sqrt(2/pi) / erfcx(alpha/sqrt(2))`:
    /// `<x> = u + sqrt(w) lambda`, `var = w (1 + alpha lambda - lambda^2)`. Both suffer from
    /// cancellation for large `alpha`; there, `delta = lambda - alpha` is computed from its
    /// asymptotic series, and `<x> = T + sqrt(w) delta`.
    pub fn moments(&self) -> Moments {
        let (sd, alpha) = (self.variance.sqrt(), self.standard_threshold());
        if alpha > SERIES_FROM {
            let r = 1.0 / (alpha * alpha);
            let delta = (1.0 - r * (2.0 - r * (10.0 - r * 74.0))) / alpha;
            let spread = r * (1.0 - r * (6.0 - r * (50.0 - r * 518.0)));
            // <log q> = -(log(2 pi w) + <z^2>)/2 - log mass with <z^2> = 1 + alpha lambda; erfcx
            // removes the alpha^2 / 2 of both.
            let log_scaled_mass = (0.5 * erfcx(alpha * FRAC_1_SQRT_2)).ln();
            let mean_log = -0.5 * ((TAU * self.variance).ln() + 1.0 + alpha * delta) - log_scaled_mass;
            return Moments { mean: self.threshold + sd * delta, variance: self.variance * spread, mean_log };
        }
        // erfcx overflows below -26; the hazard is zero to double precision long before.
        let lambda = if alpha < -25.0 { 0.0 } else { FRAC_2_PI.sqrt() / erfcx(alpha * FRAC_1_SQRT_2) };
        let delta = lambda - alpha;
        let mean = if alpha > 0.0 { self.threshold + sd * delta } else { self.location + sd * lambda };
        let variance = self.variance * (1.0 - lambda * delta).max(f64::MIN_POSITIVE);
        // <z^2> = 1 + alpha lambda. For alpha > 0.5, alpha^2 / 2 is removed from both terms.
        let mean_log = if alpha > 0.5 {
            let log_scaled_mass = (0.5 * erfcx(alpha * FRAC_1_SQRT_2)).ln();
            -0.5 * ((TAU * self.variance).ln() + 1.0 + alpha * delta) - log_scaled_mass
        } else {
            -0.5 * ((TAU * self.variance).ln() + 1.0 + alpha * lambda) - self.log_mass()
        };
        Moments { mean, variance, mean_log }
    }

    /// Fits location and variance by maximum likelihood, given a threshold below all samples.
    ///
    /// Expectation maximisation treats the mass below the threshold as hidden. Returns `None` for
    /// fewer than two different samples.
    pub fn fit(samples: &[f64], threshold: f64) -> Option<Self> {
        let n = samples.len() as f64;
        let mean = samples.iter().sum::<f64>() / n;
        let spread = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
        if spread.is_nan() || spread <= 0.0 {
            return None;
        }
        let mut fit = Self { location: mean, variance: spread, threshold };
        for _ in 0..20_000 {
            // The hidden part is the mirror image: a Gaussian rectified from above at T.
            let hidden = Self { location: -fit.location, variance: fit.variance, threshold: -threshold };
            let odds = (hidden.log_mass() - fit.log_mass()).exp();
            let m = hidden.moments();
            let (hidden_mean, total) = (-m.mean, 1.0 + odds);
            let location = (mean + odds * hidden_mean) / total;
            let about = |mean: f64, variance: f64| variance + (mean - location).powi(2);
            let variance = (about(mean, spread) + odds * about(hidden_mean, m.variance)) / total;
            let moved = (location - fit.location).abs() / spread.sqrt() + (variance / fit.variance - 1.0).abs();
            // A nearly exponential sample would drive the location to minus infinity: stop at ten
            // standard deviations.
            if !variance.is_finite() || (location - mean).abs() > 10.0 * spread.sqrt() {
                break;
            }
            fit = Self { location, variance, threshold };
            if moved < 1e-12 {
                break;
            }
        }
        Some(fit)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    use super::*;

    fn density(location: f64, variance: f64, threshold: f64) -> RectifiedGaussian {
        RectifiedGaussian { location, variance, threshold }
    }

    /// Moments by brute force: a fine midpoint rule over the effective support.
    fn brute(q: RectifiedGaussian) -> (f64, f64, f64) {
        let sd = q.variance.sqrt();
        let alpha = q.standard_threshold();
        // Decay length at the threshold, or the standard deviation.
        let low = q.threshold.max(q.location - 12.0 * sd);
        let width = if alpha > 1.0 { 45.0 * sd / alpha } else { (q.location - low).max(0.0) + 12.0 * sd };
        let n = 400_000;
        let step = width / f64::from(n);
        let log_peak = q.log_density(low.max(q.location));
        let (mut z, mut x1, mut entropy) = (0.0, 0.0, 0.0);
        for i in 0..n {
            let offset = (f64::from(i) + 0.5) * step;
            let p = (q.log_density(low + offset) - log_peak).exp();
            z += p;
            x1 += p * offset;
            entropy += p * q.log_density(low + offset);
        }
        let mean = x1 / z;
        let mut x2 = 0.0;
        for i in 0..n {
            let offset = (f64::from(i) + 0.5) * step;
            x2 += (q.log_density(low + offset) - log_peak).exp() * (offset - mean).powi(2);
        }
        (low + mean, x2 / z, entropy / z)
    }

    #[test]
    fn moments_match_quadrature() {
        for (u, w, t) in [
            (0.0, 1.0, 0.0),
            (3.0, 0.5, 0.0),
            (-3.0, 0.5, 0.0),
            (-20.0, 1.0, 0.0),
            (-200.0, 1.0, 0.0),
            (-0.5, 0.01, -0.1),
            (50.0, 2.0, 0.0),
            (0.2, 0.04, -0.1),
            (-59.0, 1.0, 0.0),
            (-61.0, 1.0, 0.0),
        ] {
            let q = density(u, w, t);
            let (got, (mean, variance, mean_log)) = (q.moments(), brute(q));
            assert!(((got.mean - t) / (mean - t) - 1.0).abs() < 1e-6, "{q:?} {got:?} {mean}");
            assert!((got.variance / variance - 1.0).abs() < 1e-5, "{q:?} {got:?} {variance}");
            assert!((got.mean_log - mean_log).abs() < 1e-5 * (1.0 + mean_log.abs()), "{q:?} {got:?} {mean_log}");
        }
    }

    #[test]
    fn moments_are_smooth_where_the_series_takes_over() {
        let at = |alpha: f64| density(-alpha, 1.0, 0.0).moments();
        let (below, above) = (at(SERIES_FROM - 1e-9), at(SERIES_FROM + 1e-9));
        assert!((below.mean / above.mean - 1.0).abs() < 1e-9);
        assert!((below.variance / above.variance - 1.0).abs() < 1e-5);
        assert!((below.mean_log - above.mean_log).abs() < 1e-8);
    }

    #[test]
    fn is_gaussian_far_above_the_threshold() {
        let m = density(100.0, 4.0, 0.0).moments();
        assert_eq!((m.mean, m.variance), (100.0, 4.0));
        assert!((m.mean_log + 0.5 * (TAU * std::f64::consts::E * 4.0).ln()).abs() < 1e-12);
    }

    #[test]
    fn extreme_thresholds_stay_finite_and_positive() {
        for u in [-1e3, -1e6, -1e9] {
            let m = density(u, 1.0, 0.0).moments();
            assert!(m.mean > 0.0 && m.variance > 0.0 && m.mean_log.is_finite(), "{u} {m:?}");
            assert!((m.mean * -u - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn a_planted_density_is_recovered() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let normal = Normal::new(0.1, 0.3).unwrap();
        let samples: Vec<f64> =
            std::iter::repeat_with(|| normal.sample(&mut rng)).filter(|&x| x > -0.1).take(50_000).collect();
        let fit = RectifiedGaussian::fit(&samples, -0.1).unwrap();
        assert!((fit.location - 0.1).abs() < 0.02 && (fit.variance - 0.09).abs() < 0.004, "{fit:?}");
    }
}
