//! Converts pixels of the second paint to those of the first.
//!
//! Both paints have the same reflections at their surface, so their ratio depends on the share of
//! these reflections in the brightness: in a highlight, it is one. The steps along the border of
//! the paints measure the ratio there. A pixel of the second paint near the border is divided by
//! the median ratio of the steps around it. The mean would be too small, because some cells at the
//! border show both paints.

use glam::{DVec3, Vec3};

use super::{Cells, Groups, Step, dilated};
use crate::picture::Plane;
use crate::statistics::weighted_median;

/// Standard deviation of the weights of steps by their distance, in cells.
const WIDTH: f64 = 5.0;
/// Largest distance of the steps, in cells.
const REACH: f64 = 12.0;
/// Smallest sum of these weights.
const MIN_WEIGHT: f64 = 4.0;

impl Groups {
    /// Returns the pixels of the second paint, converted to the first. Pixels within `margin` cells
    /// of the first group, or far from all steps, are `None`.
    pub(super) fn converted(
        &self,
        cells: &Cells,
        rgb: &Plane<Vec3>,
        steps: &[Step],
        margin: usize,
    ) -> Plane<Option<Vec3>> {
        let first = dilated(self.in_second().map(|second| !second), margin);
        let steps: Vec<([f64; 2], DVec3)> = steps
            .iter()
            .map(|step| {
                let [a, b] = step.cells.map(|cell| self.places[cell]);
                ([0.5 * (a.0 + b.0) as f64, 0.5 * (a.1 + b.1) as f64], step.change)
            })
            .collect();
        let changes = Plane::from_fn(first.width(), first.height(), |u, v| {
            if first[(u, v)] || self.index[(u, v)].is_none() {
                return None;
            }
            let near: Vec<(f64, DVec3)> = steps
                .iter()
                .filter_map(|(at, change)| {
                    let square = (at[0] - u as f64).powi(2) + (at[1] - v as f64).powi(2);
                    (square < REACH * REACH).then(|| ((-0.5 * square / (WIDTH * WIDTH)).exp(), *change))
                })
                .collect();
            let total: f64 = near.iter().map(|(weight, _)| weight).sum();
            let channel = |c: usize| weighted_median(near.iter().map(|(weight, change)| (change[c], *weight)));
            let [Some(r), Some(g), Some(b)] = [0, 1, 2].map(channel) else { return None };
            (total >= MIN_WEIGHT).then(|| DVec3::new(r, g, b))
        });
        Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
            let change = changes[cells.cell((x, y))?]?;
            Some(cells.colour(cells.tone(rgb[(x, y)]) - change))
        })
    }
}
