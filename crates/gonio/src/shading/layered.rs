use std::f64::consts::{FRAC_1_PI, TAU};
use std::sync::OnceLock;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::microfacet::{COAT_F0, COAT_IOR, f0_of, fresnel_dielectric, schlick_weight};
use super::{MetallicRoughness, Parameter, Shading};
use crate::reflectance::parametric::{Facet, lobe};

/// Base, specular layer and coat of OpenPBR.
///
/// The base is a mixture of a metal and of a Lambertian body under a dielectric. The body receives
/// only the light that the dielectric does not reflect. Both are GGX with `alpha = roughness^2`,
/// height-correlated masking and compensation of multiple scattering (Turquin 2019). The coat is a
/// GGX lobe with an index of 1.5; the base receives the light that the coat does not reflect
/// towards the viewer. Renderers differ by a few percent in how they account for this energy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layered {
    /// Linear RGB, 0..=1: colour of the body for a dielectric, of the reflection for a metal.
    pub base_color: DVec3,
    /// Mixture of dielectric (0) and metal (1).
    pub metalness: f64,
    /// Square root of GGX's `alpha`, 0..=1.
    pub roughness: f64,
    /// Relative index of refraction.
    pub ior: f64,
    /// Factor of the dielectric's reflection, and of the metal's reflection at 82 degrees; linear
    /// RGB, 0..=1.
    pub specular_color: DVec3,
    /// Weight of the coat, 0..=1.
    pub coat_weight: f64,
    /// Square root of the coat's `alpha`: at most `roughness`, but at least 0.05.
    pub coat_roughness: f64,
}

impl Shading for Layered {
    // The parameters are those of `MetallicRoughness`, with other names.
    const PARAMETERS: &'static [Parameter] = MetallicRoughness::PARAMETERS;

    const OPTIONAL: &'static [&'static [(usize, f64)]] = MetallicRoughness::OPTIONAL;

    const ROUGHNESS_AND_COAT: Option<(usize, usize)> = MetallicRoughness::ROUGHNESS_AND_COAT;

    fn of(parameters: &[f64]) -> Self {
        let MetallicRoughness { base_color, metallic, roughness, ior, specular_color, clearcoat, clearcoat_roughness } =
            MetallicRoughness::of(parameters);
        let (coat_weight, coat_roughness) = (clearcoat, clearcoat_roughness);
        Self { base_color, metalness: metallic, roughness, ior, specular_color, coat_weight, coat_roughness }
    }

    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>> {
        MetallicRoughness::starts(body, highlight)
    }

    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        self.evaluator()(wi, wo)
    }

    fn evaluator(&self) -> impl Fn(DVec3, DVec3) -> DVec3 + Sync {
        self.evaluator_with(DielectricTint::WholeReflection)
    }
}

/// The part of a dielectric's reflection that [`Layered::specular_color`] multiplies.
#[derive(Clone, Copy, Debug, PartialEq)]
enum DielectricTint {
    /// The reflection at all angles, as in OpenPBR.
    WholeReflection,
    /// The reflection at normal incidence; it is white at grazing angles, as in Cycles.
    NormalIncidence,
}

/// Blender's Principled BSDF (4.0 and later): [`Layered`] with another tint.
///
/// The factor of the dielectric's reflection applies at normal incidence. Towards grazing angles,
/// the reflection becomes white, in proportion to the increase of the Fresnel reflectance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct BlenderPrincipled(pub Layered);

impl Shading for BlenderPrincipled {
    const PARAMETERS: &'static [Parameter] = Layered::PARAMETERS;

    const OPTIONAL: &'static [&'static [(usize, f64)]] = Layered::OPTIONAL;

    const ROUGHNESS_AND_COAT: Option<(usize, usize)> = Layered::ROUGHNESS_AND_COAT;

    fn of(parameters: &[f64]) -> Self {
        Self(Layered::of(parameters))
    }

    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>> {
        Layered::starts(body, highlight)
    }

    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        self.evaluator()(wi, wo)
    }

    fn evaluator(&self) -> impl Fn(DVec3, DVec3) -> DVec3 + Sync {
        self.0.evaluator_with(DielectricTint::NormalIncidence)
    }
}

