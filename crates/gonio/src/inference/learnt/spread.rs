//! Errors that the draws of a posterior do not show.

use std::f64::consts::PI;

use crate::inference::likelihood::Likelihood;
use crate::reflectance::{CELLS, angles_of};

/// Half angles, in degrees, at which scales are given: linear between them, constant beyond.
const NODES: [f64; 6] = [2.0, 7.0, 15.0, 27.5, 45.0, 65.0];

/// Degrees of freedom of Student's distribution of the errors.
pub(super) const DEGREES_OF_FREEDOM: f64 = 3.0;

/// Scale of the error of the logarithm of a number such as gloss.
pub(super) const NUMBER_ERROR_SCALE: f64 = 0.15;

/// Scales at the half angles of [`NODES`] under an unknown light.
const UNKNOWN_LIGHT_SCALES: [f64; 6] = [0.2, 0.25, 0.3, 0.35, 0.45, 0.8];

/// Scales at the half angles of [`NODES`] under a known light.
const KNOWN_LIGHT_SCALES: [f64; 6] = [0.14, 0.14, 0.15, 0.18, 0.28, 0.6];

/// Returns the scale of the error of the log reflectance of every cell.
///
/// The draws of a posterior do not show this error. It has two causes: the coordinates of materials
/// cannot express every material, and new photographs differ from those in training. It has
/// Student's distribution with three degrees of freedom, since materials differ in their distance
/// from the prior.
///
/// `gonio-eval calibration` determines the numbers. With them, intervals contain the measured
/// values of materials outside the training set as often as their probability requires
/// (docs/results.md).
pub(super) fn error_scales(likelihood: &Likelihood) -> Vec<f32> {
    let scales = match likelihood {
        Likelihood::Embedding(_) => UNKNOWN_LIGHT_SCALES,
        Likelihood::Gaussian(_) => KNOWN_LIGHT_SCALES,
    };
    (0..CELLS).map(|cell| scale_at(&scales, angles_of(cell).0) as f32).collect()
}

/// Returns the scale at a half angle in radians.
fn scale_at(scales: &[f64; 6], half_angle: f64) -> f64 {
    let degrees = half_angle.to_degrees();
    let above = NODES.iter().position(|node| *node > degrees).unwrap_or(NODES.len());
    if above == 0 || above == NODES.len() {
        return scales[above.min(NODES.len() - 1)];
    }
    let (low, high) = (NODES[above - 1], NODES[above]);
    let share = (degrees - low) / (high - low);
    scales[above - 1] + share * (scales[above] - scales[above - 1])
}

/// Computes a quantile of Student's distribution with three degrees of freedom.
pub(super) fn student_quantile(share: f64) -> f64 {
    let below = |x: f64| {
        let y = x / 3_f64.sqrt();
        0.5 + (y / (1.0 + y * y) + y.atan()) / PI
    };
    let (mut low, mut high) = (-1e3, 1e3);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if below(middle) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Computes a quantile of ascending values of equal weight, linear between them.
pub(super) fn quantile(values: &[f32], share: f64) -> f32 {
    let last = values.len() - 1;
    let at = (share as f32 * values.len() as f32 - 0.5).clamp(0.0, last as f32);
    let below = (at as usize).min(last.saturating_sub(1));
    values[below] + (at - below as f32) * (values[(below + 1).min(last)] - values[below])
}

/// Computes a quantile of the sum of an ascending sample and an independent error.
///
/// `error` is the quantile of the error. Distances from the median are added in quadrature, as for
/// Gaussians.
pub(super) fn spread_quantile(values: &[f32], share: f64, error: f32) -> f32 {
    let median = quantile(values, 0.5);
    median + (quantile(values, share) - median).hypot(error).copysign((share - 0.5) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_linear_between_the_middles_of_values() {
        let values = [1.0, 2.0, 3.0, 4.0];
        // Middles at 1/8, 3/8, 5/8, 7/8.
        for (share, want) in [(0.05, 1.0), (0.125, 1.0), (0.25, 1.5), (0.5, 2.5), (0.99, 4.0)] {
            assert_eq!(quantile(&values, share), want);
        }
        assert_eq!(quantile(&[3.0], 0.3), 3.0);
    }

    #[test]
    fn student_quantiles_match_published_tables() {
        for (share, want) in [(0.5, 0.0), (0.75, 0.764_9), (0.95, 2.353_4), (0.025, -3.182_4)] {
            assert!((student_quantile(share) - want).abs() < 1e-4, "{share}");
        }
    }

    #[test]
    fn errors_widen_both_sides() {
        let many: Vec<f32> = (0..1000).map(|i| i as f32 / 1000.0).collect();
        // The result is exact if the sample or the error has no width.
        assert_eq!(spread_quantile(&many, 0.95, 0.0), quantile(&many, 0.95));
        assert_eq!(spread_quantile(&[5.0; 4], 0.9, 0.7), 5.7);
        assert_eq!(spread_quantile(&[5.0; 4], 0.1, -0.7), 4.3);
        let (low, high) = (spread_quantile(&many, 0.05, -0.6), spread_quantile(&many, 0.95, 0.6));
        assert!((high - 0.5 - 0.45_f32.hypot(0.6)).abs() < 1e-3 && (low + high - 1.0).abs() < 2e-3, "{low} {high}");
    }

    #[test]
    fn scales_grow_with_the_half_angle() {
        for scales in [UNKNOWN_LIGHT_SCALES, KNOWN_LIGHT_SCALES] {
            assert_eq!(scale_at(&scales, 0.0), scales[0]);
            assert_eq!(scale_at(&scales, 1.5), scales[5]);
            assert!((scale_at(&scales, 45_f64.to_radians()) - scales[4]).abs() < 1e-12);
            let degrees: Vec<f64> = (0..90).map(|h| scale_at(&scales, f64::from(h).to_radians())).collect();
            assert!(degrees.windows(2).all(|pair| pair[0] <= pair[1]));
        }
    }
}
