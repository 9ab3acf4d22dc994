//! Operations on images of the disk, and random fields.

use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

use crate::appearance::disk::{DISK_SIDE, on_disk};

pub(super) fn between(rng: &mut impl Rng, low: f32, high: f32) -> f32 {
    rng.random_range(low..high)
}

/// Draws a number whose logarithm is uniformly distributed.
pub(super) fn log_between(rng: &mut impl Rng, low: f32, high: f32) -> f32 {
    between(rng, low.ln(), high.ln()).exp()
}

pub(super) fn gauss(rng: &mut impl Rng) -> f32 {
    StandardNormal.sample(rng)
}

/// Returns the value below which a share of the cells of the disk lies.
pub(super) fn quantile(values: &[f32], share: f32) -> f32 {
    let mut on: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)).map(|c| values[c]).collect();
    let at = (share.clamp(0.0, 1.0) * (on.len() - 1) as f32) as usize;
    *on.select_nth_unstable_by(at, f32::total_cmp).1
}

/// Computes the magnitude of the slope at each cell, per width of a cell.
pub(super) fn slopes(image: &[f32]) -> Vec<f32> {
    let slope = |c: usize| {
        if !on_disk(c) || c < DISK_SIDE || c + DISK_SIDE >= DISK_SIDE * DISK_SIDE {
            return 0.0;
        }
        let along = |a: usize, b: usize| {
            if on_disk(a) && on_disk(b) { 0.5 * (image[b] - image[a]) } else { 0.0 }
        };
        let (x, y) = (along(c - 1, c + 1), along(c - DISK_SIDE, c + DISK_SIDE));
        (x * x + y * y).sqrt()
    };
    (0..DISK_SIDE * DISK_SIDE).map(slope).collect()
}

/// Blurs an image by a Gaussian mean over the disk, of standard deviation `width` in cells.
pub(super) fn blurred(image: &[f32], width: f32) -> Vec<f32> {
    let reach = (2.5 * width).ceil() as isize;
    let kernel: Vec<f32> = (-reach..=reach).map(|i| (-0.5 * (i as f32 / width).powi(2)).exp()).collect();
    let pass = |from: &[[f32; 2]], stride: isize| -> Vec<[f32; 2]> {
        let mut to = vec![[0.0_f32; 2]; from.len()];
        for (i, weight) in (-reach..=reach).zip(&kernel) {
            for y in 0..DISK_SIDE as isize {
                let (rows, columns) = if stride == 1 { (y, i) } else { (y + i, 0) };
                if !(0..DISK_SIDE as isize).contains(&rows) {
                    continue;
                }
                let (low, high) = ((-columns).max(0), (DISK_SIDE as isize - columns).min(DISK_SIDE as isize));
                let source = &from[(rows * DISK_SIDE as isize + low + columns) as usize..][..(high - low) as usize];
                let target = &mut to[(y * DISK_SIDE as isize + low) as usize..][..(high - low) as usize];
                target.iter_mut().zip(source).for_each(|(t, s)| {
                    t[0] += weight * s[0];
                    t[1] += weight * s[1];
                });
            }
        }
        to
    };
    let start: Vec<[f32; 2]> =
        (0..DISK_SIDE * DISK_SIDE).map(|c| if on_disk(c) { [image[c], 1.0] } else { [0.0; 2] }).collect();
    let done = pass(&pass(&start, 1), DISK_SIDE as isize);
    (0..DISK_SIDE * DISK_SIDE).map(|c| if on_disk(c) { done[c][0] / done[c][1] } else { 0.0 }).collect()
}

pub(super) fn bilinear(image: &[f32], x: f32, y: f32) -> f32 {
    let last = (DISK_SIDE - 2) as f32;
    let (x, y) = (x.clamp(0.0, last), y.clamp(0.0, last));
    let (column, row) = (x as usize, y as usize);
    let (s, t) = (x - column as f32, y - row as f32);
    let at = |c: usize, r: usize| image[r * DISK_SIDE + c];
    (1.0 - t) * ((1.0 - s) * at(column, row) + s * at(column + 1, row))
        + t * ((1.0 - s) * at(column, row + 1) + s * at(column + 1, row + 1))
}

/// Draws a smooth random field of mean zero and variance one: Gaussian values on a grid of `across`
/// squares across, with cubic splines between them.
pub(super) fn field(across: usize, rng: &mut impl Rng) -> Vec<f32> {
    let side = across + 3;
    let nodes: Vec<f32> = (0..side * side).map(|_| gauss(rng)).collect();
    let shift = (between(rng, 0.0, 1.0), between(rng, 0.0, 1.0));
    let basis = |t: f32| {
        let u = 1.0 - t;
        [
            u * u * u / 6.0,
            (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
            (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0,
            t * t * t / 6.0,
        ]
    };
    let line = |shift: f32| -> Vec<(usize, [f32; 4])> {
        (0..DISK_SIDE)
            .map(|i| {
                let at = (i as f32 + 0.5) / DISK_SIDE as f32 * (across as f32 - 1.0) + shift;
                (at as usize, basis(at.fract()))
            })
            .collect()
    };
    let (columns, rows) = (line(shift.0), line(shift.1));
    let mut out = Vec::with_capacity(DISK_SIDE * DISK_SIDE);
    // The weighted sum has a standard deviation of 0.479, averaged over places.
    const SCALE: f32 = 1.0 / 0.479;
    for (row, v) in &rows {
        let across_rows: Vec<f32> =
            (0..side).map(|c| (0..4).map(|k| v[k] * nodes[(row + k) * side + c]).sum::<f32>()).collect();
        out.extend(
            columns.iter().map(|(column, u)| SCALE * (0..4).map(|k| u[k] * across_rows[column + k]).sum::<f32>()),
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn fields_have_variance_one() {
        let mut rng = Pcg64::seed_from_u64(8);
        for across in [4, 7, 16] {
            let values: Vec<f32> = (0..40).flat_map(|_| field(across, &mut rng)).collect();
            let square = values.iter().map(|v| f64::from(v * v)).sum::<f64>() / values.len() as f64;
            assert!((square - 1.0).abs() < 0.15, "{across}: {square}");
        }
    }
}
