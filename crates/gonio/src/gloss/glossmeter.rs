//! Simulated reading of a glossmeter on a surface with a given BRDF table.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::reflectance::BivariateTable;
use crate::shading::fresnel_dielectric;

/// Refractive index of the polished black glass that reads 100.
const GLASS: f64 = 1.567;

/// Angular size (degrees) of the image of the source in the plane of incidence and across it.
const SOURCE: (f64, f64) = (0.75, 2.5);

/// Number of steps over the receptor in the plane of incidence, and over half of it across. The
/// steps are densest around the mirror direction, where highlights are narrow.
const RECEPTOR_STEPS: (usize, usize) = (240, 120);

/// Glossmeter according to ASTM D523 (ISO 2813).
///
/// A collimated beam illuminates the surface at an angle to the normal. The reading is the light
/// that enters a receptor around the mirror direction, relative to polished black glass of
/// refractive index 1.567, times 100.
///
/// The image of the source spans 0.75 by 2.5 degrees (in the plane of incidence by across it). The
/// receptor is offset relative to the mirror direction of each source point; the angle of incidence
/// is the nominal one for all of them.
#[derive(Clone, Debug)]
pub struct Glossmeter {
    /// The reading is the sum over cells of weight times value.
    weights: Vec<(usize, f64)>,
}

impl Glossmeter {
    /// Returns a glossmeter at 20 degrees, for glossy surfaces (receptor of 1.8 by 3.6 degrees).
    pub fn at_20() -> Self {
        Self::new(20.0, (1.8, 3.6))
    }

    /// Returns a glossmeter at 60 degrees, for all surfaces (receptor of 4.4 by 11.7 degrees).
    pub fn at_60() -> Self {
        Self::new(60.0, (4.4, 11.7))
    }

    /// `receptor` is its angular size (degrees) in the plane of incidence and across it.
    fn new(degrees: f64, receptor: (f64, f64)) -> Self {
        let incidence = f64::to_radians(degrees);
        let light = DVec3::new(-incidence.sin(), 0.0, incidence.cos());
        let scale = 100.0 / fresnel_dielectric(incidence.cos(), GLASS);
        let (along, across) = (Window::new(SOURCE.0, receptor.0), Window::new(SOURCE.1, receptor.1));
        let mut weights = BTreeMap::new();
        for (u, du) in along.nodes(RECEPTOR_STEPS.0) {
            // The other half across the plane of incidence is symmetric, hence the factor of two.
            for (v, dv) in across.nodes(2 * RECEPTOR_STEPS.1).filter(|node| node.0 > 0.0) {
                let (sin, cos) = (incidence + u).sin_cos();
                let view = DVec3::new(sin * v.cos(), v.sin(), cos * v.cos());
                let sum = light + view;
                let theta_h = sum.x.hypot(sum.y).atan2(sum.z);
                let theta_d = (0.5 * sum.length()).min(1.0).acos();
                let weight = 2.0 * scale * view.z * v.cos() * du * dv;
                for (cell, share) in BivariateTable::stencil(theta_h, theta_d) {
                    *weights.entry(cell).or_insert(0.0) += weight * share;
                }
            }
        }
        Self { weights: weights.into_iter().collect() }
    }

    /// Returns the gloss units of a table, which are proportional to its scale (its albedo).
    pub fn read(&self, table: &BivariateTable) -> f64 {
        self.weights.iter().map(|(cell, weight)| weight * f64::from(table.as_slice()[*cell])).sum()
    }
}

/// Offsets from the mirror direction along one axis, radians.
struct Window {
    /// Half of the angular size of the source.
    source: f64,
    /// Half of the angular size of the receptor.
    receptor: f64,
}

impl Window {
    fn new(source: f64, receptor: f64) -> Self {
        Self { source: 0.5 * source.to_radians(), receptor: 0.5 * receptor.to_radians() }
    }

    /// Returns the share of source points whose light enters the receptor.
    ///
    /// `offset` is the angle between the light and its mirror direction.
    fn share(&self, offset: f64) -> f64 {
        let (low, high) = (-self.receptor - offset, self.receptor - offset);
        ((high.min(self.source) - low.max(-self.source)) / (2.0 * self.source)).clamp(0.0, 1.0)
    }