impl Layered {
    fn evaluator_with(&self, tint: DielectricTint) -> impl Fn(DVec3, DVec3) -> DVec3 + Sync {
        let albedo = Albedo::table().of_roughness(self.roughness);
        let coat_albedo = Albedo::table().of_roughness(self.coat_roughness);
        let (alpha, coat_alpha) = (self.roughness.powi(2), self.coat_roughness.powi(2));
        let f0 = f0_of(self.ior);
        // Reflectance of the dielectric at normal incidence, factor of its whole reflection, and
        // decrease of its reflection at normal incidence.
        let (normal, factor, decrease) = match tint {
            DielectricTint::WholeReflection => (DVec3::splat(f0), self.specular_color, DVec3::ZERO),
            DielectricTint::NormalIncidence => {
                (f0 * self.specular_color, DVec3::ONE, f0 * (DVec3::ONE - self.specular_color))
            }
        };
        let fresnel = f82(self.base_color, self.specular_color);
        move |wi, wo| {
            let Some(facet) = Facet::new(wi, wo) else { return DVec3::ZERO };
            let base_lobe = lobe(&facet, alpha * alpha);
            let [at_zero, at_grazing] = interpolate(&albedo, facet.cos_o);
            // `at_once` is the fraction that a white lobe reflects in one bounce; the rest is
            // reflected in later bounces, multiplied by the colour once more.
            let at_once = at_zero + at_grazing;
            let later = (1.0 - at_once) / at_once;
            let normal_max = normal.max_element();
            let reflected = (normal_max * at_zero + at_grazing).min(1.0) * (1.0 + normal_max * later);
            let real = fresnel_dielectric(facet.cos_d, self.ior);
            // Zero at normal incidence, one at grazing angles.
            let share = if f0 < 1.0 { ((real - f0) / (1.0 - f0)).max(0.0) } else { 0.0 };
            let tinted = DVec3::splat(real) - decrease * (1.0 - share);
            let dielectric = self.base_color * (FRAC_1_PI * (1.0 - reflected).max(0.0))
                + factor * tinted * base_lobe * (DVec3::ONE + normal * later);
            let metal = fresnel(facet.cos_d) * base_lobe * (DVec3::ONE + self.base_color * later);
            let base = dielectric.lerp(metal, self.metalness);
            if self.coat_weight == 0.0 {
                return base;
            }
            let [at_zero, at_grazing] = interpolate(&coat_albedo, facet.cos_o);
            let coat = fresnel_dielectric(facet.cos_d, COAT_IOR) * lobe(&facet, coat_alpha * coat_alpha);
            base * (1.0 - self.coat_weight * (COAT_F0 * at_zero + at_grazing)) + DVec3::splat(self.coat_weight * coat)
        }
    }
}

/// Returns the reflectance of a metal, by the cosine to the half vector: Schlick's formula with a
/// tint at 82 degrees (Kutz et al. 2021, as in OpenPBR).
fn f82(f0: DVec3, tint: DVec3) -> impl Fn(f64) -> DVec3 {
    const COS_82: f64 = 1.0 / 7.0;
    let schlick = move |cos: f64| f0 + (DVec3::ONE - f0) * schlick_weight(cos);
    let shape = |cos: f64| cos * (1.0 - cos).powi(6);
    let dip = schlick(COS_82) * (DVec3::ONE - tint) / shape(COS_82);
    move |cos| (schlick(cos) - dip * shape(cos)).max(DVec3::ZERO)
}

/// Number of entries of [`Albedo`] along each axis.
const ALBEDO_SIDE: usize = 24;

/// Albedo of a GGX lobe in uniform light, by the cosine of the view and the roughness.
///
/// With Schlick's formula, the albedo is `f0 * [0] + [1]`.
struct Albedo(Vec<[f64; 2]>);

