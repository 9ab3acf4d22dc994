use std::f64::consts::{FRAC_1_PI, PI};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::microfacet::{fresnel_dielectric, schlick_weight, smith};
use super::{Parameter, Shading, UNIT};
use crate::reflectance::parametric::{Facet, distribution};

/// Reflecting part of Mitsuba 3's `principled`, after Burley 2012 and 2015.
///
/// It combines Burley's diffuse lobe with retro-reflection and sheen, GGX with
/// `alpha = roughness^2` and separable masking, a dielectric by index and a metal by Schlick's
/// formula, and a clear coat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Principled {
    /// Linear RGB, 0..=1: colour of the body for a dielectric, of the reflection for a metal.
    pub base_color: DVec3,
    /// Mixture of dielectric (0) and metal (1).
    pub metallic: f64,
    /// Square root of GGX's `alpha`, 0..=1.
    pub roughness: f64,
    /// Relative index of refraction, above one.
    pub eta: f64,
    /// Weight of the retro-reflecting sheen, 0..=1.
    pub sheen: f64,
    /// Weight of the coat, 0..=1.
    pub clearcoat: f64,
    /// Gloss of the coat, from satin (0) to glossy (1).
    pub clearcoat_gloss: f64,
}

impl Shading for Principled {
    const PARAMETERS: &'static [Parameter] = &[
        UNIT,
        UNIT,
        UNIT,
        UNIT,
        Parameter { low: 0.03, high: 1.0 },
        Parameter { low: 1.05, high: 2.5 },
        UNIT,
        UNIT,
        UNIT,
    ];

    const OPTIONAL: &'static [&'static [(usize, f64)]] = &[&[(6, 0.0)], &[(7, 0.0), (8, 0.0)]];

    const ROUGHNESS_AND_COAT: Option<(usize, usize)> = Some((4, 1));

    fn of(p: &[f64]) -> Self {
        Self {
            base_color: DVec3::new(p[0], p[1], p[2]),
            metallic: p[3],
            roughness: p[4],
            eta: p[5],
            sheen: p[6],
            clearcoat: p[7],
            clearcoat_gloss: p[8],
        }
    }

    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>> {
        let start = |colour: DVec3, metallic: f64, roughness: f64, coat: f64| {
            let [r, g, b] = colour.clamp(DVec3::splat(0.02), DVec3::splat(0.98)).to_array();
            vec![r, g, b, metallic, roughness, 1.5, 0.05, coat, 0.8]
        };
        [0.06, 0.12, 0.3, 0.6]
            .into_iter()
            .flat_map(|r| {
                [start(body, 0.03, r, 0.05), start(body + highlight, 0.95, r, 0.05), start(body, 0.3, r, 0.5)]
            })
            .collect()
    }

    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        let Some(facet) = Facet::new(wi, wo) else { return DVec3::ZERO };
        let Facet { cos_i, cos_o, cos_h, cos_d, .. } = facet;
        let alpha = (self.roughness * self.roughness).max(1e-3);
        let fresnel = DVec3::splat((1.0 - self.metallic) * fresnel_dielectric(cos_d, self.eta))
            + self.metallic * (self.base_color + (DVec3::ONE - self.base_color) * schlick_weight(cos_d));
        let normals = distribution(&facet, alpha * alpha);
        let mut f = fresnel * (normals * smith(cos_i, alpha) * smith(cos_o, alpha) / (4.0 * cos_i * cos_o));
        let (at_i, at_o, at_d) = (schlick_weight(cos_i), schlick_weight(cos_o), schlick_weight(cos_d));
        let back = 2.0 * self.roughness * cos_d * cos_d;
        let diffuse = (1.0 - 0.5 * at_i) * (1.0 - 0.5 * at_o) + back * (at_o + at_i + at_o * at_i * (back - 1.0));
        f += (1.0 - self.metallic) * (self.base_color * (FRAC_1_PI * diffuse) + DVec3::splat(self.sheen * at_d));
        // The coat has an index of 1.5 and masking of width 1/4; the light that it reflects is not
        // subtracted from the layers below.
        let a2 = (0.1 + (0.001 - 0.1) * self.clearcoat_gloss).powi(2);
        let d = (a2 - 1.0) / (PI * a2.ln() * (1.0 + (a2 - 1.0) * cos_h * cos_h));
        let coat = 0.25 * self.clearcoat * (0.04 + 0.96 * at_d) * d * smith(cos_i, 0.25) * smith(cos_o, 0.25);
        f + DVec3::splat(coat)
    }
}
