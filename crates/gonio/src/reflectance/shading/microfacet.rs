//! What the models of today have in common: GGX and Fresnel.

use std::f64::consts::PI;

use glam::DVec3;

/// The angles of a pair of directions that microfacet formulas are written in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(super) cos_i: f64,
    pub(super) cos_o: f64,
    /// Between the normal and the half vector.
    pub(super) cos_h: f64,
    /// Between either direction and the half vector.
    pub(super) cos_d: f64,
    pub(super) tan2_h: f64,
}

impl Pair {
    /// `None` unless light and view are above the surface.
    pub(super) fn new(wi: DVec3, wo: DVec3) -> Option<Self> {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return None;
        }
        let sum = wi + wo;
        let half = sum.normalize();
        // From x and y, since 1 - cos^2 would lose the narrow peaks.
        let tan2_h = (half.x * half.x + half.y * half.y) / (half.z * half.z);
        Some(Self { cos_i: wi.z, cos_o: wo.z, cos_h: half.z, cos_d: (0.5 * sum.length()).min(1.0), tan2_h })
    }

    /// Density of GGX's normals, which integrates with `cos_h` to 1 over the hemisphere.
    pub(super) fn ggx(&self, alpha: f64) -> f64 {
        let a2 = alpha * alpha;
        1.0 / (PI * a2 * (self.cos_h * self.cos_h * (1.0 + self.tan2_h / a2)).powi(2))
    }
}

/// `(1 - cos)^5` (Schlick 1994).
pub(super) fn schlick_weight(cos: f64) -> f64 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

/// Unpolarised reflectance of a dielectric of relative index `eta` at an angle to its facet.
pub(super) fn fresnel_dielectric(cos: f64, eta: f64) -> f64 {
    let inside = 1.0 - (1.0 - cos * cos) / (eta * eta);
    if inside <= 0.0 {
        return 1.0;
    }
    let t = inside.sqrt();
    let (s, p) = ((cos - eta * t) / (cos + eta * t), (t - eta * cos) / (t + eta * cos));
    0.5 * (s * s + p * p)
}

/// Smith's masking of GGX for one direction.
pub(super) fn smith(cos: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cos * cos).max(0.0) / (cos * cos);
    2.0 / (1.0 + (1.0 + alpha * alpha * tan2).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresnel_by_hand() {
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-12);
        assert!((fresnel_dielectric(1e-9, 1.5) - 1.0).abs() < 1e-6);
        // At Brewster's angle, tan = eta, only the perpendicular half is reflected: ((1 - eta^2) / (1 + eta^2))^2 / 2.
        let brewster = 1.5_f64.atan().cos();
        assert!((fresnel_dielectric(brewster, 1.5) - 0.5 * (1.25_f64 / 3.25).powi(2)).abs() < 1e-12);
        // Out of a dense medium all is reflected beyond the critical angle.
        assert_eq!(fresnel_dielectric(0.1, 1.0 / 1.5), 1.0);
    }

    #[test]
    fn densities_are_normalised() {
        for alpha in [0.05, 0.4, 1.0_f64] {
            // tan^2 = alpha^2 u/(1-u) makes the integrand constant; the measure is pi cos^4 dtan^2.
            let sum: f64 = (0..1000)
                .map(|i| {
                    let u = (f64::from(i) + 0.5) / 1000.0;
                    let tan2_h = alpha * alpha * u / (1.0 - u);
                    let cos_h = (1.0 + tan2_h).powf(-0.5);
                    let pair = Pair { cos_i: 1.0, cos_o: 1.0, cos_h, cos_d: 1.0, tan2_h };
                    pair.ggx(alpha) * PI * cos_h.powi(4) * alpha * alpha / (1.0 - u).powi(2) / 1000.0
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-9, "{alpha}: {sum}");
        }
        // Masking of a rough surface seen at 45 degrees, alpha = 1: 2 / (1 + sqrt 2).
        assert!((smith(0.5_f64.sqrt(), 1.0) - 2.0 / (1.0 + 2.0_f64.sqrt())).abs() < 1e-12);
    }
}
