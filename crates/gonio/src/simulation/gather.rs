//! Innermost loops of [`BallRenderer`](super::BallRenderer): sixteen half vectors at a time, in
//! vector instructions except for the lookups.

use std::array;

use glam::Vec3;

use super::ball::counted;
use super::pyramid::LightPyramid;
use crate::reflectance::{THETA_D, THETA_H};
use crate::render::lobe::{column_of, degrees_of_cosine};
use crate::render::pyramid::{Part, Place, Pyramid, half_side, whole};

/// Number of values that are processed together.
pub(super) const LANES: usize = 16;

type Lanes = [f32; LANES];

/// A half vector about a normal along z, with its solid angle and lookups.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RingSample {
    pub(super) half: Vec3,
    pub(super) solid_angle: f32,
    /// Row of the table below it, as an index of cells, and the fraction of the way to the next.
    pub(super) row: usize,
    pub(super) beyond: f32,
    /// Level of the light whose texels are as large as the sample's solid angle.
    pub(super) level: usize,
}

/// Several samples, by lanes.
#[derive(Clone, Debug)]
pub(super) struct RingBlock {
    half: [Lanes; 3],
    solid_angle: Lanes,
    row: [usize; LANES],
    beyond: Lanes,
    level: [usize; LANES],
    half_side: Lanes,
}

impl RingBlock {
    /// Packs at most [`LANES`] samples; the remaining lanes have no weight.
    pub(super) fn of(samples: &[RingSample]) -> Self {
        let at = |i: usize| samples.get(i).copied().unwrap_or_default();
        Self {
            half: [0, 1, 2].map(|axis| array::from_fn(|i| at(i).half[axis])),
            solid_angle: array::from_fn(|i| at(i).solid_angle),
            row: array::from_fn(|i| at(i).row),
            beyond: array::from_fn(|i| at(i).beyond),
            level: array::from_fn(|i| at(i).level),
            half_side: array::from_fn(|i| half_side(LightPyramid::SIDE, at(i).level)),
        }
    }
}

/// Lamps, with everything about them that does not depend on the normal.
#[derive(Clone, Debug)]
pub(super) struct LampBlock {
    towards: [Lanes; 3],
    half: [Lanes; 3],
    irradiance: Lanes,
    /// Column of the table below the difference angle, and the fraction of the way to the next.
    column: [u32; LANES],
    next: Lanes,
}

impl LampBlock {
    /// Packs all lamps of a light.
    pub(super) fn all(light: &LightPyramid) -> Vec<Self> {
        light.0.lamps().chunks(LANES).map(Self::of).collect()
    }

    fn of(lamps: &[(Vec3, f32)]) -> Self {
        // A lamp opposite the camera reaches no visible normal.
        let at = |i: usize| lamps.get(i).copied().filter(|l| l.0.z > -0.999_999).unwrap_or((Vec3::Z, 0.0));
        let sum = |i: usize| at(i).0 + Vec3::Z;
        let column = |i: usize| column_of(0.5 * sum(i).length());
        Self {
            towards: [0, 1, 2].map(|axis| array::from_fn(|i| at(i).0[axis])),
            half: [0, 1, 2].map(|axis| array::from_fn(|i| sum(i).normalize()[axis])),
            irradiance: array::from_fn(|i| at(i).1),
            column: array::from_fn(|i| column(i).0),
            next: array::from_fn(|i| column(i).1),
        }
    }
}

/// Task that adds the light at each point to the cells of the table that reflect it towards +z,
/// `[normal][cell]`.
pub(super) struct Gather<'a> {
    pub(super) rings: &'a [RingBlock],
    pub(super) lamps: &'a [LampBlock],
    pub(super) light: &'a Pyramid<f32>,
    /// Part of the light that the rings see.
    pub(super) part: Part,
    pub(super) normals: &'a [Vec3],
    pub(super) rows: &'a mut [f32],
    /// Number of cells of a row.
    pub(super) cells: usize,
}

impl pulp::NullaryFnOnce for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (normal, cells) in self.normals.iter().zip(self.rows.chunks_exact_mut(self.cells)) {
            for block in self.rings {
                add_ring(block, *normal, self.light, self.part, cells);
            }
            for block in self.lamps {
                add_lamps(block, *normal, cells);
            }
        }
    }
}

#[inline(always)]
fn add_ring(block: &RingBlock, normal: Vec3, light: &Pyramid<f32>, part: Part, cells: &mut [f32]) {
    let (right, up) = normal.any_orthonormal_pair();
    let mut weights = [0.0; LANES];
    let mut columns = [(0, 0.0); LANES];
    let mut places = [Place::default(); LANES];
    for lane in 0..LANES {
        let along = |axis: usize| {
            block.half[0][lane] * right[axis] + block.half[1][lane] * up[axis] + block.half[2][lane] * normal[axis]
        };
        let (x, y, cos_d) = (along(0), along(1), along(2));
        let twice = 2.0 * cos_d;
        let (x, y, z) = (twice * x, twice * y, twice * cos_d - 1.0);
        let cosine = x * normal.x + y * normal.y + z * normal.z;
        // Four times the cosine: the ratio of the solid angle of light to that of half vectors.
        weights[lane] = cosine.max(0.0) * 2.0 * twice.max(0.0) * block.solid_angle[lane];
        columns[lane] = column_of(cos_d.max(0.0));
        places[lane] = Place::of([x, y, z], block.half_side[lane]);
    }
    for lane in (0..LANES).filter(|&lane| weights[lane] > 0.0) {
        let weight = weights[lane] * light.at(part, block.level[lane], &places[lane]);
        add(cells, block.row[lane], block.beyond[lane], columns[lane], weight);
    }
}

#[inline(always)]
fn add_lamps(block: &LampBlock, normal: Vec3, cells: &mut [f32]) {
    let mut weights = [0.0; LANES];
    let mut rows = [(0, 0.0); LANES];
    for lane in 0..LANES {
        let dot = |v: &[Lanes; 3]| v[0][lane] * normal.x + v[1][lane] * normal.y + v[2][lane] * normal.z;
        let theta_h = degrees_of_cosine(dot(&block.half).max(0.0));
        weights[lane] = counted(theta_h) * block.irradiance[lane] * dot(&block.towards).max(0.0);
        let place = (theta_h / 90.0).sqrt() * THETA_H as f32;
        rows[lane] = whole(place.min((THETA_H - 1) as f32 - 1e-3));
    }
    for lane in (0..LANES).filter(|&lane| weights[lane] > 0.0) {
        let (row, beyond) = rows[lane];
        add(cells, row as usize * THETA_D, beyond, (block.column[lane], block.next[lane]), weights[lane]);
    }
}

/// Adds light to the four cells around a half angle (as a row of the table and the fraction of the
/// way to the next) and a difference angle (likewise a column).
#[inline(always)]
fn add(cells: &mut [f32], row: usize, beyond: f32, (column, next): (u32, f32), weight: f32) {
    let (at, next) = (row + column as usize, weight * next);
    let here = weight - next;
    let (upper, lower) = cells[at..at + THETA_D + 2].split_at_mut(THETA_D);
    upper[0] += (1.0 - beyond) * here;
    upper[1] += (1.0 - beyond) * next;
    lower[0] += beyond * here;
    lower[1] += beyond * next;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_come_back_from_their_cosines() {
        for i in 0..=900 {
            let angle = 0.1 * f64::from(i);
            let got = degrees_of_cosine(angle.to_radians().cos() as f32);
            assert!((f64::from(got) - angle).abs() < 0.02, "{angle} {got}");
        }
    }
}
