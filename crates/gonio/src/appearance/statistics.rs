//! Statistics of an image on the disk of normals: its brightness by region, and its contrast by
//! scale.
//!
//! The contrast of natural light decreases from coarse to fine scales in a known way. The lobe of a
//! material removes details finer than itself (Fleming et al. 2003; Dror et al. 2004). Explicit
//! statistics spare the network from learning squares, sums and logarithms. They are invariant to
//! the scale of the image, to rotations by 90 degrees and to mirroring.

use std::ops::Range;
use std::sync::LazyLock;

use gonio_linalg::dispatch;

use super::disk::{BLACK, DISK_SIDE, on_disk};

/// Number of scales, each twice as coarse as the previous one, starting at one cell of the disk.
const LEVELS: usize = 5;

/// Levels at which gradients are measured.
const GRADIENTS: Range<usize> = 1..4;

/// Bounds of the regions in which contrast is measured, as cosines of the angle to the view:
/// centre, middle, rim.
const REGIONS: [f32; 4] = [1.0, 0.8, 0.5, 0.0];

/// Bounds of the rings in which brightness is measured, as cosines of the angle to the view.
const RINGS: [f32; 7] = [1.0, 0.95, 0.85, 0.7, 0.5, 0.3, 0.0];

/// Quantiles of the logarithm of the values.
const QUANTILES: [f64; 13] = [0.0, 0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.98, 0.995, 1.0];

/// Number of values that [`statistics`] returns.
pub(super) const STATISTICS: usize = QUANTILES.len()
    + 4 * (RINGS.len() - 1)
    + (REGIONS.len() - 1)
    + 2 * (5 * LEVELS * (REGIONS.len() - 1)
        + 2 * (LEVELS - 1)
        + 2 * (GRADIENTS.end - GRADIENTS.start) * (REGIONS.len() - 1));

/// Computes statistics of values over their mean in observed cells, each of the order of one.
///
/// The statistics are, in this order:
///
/// * quantiles of the logarithm;
/// * in each ring, the mean, standard deviation, smallest and largest logarithm;
/// * in each region, the logarithm of the mean square of the detail finer than the cells;
/// * in each region, the logarithm of the mean square of the detail, its skewness, the logarithm of
///   its kurtosis, its largest and its smallest value;
/// * except at the finest scale, the correlations of the magnitude of the detail and of its signed
///   value with those of the next finer scale;
/// * at some scales and in each region, the logarithms of the mean squares of the radial and the
///   tangential slope.
///
/// The last three items follow for each scale, first of the values and then of their logarithm.
/// Statistics without observations are zero.
///
/// `relative`, `fine` (the finer detail, where known) and `weights` are those of the cells, row by
/// row; cells without weight are ignored.
pub(super) fn statistics(relative: &[f32], fine: &[Option<f32>], weights: &[f32], out: &mut [f32]) {
    let mut all = Vec::with_capacity(STATISTICS);
    let logs: Vec<f32> = relative.iter().map(|v| (v + BLACK).ln()).collect();
    levels(&logs, weights, &mut all);
    finest(fine, &mut all);
    let weights = weights_of_levels(weights);
    for field in [relative, &logs] {
        contrast(field.to_vec(), &weights, &mut all);
    }
    out.copy_from_slice(&all);
}

/// Precomputed geometry of the cells of each level.
struct Grid {
    side: usize,
    /// Region of each cell; off the disk, the outermost region.
    region: Vec<Option<usize>>,
    /// Ring of each cell; off the disk, the outermost ring.
    ring: Vec<Option<usize>>,
    /// Unit vector from the middle of the disk outwards, `(right, down)`.
    outwards: Vec<(f32, f32)>,
}

static GRIDS: LazyLock<[Grid; LEVELS]> = LazyLock::new(|| {
    std::array::from_fn(|level| {
        let side = DISK_SIDE >> level;
        let place = |i: usize| (i as f32 + 0.5) * (2.0 / side as f32) - 1.0;
        let centre = |cell: usize| (place(cell % side), place(cell / side));
        let within = |bounds: &[f32], cell: usize| {
            let (x, y) = centre(cell);
            let z = (1.0 - x * x - y * y).max(0.0).sqrt();
            bounds.windows(2).position(|b| z <= b[0] && z > b[1]).or((z <= 0.0).then_some(bounds.len() - 2))
        };
        let outwards = |cell: usize| {
            let (x, y) = centre(cell);
            (x / x.hypot(y), y / x.hypot(y))
        };
        let cells = 0..side * side;
        Grid {
            side,
            region: cells.clone().map(|c| within(&REGIONS, c)).collect(),
            ring: cells.clone().map(|c| within(&RINGS, c)).collect(),
            outwards: cells.map(outwards).collect(),
        }
    })
});

/// Weights of the cells of a level, and the smoothed weights.
struct Weights {
    own: Vec<f32>,
    smooth: Vec<f32>,
}

