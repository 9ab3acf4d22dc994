//! Innermost loops of [`BallRenderer`](super::ball::BallRenderer).
//!
//! They add the light at eight normals, which are images of each other, to the table cells that
//! reflect it.

use std::array;

use glam::Vec3;

use super::ball::counted;
use super::orbit::{SYMMETRIES, SymmetryLanes, image};
use super::pyramid::LightPyramid;
use crate::reflectance::{THETA_D, THETA_H};
use crate::render::lobe::{column_of, degrees_of_cosine};
use crate::render::pyramid::{Part, Place, Pyramid, half_side, whole};

/// Number of half vectors whose angles are computed together.
const LANES: usize = 16;

type Lanes = [f32; LANES];

/// Half vectors at one angle to a normal along z.
#[derive(Clone, Debug)]
pub(super) struct Ring {
    /// Row of the table below the angle, and the fraction of the distance to the next row.
    pub(super) row: usize,
    pub(super) beyond: f32,
    /// Solid angle of each half vector.
    pub(super) solid_angle: f32,
    /// Level of the light whose texels match the solid angle of light of each half vector.
    level: usize,
    half_side: f32,
    /// Blocks of half vectors by lanes, each with the number of its half vectors.
    blocks: Vec<([Lanes; 3], usize)>,
}

impl Ring {
    /// Packs half vectors.
    pub(super) fn of(halves: &[Vec3], (row, beyond): (usize, f32), solid_angle: f32, level: usize) -> Self {
        let block = |halves: &[Vec3]| {
            let at = |i: usize, axis: usize| halves.get(i).map_or(0.0, |half| half[axis]);
            ([0, 1, 2].map(|axis| array::from_fn(|i| at(i, axis))), halves.len())
        };
        let half_side = half_side(LightPyramid::FINEST_SIDE, level);
        Self { row, beyond, solid_angle, level, half_side, blocks: halves.chunks(LANES).map(block).collect() }
    }
}

/// Lamp, with its quantities that do not depend on the normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    towards: Vec3,
    half: Vec3,
    irradiance: f32,
    /// Column of the table below the difference angle, and the fraction of the distance to the
    /// next.
    column: usize,
    next: f32,
}

impl Lamp {
    /// Lists the lamps of a light, except those opposite the camera, which reach no visible normal.
    pub(super) fn all(light: &LightPyramid) -> Vec<Self> {
        let lamp = |&(towards, irradiance): &(Vec3, f32)| {
            let sum = towards + Vec3::Z;
            let (column, next) = column_of(0.5 * sum.length());
            Self { towards, half: sum.normalize(), irradiance, column: column as usize, next }
        };
        light.lamps.iter().filter(|lamp| lamp.0.z > -0.999_999).map(lamp).collect()
    }
}

/// Order of the cells of a table in memory: groups of rows, each stored column by column. The
/// difference angles of the half vectors at one normal form a band, which is contiguous in this
/// order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    /// Number of rows in a group.
    pub(super) rows: usize,
    /// Number of groups.
    pub(super) groups: usize,
}

impl Layout {
    /// Number of cells, including the rows of the last group beyond the table.
    pub(super) fn cells(self) -> usize {
        self.groups * self.rows * THETA_D
    }

    /// Index of the cell of a row in the first column. The next column follows after `rows` cells.
    #[inline(always)]
    fn first(self, row: usize) -> usize {
        row / self.rows * self.rows * THETA_D + row % self.rows
    }

    /// Arranges the values of a table in this order; cells beyond the table are zero.
    pub(super) fn laid(self, table: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; self.cells()];
        for (row, values) in table.chunks_exact(THETA_D).take(self.rows * self.groups).enumerate() {
            let first = self.first(row);
            values.iter().enumerate().for_each(|(column, value)| out[first + column * self.rows] = *value);
        }
        out
    }
}

