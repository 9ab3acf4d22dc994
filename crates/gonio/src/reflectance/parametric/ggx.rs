use super::lobes::visibility;
use super::{Facet, Parametric};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_PI, PI};

/// Isotropic GGX (Trowbridge & Reitz 1975, Walter et al. 2007) with a Lambertian part:
///
/// `f = diffuse/pi + D F G / (4 cos_i cos_o)`, with
/// `D = 1 / (pi alpha^2 cos^4 theta_h (1 + tan^2 theta_h / alpha^2)^2)`, Schlick's `F` and Smith's
/// height-correlated masking `G = 1 / (1 + Lambda_i + Lambda_o)`,
/// `Lambda = (sqrt(1 + alpha^2 tan^2) - 1) / 2` (Heitz 2014). The specular part reflects at most
/// all light; energy scattered more than once is lost.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ggx {
    /// Albedo of the Lambertian part, 0 to 1.
    pub diffuse: f64,
    /// Fresnel reflectance at normal incidence, 0 to 1.
    pub f0: f64,
    /// Width `alpha` of the slope distribution, above 0, at most 1.
    pub alpha: f64,
}

impl Parametric for Ggx {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        let Some(facet) = Facet::new(wi, wo) else { return 0.0 };
        self.diffuse * FRAC_1_PI + lobe(&facet, self.alpha * self.alpha) * facet.schlick(self.f0)
    }
}

/// Returns `D G / (4 cos_i cos_o)`, the lobe of perfectly reflecting facets.
pub(crate) fn lobe(facet: &Facet, alpha2: f64) -> f64 {
    distribution(facet, alpha2) * visibility(alpha2, facet.cos_i, facet.cos_o)
}

/// Returns the density of the facets' normals.
///
/// Times `cos_h`, it integrates to 1 over the hemisphere.
pub(crate) fn distribution(facet: &Facet, alpha2: f64) -> f64 {
    1.0 / (PI * alpha2 * (facet.cos_h * facet.cos_h * (1.0 + facet.tan2_h / alpha2)).powi(2))
}

#[cfg(test)]
mod tests {
    use super::super::directions;
    use super::super::testing::*;
    use super::*;

    #[test]
    fn values_match_closed_forms() {
        // Half vector on the normal: D = 1/(pi alpha^2) = 4/pi; normal incidence has G = 1.
        let model = Ggx { diffuse: 0.5, f0: 0.04, alpha: 0.5 };
        let (wi, wo) = directions(0.0, 0.0, 0.0);
        assert!((model.eval(wi, wo) - (0.5 + 0.04) / PI).abs() < 1e-12);
        // Mirror pair at 60 degrees: Lambda = (sqrt(1 + 3/4) - 1)/2 twice, so G = 1/sqrt(1.75).
        let mirror = Ggx { diffuse: 0.0, f0: 1.0, alpha: 0.5 };
        let (wi, wo) = directions(0.0, PI / 3.0, 0.0);
        assert!((mirror.eval(wi, wo) - 4.0 / PI / 1.75_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn distribution_is_normalised() {
        for alpha2 in [0.01, 0.25, 1.0_f64] {
            // tan^2 = alpha^2 u/(1-u) makes the integrand constant; the measure is pi cos^4 dtan^2.
            let n = 1000;
            let sum: f64 = (0..n)
                .map(|i| {
                    let u = (i as f64 + 0.5) / n as f64;
                    let t = alpha2 * u / (1.0 - u);
                    let cos_h = (1.0 + t).powf(-0.5);
                    let facet = Facet { cos_i: 1.0, cos_o: 1.0, cos_h, cos_d: 1.0, tan2_h: t };
                    distribution(&facet, alpha2) * PI * cos_h.powi(4) * alpha2 / (1.0 - u).powi(2) / n as f64
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-9, "{alpha2}: {sum}");
        }
    }

    #[test]
    fn albedo_of_a_white_mirror_is_at_most_one() {
        for alpha in [0.05, 0.3, 0.8] {
            for theta in [0.0, 0.6, 1.2, 1.5] {
                let a = albedo(&Ggx { diffuse: 0.0, f0: 1.0, alpha }, theta, alpha);
                assert!(a <= 1.0 + 1e-3 && a > 0.3, "{alpha} {theta}: {a}");
            }
        }
        // A nearly smooth mirror loses almost no light.
        let a = albedo(&Ggx { diffuse: 0.0, f0: 1.0, alpha: 0.05 }, 0.3, 0.05);
        assert!(a > 0.99, "{a}");
    }
}
