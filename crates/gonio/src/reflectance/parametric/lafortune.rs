use super::Parametric;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_PI, TAU};

/// Isotropic one-lobe Lafortune et al. 1997 with a Lambertian part, as fitted by Ngan et al. 2005:
///
/// `f = diffuse/pi + specular (n + 2) / (2 pi max(|Cxy|, |Cz|)^n)
/// max(0, Cxy (x_i x_o + y_i y_o) + Cz z_i z_o)^n`.
///
/// The factor before the lobe is from Ngan et al. Without it, the published coefficients give no
/// visible lobe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lafortune {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Factor of the lobe.
    pub specular: f64,
    /// Tangential coefficient; negative for reflection about the normal.
    pub cxy: f64,
    /// Normal coefficient. At least one of both coefficients must not be zero.
    pub cz: f64,
    /// Exponent `n`, at least 0.
    pub exponent: f64,
}

impl Parametric for Lafortune {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return 0.0;
        }
        let inner = self.cxy * (wi.x * wo.x + wi.y * wo.y) + self.cz * wi.z * wo.z;
        // Dividing before the power keeps exponents in the thousands finite.
        let base = (inner / self.cxy.abs().max(self.cz.abs())).max(0.0);
        self.diffuse * FRAC_1_PI + self.specular * (self.exponent + 2.0) / TAU * base.powf(self.exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::super::directions;
    use super::super::testing::*;
    use super::*;
    use std::f64::consts::PI;

    const PHONG: Lafortune = Lafortune { diffuse: 0.0, specular: 1.0, cxy: -0.577, cz: 0.577, exponent: 50.0 };

    #[test]
    fn values_match_closed_forms() {
        // The base is 1 in every mirror pair.
        let (wi, wo) = directions(0.0, 1.0, 0.3);
        assert!((PHONG.eval(wi, wo) - 52.0 / TAU).abs() < 1e-9);
        // Retro-reflection at 30 degrees: cos^2 - sin^2 = 1/2.
        let (wi, wo) = directions(PI / 6.0, 0.0, 0.0);
        assert!((PHONG.eval(wi, wo) - 52.0 / TAU * 0.5_f64.powi(50)).abs() < 1e-20);
    }

    #[test]
    fn lobe_reflects_its_factor_at_the_normal() {
        let a = albedo(&PHONG, 0.0, 0.15);
        assert!((a - 1.0).abs() < 2e-3, "{a}");
    }
}
