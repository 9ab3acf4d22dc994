//! Light on a reference, and the absolute scale of the reflectance.

use std::f64::consts::PI;

use glam::DVec3;

use crate::colour::Chroma;
use crate::estimate::irradiance;
use crate::lighting::LightGrid;
use crate::picture::luminance;

/// Relative error of the reflectance of a patch, from printing, ageing and gloss.
pub(super) const REFLECTANCE_LOG_SD: f64 = 0.05;

/// Standard deviation of the log irradiance of an estimated light, given a true albedo.
///
/// Nine in ten of 84 renderings deviate by less than 22.8 % (docs/references.md).
const ESTIMATE_LOG_SD: f64 = 0.12;

/// Light on a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceLight {
    /// Radiance of a matte surface of reflectance one at the reference, or at the centre of a ball:
    /// irradiance over pi.
    ///
    /// Linear RGB on the scale of the photograph.
    pub white: DVec3,
    /// Mean radiance of a matte ball of reflectance one over its visible surface, if the reference
    /// is a ball.
    pub ball: Option<DVec3>,
    /// Standard deviation of the logarithm of the luminance of both.
    pub log_sd: f64,
}

/// Factor from a table of normal albedo [`ALBEDO`](crate::estimate::ALBEDO) to reflectance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AbsoluteScale {
    /// The factor.
    pub factor: f64,
    /// Standard deviation of its logarithm.
    pub log_sd: f64,
}

impl ReferenceLight {
    /// Returns the chroma of the light: with a ball, of the light on all visible normals.
    pub fn chroma(&self) -> Chroma {
        Chroma::of(self.ball.unwrap_or(self.white))
    }

    /// Returns the absolute scale of the reflectance that was estimated together with `light`.
    ///
    /// The reference must face the camera under the same light; a ball does at its centre. The
    /// photograph shows the product of reflectance and light: if the estimated light is too bright
    /// by a factor, the reflectance is too low by the same factor.
    ///
    /// Returns `None` if either irradiance is not positive and finite.
    pub fn scale(&self, light: &LightGrid) -> Option<AbsoluteScale> {
        let factor = irradiance(light) / (PI * f64::from(luminance(self.white.as_vec3())));
        let log_sd = self.log_sd.hypot(ESTIMATE_LOG_SD);
        (factor.is_finite() && factor > 0.0).then_some(AbsoluteScale { factor, log_sd })
    }
}

impl AbsoluteScale {
    /// Returns the bounds of the 90 % interval of `value` times the factor.
    pub fn interval(&self, value: f64) -> [f64; 2] {
        let reach = (1.645 * self.log_sd).exp();
        [value * self.factor / reach, value * self.factor * reach]
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::sphere::OctahedralMap;

    #[test]
    fn gives_the_factor_between_estimated_and_true_irradiance() {
        // A uniform light of radiance 3 has the irradiance 3 pi: a white patch has the radiance 3.
        let even =
            |radiance| LightGrid::from_texels(OctahedralMap::EqualArea, 32, vec![Vec3::splat(radiance); 32 * 32]);
        let reference = ReferenceLight { white: DVec3::splat(3.0), ball: None, log_sd: 0.0 };
        for (estimated, factor) in [(3.0, 1.0), (1.5, 0.5), (12.0, 4.0)] {
            let scale = reference.scale(&even(estimated)).unwrap();
            assert!((scale.factor / factor - 1.0).abs() < 0.01, "{estimated}: {}", scale.factor);
            let [low, high] = scale.interval(0.5);
            assert!(low < 0.5 * factor && 0.5 * factor < high);
        }
        assert_eq!(reference.scale(&even(0.0)), None);
        assert_eq!(ReferenceLight { white: DVec3::ZERO, ball: None, log_sd: 0.0 }.scale(&even(1.0)), None);
    }
}