    /// Offsets with their widths, weighted by [`Self::share`].
    fn nodes(&self, steps: usize) -> impl Iterator<Item = (f64, f64)> + '_ {
        let reach = self.source + self.receptor;
        (0..steps).map(move |step| {
            let t = 2.0 * (step as f64 + 0.5) / steps as f64 - 1.0;
            let offset = reach * t.powi(3);
            (offset, self.share(offset) * 3.0 * reach * t * t * 2.0 / steps as f64)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflectance::parametric::{Ggx, Lambert, Parametric};
    use std::f64::consts::PI;

    /// Black glass whose facets have a Gaussian slope distribution of width `m`.
    fn glass(m: f64) -> BivariateTable {
        BivariateTable::from_fn(|h, d| {
            let normals = (-(h.tan() / m).powi(2)).exp() / (PI * m * m * h.cos().powi(4));
            fresnel_dielectric(d.cos(), GLASS) * normals / (4.0 * d.cos().powi(2))
        })
    }

    #[test]
    fn black_glass_reads_a_hundred() {
        // All light falls within the receptor. Linear interpolation between the samples of the
        // table enlarges narrow lobes: one of 0.09 degrees by 12 %, one of twice that width by 5 %.
        for (m, most) in [(0.0015, 0.12), (0.003, 0.06)] {
            let table = glass(m);
            for (meter, degrees) in [(Glossmeter::at_20(), 20.0_f64), (Glossmeter::at_60(), 60.0)] {
                let d = degrees.to_radians();
                let steps = 20_000;
                let held: f64 = (0..steps)
                    .map(|i| {
                        let (h, dh) = ((f64::from(i) + 0.5) * 0.02 / f64::from(steps), 0.02 / f64::from(steps));
                        let normals = table.eval(h, d) * 4.0 * d.cos().powi(2) / fresnel_dielectric(d.cos(), GLASS);
                        2.0 * PI * normals * h.cos() * h.sin() * dh
                    })
                    .sum();
                let got = meter.read(&table) / 100.0;
                assert!((got / held - 1.0).abs() < 0.015, "{m} {degrees}: {got} {held}");
                assert!((got - 1.0).abs() < most, "{m} {degrees}: {got}");
            }
        }
    }

    #[test]
    fn glass_reflectance_matches_the_standard() {
        for (degrees, want) in [(20.0_f64, 0.0491), (60.0, 0.1001)] {
            assert!((fresnel_dielectric(degrees.to_radians().cos(), GLASS) - want).abs() < 1e-4);
        }
    }

    #[test]
    fn lambertian_reading_matches_the_solid_angle_of_the_receptor() {
        // At 60 degrees, the receptor spans 4.4 x 11.7 degrees, at a cosine of about one half.
        let want = |degrees: f64, (along, across): (f64, f64), fresnel: f64| {
            100.0 * 0.5 / PI * along.to_radians() * across.to_radians() * degrees.to_radians().cos() / fresnel
        };
        let chalk = Lambert { albedo: 0.5 }.to_bivariate();
        for (meter, want) in [
            (Glossmeter::at_20(), want(20.0, (1.8, 3.6), 0.0491)),
            (Glossmeter::at_60(), want(60.0, (4.4, 11.7), 0.1001)),
        ] {
            assert!((meter.read(&chalk) / want - 1.0).abs() < 0.01, "{} {want}", meter.read(&chalk));
        }
    }

    #[test]
    fn reading_of_a_lobe_matches_quadrature() {
        let lobe = Ggx { diffuse: 0.05, f0: 0.05, alpha: 0.04 };
        let table = lobe.to_bivariate();
        let directions = |incidence: f64, (u, v): (f64, f64)| {
            DVec3::new((incidence + u).sin() * v.cos(), v.sin(), (incidence + u).cos() * v.cos())
        };
        for (meter, degrees, receptor) in
            [(Glossmeter::at_20(), 20.0_f64, (1.8, 3.6)), (Glossmeter::at_60(), 60.0, (4.4, 11.7))]
        {
            let incidence = degrees.to_radians();
            // Midpoints of a uniform grid over a rectangle.
            let grid = |(along, across): (f64, f64), n: usize| -> Vec<(f64, f64)> {
                let at = |k: usize, span: f64| ((k as f64 + 0.5) / n as f64 - 0.5) * span.to_radians();
                (0..n * n).map(|k| (at(k % n, along), at(k / n, across))).collect()
            };
            let (source, receptor_grid) = (grid(SOURCE, 8), grid(receptor, 80));
            let solid = receptor.0.to_radians() * receptor.1.to_radians() / receptor_grid.len() as f64;
            let (mut light, mut mirrored) = (0.0, 0.0);
            for from in &source {
                let towards = directions(incidence, *from);
                let wi = DVec3::new(-towards.x, -towards.y, towards.z);
                mirrored += wi.z * fresnel_dielectric(wi.z, GLASS);
                for to in &receptor_grid {
                    let wo = directions(incidence, *to);
                    light += lobe.eval(wi, wo) * wi.z * wo.z * to.1.cos() * solid;
                }
            }
            let (want, got) = (100.0 * light / mirrored, meter.read(&table));
            assert!((got / want - 1.0).abs() < 0.02, "{degrees}: {got} {want}");
        }
    }

    #[test]
    fn readings_are_proportional_to_the_table() {
        let (meter, table) = (Glossmeter::at_60(), Ggx { diffuse: 0.1, f0: 0.04, alpha: 0.2 }.to_bivariate());
        assert!((meter.read(&table.scaled(3.0)) / meter.read(&table) - 3.0).abs() < 1e-5);
    }
}
