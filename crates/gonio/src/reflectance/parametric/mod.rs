//! Parametric BRDF models: isotropic, in 1/sr, for one channel.
//!
//! They are GGX, Lambert, the three models fitted by Ngan, Durand & Matusik 2005, with which
//! section 3.2 of the paper compares, and the models from which dictionaries of materials are
//! mixed.
//!
//! Light and view are unit vectors around the normal `+z`. The BRDF is zero if either is below the
//! surface.

mod bases;
mod cook_torrance;
mod ggx;
mod lafortune;
mod lobes;
mod ward;

pub use bases::{Burley, Sheen, Undercoat};
pub use cook_torrance::CookTorrance;
pub use ggx::Ggx;
pub use lafortune::Lafortune;
pub use lobes::lobes;
pub use ward::Ward;

pub(crate) use ggx::{distribution, lobe};

use super::table::{BivariateTable, CELLS, MerlTable, PHI_D, THETA_D, angles_of, theta_d_of, theta_h_of};
use crate::parallel;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_1_PI;

/// Cosine below which a sample of the grid counts as on the horizon.
///
/// There, results depend on round-off, and models that divide by the cosines have a pole.
pub(crate) const HORIZON: f64 = 1e-9;

/// An isotropic BRDF given by a formula.
pub trait Parametric: Sync {
    /// Returns the value in 1/sr.
    ///
    /// `wi` and `wo` are unit vectors towards the light and the viewer; the normal is `+z`.
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64;

    /// Returns the mean over the `phi_d` samples of the MERL grid.
    ///
    /// Only samples with light and view above the surface count, as in
    /// [`MerlTable::bivariate`](super::MerlTable::bivariate).
    fn to_bivariate(&self) -> BivariateTable {
        let [table] = azimuth_means(1, |wi, wo| [self.eval(wi, wo)]);
        table
    }
}

/// Returns the means of several values over every `step`-th `phi_d` sample of the MERL grid.
///
/// Only samples with light and view above the surface count; without such samples, the mean is
/// zero.
pub(crate) fn azimuth_means<const N: usize>(
    step: usize,
    values: impl Fn(DVec3, DVec3) -> [f64; N] + Sync,
) -> [BivariateTable; N] {
    let cell = |c: usize| {
        let (h, d) = angles_of(c);
        let (mut sum, mut count) = ([0.0; N], 0_u32);
        for k in (0..PHI_D).step_by(step) {
            let (wi, wo) = directions(h, d, (k as f64).to_radians());
            if wi.z > HORIZON && wo.z > HORIZON {
                sum.iter_mut().zip(values(wi, wo)).for_each(|(sum, value)| *sum += value);
                count += 1;
            }
        }
        sum.map(|sum| if count > 0 { (sum / f64::from(count)) as f32 } else { 0.0 })
    };
    let cells: Vec<[f32; N]> = parallel::map_range(CELLS, cell);
    std::array::from_fn(|which| BivariateTable::from_vec(cells.iter().map(|cell| cell[which]).collect()))
}

/// Returns the MERL table of a BRDF, with missing values (-1) below the horizon.
///
/// `brdf` returns RGB values in 1/sr for unit vectors towards the light and the viewer; the normal
/// is `+z`. It is evaluated at the directions of the cells.
pub fn full_table(brdf: impl Fn(DVec3, DVec3) -> [f64; 3] + Sync) -> MerlTable {
    let cell = |at: usize| {
        let (c, k) = (at / PHI_D, at % PHI_D);
        let (wi, wo) = directions(theta_h_of(c / THETA_D), theta_d_of(c % THETA_D), (k as f64).to_radians());
        if wi.z > HORIZON && wo.z > HORIZON { brdf(wi, wo).map(|v| v as f32) } else { [-1.0; 3] }
    };
    let cells: Vec<[f32; 3]> = parallel::map_range(MerlTable::CHANNEL, cell);
    MerlTable::from_channels([0, 1, 2].map(|channel| cells.iter().map(|rgb| rgb[channel]).collect()))
}

/// Returns the unit vectors `(wi, wo)` of a half/difference direction (Rusinkiewicz 1998).
///
/// Angles are in radians. The half vector is in the plane `y = 0`.
pub fn directions(theta_h: f64, theta_d: f64, phi_d: f64) -> (DVec3, DVec3) {
    let (sh, ch) = theta_h.sin_cos();
    let (sd, cd) = theta_d.sin_cos();
    let (sp, cp) = phi_d.sin_cos();
    // The light relative to the half vector, rotated by theta_h about y; the view is its mirror
    // image.
    let turned = |x: f64, y: f64| DVec3::new(ch * x + sh * cd, y, ch * cd - sh * x);
    (turned(sd * cp, sd * sp), turned(-sd * cp, -sd * sp))
}

/// Half/difference quantities of a pair of directions, as used in microfacet formulas.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facet {
    pub(crate) cos_i: f64,
    pub(crate) cos_o: f64,
    /// Cosine between the normal and the half vector.
    pub(crate) cos_h: f64,
    /// Cosine between either direction and the half vector.
    pub(crate) cos_d: f64,
    pub(crate) tan2_h: f64,
}

