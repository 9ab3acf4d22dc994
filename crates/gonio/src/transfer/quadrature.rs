//! Adaptive quadrature of reflectance over the texels of an octahedral light grid.
//!
//! For a point with normal `n` seen from `v`, basis function `phi_k` and texel `t`:
//!
//! ```text
//! T[t, k] = integral over t of phi_k(theta_h, theta_d) max(n . w, 0) dw,    h = (w + v) / |w + v|
//! ```
//!
//! Measured materials have lobes of a fraction of a degree around `h = n`, sampled by MERL at steps
//! of hundredths of a degree; a texel of a 32 x 32 grid is 6 degrees wide. The square is therefore
//! divided as a quadtree: a cell is divided while its half vectors spread over more than a given
//! fraction of its angle to the normal. Cells never cross the borders of texels, and each undivided
//! cell is evaluated at its centre.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;

use super::kernels;
use crate::reflectance::{BivariateTable, THETA_D, THETA_H, theta_h_of};
use crate::shape::SurfacePoint;
use crate::sphere::OctahedralMap;

/// Several bivariate tables, interleaved so that one lookup reads all of them.
///
/// A lookup touches four contiguous ranges of memory.
#[derive(Clone, Debug)]
pub struct InterleavedTables {
    count: usize,
    /// Distance between the values of neighbouring cells.
    stride: usize,
    /// Values `[theta_d][theta_h][table]`, with the tables padded to the stride.
    values: Vec<f32>,
    /// [`smoothness`] of a single table; zero for several.
    smooth: f32,
}

/// Position in a table, for bilinear interpolation.
///
/// It consists of the cell below the position, and the fractions of the way to the next half angle
/// and to the next difference angle.
#[derive(Clone, Copy)]
struct Place {
    /// Index of the cell, `theta_d * THETA_H + theta_h`.
    cell: usize,
    beyond_h: f32,
    beyond_d: f32,
}

impl Place {
    /// Returns the place of `90 sqrt(theta_h / 90 degrees)` and of `theta_d` in degrees.
    #[inline(always)]
    fn of(root_h: f32, degrees_d: f32) -> Self {
        let (i, j) = ((root_h as usize).min(THETA_H - 2), (degrees_d as usize).min(THETA_D - 2));
        Self { cell: j * THETA_H + i, beyond_h: root_h - i as f32, beyond_d: degrees_d - j as f32 }
    }
}

impl InterleavedTables {
    /// Interleaves tables.
    pub fn new(tables: &[BivariateTable]) -> Self {
        let count = tables.len();
        let stride = if count == 1 { 1 } else { count.next_multiple_of(kernels::LANES) };
        let mut values = vec![0.0; THETA_D * THETA_H * stride];
        for (k, table) in tables.iter().enumerate() {
            for j in 0..THETA_D {
                for i in 0..THETA_H {
                    values[(j * THETA_H + i) * stride + k] = table.cell(i, j);
                }
            }
        }
        let smooth = if let [table] = tables { smoothness(table) } else { 0.0 };
        Self { count, stride, values, smooth }
    }

    /// Returns the number of tables.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the distance between the values of neighbouring cells.
    ///
    /// It is one for a single table, otherwise the number of tables rounded up to whole SIMD lanes.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Adds `weight` times the value of every table at a place to `out` (of length `stride`).
    #[inline(always)]
    fn add(&self, place: Place, weight: f32, out: &mut [f32]) {
        let (s, t) = (place.beyond_h, place.beyond_d);
        let w = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t].map(|w| w * weight);
        let stride = self.stride;
        let at = place.cell * stride;
        let near = &self.values[at..at + 2 * stride];
        let far = &self.values[at + THETA_H * stride..at + THETA_H * stride + 2 * stride];
        if stride == 1 {
            out[0] += w[0] * near[0] + w[1] * near[1] + w[2] * far[0] + w[3] * far[1];
        } else {
            kernels::add_four(out, [&near[..stride], &near[stride..], &far[..stride], &far[stride..]], w);
        }
    }
}

