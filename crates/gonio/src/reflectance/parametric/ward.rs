use super::{Facet, Parametric};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_PI, PI};

/// Isotropic Ward 1992 with a Lambertian part, as fitted by Ngan et al. 2005:
///
/// `f = diffuse/pi + specular exp(-tan^2 theta_h / alpha^2) / (4 pi alpha^2 sqrt(cos_i cos_o))`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ward {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Approximate albedo of the specular part.
    pub specular: f64,
    /// Standard deviation `alpha` of the surface slope, above 0.
    pub roughness: f64,
}

impl Parametric for Ward {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        let Some(facet) = Facet::new(wi, wo) else { return 0.0 };
        let alpha2 = self.roughness * self.roughness;
        let lobe = (-facet.tan2_h / alpha2).exp() / (4.0 * PI * alpha2 * (facet.cos_i * facet.cos_o).sqrt());
        self.diffuse * FRAC_1_PI + self.specular * lobe
    }
}

#[cfg(test)]
mod tests {
    use super::super::directions;
    use super::super::testing::*;
    use super::*;

    #[test]
    fn values_match_closed_forms() {
        let model = Ward { diffuse: 0.0, specular: 1.0, roughness: 0.5 };
        let (wi, wo) = directions(0.0, PI / 3.0, 0.0);
        assert!((model.eval(wi, wo) - 2.0 / PI).abs() < 1e-12);
        let (wi, wo) = directions(PI / 4.0, 0.0, 0.0);
        assert!((model.eval(wi, wo) - (-4.0_f64).exp() * 2.0_f64.sqrt() / PI).abs() < 1e-12);
    }

    #[test]
    fn narrow_lobe_reflects_its_factor_near_the_normal() {
        let a = albedo(&Ward { diffuse: 0.0, specular: 1.0, roughness: 0.05 }, 0.1, 0.05);
        assert!((a - 1.0).abs() < 0.02, "{a}");
    }
}
