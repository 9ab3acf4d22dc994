//! Expected residual of the photograph, given light and material.

use super::{Diagnostic, Light, MaterialEstimate};

/// The most probable cause of a misfit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MisfitCause {
    /// The surface varies from pixel to pixel.
    Texture,
    /// Regions differ from the prediction: several materials, shadows, light from nearby, misplaced
    /// normals or outline.
    Geometry,
    /// The given light is not that of the photograph, or has another orientation.
    KnownLight,
}

/// Residual that the light leaves of a clean simulated photograph.
///
/// It is a function of the logarithm of the [peak height](MaterialEstimate::peak_height),
/// interpolated linearly. Up to 2, the values are about the 95 % quantile over left-out materials
/// in left-out lights. Beyond 2, they lie between the 80 and the 95 % quantile of 148 photographs
/// of `gonio-eval calibration` in four training lights, of which two have a hard sun or small lamps
/// (docs/trials.md).
const RESOLUTION: [(f64, f64); 5] = [(0.0, 0.05), (2.0, 0.08), (5.0, 0.2), (7.0, 0.25), (10.0, 0.25)];

/// Ratio of the misfit to the expected one above which it is reported.
pub(super) const MISFIT_WARNING_RATIO: f64 = 1.25;

/// Largest expected share of the fine detail of a photograph that the light leaves unexplained.
/// `gonio-eval calibration` measured 0.66 to 0.81 for mirrors and lacquers in lights of 32 x 32
/// texels, which is less than this value times [`MISFIT_WARNING_RATIO`]. Refined lights leave less.
const UNRESOLVED: f64 = 0.7;

/// Largest deviation of pixels with the same normal that counts as noise. Larger deviations come
/// from texture, shadows or misaligned normals, and must not raise the expected residual.
pub(super) const MAX_NOISE: f64 = 0.1;

/// Misfit above which inaccurate normals are refined
/// ([`Detection::refined`](crate::scene::Detection::refined)).
pub const NORMAL_REFINEMENT_MISFIT: f64 = 0.2;

/// Residual above which an estimate is refused: light and material then explain less than three
/// quarters of the energy of the photograph.
pub const MAX_MISFIT: f64 = 0.5;

/// Returns the expected relative root mean square residual if the material is correct.
///
/// It combines the noise and the detail that the light grid does not resolve. The latter is at most
/// the fine detail of the photograph; otherwise a wrong shape, mistaken for a sharp highlight,
/// would raise the expected residual.
pub fn expected_misfit(material: &MaterialEstimate) -> f64 {
    expected(material.peak_height[1], material.fineness, material.scatter)
}

fn expected(gloss: f64, fineness: f64, scatter: f64) -> f64 {
    let gloss = gloss.max(1.0).ln();
    let after = RESOLUTION.iter().position(|(g, _)| *g > gloss).unwrap_or(RESOLUTION.len() - 1).max(1);
    let ((a, low), (b, high)) = (RESOLUTION[after - 1], RESOLUTION[after]);
    let of_gloss = low + (high - low) * ((gloss - a) / (b - a)).clamp(0.0, 1.0);
    of_gloss.min((UNRESOLVED * fineness).max(RESOLUTION[0].1)).hypot(scatter.min(MAX_NOISE))
}

/// Returns a diagnostic if the misfit is too large.
pub(super) fn diagnostic(material: &MaterialEstimate, light: &Light) -> Option<Diagnostic> {
    let (misfit, expected) = (light.misfit, expected_misfit(material));
    let cause = if material.scatter > 0.5 * misfit { MisfitCause::Texture } else { MisfitCause::Geometry };
    (misfit > MISFIT_WARNING_RATIO * expected).then_some(Diagnostic::Misfit { misfit, expected, cause })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expected_misfit_rises_with_gloss_and_noise() {
        assert_eq!(expected(0.3, 1.0, 0.0), 0.05);
        assert!((expected(2.0_f64.exp(), 1.0, 0.0) - 0.08).abs() < 1e-9 && expected(1e9, 1.0, 0.0) == 0.25);
        assert!((expected(1.0, 1.0, 0.08) - 0.05_f64.hypot(0.08)).abs() < 1e-9);
        let rising: Vec<f64> = (0..50).map(|i| expected((0.25 * f64::from(i)).exp(), 1.0, 0.01)).collect();
        assert!(rising.windows(2).all(|pair| pair[0] <= pair[1]));
        // A smooth photograph mistaken for that of a mirror, and one with a large scatter.
        assert_eq!(expected(1e9, 0.02, 0.0), 0.05);
        assert_eq!(expected(0.3, 0.02, 0.4), 0.05_f64.hypot(0.1));
    }
}