fn weights_of_levels(weights: &[f32]) -> Vec<Weights> {
    let mut own = weights.to_vec();
    (0..LEVELS)
        .map(|level| {
            let side = DISK_SIDE >> level;
            let smooth = smoothed(&own, side);
            let coarse = quartered(&own, side);
            Weights { own: std::mem::replace(&mut own, coarse), smooth }
        })
        .collect()
}

/// Returns the means over squares of two by two cells.
fn quartered(fine: &[f32], side: usize) -> Vec<f32> {
    let half = side / 2;
    let mut coarse = Vec::with_capacity(half * half);
    for rows in fine.chunks_exact(2 * side) {
        let (upper, lower) = rows.split_at(side);
        let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        coarse.extend(pairs.map(|(a, b)| 0.25 * ((a[0] + a[1]) + (b[0] + b[1]))));
    }
    coarse
}

/// Convolves with `[1 4 6 4 1] / 16` along both axes; values outside are zero.
fn smoothed(field: &[f32], side: usize) -> Vec<f32> {
    const TAPS: [f32; 3] = [0.375, 0.25, 0.0625];
    let mut across = vec![0.0; side * (side + 4)];
    let mut out = vec![0.0; side * side];
    dispatch(|| {
        let mut padded = vec![0.0; side + 4];
        for (line, to) in field.chunks_exact(side).zip(across[2 * side..].chunks_exact_mut(side)) {
            padded[2..side + 2].copy_from_slice(line);
            for (x, to) in to.iter_mut().enumerate() {
                let p = &padded[x..x + 5];
                *to = TAPS[0] * p[2] + TAPS[1] * (p[1] + p[3]) + TAPS[2] * (p[0] + p[4]);
            }
        }
        for (y, to) in out.chunks_exact_mut(side).enumerate() {
            let line = |row: usize| &across[(y + row) * side..][..side];
            let (a, b, c, d, e) = (line(0), line(1), line(2), line(3), line(4));
            for x in 0..side {
                to[x] = TAPS[0] * c[x] + TAPS[1] * (b[x] + d[x]) + TAPS[2] * (a[x] + e[x]);
            }
        }
    });
    out
}

/// Appends statistics of brightness, overall and in each ring.
fn levels(logs: &[f32], weights: &[f32], out: &mut Vec<f32>) {
    let mut sorted: Vec<f32> = logs.iter().zip(weights).filter(|(_, w)| **w > 0.0).map(|(v, _)| *v).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let last = sorted.len().saturating_sub(1);
    out.extend(QUANTILES.map(|q| sorted.get((q * last as f64).round() as usize).map_or(0.0, |v| 0.5 * v)));
    let mut rings = [Moments::NONE; RINGS.len() - 1];
    for ((value, weight), ring) in logs.iter().zip(weights).zip(&GRIDS[0].ring) {
        if let Some(ring) = ring.filter(|_| *weight > 0.0) {
            rings[ring].add(*value, *weight);
        }
    }
    for ring in rings {
        let [mean, square, ..] = ring.means();
        let deviation = (square - mean * mean).max(0.0).sqrt();
        out.extend([0.5 * mean as f32, deviation as f32, 0.5 * ring.least, 0.5 * ring.largest]);
    }
}

/// Appends the power of the detail finer than the cells, relative to the mean of the image.
fn finest(fine: &[Option<f32>], out: &mut Vec<f32>) {
    let mut sums = [[0.0_f64; 2]; REGIONS.len() - 1];
    for (detail, region) in fine.iter().zip(&GRIDS[0].region) {
        if let (Some(detail), Some(region)) = (detail, region) {
            sums[*region][0] += 1.0;
            sums[*region][1] += f64::from(*detail).powi(2);
        }
    }
    out.extend(sums.map(|[count, square]| if count > 0.0 { power(square / count) } else { 0.0 }));
}

/// Appends statistics of detail and slopes at each scale.
fn contrast(mut field: Vec<f32>, weights: &[Weights], out: &mut Vec<f32>) {
    let mut finer: Option<Vec<f32>> = None;
    for (level, (grid, weights)) in GRIDS.iter().zip(weights).enumerate() {
        let weighted: Vec<f32> = field.iter().zip(&weights.own).map(|(v, w)| v * w).collect();
        let sums = smoothed(&weighted, grid.side);
        let mean = |c: usize| if weights.smooth[c] > 0.0 { sums[c] / weights.smooth[c] } else { 0.0 };
        let smooth: Vec<f32> = (0..field.len()).map(mean).collect();
        let detail: Vec<f32> = field.iter().zip(&smooth).map(|(v, s)| v - s).collect();
        details(&detail, &weights.own, grid, out);
        if let Some(finer) = &finer {
            agreement(&detail, &weights.own, finer, grid.side, out);
        }
        if GRADIENTS.contains(&level) {
            slopes(&smooth, &weights.own, grid, out);
        }
        // Means of the smooth part over the observed cells.
        let (above, below) = (quartered(&sums, grid.side), quartered(&weights.smooth, grid.side));
        field = above.iter().zip(&below).map(|(a, b)| if *b > 0.0 { a / b } else { 0.0 }).collect();
        finer = Some(detail);
    }
}

