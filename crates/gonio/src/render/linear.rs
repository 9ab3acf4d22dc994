//! Pictures of any bivariate BRDF under one light, as a sparse matrix.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::integrate::{IntegratorSettings, Nodes, nodes, nodes_within};
use super::surface::PENUMBRA;
use super::tree::LightTree;
use crate::picture::luminance;
use crate::reflectance::{BivariateTable, CELLS};
#[cfg(doc)]
use crate::shape::Hit;
use crate::shape::{Points, Surface, SurfacePoint};

/// Luminance of a list of points as a linear function of the cells of a [`BivariateTable`].
///
/// The matrix contains the light of eq. 1, sorted by the half and difference angle at which it
/// arrives. A picture then costs a sparse product instead of an integration, so that thousands of
/// BRDFs can be rendered in one light.
#[derive(Clone, Debug)]
pub struct Relighter {
    /// Index of the end of each point's entries.
    ends: Vec<usize>,
    cells: Vec<u16>,
    weights: Vec<f32>,
}

impl Relighter {
    /// Computes the matrix for these points under `light`.
    ///
    /// The light is divided as finely as the sharpest of `examples`, each scaled to the same
    /// albedo, requires for the accuracy of `settings`. Sharper BRDFs are rendered less accurately.
    pub fn new<'a>(
        points: impl Into<Points<'a>>,
        examples: &[BivariateTable],
        light: &LightTree,
        settings: &IntegratorSettings,
    ) -> Self {
        let points = points.into();
        let divided = divided(points, examples, light, settings);
        let [matrix] = Self::gathered(points.len(), divided, |radiance| [f64::from(luminance(radiance))]);
        matrix
    }

    /// Computes the matrix like [`Self::new`], for points of a surface with self-shadowing.
    ///
    /// `clear` gives the origin of the rays from each point ([`Hit::ray_origin`]).
    ///
    /// # Panics
    /// If points and origins differ in number.
    pub fn of_surface(
        points: &[SurfacePoint],
        (surface, clear): (&dyn Surface, &[DVec3]),
        examples: &[BivariateTable],
        light: &LightTree,
        settings: &IntegratorSettings,
    ) -> Self {
        assert_eq!(points.len(), clear.len());
        let envelope = envelope(examples);
        let divided = |at: usize| {
            let mut nodes = nodes_within(&points[at], &envelope, light, settings, PENUMBRA);
            nodes.shadow(&envelope, |directions| surface.blocked(clear[at], directions));
            nodes
        };
        let [matrix] = Self::gathered(points.len(), divided, |radiance| [f64::from(luminance(radiance))]);
        matrix
    }

    /// Computes one matrix per channel of the light (red, green, blue), like [`Self::new`].
    ///
    /// Each matrix gives the reflection of one channel of the light by the same channel of a BRDF.
    pub fn of_channels<'a>(
        points: impl Into<Points<'a>>,
        examples: &[BivariateTable],
        light: &LightTree,
        settings: &IntegratorSettings,
    ) -> [Self; 3] {
        let points = points.into();
        let divided = divided(points, examples, light, settings);
        Self::gathered(points.len(), divided, |radiance| radiance.as_dvec3().to_array())
    }

    /// Returns the matrix with each weight replaced by `weight(cell, weight)`.
    pub(crate) fn map(&self, weight: impl Fn(usize, f32) -> f32) -> Self {
        let weights = self.cells.iter().zip(&self.weights).map(|(cell, w)| weight(usize::from(*cell), *w)).collect();
        Self { ends: self.ends.clone(), cells: self.cells.clone(), weights }
    }

    /// Returns the rows of the given points.
    pub(crate) fn select(&self, points: &[usize]) -> Self {
        let mut some = Self { ends: Vec::with_capacity(points.len()), cells: Vec::new(), weights: Vec::new() };
        for &point in points {
            some.append(self.row(point));
        }
        some
    }

    /// Appends a row.
    fn append(&mut self, row: impl Iterator<Item = (usize, f32)>) {
        for (cell, weight) in row {
            self.cells.push(cell as u16);
            self.weights.push(weight);
        }
        self.ends.push(self.cells.len());
    }

    /// Returns the sum of this matrix and `factor` times another one for the same points.
    ///
    /// # Panics
    /// If the matrices differ in the number of points.
    pub(crate) fn plus(&self, other: &Self, factor: f64) -> Self {
        assert_eq!(self.len(), other.len());
        let mut sum = Self { ends: Vec::with_capacity(self.len()), cells: Vec::new(), weights: Vec::new() };
        for point in 0..self.len() {
            let scaled = other.row(point).map(|(cell, weight)| (cell, (factor * f64::from(weight)) as f32));
            sum.append(self.row(point).chain(scaled));
        }
        sum
    }

    /// Computes one matrix for each number that `measure` derives from the light.
    ///
    /// `divided` returns the light at each of `count` points.
    fn gathered<const N: usize>(
        count: usize,
        divided: impl Fn(usize) -> Nodes + Sync,
        measure: impl Fn(Vec3) -> [f64; N] + Sync,
    ) -> [Self; N] {
        let rows: Vec<Vec<(u16, [f32; N])>> = (0..count)
            .into_par_iter()
            .map_init(
                || vec![[0.0_f64; N]; CELLS],
                |row, at| {
                    for node in &divided(at).nodes {
                        let weights = measure(node.weight.as_vec3());
                        for (cell, share) in BivariateTable::stencil(node.theta_h, node.theta_d) {
                            row[cell].iter_mut().zip(weights).for_each(|(sum, weight)| *sum += share * weight);
                        }
                    }
                    let entries = row.iter().enumerate().filter(|(_, w)| w.iter().any(|w| *w != 0.0));
                    let entries = entries.map(|(cell, w)| (cell as u16, w.map(|w| w as f32))).collect();
                    row.fill([0.0; N]);
                    entries
                },
            )
            .collect();
        let ends: Vec<usize> = rows
            .iter()
            .scan(0, |end, row| {
                *end += row.len();
                Some(*end)
            })
            .collect();
        std::array::from_fn(|n| {
            let (cells, weights) = rows.iter().flatten().map(|(cell, w)| (*cell, w[n])).unzip();
            Self { ends: ends.clone(), cells, weights }
        })
    }

    /// Returns the number of points.
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Returns cells and weights of a point.
    pub(crate) fn row(&self, point: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = if point == 0 { 0 } else { self.ends[point - 1] }..self.ends[point];
        self.cells[range.clone()].iter().map(|cell| usize::from(*cell)).zip(self.weights[range].iter().copied())
    }

    /// Returns the luminance of every point for a BRDF.
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

