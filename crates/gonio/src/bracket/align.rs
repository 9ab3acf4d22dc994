//! Alignment of exposures by translation: median threshold bitmaps (Ward, "Fast, robust image
//! registration for compositing high dynamic range photographs from hand-held exposures", 2003).
//!
//! A threshold at the same quantile divides two exposures of a scene into the same parts, whatever
//! the response of the camera. The best shift minimises the share of pixels on different sides,
//! without the pixels near the threshold. The search doubles the resolution step by step.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Exposure;
use crate::parallel;
use crate::picture::Plane;

/// Half of the longer side, in pixels, above which a level is halved.
const COARSEST_SIDE: usize = 40;
/// Largest shift at the coarsest level, as a share of the longer side.
const COARSE_REACH: f64 = 0.12;
/// Number of shifts of a level that the next level refines.
const CANDIDATES: usize = 4;
/// Largest number of levels above the full resolution.
const MAX_LEVELS: usize = 5;
/// Quantiles for thresholds, in order of preference.
const QUANTILES: [f64; 9] = [0.5, 0.35, 0.65, 0.2, 0.8, 0.08, 0.92, 0.03, 0.97];
/// Largest number of thresholds.
const MAX_THRESHOLDS: usize = 5;
/// Range of a threshold, as a share of the largest code: codes that are neither black nor clipped.
const THRESHOLDS: Range<f64> = 0.05..0.95;
/// Distance from the threshold within which pixels do not count, as a share of the largest code.
const THRESHOLD_MARGIN: f64 = 4.0 / 255.0;
/// Smallest number of pixels on each side of the threshold, as a share of all.
const MIN_SHARE: f64 = 0.02;
/// Number of rows, and of columns, of the cells whose differences are compared before and after.
const CELLS: usize = 8;
/// Largest share of the differing pixels that may remain after a shift, and largest share of the
/// changed cells that may have more of them than before.
const IMPROVED: (f64, f64) = (0.8, 0.25);

/// Returns the columns and rows by which the scene is displaced in each exposure, relative to the
/// first.
///
/// An exposure keeps the shift of its neighbour if no threshold divides both, or if a shift hardly
/// removes differences.
pub(super) fn shifts(exposures: &[Exposure]) -> Vec<(i32, i32)> {
    let mut order: Vec<usize> = (0..exposures.len()).collect();
    order.sort_by(|&a, &b| exposures[a].amount.total_cmp(&exposures[b].amount));
    let greens: Vec<Plane<f32>> = parallel::map(exposures, green);
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
        let divisions = divisions(a, b, candidates[0]);
        let side = a.width().max(a.height());
        let reach = if level == 0 { (COARSE_REACH * side as f64).round() as i32 } else { 1 };
        let around = |&(dx, dy): &(i32, i32)| {
            (dy - reach..=dy + reach).flat_map(move |dy| (dx - reach..=dx + reach).map(move |dx| (dx, dy)))
        };
        let tried: BTreeSet<(i32, i32)> = candidates.iter().flat_map(around).collect();
        let difference = |shift: (i32, i32)| divisions.iter().map(|of| of.differences(shift).share()).sum::<f64>();
        let mut scored: Vec<_> = tried.into_iter().map(|shift| (difference(shift), shift)).collect();
        // Among equal differences, the smallest shift.
        let length = |(dx, dy): (i32, i32)| dx * dx + dy * dy;
        scored.sort_by(|a, b| a.0.total_cmp(&b.0).then(length(a.1).cmp(&length(b.1))));
        candidates = scored.into_iter().take(CANDIDATES).map(|(_, shift)| shift).collect();
    }
    let shift = candidates[0];
    if improves(&divisions(a, b, shift), shift) { shift } else { (0, 0) }
}

/// Whether a shift removes differences, and in most parts of the picture. A moving object changes
/// few parts.
fn improves(divisions: &[Division], shift: (i32, i32)) -> bool {
    let (mut before, mut after) = (Differences::default(), Differences::default());
    for division in divisions {
        before = before.add(&division.differences((0, 0)));
        after = after.add(&division.differences(shift));
    }
    let cells = before.cells().zip(after.cells());
    let (better, worse) = cells.fold((0, 0), |(better, worse), (before, after)| {
        (better + usize::from(after < before), worse + usize::from(after > before))
    });
    after.share() <= IMPROVED.0 * before.share() && worse as f64 <= IMPROVED.1 * (better + worse) as f64
}

/// Returns the means of blocks of 2 x 2 pixels.
fn halved(of: &Plane<f32>) -> Plane<f32> {
    Plane::from_fn(of.width() / 2, of.height() / 2, |x, y| {
        0.25 * (of[(2 * x, 2 * y)] + of[(2 * x + 1, 2 * y)] + of[(2 * x, 2 * y + 1)] + of[(2 * x + 1, 2 * y + 1)])
    })
}

/// Side of the threshold: 1 above, -1 below, 0 near it.
type Bitmap = Plane<i8>;

/// Two exposures, divided at the same quantile.
struct Division {
    a: Bitmap,
    b: Bitmap,
}