impl Albedo {
    fn table() -> &'static Self {
        static TABLE: OnceLock<Albedo> = OnceLock::new();
        TABLE.get_or_init(|| {
            let at = |i: usize| i as f64 / (ALBEDO_SIDE - 1) as f64;
            let each = |i: usize| reflected(at(i % ALBEDO_SIDE).max(0.01), at(i / ALBEDO_SIDE).powi(2).max(1e-3));
            Self((0..ALBEDO_SIDE * ALBEDO_SIDE).map(each).collect())
        })
    }

    /// Interpolates over the roughness; returns the albedo by the cosine of the view.
    fn of_roughness(&self, roughness: f64) -> [[f64; 2]; ALBEDO_SIDE] {
        let (row, share) = position(roughness);
        let entry = |row: usize, at: usize| self.0[row * ALBEDO_SIDE + at];
        std::array::from_fn(|at| mixed(entry(row, at), entry(row + 1, at), share))
    }
}

/// Returns the index of the entry before `x`, 0 to 1, on an axis of [`Albedo`], and the weight of
/// the next entry.
fn position(x: f64) -> (usize, f64) {
    let x = x.clamp(0.0, 1.0) * (ALBEDO_SIDE - 1) as f64;
    let index = (x as usize).min(ALBEDO_SIDE - 2);
    (index, x - index as f64)
}