/// Returns the maximum over all tables in each cell, with each table scaled to albedo one.
pub(super) fn envelope(tables: &[BivariateTable]) -> BivariateTable {
    let scales: Vec<f32> = tables.iter().map(|t| (1.0 / t.normal_albedo().max(1e-300)) as f32).collect();
    let cell = |c: usize| tables.iter().zip(&scales).map(|(t, s)| s * t.as_slice()[c]).fold(0.0, f32::max);
    BivariateTable::from_vec((0..CELLS).map(cell).collect())
}

/// Returns a function that divides the visible part of the light at each point.
fn divided<'a>(
    Points { points, visibility }: Points<'a>,
    examples: &[BivariateTable],
    light: &'a LightTree,
    settings: &'a IntegratorSettings,
) -> impl Fn(usize) -> Nodes + Sync + 'a {
    let envelope = envelope(examples);
    move |at| match visibility {
        None => nodes(&points[at], &envelope, light, settings),
        Some(visibility) => {
            let mut nodes = nodes_within(&points[at], &envelope, light, settings, PENUMBRA);
            for node in &mut nodes.nodes {
                node.weight *= f64::from(visibility.share_along(at, node.direction));
            }
            nodes
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lighting::EnvironmentMap;
    use crate::picture::Plane;
    use crate::render::radiance;
    use crate::sphere::direction_of_lat_long;
    use crate::testing::ball;

    #[test]
    fn matches_the_integrator() {
        let lamp = DVec3::new(0.4, 0.5, 0.6).normalize();
        let map = EnvironmentMap::new(Plane::from_fn(256, 128, |x, y| {
            let d = direction_of_lat_long((x as f64 + 0.5) / 256.0, (y as f64 + 0.5) / 128.0);
            Vec3::new(0.5, 1.0, 0.7) * if d.angle_between(lamp) < 0.04 { 2000.0 } else { 1.0 + d.y as f32 }
        }))
        .unwrap();
        let tree = LightTree::of_map(&map);
        let points: Vec<SurfacePoint> = ball(40).into_iter().filter(|p| p.normal.z > 0.2).collect();
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
        // The luminance of the channels' matrices equals that of the luminance matrix, and the
        // channels have the ratios of the light.
        let channels = Relighter::of_channels(&points, &tables, &tree, &fine).map(|m| m.render(&tables[1]));
        for (i, grey) in matrix.render(&tables[1]).into_iter().enumerate() {
            let colour = Vec3::from_array([0, 1, 2].map(|c| channels[c][i] as f32));
            assert!((f64::from(luminance(colour)) / grey - 1.0).abs() < 1e-5, "{colour} {grey}");
            assert!((colour.x / colour.y - 0.5).abs() < 1e-5 && (colour.z / colour.y - 0.7).abs() < 1e-5, "{colour}");
        }
    }
}