/// Light at the normals of some orbits, grouped by the table cell that reflects it.
pub(super) struct Cells {
    layout: Layout,
    /// Number of orbits.
    pub(super) orbits: usize,
    /// `[cell][orbit][way]`.
    pub(super) light: Vec<f32>,
    /// First and last column that is not zero in each group of rows.
    bands: Vec<(usize, usize)>,
}

/// Band without columns.
const NOTHING: (usize, usize) = (usize::MAX, 0);

impl Cells {
    pub(super) fn new(layout: Layout, orbits: usize) -> Self {
        let light = vec![0.0; layout.cells() * orbits * SYMMETRIES];
        Self { layout, orbits, light, bands: vec![NOTHING; layout.groups] }
    }

    /// Iterates over the ranges of cells that are not zero.
    pub(super) fn ranges(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        let rows = self.layout.rows;
        let range = move |(group, &(low, high)): (usize, &(usize, usize))| {
            let first = group * THETA_D;
            (first + low) * rows..(first + high + 1) * rows
        };
        self.bands.iter().enumerate().filter(|(_, band)| **band != NOTHING).map(range)
    }

    /// Sets all cells to zero.
    pub(super) fn clear(&mut self) {
        let (ranges, each): (Vec<_>, usize) = (self.ranges().collect(), self.orbits * SYMMETRIES);
        ranges.into_iter().for_each(|r| self.light[r.start * each..r.end * each].fill(0.0));
        self.bands.fill(NOTHING);
    }
}

/// Extends the bands of a row and of the next row to a range of columns.
#[inline(always)]
fn widen(bands: &mut [(usize, usize)], layout: Layout, row: usize, (low, high): (usize, usize)) {
    for group in [row / layout.rows, (row + 1) / layout.rows] {
        let (first, last) = &mut bands[group];
        (*first, *last) = ((*first).min(low), (*last).max(high));
    }
}

/// Task that adds the light at the images of some normals to `cells`, which must be zero.
pub(super) struct Gather<'a> {
    pub(super) rings: &'a [Ring],
    pub(super) lamps: &'a [Lamp],
    pub(super) light: &'a Pyramid<SymmetryLanes>,
    /// Part of the light that the rings sample.
    pub(super) part: Part,
    /// One normal of each orbit.
    pub(super) normals: &'a [Vec3],
    pub(super) cells: &'a mut Cells,
}

impl pulp::NullaryFnOnce for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (orbit, normal) in self.normals.iter().enumerate() {
            for ring in self.rings {
                add_ring(ring, *normal, (self.light, self.part), orbit, self.cells);
            }
            let images: [(f32, f32); SYMMETRIES] = array::from_fn(|way| image(way, (normal.x, normal.y)));
            let (x, y) = (images.map(|i| i.0), images.map(|i| i.1));
            for lamp in self.lamps {
                add_lamp(lamp, (&x, &y, normal.z), orbit, self.cells);
            }
        }
    }
}

