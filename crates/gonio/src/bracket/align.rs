//! Alignment of exposures by translation: median threshold bitmaps (Ward, "Fast, robust image
//! registration for compositing high dynamic range photographs from hand-held exposures", 2003).
//!
//! A threshold at the same quantile divides two exposures of a scene into the same parts, whatever
//! the response of the camera. The best shift minimises the share of pixels on different sides,
//! without the pixels near the threshold. The search doubles the resolution step by step.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::Exposure;
use crate::picture::Plane;

/// Longer side of the coarsest level, in pixels.
const COARSEST_SIDE: usize = 40;
/// Largest shift at the coarsest level, in its pixels.
const COARSE_REACH: i32 = 3;
/// Number of shifts of a level that the next level refines.
const CANDIDATES: usize = 4;
/// Largest number of levels above the full resolution.
const MAX_LEVELS: usize = 5;
/// Quantiles for the threshold, in order of preference.
const QUANTILES: [f64; 7] = [0.5, 0.35, 0.65, 0.2, 0.8, 0.08, 0.92];
/// Range of a threshold, as a share of the largest code: codes that are neither black nor clipped.
const THRESHOLDS: std::ops::Range<f64> = 0.05..0.95;
/// Distance from the threshold within which pixels do not count, as a share of the largest code.
const NEAR: f64 = 4.0 / 255.0;
/// Smallest number of pixels on each side of the threshold, as a share of all.
const MIN_SHARE: f64 = 0.02;
/// Largest share of the differing pixels that may remain after a shift.
const IMPROVED: f64 = 0.5;

/// Returns the columns and rows by which the scene is displaced in each exposure, relative to the
/// first.
///
/// An exposure keeps the shift of its neighbour if no threshold separates both, or if a shift does
/// not remove half of the differences.
pub(super) fn shifts(exposures: &[Exposure]) -> Vec<(i32, i32)> {
    let mut order: Vec<usize> = (0..exposures.len()).collect();
    order.sort_by(|&a, &b| exposures[a].amount.total_cmp(&exposures[b].amount));
    let greens: Vec<Plane<f32>> = exposures.par_iter().map(green).collect();
    let mut shifts = vec![(0, 0); exposures.len()];
    for pair in order.windows(2) {
        let (dx, dy) = displacement(&greens[pair[0]], &greens[pair[1]]);
        shifts[pair[1]] = (shifts[pair[0]].0 + dx, shifts[pair[0]].1 + dy);
    }
    let first = shifts.first().copied().unwrap_or_default();
    shifts.into_iter().map(|(dx, dy)| (dx - first.0, dy - first.1)).collect()
}

/// Returns the green channel, 0..=1.
fn green(exposure: &Exposure) -> Plane<f32> {
    let (width, height) = exposure.codes.size();
    let scale = 1.0 / f32::from(exposure.codes.max());
    Plane::from_fn(width, height, |x, y| scale * f32::from(exposure.codes.at(y * width + x)[1]))
}

/// Returns the displacement of `b` relative to `a`; zero if it cannot be determined.
fn displacement(a: &Plane<f32>, b: &Plane<f32>) -> (i32, i32) {
    let mut levels = vec![(a.clone(), b.clone())];
    while let Some((a, b)) = levels.last()
        && a.width().max(a.height()) > 2 * COARSEST_SIDE
        && levels.len() <= MAX_LEVELS
    {
        let next = (halved(a), halved(b));
        levels.push(next);
    }
    let mut candidates = vec![(0, 0)];
    for (level, (a, b)) in levels.iter().rev().enumerate() {
        candidates.iter_mut().for_each(|shift| *shift = (2 * shift.0, 2 * shift.1));
        let Some((a, b)) = bitmaps(a, b) else { continue };
        let reach = if level == 0 { COARSE_REACH } else { 1 };
        let around = |&(dx, dy): &(i32, i32)| {
            (dy - reach..=dy + reach).flat_map(move |dy| (dx - reach..=dx + reach).map(move |dx| (dx, dy)))
        };
        let tried: BTreeSet<(i32, i32)> = candidates.iter().flat_map(around).collect();
        let mut scored: Vec<_> = tried.into_iter().map(|shift| (difference(&a, &b, shift), shift)).collect();
        // Among equal differences, the smallest shift.
        let length = |(dx, dy): (i32, i32)| dx * dx + dy * dy;
        scored.sort_by(|a, b| a.0.total_cmp(&b.0).then(length(a.1).cmp(&length(b.1))));
        candidates = scored.into_iter().take(CANDIDATES).map(|(_, shift)| shift).collect();
    }
    let shift = candidates[0];
    let Some((a, b)) = bitmaps(a, b) else { return (0, 0) };
    if difference(&a, &b, shift) <= IMPROVED * difference(&a, &b, (0, 0)) { shift } else { (0, 0) }
}

