//! Expected residual of the photograph, given light and material.

use super::{Doubt, Light, Material};

/// The most probable reason for a misfit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The surface varies from pixel to pixel.
    Texture,
    /// Regions differ from the prediction: several materials, shadows, light from nearby, misplaced
    /// normals or outline.
    Regions,
    /// The light that was given is not the one in the photograph, or not where it was.
    Light,
}

/// Residual of a clean simulated photograph because its light has more than 32 x 32 texels, by the
/// logarithm of the [gloss](Material::gloss), linear between the entries: about the 95 % quantile
/// of photographs of left-out materials in left-out lights (`gonio-eval folds`, docs/trials.md).
const RESOLUTION: [(f64, f64); 5] = [(0.0, 0.05), (2.0, 0.08), (5.0, 0.22), (7.0, 0.45), (10.0, 0.45)];

/// Ratio of a misfit to the expected one above which it is a reason to doubt.
const TOO_LARGE: f64 = 1.25;

/// Expected residual of light and material, relative and as a root mean square, if the material is
/// right: the noise, and the part that the light has no texels for.
pub fn expected_misfit(material: &Material) -> f64 {
    expected(material.gloss[1], material.scatter)
}

fn expected(gloss: f64, scatter: f64) -> f64 {
    let gloss = gloss.max(1.0).ln();
    let after = RESOLUTION.iter().position(|(g, _)| *g > gloss).unwrap_or(RESOLUTION.len() - 1).max(1);
    let ((a, low), (b, high)) = (RESOLUTION[after - 1], RESOLUTION[after]);
    (low + (high - low) * ((gloss - a) / (b - a)).clamp(0.0, 1.0)).hypot(scatter)
}

/// Doubt about a misfit that is too large, if it is.
pub(super) fn doubt(material: &Material, light: &Light) -> Option<Doubt> {
    let (left, expected) = (light.misfit, expected_misfit(material));
    let reason = if material.scatter > 0.5 * left { Reason::Texture } else { Reason::Regions };
    (left > TOO_LARGE * expected).then_some(Doubt::Misfit { left, expected, reason })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sharper_materials_and_noisier_pixels_leave_more() {
        assert_eq!(expected(0.3, 0.0), 0.05);
        assert!((expected(2.0_f64.exp(), 0.0) - 0.08).abs() < 1e-9 && expected(1e9, 0.0) == 0.45);
        assert!((expected(1.0, 0.12) - 0.13).abs() < 1e-9);
        let rising: Vec<f64> = (0..50).map(|i| expected((0.25 * f64::from(i)).exp(), 0.01)).collect();
        assert!(rising.windows(2).all(|pair| pair[0] <= pair[1]));
    }
}