impl Facet {
    /// Computes the quantities; `None` unless light and view are above the surface.
    pub(crate) fn new(wi: DVec3, wo: DVec3) -> Option<Self> {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return None;
        }
        let sum = wi + wo;
        let half = sum.normalize();
        // Computed from x and y, since 1 - cos^2 would be inaccurate in narrow peaks.
        let tan2_h = (half.x * half.x + half.y * half.y) / (half.z * half.z);
        Some(Self { cos_i: wi.z, cos_o: wo.z, cos_h: half.z, cos_d: (0.5 * sum.length()).min(1.0), tan2_h })
    }

    /// Returns the Fresnel reflectance `f0 + (1 - f0) (1 - cos_d)^5` (Schlick 1994).
    pub(crate) fn schlick(&self, f0: f64) -> f64 {
        f0 + (1.0 - f0) * (1.0 - self.cos_d).powi(5)
    }
}

/// Lambert's constant BRDF, `albedo / pi`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lambert {
    /// Albedo, 0 to 1.
    pub albedo: f64,
}

impl Parametric for Lambert {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        if wi.z > 0.0 && wo.z > 0.0 { self.albedo * FRAC_1_PI } else { 0.0 }
    }
}

#[cfg(test)]
mod testing {
    use super::*;

    /// Computes the directional albedo, the integral of `f cos_i` over the light.
    ///
    /// The quadrature is around the mirror direction: the half vector is sampled as
    /// `tan^2 = a^2 u / (1 - u)`.
    pub(super) fn albedo(model: &impl Parametric, theta_o: f64, a: f64) -> f64 {
        let (n_u, n_phi) = (800, 400);
        let wo = DVec3::new(theta_o.sin(), 0.0, theta_o.cos());
        let mut sum = 0.0;
        for i in 0..n_u {
            let u = (i as f64 + 0.5) / n_u as f64;
            let tan2 = a * a * u / (1.0 - u);
            let cos_h = 1.0 / (1.0 + tan2).sqrt();
            let sin_h = cos_h * tan2.sqrt();
            for j in 0..n_phi {
                let phi = (j as f64 + 0.5) / n_phi as f64 * std::f64::consts::TAU;
                let half = DVec3::new(sin_h * phi.cos(), sin_h * phi.sin(), cos_h);
                let cos_d = half.dot(wo);
                let wi = 2.0 * cos_d * half - wo;
                if cos_d <= 0.0 || wi.z <= 0.0 {
                    continue;
                }
                // Density of the half vector over solid angle; that of the light is smaller by 4
                // cos_d.
                let density = a * a / (a * a + tan2).powi(2) / (std::f64::consts::PI * cos_h.powi(3));
                sum += model.eval(wi, wo) * wi.z * 4.0 * cos_d / density;
            }
        }
        sum / (n_u * n_phi) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::testing::*;
    use super::*;

    #[test]
    fn directions_have_the_given_angles() {
        let (h, d, phi) = (0.6, 0.8, 2.2);
        let (wi, wo) = directions(h, d, phi);
        let half = (wi + wo).normalize();
        assert!((wi.length() - 1.0).abs() < 1e-14 && (wo.length() - 1.0).abs() < 1e-14);
        assert!((half - DVec3::new(h.sin(), 0.0, h.cos())).length() < 1e-14);
        assert!((half.dot(wi) - d.cos()).abs() < 1e-14);
        for (h, d, phi) in [(0.6, 0.8, 2.2), (1.4, 1.2, 0.3), (1.3, 1.3, 1.6)] {
            let (wi, wo) = directions(h, d, phi);
            assert_eq!(super::super::table::above_horizon(h, d, phi), wi.z > 0.0 && wo.z > 0.0);
        }
    }

    #[test]
    fn models_are_reciprocal_and_zero_below_the_surface() {
        let models: [&dyn Parametric; 8] = [
            &Lambert { albedo: 0.4 },
            &Burley { albedo: 0.6, roughness: 0.8 },
            &Undercoat { albedo: 0.5, f0: 0.04 },
            &Sheen { factor: 0.7, width: 0.3 },
            &CookTorrance { diffuse: 0.2, specular: 0.3, f0: 0.1, roughness: 0.25 },
            &Ggx { diffuse: 0.1, f0: 0.04, alpha: 0.2 },
            &Lafortune { diffuse: 0.1, specular: 0.3, cxy: -0.6, cz: 0.5, exponent: 12.0 },
            &Ward { diffuse: 0.2, specular: 0.3, roughness: 0.2 },
        ];
        for (at, model) in models.into_iter().enumerate() {
            for i in 0..64 {
                let h = [0.0, 0.2, 0.7, 1.2][i / 16];
                let (d, phi) = ([0.0, 0.4, 1.0, 1.4][i / 4 % 4], [0.0, 0.9, 2.0, 3.0][i % 4]);
                let (wi, wo) = directions(h, d, phi);
                let (there, back) = (model.eval(wi, wo), model.eval(wo, wi));
                assert!((there - back).abs() <= 1e-12 * there.abs(), "{at}: {h} {d} {phi}: {there} {back}");
                assert!(there >= 0.0 && (there == 0.0 || (wi.z > 0.0 && wo.z > 0.0)), "{at}: {h} {d} {phi}");
            }
        }
    }

    #[test]
    fn lambert_is_constant_and_has_its_albedo() {
        let model = Lambert { albedo: 0.4 };
        let table = model.to_bivariate();
        assert!(table.as_slice().iter().all(|v| (f64::from(*v) - 0.4 * FRAC_1_PI).abs() < 1e-7));
        assert!((albedo(&model, 0.5, 0.7) - 0.4).abs() < 1e-3, "{}", albedo(&model, 0.5, 0.7));
    }
}