/// Returns the means of blocks of 2 x 2 pixels.
fn halved(of: &Plane<f32>) -> Plane<f32> {
    Plane::from_fn(of.width() / 2, of.height() / 2, |x, y| {
        0.25 * (of[(2 * x, 2 * y)] + of[(2 * x + 1, 2 * y)] + of[(2 * x, 2 * y + 1)] + of[(2 * x + 1, 2 * y + 1)])
    })
}

/// Side of the threshold: 1 above, -1 below, 0 near it.
type Bitmap = Plane<i8>;

/// Divides two exposures at the same quantile; `None` if no threshold is suitable for both.
fn bitmaps(a: &Plane<f32>, b: &Plane<f32>) -> Option<(Bitmap, Bitmap)> {
    let sorted = |plane: &Plane<f32>| {
        let mut values = plane.as_slice().to_vec();
        values.sort_unstable_by(f32::total_cmp);
        values
    };
    let (in_a, in_b) = (sorted(a), sorted(b));
    let divided = |plane: &Plane<f32>, sorted: &[f32], quantile: f64| {
        let threshold = *sorted.get((quantile * sorted.len() as f64) as usize)?;
        let bitmap = plane.map(|v| match v - threshold {
            off if off.abs() <= NEAR as f32 => 0,
            off if off > 0.0 => 1,
            _ => -1,
        });
        let least = MIN_SHARE * sorted.len() as f64;
        let is_divided =
            [-1, 1].iter().all(|side| bitmap.as_slice().iter().filter(|s| *s == side).count() as f64 > least);
        (THRESHOLDS.contains(&f64::from(threshold)) && is_divided).then_some(bitmap)
    };
    QUANTILES.iter().find_map(|&quantile| Some((divided(a, &in_a, quantile)?, divided(b, &in_b, quantile)?)))
}

/// Returns the share of pixels on different sides after a shift of `b`, among those on known sides.
fn difference(a: &Bitmap, b: &Bitmap, (dx, dy): (i32, i32)) -> f64 {
    let (width, height) = a.size();
    // Pixels (x, y) of `a` that lie within `b` after the shift.
    let within = |by: i32, most: usize| {
        let most = most as i32;
        ((-by).clamp(0, most) as usize)..((most - by).clamp(0, most) as usize)
    };
    let (columns, rows) = (within(dx, width), within(dy, height));
    let of_row = |y: usize| {
        let from = (y as i32 + dy) as usize * width + (columns.start as i32 + dx) as usize;
        let a = &a.as_slice()[y * width + columns.start..y * width + columns.end];
        let b = &b.as_slice()[from..from + a.len()];
        a.iter().zip(b).fold((0_usize, 0_usize), |(known, differing), (a, b)| {
            let product = a * b;
            (known + usize::from(product != 0), differing + usize::from(product < 0))
        })
    };
    if columns.is_empty() {
        return 1.0;
    }
    let add = |a: (usize, usize), b: (usize, usize)| (a.0 + b.0, a.1 + b.1);
    let (known, differing) = rows.into_par_iter().map(of_row).reduce(|| (0, 0), add);
    if known == 0 { 1.0 } else { differing as f64 / known as f64 }
}
