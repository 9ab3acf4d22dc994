//! Angle between two views of one ball, and their agreement.

use std::f64::consts::{PI, TAU};

use serde::Serialize;

use super::unwrap::{Texel, unwrap};
use super::{ProbeError, Reflectance, View};
use crate::picture::luminance;
use crate::sphere::lat_long_solid_angle;
use crate::statistics::weighted_median;

/// Number of rows of the maps on which all turns are tried.
const COARSE: usize = 64;
/// Number of rows of the maps on which the best turn is refined.
const FINE_ROWS: usize = 256;
/// Angle, in radians, from the best turn beyond which another turn counts as different.
const APART: f64 = 0.35;
/// Smallest correlation of two views at the correct turn.
const MIN_CORRELATION: f64 = 0.5;
/// Largest difference of this correlation from one, as a share of that of the next best turn.
const MAX_LACK: f64 = 0.7;
/// Smallest difference from the correlation of the next best turn.
const MIN_LEAD: f64 = 0.03;
/// Brightness added before logarithms are taken, as a share of the mean.
const LOG_FLOOR: f64 = 0.02;
/// Trust at or above which a texel is compared: the ball is seen from the front and does not
/// reflect the camera.
const COMPARED: f64 = 0.02;

/// Agreement of two views in the directions that both show.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Angle by which the second camera moved around the ball, counterclockwise as seen from above,
    /// in degrees, -180..=180.
    pub azimuth_degrees: f64,
    /// Whether the angle was estimated from the views.
    pub estimated: bool,
    /// Correlation of the logarithms of both views, -1..=1.
    pub correlation: f64,
    /// Median difference of both views in luminance, relative to their mean.
    pub difference: f64,
    /// Brightness of the second view over that of the first; the second view is divided by it.
    pub brightness: f64,
    /// Share of the sphere that both views show well.
    pub overlap: f64,
}

/// Logarithm of luminance and weight of each texel of a map, row-major.
struct Compared {
    rows: usize,
    texels: Vec<(f64, f64)>,
}

impl Compared {
    fn of(view: &View, rows: usize, reflectance: &Reflectance) -> Self {
        let map = unwrap(view, rows, 0.0, reflectance);
        let weights = |i: usize| if map[i].trust >= COMPARED { solid_angle(rows, i) } else { 0.0 };
        let total: f64 = (0..map.len()).map(weights).sum();
        let mean = (0..map.len()).map(|i| weights(i) * brightness(&map[i])).sum::<f64>() / total.max(1e-300);
        let floor = (LOG_FLOOR * mean).max(1e-30);
        Self { rows, texels: (0..map.len()).map(|i| ((brightness(&map[i]) + floor).ln(), weights(i))).collect() }
    }

    /// Returns the correlation with another map whose columns are moved to the right.
    ///
    /// Returns -1 if the maps share less than a twentieth of the sphere.
    fn correlation(&self, other: &Self, columns: isize) -> f64 {
        let wide = 2 * self.rows;
        let shift = columns.rem_euclid(wide as isize) as usize;
        let pairs = || {
            self.texels.iter().enumerate().filter_map(|(i, (a, weight))| {
                let (x, y) = (i % wide, i / wide);
                let (b, also) = other.texels[y * wide + (x + wide - shift) % wide];
                (*weight > 0.0 && also > 0.0).then_some((*a, b, *weight))
            })
        };
        correlation(pairs)
    }
}

