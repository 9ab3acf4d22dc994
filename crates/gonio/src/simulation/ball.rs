//! Fast rendering of a ball of many materials under one light.
//!
//! Training of the posterior gathers thousands of lights, each as a matrix from tables to pictures.
//! Here the light at a point is sampled at half vectors, in rings about its normal that are as fine
//! as the table, and each sample is the mean over its own solid angle (prefiltered importance
//! sampling, Colbert & Krivanek 2007). That is a hundred times faster than
//! [`Relighter`](crate::render::Relighter) and agrees with it within some percent.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use glam::Vec3;
use rayon::prelude::*;

use super::gather::{Gather, LANES, LampBlock, RingBlock, RingSample};
use super::pyramid::LightPyramid;
use crate::reflectance::{BivariateTable, CELLS, THETA_D, THETA_H};
use crate::render::pyramid::{Part, level};
use crate::transfer::kernels::dispatch;

/// Number of rings of half vectors about a normal, even in the square root of the angle like the
/// rows of a table.
const RINGS: usize = 90;

/// Least and largest number of samples of a ring.
const SPOKES: (f32, f32) = (8.0, 44.0);

/// Typical cosine of the difference angle, used to choose levels.
const TYPICAL: f64 = 0.8;

/// Number of points that are gathered before they are multiplied with the tables.
const CHUNK: usize = 24;

/// Half vectors about a normal along z, for rendering balls.
#[derive(Clone, Debug)]
pub struct BallRenderer {
    near: Vec<RingBlock>,
    far: Vec<RingBlock>,
    /// Number of rows of a table that the near rings reach.
    near_rows: usize,
}

/// Half angles in degrees between which lamps change from samples, which show their shape in a
/// sharp highlight, to points, which are exact in a wide one.
const NEAR: (f32, f32) = (3.0, 6.0);

/// Group of rings about a normal: half angles below three degrees, or beyond six; those between
/// have a share in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rings {
    /// Rings that show sharp highlights, with lamps as samples.
    Near,
    /// Rings whose content changes little over a degree, with lamps added one by one.
    Far,
}

/// Returns the share of the far rings, and of the lamps that are points, at a half angle in
/// degrees.
#[inline(always)]
pub(super) fn counted(theta_h: f32) -> f32 {
    ((theta_h - NEAR.0) / (NEAR.1 - NEAR.0)).clamp(0.0, 1.0)
}

impl Default for BallRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl BallRenderer {
    /// Builds the rings.
    pub fn new() -> Self {
        let (mut near, mut far, mut near_rows) = (Vec::new(), Vec::new(), 0);
        let right = std::f64::consts::FRAC_PI_2;
        for ring in 0..RINGS {
            let edge = |r: usize| (r as f64 / RINGS as f64).powi(2) * right;
            // The middle is taken in the root of the angle, in which tables are linear.
            let root = (ring as f64 + 0.5) / RINGS as f64;
            let theta = root * root * right;
            let (low, high) = (edge(ring), edge(ring + 1));
            let wanted = std::f64::consts::TAU * theta.sin() / (high - low);
            let spokes = wanted.clamp(f64::from(SPOKES.0), f64::from(SPOKES.1)).round() as usize;
            let solid_angle = std::f64::consts::TAU * (low.cos() - high.cos()) / spokes as f64;
            let place = (root * THETA_H as f64).min((THETA_H - 1) as f64 - 1e-6);
            for spoke in 0..spokes {
                // Rings are turned against each other by the golden section.
                let phi = std::f64::consts::TAU * ((spoke as f64 + 0.5) / spokes as f64 + 0.618_034 * ring as f64);
                let half =
                    Vec3::new((theta.sin() * phi.cos()) as f32, (theta.sin() * phi.sin()) as f32, theta.cos() as f32);
                let row = place as usize * THETA_D;
                let level = level(LightPyramid::SIDE, 4.0 * TYPICAL * solid_angle);
                let far_share = counted(theta.to_degrees() as f32);
                let sample = |share: f32| RingSample {
                    half,
                    solid_angle: share * solid_angle as f32,
                    row,
                    beyond: place.fract() as f32,
                    level,
                };
                if far_share < 1.0 {
                    near.push(sample(1.0 - far_share));
                    near_rows = row / THETA_D + 2;
                }
                if far_share > 0.0 {
                    far.push(sample(far_share));
                }
            }
        }
        let blocks = |samples: Vec<RingSample>| samples.chunks(LANES).map(RingBlock::of).collect();
        Self { near: blocks(near), far: blocks(far), near_rows }
    }

