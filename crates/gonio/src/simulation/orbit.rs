//! The eight symmetries of the disk of normals: mirror images in both axes and in the diagonal.
//!
//! They keep the view direction fixed. Applied to a normal and a light, they preserve the angles
//! between half vector, normal and view. The geometry of one normal is therefore valid for eight,
//! and only the light differs.

use std::collections::HashMap;
use std::ops::{Add, Mul, Sub};

use glam::Vec3;

/// Number of symmetries, and of normals that are processed together.
pub(super) const SYMMETRIES: usize = 8;

/// One number for each symmetry, for vector instructions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub(super) struct SymmetryLanes(pub(super) [f32; SYMMETRIES]);

/// Implements an operator element by element, in a loop that compiles to one vector instruction.
macro_rules! by_ways {
    ($trait:ident, $method:ident, $assign:tt) => {
        impl $trait for SymmetryLanes {
            type Output = Self;

            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for (own, other) in self.0.iter_mut().zip(other.0) {
                    *own $assign other;
                }
                self
            }
        }
    };
}

by_ways!(Add, add, +=);
by_ways!(Sub, sub, -=);

impl Mul<f32> for SymmetryLanes {
    type Output = Self;

    #[inline(always)]
    fn mul(mut self, factor: f32) -> Self {
        for own in &mut self.0 {
            *own *= factor;
        }
        self
    }
}

impl From<[f32; SYMMETRIES]> for SymmetryLanes {
    fn from(values: [f32; SYMMETRIES]) -> Self {
        Self(values)
    }
}

impl SymmetryLanes {
    /// Adds the values, multiplied by `share`, to `others`.
    #[inline(always)]
    pub(super) fn add_to(self, share: f32, others: &mut [f32; SYMMETRIES]) {
        for (other, own) in others.iter_mut().zip(self.0) {
            *other += share * own;
        }
    }
}

/// Applies a symmetry to `x` and `y` of a vector.
#[inline(always)]
pub(super) fn image(way: usize, (x, y): (f32, f32)) -> (f32, f32) {
    let (x, y) = if way & 4 == 0 { (x, y) } else { (y, x) };
    (if way & 1 == 0 { x } else { -x }, if way & 2 == 0 { y } else { -y })
}

/// Returns column and row of the image of a texel of an octahedral square.
///
/// Row 0 is at the top; `last` is the index of the last column and row.
pub(super) fn image_of_texel(way: usize, last: usize, (column, row): (usize, usize)) -> (usize, usize) {
    let (column, row) = if way & 4 == 0 { (column, row) } else { (last - row, last - column) };
    (if way & 1 == 0 { column } else { last - column }, if way & 2 == 0 { row } else { last - row })
}

/// Groups of eight normals that are images of each other, sorted by their angle to the view.
#[derive(Clone, Debug)]
pub(super) struct Orbits {
    /// One normal of each group, with `x >= y > 0`.
    pub(super) normals: Vec<Vec3>,
    /// Indices of the images of each of these normals among all normals.
    pub(super) places: Vec<[usize; SYMMETRIES]>,
    /// Number of all normals.
    pub(super) count: usize,
}

impl Orbits {
    /// Groups normals into orbits.
    ///
    /// # Panics
    /// If `normals` lacks an image of a normal, or if a normal has an `x` or `y` of zero.
    pub(super) fn of(normals: &[Vec3]) -> Self {
        let key = |(x, y): (f32, f32)| (x.to_bits(), y.to_bits());
        let found: HashMap<(u32, u32), usize> = normals.iter().enumerate().map(|(i, n)| (key((n.x, n.y)), i)).collect();
        assert!(normals.iter().all(|n| n.x != 0.0 && n.y != 0.0), "a normal on an axis");
        let mut first: Vec<Vec3> = normals.iter().copied().filter(|n| n.x >= n.y && n.y > 0.0).collect();
        first.sort_by(|a, b| b.z.total_cmp(&a.z));
        let places = first
            .iter()
            .map(|n| std::array::from_fn(|way| *found.get(&key(image(way, (n.x, n.y)))).expect("all images")))
            .collect();
        Self { normals: first, places, count: normals.len() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::appearance::disk::{DISK_SIDE, normal, on_disk};

    #[test]
    fn orbits_of_the_disk_contain_every_normal() {
        let normals: Vec<Vec3> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)).map(normal).collect();
        let orbits = Orbits::of(&normals);
        let mut seen = vec![false; normals.len()];
        for (first, places) in orbits.normals.iter().zip(&orbits.places) {
            for (way, &place) in places.iter().enumerate() {
                let (x, y) = image(way, (first.x, first.y));
                assert_eq!(normals[place], Vec3::new(x, y, first.z));
                seen[place] = true;
            }
        }
        assert!(seen.iter().all(|s| *s));
        assert!(orbits.normals.is_sorted_by(|a, b| a.z >= b.z));
    }
}