fn mixed(a: [f64; 2], b: [f64; 2], share: f64) -> [f64; 2] {
    [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
}

/// Interpolates an albedo over the cosine of the view.
fn interpolate(albedo: &[[f64; 2]; ALBEDO_SIDE], cos: f64) -> [f64; 2] {
    let (at, share) = position(cos);
    mixed(albedo[at], albedo[at + 1], share)
}

/// Computes an entry by integration over the visible normals (Heitz 2018).
///
/// The normals lie on a regular grid of the unit square; each contributes `F G2 / G1`.
fn reflected(cos: f64, alpha: f64) -> [f64; 2] {
    const N: usize = 24;
    let view = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let stretched = DVec3::new(alpha * view.x, 0.0, view.z).normalize();
    let first = if stretched.x > 1e-9 { DVec3::new(0.0, 1.0, 0.0) } else { DVec3::X };
    let second = stretched.cross(first);
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    let mut sum = [0.0; 2];
    for i in 0..N * N {
        let (u, v) = (((i % N) as f64 + 0.5) / N as f64, ((i / N) as f64 + 0.5) / N as f64);
        let (r, (sin, cos_phi)) = (u.sqrt(), (TAU * v).sin_cos());
        let x = r * cos_phi;
        let s = 0.5 * (1.0 + stretched.z);
        let y = (1.0 - s) * (1.0 - x * x).max(0.0).sqrt() + s * r * sin;
        let normal = x * first + y * second + (1.0 - x * x - y * y).max(0.0).sqrt() * stretched;
        let half = DVec3::new(alpha * normal.x, alpha * normal.y, normal.z.max(1e-9)).normalize();
        let cos_d = view.dot(half).clamp(0.0, 1.0);
        let light = 2.0 * cos_d * half - view;
        if light.z > 0.0 {
            let weight = (1.0 + lambda(view.z)) / (1.0 + lambda(view.z) + lambda(light.z));
            let grazing = schlick_weight(cos_d);
            sum[0] += weight * (1.0 - grazing);
            sum[1] += weight * grazing;
        }
    }
    sum.map(|s| s / (N * N) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes the albedo in a uniform sky by brute force over directions.
    fn albedo(model: &Layered, cos: f64) -> f64 {
        let view = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
        let (rings, spokes) = (400, 400);
        (0..rings * spokes)
            .map(|i| {
                let z = ((i % rings) as f64 + 0.5) / rings as f64;
                let (s, c) = (TAU * ((i / rings) as f64 + 0.5) / spokes as f64).sin_cos();
                let r = (1.0 - z * z).sqrt();
                model.eval(DVec3::new(r * c, r * s, z), view).x * z * TAU / (rings * spokes) as f64
            })
            .sum()
    }

    #[test]
    fn white_materials_reflect_all_light() {
        // A white metal and a white body under a coat reflect all light.
        for (metalness, roughness, cos) in [(1.0, 0.7, 0.6), (1.0, 1.0, 0.9), (0.0, 0.6, 0.8), (0.0, 0.9, 0.5)] {
            let model = Layered {
                base_color: DVec3::ONE,
                metalness,
                roughness,
                ior: 1.5,
                specular_color: DVec3::ONE,
                coat_weight: 0.0,
                coat_roughness: 0.0,
            };
            let got = albedo(&model, cos);
            assert!((got - 1.0).abs() < 0.02, "{metalness} {roughness} {cos}: {got}");
        }
    }

    #[test]
    fn tint_applies_to_the_metal_at_82_degrees() {
        let (f0, tint) = (DVec3::new(0.9, 0.6, 0.3), DVec3::new(0.5, 0.8, 1.0));
        let fresnel = f82(f0, tint);
        let white = f82(f0, DVec3::ONE);
        assert_eq!(fresnel(1.0), f0);
        assert!((fresnel(1.0 / 7.0) - tint * white(1.0 / 7.0)).length() < 1e-12);
        assert!((white(0.0) - DVec3::ONE).length() < 1e-12);
    }

    #[test]
    fn the_tint_of_blender_fades_towards_grazing_angles() {
        // A lobe without body or coat: the ratio to the white one is the tint.
        let model = |tint: f64| {
            let parameters = [0.0, 0.0, 0.0, 0.0, 0.5, 1.5, tint, tint, tint, 0.0, 0.02];
            (Layered::of(&parameters), BlenderPrincipled::of(&parameters))
        };
        let ((white, white_blender), (tinted, tinted_blender)) = (model(1.0), model(0.2));
        let pair = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            (DVec3::new(sin, 0.0, cos), DVec3::new(-sin, 0.0, cos))
        };
        for degrees in [1.0, 50.0, 88.0] {
            let (wi, wo) = pair(degrees);
            assert_eq!(white.eval(wi, wo), white_blender.eval(wi, wo));
            let real = fresnel_dielectric(wi.z, 1.5);
            let expected = (real - 0.8 * 0.04 * (1.0 - real) / 0.96) / real;
            for (got, expected) in [
                (tinted.eval(wi, wo).x / white.eval(wi, wo).x, 0.2),
                (tinted_blender.eval(wi, wo).x / white_blender.eval(wi, wo).x, expected),
            ] {
                assert!((got / expected - 1.0).abs() < 0.02, "{degrees}: {got}, expected {expected}");
            }
        }
    }

    #[test]
    fn a_coat_adds_its_lobe_and_darkens_the_base() {
        let bare = Layered::of(&[0.3, 0.3, 0.3, 0.0, 0.6, 1.3, 1.0, 1.0, 1.0, 0.0, 0.02]);
        let coated = Layered { coat_weight: 1.0, coat_roughness: 0.15, ..bare };
        let (up, side) = (DVec3::Z, DVec3::new(0.8, 0.0, 0.6));
        assert!(coated.eval(up, up).x > 10.0 * bare.eval(up, up).x);
        let ratio = coated.eval(side, up).x / bare.eval(side, up).x;
        assert!((ratio - 0.96).abs() < 0.01, "{ratio}");
        assert!(albedo(&Layered { base_color: DVec3::ONE, ..coated }, 0.7) < 1.02);
    }

    #[test]
    fn albedo_table_matches_its_entries() {
        for (cos, roughness) in [(0.9_f64, 0.5_f64), (0.4, 0.8)] {
            let got = interpolate(&Albedo::table().of_roughness(roughness), cos);
            let want = reflected(cos, roughness * roughness);
            assert!((got[0] - want[0]).abs() + (got[1] - want[1]).abs() < 0.01, "{got:?} {want:?}");
        }
    }
}
