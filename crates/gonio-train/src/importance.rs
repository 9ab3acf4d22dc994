//! Importance weights of materials drawn from the prior of the training.

use gonio::gloss::tip_sharpness;
use gonio::reflectance::BivariateTable;

/// Sharpness of the tip of a lobe at which half of the reduction applies: slightly above that of
/// GGX lobes, `ln 4`.
const SHARP: f64 = 1.5;

/// Width of the transition, in units of sharpness.
const TRANSITION: f64 = 0.2;

/// Reduction of the logarithm of the weight of materials with sharp tips.
const REDUCTION: f64 = 2.0;

/// Returns the logarithm of the importance weight of a material.
///
/// The prior of the training contains many lobes with a sharp tip above wide tails, like those of
/// MERL. Such lobes are rare among materials that other laboratories measured. The posterior
/// therefore weights them by a seventh. `docs/training.md` states the measurements.
pub(crate) fn log_importance(table: &BivariateTable) -> f32 {
    let Some(sharpness) = tip_sharpness(table) else { return 0.0 };
    let reduced = -REDUCTION / (1.0 + (-(sharpness - SHARP) / TRANSITION).exp());
    reduced as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sharp_tips_are_rare() {
        let with_spike = |spike: f64| {
            let value = move |h: f64| 0.1 + (-(h / 0.1).powi(2)).exp() + if h == 0.0 { spike } else { 0.0 };
            log_importance(&BivariateTable::from_fn(move |h, _| value(h)))
        };
        assert_eq!(log_importance(&BivariateTable::from_fn(|_, _| 0.3)), 0.0);
        assert!(with_spike(0.0) > -0.1, "{}", with_spike(0.0));
        assert!((with_spike(20.0) + 2.0).abs() < 0.01, "{}", with_spike(20.0));
    }
}