#[inline(always)]
fn add_ring(
    ring: &Ring,
    normal: Vec3,
    (light, part): (&Pyramid<SymmetryLanes>, Part),
    orbit: usize,
    cells: &mut Cells,
) {
    let all_cells = cells.light.as_chunks_mut::<SYMMETRIES>().0;
    let (right, up) = normal.any_orthonormal_pair();
    let (layout, orbits) = (cells.layout, cells.orbits);
    let (upper, lower) = (layout.first(ring.row), layout.first(ring.row + 1));
    let (mut low, mut high) = NOTHING;
    for (half, count) in &ring.blocks {
        let mut weights = [0.0; LANES];
        let mut columns = [(0, 0.0); LANES];
        let mut places = [Place::default(); LANES];
        for lane in 0..LANES {
            let along =
                |axis: usize| half[0][lane] * right[axis] + half[1][lane] * up[axis] + half[2][lane] * normal[axis];
            let (x, y, cos_d) = (along(0), along(1), along(2));
            let twice = 2.0 * cos_d;
            let (x, y, z) = (twice * x, twice * y, twice * cos_d - 1.0);
            let cosine = x * normal.x + y * normal.y + z * normal.z;
            // Four times the cosine: the ratio of the solid angle of light to that of half vectors.
            weights[lane] = cosine.max(0.0) * 2.0 * twice.max(0.0) * ring.solid_angle;
            columns[lane] = column_of(cos_d.max(0.0));
            places[lane] = Place::of([x, y, z], ring.half_side);
        }
        for lane in (0..*count).filter(|&lane| weights[lane] > 0.0) {
            let (column, next) = (columns[lane].0 as usize, columns[lane].1);
            (low, high) = (low.min(column), high.max(column + 1));
            let all = light.at(part, ring.level, &places[lane]) * weights[lane];
            let beyond = all * next;
            let here = all - beyond;
            for (first, share) in [(upper, 1.0 - ring.beyond), (lower, ring.beyond)] {
                let at = (first + column * layout.rows) * orbits + orbit;
                here.add_to(share, &mut all_cells[at]);
                beyond.add_to(share, &mut all_cells[at + layout.rows * orbits]);
            }
        }
    }
    if low < high {
        widen(&mut cells.bands, layout, ring.row, (low, high));
    }
}

/// Adds a lamp at the normals with coordinates `x` and `y` and their common coordinate `z`.
#[inline(always)]
fn add_lamp(lamp: &Lamp, (x, y, z): (&[f32; SYMMETRIES], &[f32; SYMMETRIES], f32), orbit: usize, cells: &mut Cells) {
    let mut weights = [0.0; SYMMETRIES];
    let mut rows = [(0, 0.0); SYMMETRIES];
    for way in 0..SYMMETRIES {
        let dot = |v: Vec3| v.x * x[way] + v.y * y[way] + v.z * z;
        let theta_h = degrees_of_cosine(dot(lamp.half).max(0.0));
        weights[way] = counted(theta_h) * lamp.irradiance * dot(lamp.towards).max(0.0);
        let place = (theta_h / 90.0).sqrt() * THETA_H as f32;
        rows[way] = whole(place.min((THETA_H - 1) as f32 - 1e-3));
    }
    let (layout, orbits) = (cells.layout, cells.orbits);
    let all_cells = cells.light.as_chunks_mut::<SYMMETRIES>().0;
    for way in (0..SYMMETRIES).filter(|&way| weights[way] > 0.0) {
        let (row, beyond) = (rows[way].0 as usize, rows[way].1);
        let next = weights[way] * lamp.next;
        let here = weights[way] - next;
        for (row, share) in [(row, 1.0 - beyond), (row + 1, beyond)] {
            let at = (layout.first(row) + lamp.column * layout.rows) * orbits + orbit;
            all_cells[at][way] += share * here;
            all_cells[at + layout.rows * orbits][way] += share * next;
        }
        widen(&mut cells.bands, layout, row, (lamp.column, lamp.column + 1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_of_cosine_inverts_the_cosine() {
        for i in 0..=900 {
            let angle = 0.1 * f64::from(i);
            let got = degrees_of_cosine(angle.to_radians().cos() as f32);
            assert!((f64::from(got) - angle).abs() < 0.02, "{angle} {got}");
        }
    }

    #[test]
    fn the_layout_stores_every_cell_once() {
        for layout in [Layout { rows: 25, groups: 1 }, Layout { rows: 8, groups: 12 }] {
            let rows = THETA_H.min(layout.rows * layout.groups);
            let table: Vec<f32> = (1..=rows * THETA_D).map(|i| i as f32).collect();
            let laid = layout.laid(&table);
            assert_eq!(laid.len(), layout.cells());
            for (cell, value) in table.iter().enumerate() {
                assert_eq!(laid[layout.first(cell / THETA_D) + cell % THETA_D * layout.rows], *value);
            }
            assert_eq!(laid.iter().filter(|v| **v > 0.0).count(), table.len());
        }
    }
}