/// Divides two exposures at the quantiles suitable for both, at most [`MAX_THRESHOLDS`].
///
/// The quantiles are those of the part that both show if `b` is displaced by `shift`.
fn divisions(a: &Plane<f32>, b: &Plane<f32>, shift: (i32, i32)) -> Vec<Division> {
    let (in_a, in_b) = (Histogram::new(a, shift), Histogram::new(b, (-shift.0, -shift.1)));
    let divided = |plane: &Plane<f32>, histogram: &Histogram, quantile: f64| {
        let threshold = histogram.quantile(quantile)?;
        let bitmap = plane.map(|v| match v - threshold {
            off if off.abs() <= THRESHOLD_MARGIN as f32 => 0,
            off if off > 0.0 => 1,
            _ => -1,
        });
        let least = MIN_SHARE * plane.as_slice().len() as f64;
        let is_divided =
            [-1, 1].iter().all(|side| bitmap.as_slice().iter().filter(|s| *s == side).count() as f64 > least);
        (THRESHOLDS.contains(&f64::from(threshold)) && is_divided).then_some(bitmap)
    };
    let both = |&quantile: &f64| Some(Division { a: divided(a, &in_a, quantile)?, b: divided(b, &in_b, quantile)? });
    QUANTILES.iter().filter_map(both).take(MAX_THRESHOLDS).collect()
}

/// Numbers of pixels by value.
struct Histogram(Vec<u32>);

impl Histogram {
    /// Counts the values of the pixels that an exposure displaced by a shift shows, too.
    fn new(plane: &Plane<f32>, (dx, dy): (i32, i32)) -> Self {
        let (columns, rows) = (shared(dx, plane.width()), shared(dy, plane.height()));
        let mut counts = vec![0; 1 << 16];
        for y in rows {
            for value in &plane.as_slice()[y * plane.width()..][columns.clone()] {
                counts[(value * f32::from(u16::MAX)).round() as usize] += 1;
            }
        }
        Self(counts)
    }

    /// Returns the value that a share of the pixels does not reach; `None` without pixels.
    fn quantile(&self, share: f64) -> Option<f32> {
        let rank = (share * self.0.iter().map(|&n| f64::from(n)).sum::<f64>()) as u32;
        let mut below = 0;
        let reaches = |count: &u32| {
            below += count;
            below > rank
        };
        self.0.iter().position(reaches).map(|value| value as f32 / f32::from(u16::MAX))
    }
}

/// Returns the columns (or rows) of `a` that `b`, displaced by `by`, shows too.
fn shared(by: i32, count: usize) -> Range<usize> {
    let count = count as i32;
    ((-by).clamp(0, count) as usize)..((count - by).clamp(0, count) as usize)
}

/// Numbers of pixels in each cell of [`CELLS`] x [`CELLS`]: those on known sides of a threshold in
/// both exposures, and those of them on different sides.
#[derive(Clone, Default)]
struct Differences([[(usize, usize); CELLS]; CELLS]);

impl Differences {
    fn add(mut self, other: &Self) -> Self {
        for (a, b) in self.0.as_flattened_mut().iter_mut().zip(other.0.as_flattened()) {
            *a = (a.0 + b.0, a.1 + b.1);
        }
        self
    }

    /// Returns the share of the known pixels that differ.
    fn share(&self) -> f64 {
        let (known, differing) = self.0.as_flattened().iter().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        if known == 0 { 1.0 } else { differing as f64 / known as f64 }
    }

    /// Returns the share of the pixels of each cell that differ.
    fn cells(&self) -> impl Iterator<Item = f64> {
        self.0.as_flattened().iter().map(|&(known, differing)| differing as f64 / known.max(1) as f64)
    }
}

impl Division {
    /// Compares the pixels of `a` with those of `b` displaced by a shift.
    fn differences(&self, (dx, dy): (i32, i32)) -> Differences {
        let (width, height) = self.a.size();
        let (columns, rows) = (shared(dx, width), shared(dy, height));
        let of_row = |y: usize| {
            let mut found = Differences::default();
            let cells = &mut found.0[y * CELLS / height];
            for (k, (known, differing)) in cells.iter_mut().enumerate() {
                let columns = (k * width / CELLS).max(columns.start)..((k + 1) * width / CELLS).min(columns.end);
                if columns.is_empty() {
                    continue;
                }
                let from = ((y as i32 + dy) as usize * width + columns.start).strict_add_signed(dx as isize);
                let b = &self.b.as_slice()[from..from + columns.len()];
                let a = &self.a.as_slice()[y * width..][columns];
                // Sums of few bytes fit in a byte, so that many are added at a time.
                for (a, b) in a.chunks(128).zip(b.chunks(128)) {
                    let count = |condition: fn(i8) -> bool| {
                        let sum = |sum: u8, (a, b): (&i8, &i8)| sum + u8::from(condition(a * b));
                        usize::from(a.iter().zip(b).fold(0, sum))
                    };
                    *known += count(|product| product != 0);
                    *differing += count(|product| product < 0);
                }
            }
            found
        };
        parallel::map_range(rows.len(), |at| of_row(rows.start + at))
            .iter()
            .fold(Differences::default(), |a, b| a.add(b))
    }
}
