//! Picture of the uncertainty of a BRDF: its mean and the width of its interval, as maps over half
//! and difference angle.

mod axes;
mod sheet;

use glam::Vec3;
use gonio::estimate::MaterialEstimate;
use gonio::picture::{Plane, srgb_decode};
use gonio::reflectance::{BivariateTable, THETA_D, THETA_H, is_trusted, trusted_cells};

pub use axes::svg;
pub use sheet::draw;

/// Pixels along a side of a cell of the table.
const CELL: usize = 6;
/// Side of a map, in pixels.
const MAP: usize = CELL * THETA_H;
/// Ticks of the half angle, which is stretched at the highlight, and of the difference angle.
const HALF_TICKS: [f64; 8] = [0.0, 1.0, 5.0, 10.0, 20.0, 40.0, 60.0, 80.0];
const DIFFERENCE_TICKS: [f64; 5] = [0.0, 20.0, 40.0, 60.0, 80.0];
/// Names of the axes.
const HALF: &str = "half angle (degrees)";
const DIFFERENCE: &str = "difference angle (degrees)";
/// Colours of the lines of hatching: one of them is visible on any background.
const HATCHING: [Vec3; 2] = [Vec3::new(0.8, 0.8, 0.78), Vec3::new(0.01, 0.01, 0.01)];

/// Stops of the colour scale, dark to bright: viridis.
const STOPS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// A map over half and difference angle, which shows the value of each cell of a table by colour.
pub struct Map {
    /// Identifier for the page.
    id: &'static str,
    title: &'static str,
    /// Meaning of the hatching.
    note: &'static str,
    scale: Scale,
    pixels: Plane<Vec3>,
}

/// Draws the BRDF (1/sr), hatched beyond the trusted angles.
pub fn mean(table: &BivariateTable) -> Map {
    let value = |c: usize| f64::from(table.as_slice()[c].max(1e-9));
    let (low, high) =
        trusted_cells().fold((f64::INFINITY, 0.0_f64), |(low, high), c| (low.min(value(c)), high.max(value(c))));
    let scale = Scale { low, high: high.max(2.0 * low) };
    let pixels = painted(&scale, &value, &|c| !is_trusted(c));
    Map { id: "mean", title: "BRDF (1/sr)", note: "hatched: above 80 degrees", scale, pixels }
}

/// Draws the ratio of the 95 % and the 5 % quantile, hatched where the BRDF is undetermined.
pub fn width(material: &MaterialEstimate) -> Map {
    let (lower, upper) = (&material.quantiles[0], &material.quantiles[material.quantiles.len() - 1]);
    let factor = |c: usize| f64::from(upper[c].max(1e-9)) / f64::from(lower[c].max(1e-9));
    let scale = Scale { low: 1.0, high: trusted_cells().map(factor).fold(4.0, f64::max) };
    let pixels = painted(&scale, &factor, &|c| material.undetermined[c]);
    Map {
        id: "interval",
        title: "Width of the 90 % interval (factor)",
        note: "hatched: undetermined, or above 80 degrees",
        scale,
        pixels,
    }
}

/// Paints the cells: half angle to the right, on the axis of the table, difference angle upwards.
fn painted(scale: &Scale, value: &dyn Fn(usize) -> f64, hatched: &dyn Fn(usize) -> bool) -> Plane<Vec3> {
    Plane::from_fn(MAP, MAP, |x, y| {
        let (i, j) = (x / CELL, THETA_D - 1 - y / CELL);
        let cell = i * THETA_D + j;
        match (x + y) % 16 {
            at @ 0..4 if hatched(cell) => HATCHING[at / 2],
            _ => colour(scale.at(value(cell))),
        }
    })
}

/// Returns the horizontal position of a half angle in a map, 0..=1; row i of a table is at (i/90)^2
/// 90 degrees.
fn across(degrees: f64) -> f64 {
    (degrees / 90.0).sqrt() + 0.5 / THETA_H as f64
}

/// Returns the vertical position of a difference angle in a map, 0..=1 from the top.
fn down(degrees: f64) -> f64 {
    1.0 - (degrees + 0.5) / THETA_D as f64
}

/// A logarithmic scale.
struct Scale {
    low: f64,
    high: f64,
}

impl Scale {
    /// Returns the position of a value, 0..=1.
    fn at(&self, value: f64) -> f64 {
        ((value / self.low).ln() / (self.high / self.low).ln()).clamp(0.0, 1.0)
    }

    /// Returns round values for labels, fewer on a long scale.
    fn ticks(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        let steps: &[f64] = if decades < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let all = (-9..9).flat_map(|e| steps.iter().map(move |s| s * 10.0_f64.powi(e)));
        all.filter(|v| (0.999 * self.low..=1.001 * self.high).contains(v)).collect()
    }
}

/// Returns the colour of a position on the scale, linear.
fn colour(at: f64) -> Vec3 {
    let x = at * (STOPS.len() - 1) as f64;
    let i = (x as usize).min(STOPS.len() - 2);
    let mixed =
        Vec3::from(STOPS[i].map(f32::from)).lerp(Vec3::from(STOPS[i + 1].map(f32::from)), (x - i as f64) as f32);
    (mixed / 255.0).map(srgb_decode)
}

/// Formats a round number as briefly as possible.
fn number(value: f64) -> String {
    if (0.001..10_000.0).contains(&value) { format!("{value}") } else { format!("{value:.0e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_have_round_ticks() {
        assert_eq!(Scale { low: 1.0, high: 30.0 }.ticks(), [1.0, 2.0, 5.0, 10.0, 20.0]);
        assert_eq!(Scale { low: 0.005, high: 120.0 }.ticks().len(), 5);
        assert_eq!(number(0.002), "0.002");
        assert_eq!(number(1e-5), "1e-5");
    }
}
