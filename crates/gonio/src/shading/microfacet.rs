//! Fresnel and masking terms that several models share. GGX is in the parametric models.

/// Index of refraction of coats.
pub const COAT_IOR: f64 = 1.5;

/// Reflectance of coats along the normal.
pub(super) const COAT_F0: f64 = {
    let root = (COAT_IOR - 1.0) / (COAT_IOR + 1.0);
    root * root
};

/// Returns `(1 - cos)^5` (Schlick 1994).
pub(super) fn schlick_weight(cos: f64) -> f64 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

/// Returns the unpolarised reflectance of a dielectric of relative index `eta`.
///
/// `cos` is the cosine of the angle to the normal of the facet.
pub(crate) fn fresnel_dielectric(cos: f64, eta: f64) -> f64 {
    let inside = 1.0 - (1.0 - cos * cos) / (eta * eta);
    if inside <= 0.0 {
        return 1.0;
    }
    let t = inside.sqrt();
    let (s, p) = ((cos - eta * t) / (cos + eta * t), (t - eta * cos) / (t + eta * cos));
    0.5 * (s * s + p * p)
}

/// Returns the reflectance along the normal of a dielectric of relative index `eta`.
pub(super) fn f0_of(eta: f64) -> f64 {
    ((eta - 1.0) / (eta + 1.0)).powi(2)
}

/// Returns Smith's masking of GGX for one direction.
pub(super) fn smith(cos: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cos * cos).max(0.0) / (cos * cos);
    2.0 / (1.0 + (1.0 + alpha * alpha * tan2).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresnel_matches_closed_forms() {
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-12);
        assert!((f0_of(1.5) - 0.04).abs() < 1e-12);
        assert!((fresnel_dielectric(1e-9, 1.5) - 1.0).abs() < 1e-6);
        // At Brewster's angle, tan = eta, only perpendicular polarisation is reflected: ((1 -
        // eta^2) / (1 + eta^2))^2 / 2.
        let brewster = 1.5_f64.atan().cos();
        assert!((fresnel_dielectric(brewster, 1.5) - 0.5 * (1.25_f64 / 3.25).powi(2)).abs() < 1e-12);
        // From inside a dense medium, all light is reflected beyond the critical angle.
        assert_eq!(fresnel_dielectric(0.1, 1.0 / 1.5), 1.0);
    }

    #[test]
    fn masking_matches_a_closed_form() {
        // Masking of a rough surface at 45 degrees, alpha = 1: 2 / (1 + sqrt 2).
        assert!((smith(0.5_f64.sqrt(), 1.0) - 2.0 / (1.0 + 2.0_f64.sqrt())).abs() < 1e-12);
    }
}