/// Returns the weighted correlation of pairs; -1 if they cover less than a twentieth of the sphere.
fn correlation<I: Iterator<Item = (f64, f64, f64)>>(pairs: impl Fn() -> I) -> f64 {
    let (mut weight, mut a_sum, mut b_sum) = (0.0, 0.0, 0.0);
    for (a, b, w) in pairs() {
        weight += w;
        a_sum += w * a;
        b_sum += w * b;
    }
    if weight < 0.05 * 4.0 * PI {
        return -1.0;
    }
    let (a_mean, b_mean) = (a_sum / weight, b_sum / weight);
    let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
    for (a, b, w) in pairs() {
        aa += w * (a - a_mean) * (a - a_mean);
        ab += w * (a - a_mean) * (b - b_mean);
        bb += w * (b - b_mean) * (b - b_mean);
    }
    // Views without detail have no correlation.
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

fn brightness(texel: &Texel) -> f64 {
    f64::from(luminance(texel.radiance.as_vec3()))
}

/// Returns the solid angle of a texel, given its index.
pub(super) fn solid_angle(rows: usize, texel: usize) -> f64 {
    lat_long_solid_angle(texel / (2 * rows), rows)
}

/// Estimates the angle, in radians, by which the second camera moved around the ball.
///
/// This is the angle at which the maps correlate best.
///
/// # Errors
/// [`ProbeError::AmbiguousAzimuth`] if the correlation is too small, or too similar at another
/// angle.
pub(super) fn estimate_azimuth(first: &View, second: &View, reflectance: &Reflectance) -> Result<f64, ProbeError> {
    // If the camera moves counterclockwise, its map moves to the left.
    let angle = |columns: f64, rows: usize| -columns * PI / rows as f64;
    let maps = |rows: usize| [first, second].map(|view| Compared::of(view, rows, reflectance));
    let [a, b] = maps(COARSE);
    let coarse: Vec<f64> = (0..2 * COARSE as isize).map(|columns| a.correlation(&b, columns)).collect();
    let top = (0..coarse.len()).max_by(|&i, &j| coarse[i].total_cmp(&coarse[j])).unwrap_or(0);
    let apart = |i: usize| {
        let between = angle(i as f64 - top as f64, COARSE).rem_euclid(TAU);
        between.min(TAU - between) > APART
    };
    let best = coarse[top];
    let second = (0..coarse.len()).filter(|i| apart(*i)).map(|i| coarse[i]).fold(-1.0, f64::max);
    if best < MIN_CORRELATION || 1.0 - best > MAX_LACK * (1.0 - second) || best - second < MIN_LEAD {
        return Err(ProbeError::AmbiguousAzimuth { best, second });
    }
    let [a, b] = maps(FINE_ROWS);
    let scale = FINE_ROWS / COARSE;
    let around = (top * scale) as isize;
    let near: Vec<f64> = (-6..=6).map(|off| a.correlation(&b, around + off)).collect();
    let at = (1..near.len() - 1).max_by(|&i, &j| near[i].total_cmp(&near[j])).unwrap_or(6);
    let (left, middle, right) = (near[at - 1], near[at], near[at + 1]);
    // Vertex of the parabola through the best value and its neighbours.
    let bend = left - 2.0 * middle + right;
    let part = if bend < 0.0 { (0.5 * (left - right) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    let turn = angle((around + at as isize - 6) as f64 + part, FINE_ROWS);
    Ok((turn + PI).rem_euclid(TAU) - PI)
}

/// Compares two maps of one light with `rows` rows.
pub(super) fn compare(first: &[Texel], second: &[Texel], rows: usize, turn: f64, found: bool) -> Agreement {
    let both = || {
        let texels = first.iter().zip(second).enumerate();
        texels
            .filter(|(_, (a, b))| a.trust >= COMPARED && b.trust >= COMPARED)
            .map(|(i, (a, b))| (i, brightness(a), brightness(b)))
    };
    let weight: f64 = both().map(|(i, ..)| solid_angle(rows, i)).sum();
    let sums =
        both().fold((0.0, 0.0), |(a, b), (i, x, y)| (a + solid_angle(rows, i) * x, b + solid_angle(rows, i) * y));
    let floors = (LOG_FLOOR * sums.0 / weight.max(1e-300), LOG_FLOOR * sums.1 / weight.max(1e-300));
    let (dark, dark_second) = (floors.0.max(1e-30), floors.1.max(1e-30));
    let ratios = both().map(|(i, a, b)| ((b + dark_second) / (a + dark), solid_angle(rows, i)));
    let brightness = weighted_median(ratios).unwrap_or(1.0);
    let off = both().map(|(i, a, b)| {
        let b = b / brightness;
        ((a - b).abs() / (0.5 * (a + b) + dark), solid_angle(rows, i))
    });
    Agreement {
        azimuth_degrees: turn.to_degrees(),
        estimated: found,
        correlation: correlation(|| {
            both().map(|(i, a, b)| ((a + dark).ln(), (b + dark_second).ln(), solid_angle(rows, i)))
        }),
        difference: weighted_median(off).unwrap_or(0.0),
        brightness,
        overlap: weight / (4.0 * PI),
    }
}
