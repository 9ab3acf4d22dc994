//! Converts pixels of the second paint to those of the first.
//!
//! Both paints have the same reflections at their surface, so their ratio depends on the share of
//! these reflections in the brightness: in a highlight, it is one. The steps along the border of
//! the paints measure the ratio there. A pixel of the second paint near the border is divided by
//! the median ratio of the steps around it: in some steps, a cell shows both paints.

use glam::{DVec3, Vec3};

use super::{Cells, Groups};
use crate::picture::Plane;
use crate::scene::components::neighbours;

/// Standard deviation of the weights of steps by their distance, in cells.
const WIDTH: f64 = 5.0;
/// Largest distance of the steps, in cells.
const REACH: f64 = 12.0;
/// Smallest sum of these weights.
const MIN_WEIGHT: f64 = 4.0;

impl Groups {
    /// Returns the pixels of the second paint, converted to the first. Pixels within `margin` cells
    /// of the first group, or far from all steps, are `None`.
    pub(super) fn converted(&self, cells: &Cells, rgb: &Plane<Vec3>, margin: usize) -> Plane<Option<Vec3>> {
        let grid = self.index.size();
        let second = self.with_margin(0);
        let mut first = second.map(|second| !second);
        for _ in 0..margin {
            first = Plane::from_fn(grid.0, grid.1, |u, v| {
                first[(u, v)] || neighbours((u, v), grid, true).any(|near| first[near])
            });
        }
        let steps: Vec<([f64; 2], DVec3)> = self
            .steps()
            .into_iter()
            .map(|step| {
                let [a, b] = step.cells.map(|cell| self.places[cell]);
                ([0.5 * (a.0 + b.0) as f64, 0.5 * (a.1 + b.1) as f64], step.change)
            })
            .collect();
        let changes = Plane::from_fn(grid.0, grid.1, |u, v| {
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
            let channel =
                |c: usize| weighted_median(near.iter().map(|(weight, change)| (change[c], *weight)).collect());
            (total >= MIN_WEIGHT).then(|| DVec3::from_array([0, 1, 2].map(channel)))
        });
        Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
            let change = changes[cells.cell((x, y))?]?;
            Some(cells.colour(cells.tone(rgb[(x, y)]) - change))
        })
    }
}

/// Returns the median of values with weights.
fn weighted_median(mut values: Vec<(f64, f64)>) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    values
        .iter()
        .find(|(_, weight)| {
            sum += weight;
            sum >= half
        })
        .map_or(0.0, |(value, _)| *value)
}
