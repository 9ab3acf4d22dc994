//! Bases below the lobes: diffuse reflection other than Lambert's, and cloth.

use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, PI};

use super::lobes::averaged;
use super::{BivariateTable, Facet, Parametric};

/// Diffuse reflection of rough or smooth surfaces, modelled on measurements (Burley 2012).
///
/// The BRDF is `albedo / pi` times one factor for light and one for view,
/// `1 + (F90 - 1)(1 - cos)^5` with `F90 = 1/2 + 2 roughness cos_d^2`. At grazing angles, smooth
/// surfaces are darker and rough ones brighter, especially in the direction back to the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Burley {
    /// Albedo without the factors, 0 to 1.
    pub albedo: f64,
    /// Roughness, 0 to 1.
    pub roughness: f64,
}

impl Burley {
    fn at(&self, facet: &Facet) -> f64 {
        let excess = 2.0 * self.roughness * facet.cos_d * facet.cos_d - 0.5;
        let factor = |cos: f64| 1.0 + excess * (1.0 - cos).powi(5);
        self.albedo * FRAC_1_PI * factor(facet.cos_i) * factor(facet.cos_o)
    }
}

/// Lambertian reflection below a clear surface, through which light passes on its way in and out.
///
/// The BRDF is `albedo / pi (1 - F_i)(1 - F_o)` with Schlick's `F` at the angles to the normal
/// (Ashikhmin & Shirley 2000 without their factors).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undercoat {
    /// Albedo of the layer below, 0 to 1.
    pub albedo: f64,
    /// Reflectance of the surface along the normal, 0 to 1.
    pub f0: f64,
}

impl Undercoat {
    fn at(&self, facet: &Facet) -> f64 {
        let enters = |cos: f64| (1.0 - self.f0) * (1.0 - (1.0 - cos).powi(5));
        self.albedo * FRAC_1_PI * enters(facet.cos_i) * enters(facet.cos_o)
    }
}

/// Bright rim of cloth with upright fibres (Ashikhmin & Premoze 2007).
///
/// The BRDF is `D / (4 (cos_i + cos_o - cos_i cos_o))` with an inverted Gaussian,
/// `D = (1 + 4 exp(-1 / (width^2 tan^2)) / sin^4) / (pi (1 + 4 width^2))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// Factor of the BRDF.
    pub factor: f64,
    /// Width of the fibres' inclination from upright, above 0 and at most about 1.
    pub width: f64,
}

impl Sheen {
    fn at(&self, facet: &Facet) -> f64 {
        let w2 = self.width * self.width;
        let sin2 = facet.tan2_h / (1.0 + facet.tan2_h);
        // At the normal, the exponential is zero and outweighs the diverging factor.
        let upright = if facet.tan2_h > 1e-12 { (-1.0 / (w2 * facet.tan2_h)).exp() / (sin2 * sin2) } else { 0.0 };
        let distribution = (1.0 + 4.0 * upright) / (PI * (1.0 + 4.0 * w2));
        let spread = 4.0 * (facet.cos_i + facet.cos_o - facet.cos_i * facet.cos_o);
        self.factor * distribution / spread
    }
}

macro_rules! symmetric {
    ($($model:ty),*) => {$(
        impl Parametric for $model {
            fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
                Facet::new(wi, wo).map_or(0.0, |facet| self.at(&facet))
            }

            fn to_bivariate(&self) -> BivariateTable {
                averaged(|facet| self.at(facet))
            }
        }
    )*};
}

symmetric!(Burley, Undercoat, Sheen);

#[cfg(test)]
mod tests {
    use super::super::testing::*;
    use super::super::{HORIZON, PHI_D, directions};
    use super::*;
    use crate::reflectance::{theta_d_of, theta_h_of};

    const RUBBED: Burley = Burley { albedo: 0.6, roughness: 0.8 };
    const BELOW: Undercoat = Undercoat { albedo: 0.5, f0: 0.04 };
    const CLOTH: Sheen = Sheen { factor: 0.7, width: 0.3 };

    #[test]
    fn values_match_closed_forms() {
        let (wi, wo) = directions(0.0, 0.0, 0.0);
        assert!((RUBBED.eval(wi, wo) - 0.6 / PI).abs() < 1e-12);
        assert!((BELOW.eval(wi, wo) - 0.5 * 0.96 * 0.96 / PI).abs() < 1e-12);
        assert!((CLOTH.eval(wi, wo) - 0.7 / (PI * 1.36) / 4.0).abs() < 1e-12);
        // Retro-reflection at 60 degrees: F90 = 2.1, cosines 1/2; tan^2 = 3, sin^4 = 9/16.
        let (wi, wo) = directions(PI / 3.0, 0.0, 0.0);
        assert!((RUBBED.eval(wi, wo) - 0.6 / PI * (1.0 + 1.1 / 32.0_f64).powi(2)).abs() < 1e-12);
        assert!((BELOW.eval(wi, wo) - 0.5 / PI * (0.96 * 31.0 / 32.0_f64).powi(2)).abs() < 1e-12);
        let d = (1.0 + 4.0 * (-1.0_f64 / 0.27).exp() * 16.0 / 9.0) / (PI * 1.36);
        assert!((CLOTH.eval(wi, wo) - 0.7 * d / 3.0).abs() < 1e-12);
    }

    #[test]
    fn tables_are_means_over_phi_d() {
        for model in [&RUBBED as &dyn Parametric, &BELOW, &CLOTH] {
            let table = model.to_bivariate();
            for (i, j) in [(0, 0), (30, 40), (70, 20), (60, 75), (85, 60)] {
                let pairs = (0..PHI_D)
                    .map(|k| directions(theta_h_of(i), theta_d_of(j), (k as f64).to_radians()))
                    .filter(|(wi, wo)| wi.z > HORIZON && wo.z > HORIZON);
                let values: Vec<f64> = pairs.map(|(wi, wo)| model.eval(wi, wo)).collect();
                let want = values.iter().sum::<f64>() / values.len() as f64;
                assert!((f64::from(table.cell(i, j)) - want).abs() < 1e-5 * want, "{i} {j}");
            }
        }
    }

    #[test]
    fn albedo_is_at_most_one() {
        for width in [0.15, 0.3, 0.6, 1.0] {
            for theta in [0.0, 0.6, 1.2, 1.5] {
                let a = albedo(&Sheen { factor: 1.0, width }, theta, 1.0);
                assert!(a <= 1.0 && a > 0.02, "{width} {theta}: {a}");
            }
        }
        assert!(albedo(&Burley { albedo: 1.0, roughness: 0.5 }, 0.3, 1.0) < 1.02);
        assert!(albedo(&Undercoat { albedo: 1.0, f0: 0.04 }, 0.3, 1.0) < 0.96 * 0.96);
    }
}