/// Returns the smallest step in half angle over which a table changes by more than a factor e.
///
/// The step is in radians; zero if the table contains a zero.
fn smoothness(table: &BivariateTable) -> f32 {
    let mut least = FRAC_PI_2;
    for j in 0..THETA_D {
        let logs: Vec<f32> = (0..THETA_H).map(|i| table.cell(i, j).ln()).collect();
        if logs.iter().any(|log| !log.is_finite()) {
            return 0.0;
        }
        for (i, log) in logs.iter().enumerate() {
            if let Some(k) = (i + 1..THETA_H).find(|&k| (logs[k] - log).abs() > 1.0) {
                least = least.min((theta_h_of(k) - theta_h_of(i)) as f32);
            }
        }
    }
    least
}

/// Fineness of the quadrature.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct QuadratureSettings {
    /// Level to which every cell is divided at least: `2^base` cells per side.
    ///
    /// If the light grid is finer, its level is used instead.
    pub base: u32,
    /// A cell is divided if its half vectors spread over more than this fraction of its angle to
    /// the normal.
    pub ratio: f32,
    /// Angle (radians) added to the angle to the normal in that test.
    ///
    /// Lobes are resolved to `ratio * core`. For a single table, this angle is at least that over
    /// which the table changes by a factor e.
    pub core: f32,
}

impl Default for QuadratureSettings {
    /// Returns the settings chosen by `gonio-eval quadrature` (`docs/quadrature.md`).
    fn default() -> Self {
        Self { base: 6, ratio: 0.3, core: 0.003 }
    }
}

/// Deepest level of cells, with 0.015 degrees of half angle.
const DEEPEST: u32 = 14;
/// Deepest level whose cell centres are tabulated.
const TABULATED: u32 = 9;

/// Quadrature for one light grid.
#[derive(Debug)]
pub struct Quadrature {
    map: OctahedralMap,
    grid_level: u32,
    settings: QuadratureSettings,
    /// Centre direction and solid angle of each cell by level, row-major from the top.
    centres: Vec<Vec<(Vec3, f32)>>,
}

/// Returns centre direction and solid angle of cell `(x, y)` of a level.
fn cell(map: OctahedralMap, level: u32, x: u32, y: u32) -> (Vec3, f32) {
    let n = f64::from(1_u32 << level);
    let (u, v) = ((f64::from(2 * x + 1)) / n - 1.0, 1.0 - f64::from(2 * y + 1) / n);
    (map.direction(u, v).as_vec3(), (map.density(u, v) * 4.0 / (n * n)) as f32)
}

impl Quadrature {
    /// Creates the quadrature over the texels of a grid of `side` by `side`, a power of two.
    pub fn new(map: OctahedralMap, side: usize, settings: QuadratureSettings) -> Self {
        let centres = (0..=TABULATED)
            .map(|level| {
                let n = 1_u32 << level;
                (0..n * n).map(|c| cell(map, level, c % n, c / n)).collect()
            })
            .collect();
        Self { map, grid_level: side.ilog2(), settings, centres }
    }

    /// Returns the number of texels of the light grid.
    pub fn texels(&self) -> usize {
        1 << (2 * self.grid_level)
    }

    /// Adds `T[t, k]` to `out[t * stride + k]` for all texels and tables.
    ///
    /// # Panics
    /// If `out` is not `texels * stride` long.
    pub fn integrate(&self, point: &SurfacePoint, tables: &InterleavedTables, out: &mut [f32]) {
        assert_eq!(out.len(), self.texels() * tables.stride());
        let first = self.settings.base.max(self.grid_level).clamp(2, DEEPEST);
        self.visit_cells(point, tables, first, &mut TexelSums { grid_level: self.grid_level, tables, out });
    }

    /// Adds the integrals over cells to `sums`, of which those far from the lobe are coarser than
    /// the grid: `2^base` per side.
    ///
    /// # Panics
    /// If there are several tables, or the cells of `sums` do not end at the grid.
    pub(super) fn integrate_cells(
        &self,
        point: &SurfacePoint,
        table: &InterleavedTables,
        base: u32,
        sums: &mut CellSums,
    ) {
        assert!(table.count() == 1 && sums.finest == self.grid_level && base <= sums.finest);
        self.visit_cells(point, table, base.max(2), &mut (table, sums));
    }

