//! Picture of the uncertainty of a BRDF: its mean, and the width of the interval around it.

use glam::Vec3;
use gonio::estimate::Material;
use gonio::picture::{Plane, srgb_decode};
use gonio::reflectance::{BivariateTable, THETA_D, THETA_H, is_trusted, trusted_cells};

use crate::canvas::{INK, LETTER, PAPER, fill, place, sheet, text};

/// Pixels along a side of a cell of the table.
const CELL: usize = 4;
/// Side of a map.
const MAP: usize = CELL * THETA_H;
/// Margin to the left of a map, for the numbers of its axis.
const LEFT: usize = 72;
/// Space between a map and its colour bar, width of the bar, and width of the bar's numbers.
const BAR: (usize, usize, usize) = (16, 14, 90);
/// Margins above and below a map.
const TOP: usize = 36;
const BOTTOM: usize = 86;

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

/// Draws the mean over half and difference angle beside the factor between the 5 and the 95 %
/// quantile, hatched where the photograph hardly narrows it: linear display values in 0..=1.
pub fn draw(material: &Material) -> Plane<Vec3> {
    let (left, right) = (mean(&material.table), width(material));
    let mut out = sheet(left.width() + right.width(), left.height());
    place(&mut out, 0, 0, &left);
    place(&mut out, left.width(), 0, &right);
    out
}

/// Draws a BRDF (1/sr) over half and difference angle, hatched beyond the trusted angles.
pub fn mean(table: &BivariateTable) -> Plane<Vec3> {
    let value = |c: usize| f64::from(table.as_slice()[c].max(1e-9));
    let (low, high) =
        trusted_cells().fold((f64::INFINITY, 0.0_f64), |(low, high), c| (low.min(value(c)), high.max(value(c))));
    let scale = Scale { low, high: high.max(2.0 * low) };
    map("BRDF (1/sr)", &scale, &value, &|c| !is_trusted(c))
}

/// Draws the factor between the 5 and the 95 % quantile over the same angles, hatched where the
/// photograph hardly narrows it.
pub fn width(material: &Material) -> Plane<Vec3> {
    let (lower, upper) = (&material.quantiles[0], &material.quantiles[material.quantiles.len() - 1]);
    let factor = |c: usize| f64::from(upper[c].max(1e-9)) / f64::from(lower[c].max(1e-9));
    let scale = Scale { low: 1.0, high: trusted_cells().map(factor).fold(4.0, f64::max) };
    let mut out = map("width of the 90 % interval (factor)", &scale, &factor, &|c| material.undetermined[c]);
    text(&mut out, LEFT, TOP + MAP + 60, "hatched: hardly told, or beyond 80 degrees");
    out
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

    /// Returns round values to label, fewer on a long scale.
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

/// Draws one map with axes and a colour bar: half angle to the right, on the axis of the table,
/// difference angle upwards.
fn map(title: &str, scale: &Scale, value: &dyn Fn(usize) -> f64, hatched: &dyn Fn(usize) -> bool) -> Plane<Vec3> {
    let mut sheet = sheet(LEFT + MAP + BAR.0 + BAR.1 + BAR.2, TOP + MAP + BOTTOM);
    let (out, left) = (&mut sheet, LEFT);
    text(out, left, TOP - 20, title);
    let pixels = Plane::from_fn(MAP, MAP, |x, y| {
        let (i, j) = (x / CELL, THETA_D - 1 - y / CELL);
        let cell = i * THETA_D + j;
        let plain = colour(scale.at(value(cell)));
        // Lines of two colours: one of them is visible on any background.
        match (x + y) % 12 {
            0 | 1 if hatched(cell) => INK,
            2 | 3 if hatched(cell) => PAPER,
            _ => plain,
        }
    });
    place(out, left, TOP, &pixels);
    // Sample i of the half angle is at (i/90)^2 90 degrees.
    for degrees in [0.0, 1.0, 5.0, 10.0, 20.0, 40.0, 60.0, 80.0_f64] {
        let x = left + ((degrees / 90.0).sqrt() * MAP as f64) as usize + CELL / 2;
        fill(out, (x, TOP + MAP), (1, 5), INK);
        let label = format!("{degrees:.0}");
        text(out, x + 1 - label.len() * LETTER / 2, TOP + MAP + 10, &label);
    }
    text(out, left + MAP / 2 - 15 * LETTER, TOP + MAP + 28, "half angle theta_h (degrees)");
    for degrees in [0, 20, 40, 60, 80] {
        let y = TOP + MAP - degrees * CELL - CELL / 2;
        fill(out, (left - 5, y), (5, 1), INK);
        let label = degrees.to_string();
        text(out, left - 9 - label.len() * LETTER, y - LETTER / 2, &label);
    }
    for (n, line) in ["theta_d", "(deg.)"].iter().enumerate() {
        text(out, 2, TOP + MAP / 2 - 36 + 12 * n, line);
    }
    let bar = left + MAP + BAR.0;
    place(out, bar, TOP, &Plane::from_fn(BAR.1, MAP, |_, y| colour(1.0 - y as f64 / (MAP - 1) as f64)));
    for tick in scale.ticks() {
        let y = TOP + ((1.0 - scale.at(tick)) * (MAP - 1) as f64) as usize;
        fill(out, (bar + BAR.1, y), (4, 1), INK);
        text(out, bar + BAR.1 + 8, y.saturating_sub(LETTER / 2), &number(tick));
    }
    sheet
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
