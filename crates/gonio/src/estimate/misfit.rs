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

/// Largest share of the fine detail of a photograph that its light has left unexplained
/// (`gonio-eval calibration`: 0.66 to 0.81 in photographs of mirrors and lacquers, which leaves a
/// margin below [`TOO_LARGE`]).
const UNRESOLVED: f64 = 0.7;

/// Largest deviation of pixels that share a normal that counts as noise: what exceeds it are
/// texture, shadows, or normals that do not lie on the photograph, and must not excuse the
/// residual.
pub(super) const MAX_NOISE: f64 = 0.1;

/// Residual above which an estimate is refused: light and material explain less than three quarters
/// of the energy of the photograph.
pub const MAX_MISFIT: f64 = 0.5;

/// Expected residual of light and material, relative and as a root mean square, if the material is
/// right: the noise, and the part that the light has no texels for. That part is at most the fine
/// detail that the photograph has, so that a wrong shape, which is mistaken for a sharp highlight,
/// does not excuse itself.
pub fn expected_misfit(material: &Material) -> f64 {
    expected(material.gloss[1], material.fineness, material.scatter)
}

fn expected(gloss: f64, fineness: f64, scatter: f64) -> f64 {
    let gloss = gloss.max(1.0).ln();
    let after = RESOLUTION.iter().position(|(g, _)| *g > gloss).unwrap_or(RESOLUTION.len() - 1).max(1);
    let ((a, low), (b, high)) = (RESOLUTION[after - 1], RESOLUTION[after]);
    let of_gloss = low + (high - low) * ((gloss - a) / (b - a)).clamp(0.0, 1.0);
    of_gloss.min((UNRESOLVED * fineness).max(RESOLUTION[0].1)).hypot(scatter.min(MAX_NOISE))
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
        assert_eq!(expected(0.3, 1.0, 0.0), 0.05);
        assert!((expected(2.0_f64.exp(), 1.0, 0.0) - 0.08).abs() < 1e-9 && expected(1e9, 1.0, 0.0) == 0.45);
        assert!((expected(1.0, 1.0, 0.08) - 0.05_f64.hypot(0.08)).abs() < 1e-9);
        let rising: Vec<f64> = (0..50).map(|i| expected((0.25 * f64::from(i)).exp(), 1.0, 0.01)).collect();
        assert!(rising.windows(2).all(|pair| pair[0] <= pair[1]));
        // A smooth photograph of something taken for a mirror, and one whose pixels do not agree.
        assert_eq!(expected(1e9, 0.02, 0.0), 0.05);
        assert_eq!(expected(0.3, 0.02, 0.4), 0.05_f64.hypot(0.1));
    }
}
