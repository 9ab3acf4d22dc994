use std::f64::consts::FRAC_1_PI;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::microfacet::{COAT_F0, f0_of, schlick_weight};
use super::{Parameter, Shading, UNIT};
use crate::reflectance::parametric::{Facet, lobe};

/// Metallic-roughness material of glTF 2.0 with the extensions `KHR_materials_ior`,
/// `KHR_materials_specular` and `KHR_materials_clearcoat`.
///
/// The model of appendix B of the specification is a mixture of a metal and of a Lambertian body
/// under a dielectric, both GGX with `alpha = roughness^2`, height-correlated masking and Schlick's
/// formula. The coat is a third lobe with an index of 1.5.
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
    /// Factor of the dielectric's reflectance at normal incidence, linear RGB, 0..=1.
    pub specular_color: DVec3,
    /// Weight of the coat, 0..=1.
    pub clearcoat: f64,
    /// Square root of the coat's `alpha`: at most `roughness`, but at least 0.05.
    pub clearcoat_roughness: f64,
}

/// Index of the first channel of the specular colour.
const SPECULAR: usize = 6;

/// Index of the coat's weight.
const COAT: usize = 9;

/// Smallest roughness of a coat: a lobe of 0.14 degrees, the half angle between samples of a table.
const SHARPEST_COAT: f64 = 0.05;

impl Shading for MetallicRoughness {
    const PARAMETERS: &'static [Parameter] = &[
        UNIT,
        UNIT,
        UNIT,
        UNIT,
        Parameter { low: 0.03, high: 1.0 },
        Parameter { low: 1.0, high: 2.5 },
        UNIT,
        UNIT,
        UNIT,
        UNIT,
        // Roughness of the coat relative to that of the base.
        Parameter { low: 0.02, high: 1.0 },
    ];

    const OPTIONAL: &'static [&'static [(usize, f64)]] =
        &[&[(COAT, 0.0), (COAT + 1, 0.02)], &[(SPECULAR, 1.0), (SPECULAR + 1, 1.0), (SPECULAR + 2, 1.0)]];

    const ROUGHNESS_AND_COAT: Option<(usize, usize)> = Some((4, 0));

    fn of(p: &[f64]) -> Self {
        Self {
            base_color: DVec3::new(p[0], p[1], p[2]),
            metallic: p[3],
            roughness: p[4],
            ior: p[5],
            specular_color: DVec3::from_slice(&p[SPECULAR..]),
            clearcoat: p[COAT],
            clearcoat_roughness: if p[COAT] > 0.0 { (p[COAT + 1] * p[4]).max(SHARPEST_COAT) } else { 0.0 },
        }
    }

    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>> {
        let start = |colour: DVec3, metallic: f64, roughness: f64, coat: [f64; 2]| {
            let [r, g, b] = colour.clamp(DVec3::splat(0.02), DVec3::splat(0.98)).to_array();
            vec![r, g, b, metallic, roughness, 1.5, 0.95, 0.95, 0.95, coat[0], coat[1]]
        };
        let bare = [0.06, 0.12, 0.3, 0.6].into_iter().flat_map(|r| {
            let coat = [0.03, 0.5];
            [start(body, 0.03, r, coat), start(body + highlight, 0.95, r, coat), start(body, 0.4, r, coat)]
        });
        // A sharp coat over a wider lobe.
        let coated = [0.3, 0.6].into_iter().flat_map(|r| {
            let coat = |share: f64| [0.8, share];
            [
                start(body, 0.03, r, coat(0.3)),
                start(body + highlight, 0.9, r, coat(0.15)),
                start(body, 0.4, r, coat(0.3)),
            ]
        });
        bare.chain(coated).collect()
    }

    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        let Some(facet) = Facet::new(wi, wo) else { return DVec3::ZERO };
        let base_lobe = lobe(&facet, self.roughness.powi(4));
        let weight = schlick_weight(facet.cos_d);
        let f0 = f0_of(self.ior) * self.specular_color;
        let fresnel = f0 + (DVec3::ONE - f0) * weight;
        let dielectric = self.base_color * (FRAC_1_PI * (1.0 - fresnel.max_element())) + fresnel * base_lobe;
        let metal = (self.base_color + (DVec3::ONE - self.base_color) * weight) * base_lobe;
        let base = dielectric.lerp(metal, self.metallic);
        if self.clearcoat == 0.0 {
            return base;
        }
        // The specification takes Schlick's formula at the angle between view and normal.
        let coat = self.clearcoat * (COAT_F0 + (1.0 - COAT_F0) * schlick_weight(facet.cos_o));
        base.lerp(DVec3::splat(lobe(&facet, self.clearcoat_roughness.powi(4))), coat)
    }
}