    fn visit_cells<S: Sums>(&self, point: &SurfacePoint, tables: &InterleavedTables, first: u32, sums: &mut S) {
        let point = Point { normal: point.normal.as_vec3(), view: point.view.as_vec3() };
        let core = self.settings.core.max(tables.smooth);
        gonio_linalg::dispatch(Integration { quadrature: self, point, core, first, sums });
    }
}

/// Destination of the integrals over cells.
trait Sums {
    /// Adds `weight` times the tables at a place of the cell `(x, y)` of a level.
    fn add(&mut self, level: u32, x: u32, y: u32, place: Place, weight: f32);
}

/// Sums over the texels of a grid, for all tables.
struct TexelSums<'a> {
    grid_level: u32,
    tables: &'a InterleavedTables,
    out: &'a mut [f32],
}

impl Sums for TexelSums<'_> {
    #[inline(always)]
    fn add(&mut self, level: u32, x: u32, y: u32, place: Place, weight: f32) {
        let up = level - self.grid_level;
        let texel = (((y >> up) << self.grid_level) + (x >> up)) as usize;
        let stride = self.tables.stride;
        self.tables.add(place, weight, &mut self.out[texel * stride..(texel + 1) * stride]);
    }
}

/// Sums over the cells of several levels of the square, up to those of the light grid, for one
/// table.
#[derive(Debug)]
pub(super) struct CellSums {
    /// Level of the light grid.
    finest: u32,
    /// Sum of every cell, by level.
    sums: Vec<f32>,
    /// Cells with a sum.
    touched: Vec<u32>,
}

impl CellSums {
    /// Creates sums of zero for the levels `0..=finest`.
    pub(super) fn new(finest: u32) -> Self {
        Self { finest, sums: vec![0.0; Self::first_of(finest + 1)], touched: Vec::new() }
    }

    /// Index of the first cell of a level; cells are row-major from the top.
    pub(super) fn first_of(level: u32) -> usize {
        ((1 << (2 * level)) - 1) / 3
    }

    /// Calls `each` with the index and the sum of every cell that has one, and resets them to zero.
    pub(super) fn drain(&mut self, mut each: impl FnMut(usize, f32)) {
        self.touched.sort_unstable();
        for cell in self.touched.drain(..) {
            each(cell as usize, std::mem::take(&mut self.sums[cell as usize]));
        }
    }
}

impl Sums for (&InterleavedTables, &mut CellSums) {
    #[inline(always)]
    fn add(&mut self, level: u32, x: u32, y: u32, place: Place, weight: f32) {
        let (table, sums) = self;
        let up = level.saturating_sub(sums.finest);
        let level = level - up;
        let cell = CellSums::first_of(level) + (((y >> up) << level) + (x >> up)) as usize;
        let before = sums.sums[cell];
        table.add(place, weight, &mut sums.sums[cell..=cell]);
        if before == 0.0 && sums.sums[cell] != 0.0 {
            sums.touched.push(cell as u32);
        }
    }
}

/// Task that integrates the tables at one point.
struct Integration<'a, S> {
    quadrature: &'a Quadrature,
    point: Point,
    /// Angle that is added to the half angle in the test of division.
    core: f32,
    /// Level to which every cell is divided at least.
    first: u32,
    sums: &'a mut S,
}

impl<S: Sums> pulp::NullaryFnOnce for Integration<'_, S> {
    type Output = ();

    /// Divides the square level by level.
    #[inline(always)]
    fn call(mut self) {
        let mut level = self.first;
        let side = 1_u32 << level;
        let mut divided = Vec::new();
        for first in (0..side * side).step_by(LANES) {
            let cells = std::array::from_fn(|lane| ((first + lane as u32) % side, (first + lane as u32) / side));
            self.visit(level, (&cells, LANES), &mut divided);
        }
        let mut parents = Vec::new();
        while !divided.is_empty() {
            std::mem::swap(&mut parents, &mut divided);
            divided.clear();
            level += 1;
            for four in parents.chunks(LANES / 4) {
                let child = |lane: usize| {
                    let (x, y) = four[(lane / 4).min(four.len() - 1)];
                    (2 * x + (lane as u32 & 1), 2 * y + (lane as u32 >> 1 & 1))
                };
                self.visit(level, (&std::array::from_fn(child), 4 * four.len()), &mut divided);
            }
        }
    }
}

