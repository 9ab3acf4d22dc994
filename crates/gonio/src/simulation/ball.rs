//! Fast rendering of a ball of many materials under one light.
//!
//! Training of the posterior requires hundreds of lights; each is gathered as a matrix that maps
//! tables to pictures. This module samples the light at a point at half vectors, in rings about the
//! normal that are as fine as the table. Each sample is the mean of the light over the solid angle
//! of the sample (prefiltered importance sampling, Colbert & Krivanek 2007). The renderer is much
//! faster than [`Relighter`](crate::render::Relighter) and agrees with it within a few percent.

use faer::{Accum, MatMut, MatRef};
use glam::Vec3;
use gonio_linalg::{dispatch, multiply};
use rayon::prelude::*;

use super::gather::{Cells, Gather, Lamp, Layout, Ring};
use super::orbit::{Orbits, SYMMETRIES};
use super::pyramid::LightPyramid;
use crate::parallel;
use crate::reflectance::{BivariateTable, THETA_H};
use crate::render::pyramid::{Part, level};

/// Number of rings of half vectors about a normal. The rings are spaced evenly in the square root
/// of the angle, like the rows of a table.
const RINGS: usize = 90;

/// Smallest and largest number of samples in a ring.
const SPOKES: (f32, f32) = (8.0, 44.0);

/// Typical cosine of the difference angle, used to choose levels.
const TYPICAL: f64 = 0.8;

/// Number of orbits gathered before each multiplication with the tables.
const CHUNK: usize = 6;

/// Number of table rows in a group of cells of the far rings. A smaller group has a narrower band
/// of columns.
const FAR_ROWS: usize = 9;

/// Renderer of balls: rings of half vectors about a normal along z.
#[derive(Clone, Debug)]
pub(super) struct BallRenderer {
    near: Vec<Ring>,
    far: Vec<Ring>,
    /// Number of table rows that the near rings use.
    near_rows: usize,
}

/// Half angles in degrees between which lamps change from samples to points. Samples preserve the
/// shape of a lamp in a sharp highlight; points are exact in a wide highlight.
const LAMP_ANGLES: (f32, f32) = (3.0, 6.0);

/// Group of rings about a normal, by half angle: below 3 degrees, or above 6 degrees. Rings between
/// these angles contribute to both groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rings {
    /// Rings that resolve sharp highlights. The samples of the light include the lamps.
    Near,
    /// Rings whose contribution changes little over one degree. Lamps are added one by one.
    Far,
}

/// Returns the weight of the far rings, and of lamps added as points, at a half angle in degrees.
#[inline(always)]
pub(super) fn counted(theta_h: f32) -> f32 {
    ((theta_h - LAMP_ANGLES.0) / (LAMP_ANGLES.1 - LAMP_ANGLES.0)).clamp(0.0, 1.0)
}

impl BallRenderer {
    /// Builds the rings.
    pub(super) fn new() -> Self {
        let (mut near, mut far, mut near_rows) = (Vec::new(), Vec::new(), 0);
        let right = std::f64::consts::FRAC_PI_2;
        for ring in 0..RINGS {
            let edge = |r: usize| (r as f64 / RINGS as f64).powi(2) * right;
            // The middle in the square root of the angle, in which tables are linear.
            let root = (ring as f64 + 0.5) / RINGS as f64;
            let theta = root * root * right;
            let (low, high) = (edge(ring), edge(ring + 1));
            let wanted = std::f64::consts::TAU * theta.sin() / (high - low);
            let spokes = wanted.clamp(f64::from(SPOKES.0), f64::from(SPOKES.1)).round() as usize;
            let solid_angle = std::f64::consts::TAU * (low.cos() - high.cos()) / spokes as f64;
            let place = (root * THETA_H as f64).min((THETA_H - 1) as f64 - 1e-6);
            let half = |spoke: usize| {
                // Each ring is rotated relative to the previous one by the golden section of a full
                // turn.
                let phi = std::f64::consts::TAU * ((spoke as f64 + 0.5) / spokes as f64 + 0.618_034 * ring as f64);
                Vec3::new((theta.sin() * phi.cos()) as f32, (theta.sin() * phi.sin()) as f32, theta.cos() as f32)
            };
            let halves: Vec<Vec3> = (0..spokes).map(half).collect();
            let (row, beyond) = (place as usize, place.fract() as f32);
            let level = level(LightPyramid::FINEST_SIDE, 4.0 * TYPICAL * solid_angle);
            let counted = counted(theta.to_degrees() as f32);
            let ring = |share: f32| Ring::of(&halves, (row, beyond), share * solid_angle as f32, level);
            if counted < 1.0 {
                near.push(ring(1.0 - counted));
                near_rows = row + 2;
            }
            if counted > 0.0 {
                far.push(ring(counted));
            }
        }
        Self { near, far, near_rows }
    }

