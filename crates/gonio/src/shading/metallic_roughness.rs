use std::f64::consts::FRAC_1_PI;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::microfacet::{f0_of, schlick_weight};
use super::{Parameter, Shading, UNIT};
use crate::reflectance::parametric::{Facet, lobe};

/// Metallic-roughness material of glTF 2.0 with the index of `KHR_materials_ior`.
///
/// The model of appendix B of the specification is a mixture of a metal and of a Lambertian body
/// under a dielectric, both GGX with `alpha = roughness^2`, height-correlated masking and Schlick's
/// formula.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MetallicRoughness {
    /// Linear RGB, 0..=1: colour of the body for a dielectric, of the reflection for a metal.
    pub base_color: DVec3,
    /// Mixture of dielectric (0) and metal (1).
    pub metallic: f64,
    /// Square root of GGX's `alpha`, 0..=1.
    pub roughness: f64,
    /// Relative index of refraction; 1.5 without the extension.
    pub ior: f64,
}

impl Shading for MetallicRoughness {
    const PARAMETERS: &'static [Parameter] =
        &[UNIT, UNIT, UNIT, UNIT, Parameter { low: 0.03, high: 1.0 }, Parameter { low: 1.0, high: 2.5 }];

    fn of(p: &[f64]) -> Self {
        Self { base_color: DVec3::new(p[0], p[1], p[2]), metallic: p[3], roughness: p[4], ior: p[5] }
    }

    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>> {
        let start = |colour: DVec3, metallic: f64, roughness: f64| {
            let [r, g, b] = colour.clamp(DVec3::splat(0.02), DVec3::splat(0.98)).to_array();
            vec![r, g, b, metallic, roughness, 1.5]
        };
        [0.06, 0.12, 0.3, 0.6]
            .into_iter()
            .flat_map(|r| [start(body, 0.03, r), start(body + highlight, 0.95, r), start(body, 0.4, r)])
            .collect()
    }

    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        let Some(facet) = Facet::new(wi, wo) else { return DVec3::ZERO };
        let lobe = lobe(&facet, self.roughness.powi(4));
        let fresnel = facet.schlick(f0_of(self.ior));
        let dielectric = self.base_color * (FRAC_1_PI * (1.0 - fresnel)) + DVec3::splat(fresnel * lobe);
        let metal = (self.base_color + (DVec3::ONE - self.base_color) * schlick_weight(facet.cos_d)) * lobe;
        dielectric.lerp(metal, self.metallic)
    }
}
