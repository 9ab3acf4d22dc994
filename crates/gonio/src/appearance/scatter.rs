//! Scatter of pixels that share a normal.

use super::disk::{DISK_SIDE, RIM, Sample};
use crate::statistics::quantile;

/// Smallest number of observations of a patch of cells from which scatter is estimated.
const PATCH: usize = 6;

/// Smallest scatter: no camera is better.
const MIN_SCATTER: f32 = 0.001;

/// Estimates the relative standard deviation of observations that share a normal.
///
/// This is the median, over small patches of the disk with six or more observations, of the
/// standard deviation about a plane. The patches have the smallest size at which a quarter of them
/// have that many observations. Returns `None` if there is no such size.
pub fn scatter(samples: &[Sample]) -> Option<f32> {
    for side in [DISK_SIDE, DISK_SIDE / 2, DISK_SIDE / 4, DISK_SIDE / 8] {
        let mut order: Vec<(u32, u32)> = Vec::with_capacity(samples.len());
        let cells = side as f32 * 0.5;
        for (at, s) in samples.iter().enumerate() {
            if s.weight > 0.0 && s.x * s.x + s.y * s.y <= RIM * RIM {
                let place = |v: f32| (((v + 1.0) * cells) as usize).min(side - 1);
                order.push(((place(-s.y) * side + place(s.x)) as u32, at as u32));
            }
        }
        order.sort_unstable();
        let mut variances: Vec<f32> = order
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|patch| patch.len() >= PATCH)
            .filter_map(|patch| about_plane(patch.iter().map(|(_, at)| &samples[*at as usize])))
            .collect();
        if variances.len() * 4 >= (0.76 * (side * side) as f32) as usize && !variances.is_empty() {
            return quantile(&mut variances, 0.5).map(|median| median.sqrt().max(MIN_SCATTER));
        }
    }
    None
}

/// Returns the variance about a least-squares plane over the squared mean; `None` for black
/// patches.
fn about_plane<'a>(patch: impl Iterator<Item = &'a Sample> + Clone) -> Option<f32> {
    let count = patch.clone().count() as f64;
    let mean = |f: &dyn Fn(&Sample) -> f32| patch.clone().map(|s| f64::from(f(s))).sum::<f64>() / count;
    let (x, y, value) = (mean(&|s| s.x), mean(&|s| s.y), mean(&|s| s.value));
    let (mut xx, mut xy, mut yy, mut xv, mut yv, mut vv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for s in patch {
        let (a, b, c) = (f64::from(s.x) - x, f64::from(s.y) - y, f64::from(s.value) - value);
        xx += a * a;
        xy += a * b;
        yy += b * b;
        xv += a * c;
        yv += b * c;
        vv += c * c;
    }
    let determinant = xx * yy - xy * xy;
    let explained = if determinant > 1e-9 * (xx + yy).powi(2) {
        (yy * xv * xv - 2.0 * xy * xv * yv + xx * yv * yv) / determinant
    } else {
        0.0
    };
    (value > 0.0).then(|| (((vv - explained).max(0.0) / (count - 3.0)) / (value * value)) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::disk::tests::ball;
    use super::*;

    #[test]
    fn scatter_equals_the_noise_of_single_observations() {
        for (count, noise) in [(200_000, 0.2), (200_000, 0.01), (12_000, 0.1), (2_000, 0.3)] {
            let got = scatter(&ball(count, noise)).unwrap();
            assert!((got / noise - 1.0).abs() < 0.15, "{count} {noise}: {got}");
        }
        // The floor, and too few observations.
        assert!(scatter(&ball(200_000, 0.0)).unwrap() < 0.002);
        assert_eq!(scatter(&ball(40, 0.1)), None);
    }
}