impl<S: Sums> Integration<'_, S> {
    /// Adds the cells of a level that need no division and lists the others.
    ///
    /// Only the first `count` of the cells `(x, y)` are used.
    #[inline(always)]
    fn visit(&mut self, level: u32, (cells, count): (&[(u32, u32); LANES], usize), divided: &mut Vec<(u32, u32)>) {
        let Quadrature { map, settings, centres, .. } = self.quadrature;
        let mut light = [[0.0; LANES]; 3];
        let mut weight = [0.0; LANES];
        for lane in 0..LANES {
            let (x, y) = cells[lane];
            let (direction, solid_angle) = match centres.get(level as usize) {
                Some(centres) => centres[((y << level) + x) as usize],
                None => cell(*map, level, x, y),
            };
            for axis in 0..3 {
                light[axis][lane] = direction[axis];
            }
            weight[lane] = solid_angle;
        }
        let radius = map.cell_radius(level) as f32;
        let angles = self.point.angles(&light, radius);
        let finest = level == DEEPEST;
        for lane in (0..count).filter(|&lane| angles.cosine[lane] >= -radius) {
            let (x, y) = cells[lane];
            if !finest && angles.spread[lane] > settings.ratio * (angles.theta_h[lane] + self.core) {
                divided.push((x, y));
            } else if angles.cosine[lane] > 0.0 {
                let place = Place::of(angles.root_h[lane], angles.degrees_d[lane]);
                self.sums.add(level, x, y, place, angles.cosine[lane] * weight[lane]);
            }
        }
    }
}

/// Number of cells whose angles are computed together, a multiple of four.
const LANES: usize = 16;

type Lanes = [f32; LANES];

/// A point of the surface in single precision.
struct Point {
    normal: Vec3,
    view: Vec3,
}

/// Angles of the centres of cells in the frame of a point, by lanes.
struct Angles {
    /// Cosine of the angle between light and normal.
    cosine: Lanes,
    /// Half angle, radians.
    theta_h: Lanes,
    /// Half angle as required by [`Place::of`].
    root_h: Lanes,
    /// Difference angle in degrees.
    degrees_d: Lanes,
    /// Upper bound (radians) of the spread of the cell's half vectors.
    spread: Lanes,
}

impl Point {
    /// Computes the angles of directions towards the light.
    ///
    /// `radius` is the angular radius of the cells.
    #[inline(always)]
    fn angles(&self, light: &[Lanes; 3], radius: f32) -> Angles {
        let zero = [0.0; LANES];
        let mut angles = Angles { cosine: zero, theta_h: zero, root_h: zero, degrees_d: zero, spread: zero };
        let (n, v) = (self.normal, self.view);
        let [right, up, towards] = light;
        for lane in 0..LANES {
            let (x, y, z) = (right[lane], up[lane], towards[lane]);
            angles.cosine[lane] = x * n.x + y * n.y + z * n.z;
            let (sx, sy, sz) = (x + v.x, y + v.y, z + v.z);
            let twice_cos_d = (sx * sx + sy * sy + sz * sz).sqrt();
            // Chords remain accurate for small angles. The sine of half an angle is half its chord.
            let scale = 1.0 / twice_cos_d.max(1e-6);
            let (hx, hy, hz) = (sx * scale - n.x, sy * scale - n.y, sz * scale - n.z);
            let theta_h = 2.0 * kernels::asin_of_sqrt(0.25 * (hx * hx + hy * hy + hz * hz));
            // A cell of angular radius r spreads its half vectors by at most r / (2 cos theta_d).
            angles.spread[lane] = radius / twice_cos_d.max(0.05);
            angles.theta_h[lane] = theta_h;
            angles.root_h[lane] = ((theta_h / FRAC_PI_2).sqrt() * THETA_H as f32).clamp(0.0, (THETA_H - 1) as f32);
            let (dx, dy, dz) = (x - v.x, y - v.y, z - v.z);
            let theta_d = kernels::asin_of_sqrt(0.25 * (dx * dx + dy * dy + dz * dz));
            angles.degrees_d[lane] = (theta_d * (180.0 / PI)).clamp(0.0, (THETA_D - 1) as f32);
        }
        angles
    }
}

#[cfg(test)]
mod tests;