    /// Renders the luminance of points seen from +z, for each table and one group of rings.
    ///
    /// The result is `[table][normal]`, in the order of the normals from which `orbits` was built.
    /// The sum of both groups is the full picture.
    pub(super) fn render(
        &self,
        orbits: &Orbits,
        tables: &[BivariateTable],
        light: &LightPyramid,
        rings: Rings,
    ) -> Vec<Vec<f32>> {
        // Near rings need only the first rows of the tables.
        let (rings, lamps, part, layout) = match rings {
            Rings::Near => (&self.near, Vec::new(), Part::All, Layout { rows: self.near_rows, groups: 1 }),
            Rings::Far => {
                let layout = Layout { rows: FAR_ROWS, groups: THETA_H.div_ceil(FAR_ROWS) };
                (&self.far, Lamp::all(light), Part::WithoutLamps, layout)
            }
        };
        let laid: Vec<f32> = parallel::flat_map_range(tables.len(), |at| layout.laid(tables[at].as_slice()));
        let laid = MatRef::from_column_major_slice(&laid, layout.cells(), tables.len());
        let chunk = CHUNK * SYMMETRIES;
        // `[table][orbit][way]` of each chunk.
        let parts: Vec<Vec<f32>> = orbits
            .normals
            .par_chunks(CHUNK)
            .map_init(
                || Cells::new(layout, CHUNK),
                |cells, normals| {
                    dispatch(Gather { rings, lamps: &lamps, light: &light.images, part, normals, cells });
                    let mut out = vec![0.0_f32; chunk * tables.len()];
                    let gathered = MatRef::from_column_major_slice(&cells.light, chunk, layout.cells());
                    for range in cells.ranges() {
                        let product = MatMut::from_column_major_slice_mut(&mut out, chunk, tables.len());
                        let (gathered, laid) = (gathered.get(.., range.clone()), laid.get(range, ..));
                        multiply(product, Accum::Add, gathered, laid, 1.0);
                    }
                    cells.clear();
                    out
                },
            )
            .collect();
        let picture = |table: usize| {
            let mut picture = vec![0.0; orbits.count];
            for (part, places) in parts.iter().zip(orbits.places.chunks(CHUNK)) {
                let values = part[table * chunk..][..chunk].as_chunks::<SYMMETRIES>().0;
                for (values, places) in values.iter().zip(places) {
                    values.iter().zip(places).for_each(|(value, place)| picture[*place] = *value);
                }
            }
            picture
        };
        parallel::map_range(tables.len(), picture)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::orbit::image;
    use super::*;
    use crate::render::{IntegratorSettings, LightTree, Relighter};
    use crate::shape::SurfacePoint;
    use crate::testing::{ball, environment_map};

    #[test]
    fn pictures_match_the_integrator() {
        let lamp = DVec3::new(0.4, 0.5, 0.6).normalize();
        let light = |d: DVec3| if d.angle_between(lamp) < 0.05 { 300.0 } else { 1.0 + d.y };
        let tree = LightTree::of_map(&environment_map(1024, light));
        let some = ball(120).into_iter().map(|p| p.normal.as_vec3()).filter(|n| n.z > 0.2 && n.x > n.y && n.y > 0.0);
        let images = |n: Vec3| (0..SYMMETRIES).map(move |way| (image(way, (n.x, n.y)), n.z));
        let normals: Vec<Vec3> = some.flat_map(images).map(|((x, y), z)| Vec3::new(x, y, z)).collect();
        let orbits = Orbits::of(&normals);
        let point = |n: &Vec3| SurfacePoint { normal: n.as_dvec3(), view: DVec3::Z };
        let points: Vec<SurfacePoint> = normals.iter().map(point).collect();
        let lobe =
            |width: f64| BivariateTable::from_fn(move |h, d| 0.1 + d + 3.0 / (1.0 + (h / width).powi(2)).powi(2));
        for (width, median, worst) in [(1.0, 0.01, 0.06), (0.2, 0.01, 0.1), (0.05, 0.02, 0.25), (0.02, 0.03, 0.4)] {
            let tables = [lobe(width)];
            let fine = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
            let want = Relighter::new(&points, &tables, &tree, &fine);
            let want = want.render(&tables[0]);
            let pyramid = LightPyramid::new(light);
            let [near, far] = [Rings::Near, Rings::Far]
                .map(|rings| BallRenderer::new().render(&orbits, &tables, &pyramid, rings).swap_remove(0));
            let got = near.iter().zip(&far).map(|(near, far)| f64::from(near + far));
            let mut errors: Vec<f64> = got.zip(&want).map(|(a, b)| (a / b - 1.0).abs()).collect();
            errors.sort_by(f64::total_cmp);
            let (middle, last) = (errors[errors.len() / 2], errors[errors.len() - 1]);
            assert!(middle < median && last < worst, "{width}: {middle} {last}");
        }
    }
}
