use super::{Facet, Parametric};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_1_PI;

/// Cook & Torrance 1982 with a Lambertian part, as fitted by Ngan et al. 2005:
///
/// `f = diffuse/pi + specular D F G / (pi cos_i cos_o)`, with Beckmann's
/// `D = exp(-tan^2 theta_h / m^2) / (m^2 cos^4 theta_h)`, Schlick's `F` and the V-groove
/// `G = min(1, 2 cos_h cos_i / cos_d, 2 cos_h cos_o / cos_d)`.
///
/// The factor `pi` replaces the 4 of modern microfacet theory, whose normalised `D` is `D / pi`
/// here. The specular lobe therefore reflects up to four times `specular`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CookTorrance {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Factor of the specular part.
    pub specular: f64,
    /// Fresnel reflectance at normal incidence ("eta" in the published fits).
    pub f0: f64,
    /// Root mean square slope `m` of the facets, above 0.
    pub roughness: f64,
}

impl Parametric for CookTorrance {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        let Some(facet) = Facet::new(wi, wo) else { return 0.0 };
        let d = beckmann(&facet, self.roughness);
        let f = facet.schlick(self.f0);
        let g = (2.0 * facet.cos_h * facet.cos_i.min(facet.cos_o) / facet.cos_d).min(1.0);
        FRAC_1_PI * (self.diffuse + self.specular * d * f * g / (facet.cos_i * facet.cos_o))
    }
}

/// Returns `exp(-tan^2 / m^2) / (m^2 cos^4)`.
///
/// Times `cos_h`, it integrates to pi over the hemisphere.
fn beckmann(facet: &Facet, m: f64) -> f64 {
    let m2 = m * m;
    (-facet.tan2_h / m2).exp() / (m2 * facet.cos_h.powi(4))
}

#[cfg(test)]
mod tests {
    use super::super::directions;
    use super::super::testing::*;
    use super::*;
    use std::f64::consts::PI;

    const MODEL: CookTorrance = CookTorrance { diffuse: 0.2, specular: 0.3, f0: 0.1, roughness: 0.25 };

    #[test]
    fn values_match_closed_forms() {
        // Normal incidence, half vector on the normal: D = 1/m^2 = 16, F = f0, G = 1.
        let (wi, wo) = directions(0.0, 0.0, 0.0);
        assert!((MODEL.eval(wi, wo) - (0.2 + 0.3 * 16.0 * 0.1) / PI).abs() < 1e-12);
        // Mirror pair at 60 degrees: D = 16, F = 0.1 + 0.9/32, G = min(1, 2 cos 60/cos 60) = 1,
        // cosines 1/2.
        let (wi, wo) = directions(0.0, PI / 3.0, 0.0);
        let want = (0.2 + 0.3 * 16.0 * (0.1 + 0.9 / 32.0) * 4.0) / PI;
        assert!((MODEL.eval(wi, wo) - want).abs() < 1e-12);
        // Half vector at 45 degrees, retro-reflection: tan = 1, cos = 1/sqrt 2, G = min(1, 2 * 1/2)
        // = 1.
        let (wi, wo) = directions(PI / 4.0, 0.0, 0.0);
        let want = (0.2 + 0.3 * 16.0 * (-16.0_f64).exp() * 4.0 * 0.1 * 2.0) / PI;
        assert!((MODEL.eval(wi, wo) - want).abs() < 1e-12);
        // Half vector at 60 degrees, retro-reflection: G = 2 cos^2 60 = 1/2.
        let wide = CookTorrance { diffuse: 0.0, specular: 1.0, f0: 1.0, roughness: 1.0 };
        let (wi, wo) = directions(PI / 3.0, 0.0, 0.0);
        let want = (-3.0_f64).exp() * 16.0 * 0.5 * 4.0 / PI;
        assert!((wide.eval(wi, wo) - want).abs() < 1e-12);
    }

    #[test]
    fn distribution_is_normalised() {
        for m in [0.05, 0.3, 1.0] {
            // Over tan^2 = t, the measure cos_h sin_h dtheta dphi is pi cos^4 dt.
            let (n, top) = (20_000, 40.0 * m * m);
            let sum: f64 = (0..n)
                .map(|i| {
                    let t = (i as f64 + 0.5) / n as f64 * top;
                    let cos_h = (1.0 + t).powf(-0.5);
                    let facet = Facet { cos_i: 1.0, cos_o: 1.0, cos_h, cos_d: 1.0, tan2_h: t };
                    beckmann(&facet, m) * PI * cos_h.powi(4) * top / n as f64
                })
                .sum();
            assert!((sum - PI).abs() < 1e-5, "{m}: {sum}");
        }
    }

    #[test]
    fn lobe_reflects_at_most_four_times_its_factor() {
        let mirror = CookTorrance { diffuse: 0.0, specular: 1.0, f0: 1.0, roughness: 0.1 };
        let a = albedo(&mirror, 0.3, 0.1);
        assert!(a <= 4.0 + 1e-5 && a > 3.9, "{a}");
    }
}