    /// Renders the luminance of points with these normals, seen from +z, for each of the tables and
    /// one group of rings: `[table][point]`. The sum over both groups is the full picture.
    pub fn render(
        &self,
        normals: &[Vec3],
        tables: &[BivariateTable],
        light: &LightPyramid,
        rings: Rings,
    ) -> Vec<Vec<f32>> {
        // Near rings need only the first rows of the tables.
        let (blocks, lamps, part, cells) = match rings {
            Rings::Near => (&self.near, Vec::new(), Part::All, self.near_rows * THETA_D),
            Rings::Far => (&self.far, LampBlock::all(light), Part::Even, CELLS),
        };
        let mut matrix = Vec::with_capacity(tables.len() * cells);
        tables.iter().for_each(|t| matrix.extend_from_slice(&t.as_slice()[..cells]));
        let tables_as_columns = MatRef::from_column_major_slice(&matrix, cells, tables.len());
        let parts: Vec<Vec<f32>> = normals
            .par_chunks(CHUNK)
            .map_init(
                || vec![0.0_f32; CHUNK * cells],
                |rows, normals| {
                    let rows = &mut rows[..normals.len() * cells];
                    rows.fill(0.0);
                    dispatch(Gather { rings: blocks, lamps: &lamps, light: &light.0, part, normals, rows, cells });
                    let mut out = vec![0.0_f32; normals.len() * tables.len()];
                    let product = MatMut::from_column_major_slice_mut(&mut out, normals.len(), tables.len());
                    let rows = MatRef::from_row_major_slice(rows, normals.len(), cells);
                    matmul(product, Accum::Replace, rows, tables_as_columns, 1.0, Par::Seq);
                    out
                },
            )
            .collect();
        let mut pictures = vec![Vec::with_capacity(normals.len()); tables.len()];
        for (part, normals) in parts.iter().zip(normals.chunks(CHUNK)) {
            for (picture, values) in pictures.iter_mut().zip(part.chunks_exact(normals.len())) {
                picture.extend_from_slice(values);
            }
        }
        pictures
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::render::{IntegratorSettings, LightTree, Relighter};
    use crate::shape::SurfacePoint;
    use crate::testing::{ball, light_map};

    #[test]
    fn it_shows_what_the_integrator_does() {
        let lamp = DVec3::new(0.4, 0.5, 0.6).normalize();
        let light = |d: DVec3| if d.angle_between(lamp) < 0.05 { 300.0 } else { 1.0 + d.y };
        let tree = LightTree::of_map(&light_map(1024, light));
        let points: Vec<SurfacePoint> = ball(120).into_iter().filter(|p| p.normal.z > 0.2).collect();
        let lobe =
            |width: f64| BivariateTable::from_fn(move |h, d| 0.1 + d + 3.0 / (1.0 + (h / width).powi(2)).powi(2));
        for (width, median, worst) in [(1.0, 0.01, 0.06), (0.2, 0.01, 0.1), (0.05, 0.02, 0.25), (0.02, 0.03, 0.4)] {
            let tables = [lobe(width)];
            let fine = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
            let want = Relighter::new(&points, &tables, &tree, &fine);
            let want = want.render(&tables[0]);
            let seen: Vec<Vec3> = points.iter().map(|p| p.normal.as_vec3()).collect();
            let pyramid = LightPyramid::new(light);
            let [near, far] = [Rings::Near, Rings::Far]
                .map(|rings| BallRenderer::new().render(&seen, &tables, &pyramid, rings).swap_remove(0));
            let got = near.iter().zip(&far).map(|(near, far)| f64::from(near + far));
            let mut errors: Vec<f64> = got.zip(&want).map(|(a, b)| (a / b - 1.0).abs()).collect();
            errors.sort_by(f64::total_cmp);
            let (middle, last) = (errors[errors.len() / 2], errors[errors.len() - 1]);
            assert!(middle < median && last < worst, "{width}: {middle} {last}");
        }
    }
}
