//! Pictures of any grey bivariate BRDF under one light, as a matrix.

use rayon::prelude::*;

use super::integrate::{IntegratorSettings, nodes};
use super::tree::LightTree;
use crate::picture::luminance;
use crate::reflectance::{BivariateTable, CELLS};
use crate::transfer::SurfacePoint;

/// The luminance of each of a list of points, as a linear function of the cells of a [`BivariateTable`]: the light of eq. 1 gathered
/// by the half and difference angle it arrives at. A picture costs a sparse product instead of an integration, so that
/// thousands of BRDFs can be seen in one light.
#[derive(Clone, Debug)]
pub struct Relighter {
    /// Where the entries of each point end.
    ends: Vec<usize>,
    cells: Vec<u16>,
    weights: Vec<f32>,
}

impl Relighter {
    /// The matrix for these points under `light`. The light is divided as finely as the sharpest of `examples` needs to
    /// the accuracy of `settings`, each as bright as the others; sharper BRDFs than these are rendered less exactly.
    pub fn new(
        points: &[SurfacePoint],
        examples: &[BivariateTable],
        light: &LightTree,
        settings: &IntegratorSettings,
    ) -> Self {
        let envelope = envelope(examples);
        let rows: Vec<Vec<(u16, f32)>> = points
            .par_iter()
            .map_init(
                || vec![0.0_f64; CELLS],
                |row, point| {
                    for node in &nodes(point, &envelope, light, settings).nodes {
                        let weight = f64::from(luminance(node.weight.as_vec3()));
                        for (cell, share) in BivariateTable::stencil(node.theta_h, node.theta_d) {
                            row[cell] += share * weight;
                        }
                    }
                    let entries = row.iter().enumerate().filter(|(_, w)| **w != 0.0);
                    let entries = entries.map(|(cell, w)| (cell as u16, *w as f32)).collect();
                    row.fill(0.0);
                    entries
                },
            )
            .collect();
        let ends = rows
            .iter()
            .scan(0, |end, row| {
                *end += row.len();
                Some(*end)
            })
            .collect();
        let (cells, weights) = rows.into_iter().flatten().unzip();
        Self { ends, cells, weights }
    }

    /// Luminance of every point for a BRDF.
    pub fn render(&self, brdf: &BivariateTable) -> Vec<f64> {
        let values = brdf.as_slice();
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        let rows = starts.zip(&self.ends).map(|(start, &end)| {
            let entries = self.cells[start..end].iter().zip(&self.weights[start..end]);
            entries.map(|(&cell, &w)| f64::from(w) * f64::from(values[usize::from(cell)])).sum()
        });
        rows.collect()
    }
}

/// The largest of all tables in each cell, each scaled to albedo one.
pub(super) fn envelope(tables: &[BivariateTable]) -> BivariateTable {
    let scales: Vec<f32> = tables.iter().map(|t| (1.0 / t.normal_albedo().max(1e-300)) as f32).collect();
    let cell = |c: usize| tables.iter().zip(&scales).map(|(t, s)| s * t.as_slice()[c]).fold(0.0, f32::max);
    BivariateTable::from_vec((0..CELLS).map(cell).collect())
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::lighting::EnvironmentMap;
    use crate::picture::Plane;
    use crate::render::radiance;
    use crate::sphere::{direction_of_lat_long, fibonacci_hemisphere};

    #[test]
    fn it_shows_what_the_integrator_does() {
        let lamp = DVec3::new(0.4, 0.5, 0.6).normalize();
        let map = EnvironmentMap::new(Plane::from_fn(256, 128, |x, y| {
            let d = direction_of_lat_long((x as f64 + 0.5) / 256.0, (y as f64 + 0.5) / 128.0);
            Vec3::new(0.5, 1.0, 0.7) * if d.angle_between(lamp) < 0.04 { 2000.0 } else { 1.0 + d.y as f32 }
        }))
        .unwrap();
        let tree = LightTree::of_map(&map);
        let points: Vec<SurfacePoint> = fibonacci_hemisphere(40)
            .filter(|n| n.z > 0.2)
            .map(|normal| SurfacePoint { normal, view: DVec3::Z })
            .collect();
        let lobe =
            |width: f64| BivariateTable::from_fn(move |h, d| 0.1 + d + 9.0 / (1.0 + (h / width).powi(2)).powi(2));
        let tables: Vec<BivariateTable> = [0.01, 0.1, 1.0].map(lobe).into();
        let fine = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
        let matrix = Relighter::new(&points, &tables, &tree, &fine);
        for table in &tables {
            for (point, got) in points.iter().zip(matrix.render(table)) {
                let want = f64::from(luminance(radiance(point, table, table, &tree, &fine).as_vec3()));
                assert!((got / want - 1.0).abs() < 5e-3, "{got} {want}");
            }
        }
    }
}