/// Returns the logarithm of a mean square, scaled to the order of one.
fn power(square: f64) -> f32 {
    ((square + 1e-9).ln() / 6.0 + 1.0) as f32
}

fn details(detail: &[f32], weights: &[f32], grid: &Grid, out: &mut Vec<f32>) {
    let mut regions = [Moments::NONE; REGIONS.len() - 1];
    for ((value, weight), region) in detail.iter().zip(weights).zip(&grid.region) {
        if let Some(region) = region.filter(|_| *weight > 0.0) {
            regions[region].add(*value, *weight);
        }
    }
    for region in regions {
        if region.weight <= 0.0 {
            out.extend([0.0; 5]);
            continue;
        }
        let [_, square, cube, fourth] = region.means();
        let deviation = (square + 1e-9).sqrt();
        let largest = |v: f32| (f64::from(v.max(0.0)) / deviation).ln_1p() - 1.0;
        out.extend([
            power(square),
            0.5 * (cube / deviation.powi(3)).asinh() as f32,
            0.5 * ((fourth / deviation.powi(4) + 1e-3).ln() - 1.0) as f32,
            largest(region.largest) as f32,
            largest(-region.least) as f32,
        ]);
    }
}

/// Appends the correlations of two scales: of their magnitudes and of their signed values.
fn agreement(detail: &[f32], weights: &[f32], finer: &[f32], side: usize, out: &mut Vec<f32>) {
    let magnitude = |v: &[f32]| v.iter().map(|x| x.abs()).collect::<Vec<f32>>();
    let pairs =
        [(magnitude(detail), quartered(&magnitude(finer), 2 * side)), (detail.to_vec(), quartered(finer, 2 * side))];
    for (own, other) in pairs {
        let mut sums = [0.0_f64; 6];
        for ((a, b), w) in own.iter().zip(&other).zip(weights) {
            let [a, b, w] = [*a, *b, *w].map(f64::from);
            for (sum, term) in sums.iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                *sum += w * term;
            }
        }
        let [total, a, b, aa, bb, ab] = sums;
        let total = total.max(1e-12);
        let (va, vb, vab) = (aa - a * a / total, bb - b * b / total, ab - a * b / total);
        out.push((vab / (va.max(0.0) * vb.max(0.0) + 1e-12 * total * total).sqrt()) as f32);
    }
}

/// Appends mean squares of the radial and the tangential slope, in values per cell of the level.
fn slopes(smooth: &[f32], weights: &[f32], grid: &Grid, out: &mut Vec<f32>) {
    let side = grid.side;
    let mut sums = [[0.0_f64; 3]; REGIONS.len() - 1];
    for row in 1..side - 1 {
        for cell in row * side + 1..row * side + side - 1 {
            let around = [cell - 1, cell + 1, cell - side, cell + side];
            let Some(region) = grid.region[cell].filter(|_| weights[cell] > 0.0) else { continue };
            if around.iter().any(|&c| weights[c] <= 0.0) {
                continue;
            }
            let [left, right, above, below] = around.map(|c| smooth[c]);
            let (x, y) = (0.5 * (right - left), 0.5 * (below - above));
            let (dx, dy) = grid.outwards[cell];
            let (radial, tangential) = (x * dx + y * dy, y * dx - x * dy);
            let weight = f64::from(weights[cell]);
            let terms = [1.0, f64::from(radial * radial), f64::from(tangential * tangential)];
            sums[region].iter_mut().zip(terms).for_each(|(s, t)| *s += weight * t);
        }
    }
    for [weight, radial, tangential] in sums {
        let mean = |sum: f64| if weight > 0.0 { power(sum / weight) } else { 0.0 };
        out.extend([mean(radial), mean(tangential)]);
    }
}

/// Weighted sums of powers, and extremes.
#[derive(Clone, Copy)]
struct Moments {
    weight: f64,
    sums: [f64; 4],
    least: f32,
    largest: f32,
}

impl Moments {
    const NONE: Self = Self { weight: 0.0, sums: [0.0; 4], least: 0.0, largest: 0.0 };

    fn add(&mut self, value: f32, weight: f32) {
        let (x, w) = (f64::from(value), f64::from(weight));
        let square = x * x;
        for (sum, power) in self.sums.iter_mut().zip([x, square, x * square, square * square]) {
            *sum += w * power;
        }
        (self.least, self.largest) =
            if self.weight > 0.0 { (self.least.min(value), self.largest.max(value)) } else { (value, value) };
        self.weight += w;
    }

    /// Returns the means of the powers one to four; zero without weight.
    fn means(&self) -> [f64; 4] {
        self.sums.map(|s| if self.weight > 0.0 { s / self.weight } else { 0.0 })
    }
}

/// Returns one for each observed cell of the disk, zero elsewhere.
pub(super) fn observed(counts: &[f32]) -> Vec<f32> {
    counts.iter().enumerate().map(|(c, n)| f32::from(u8::from(*n > 0.0 && on_disk(c)))).collect()
}

#[cfg(test)]
mod tests;
