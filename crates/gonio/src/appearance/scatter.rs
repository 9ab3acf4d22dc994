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
        let cells = side as f32 * 0.5;
        let place = |v: f32| (((v + 1.0) * cells) as usize).min(side - 1);
        let used = || samples.iter().filter(|s| s.weight > 0.0 && s.x * s.x + s.y * s.y <= RIM * RIM);
        let mut patches = vec![Patch::default(); side * side];
        let patch_of = |s: &Sample| place(-s.y) * side + place(s.x);
        used().for_each(|s| patches[patch_of(s)].add_to_sums(s));
        used().for_each(|s| patches[patch_of(s)].add_to_moments(s));
        let large = patches.iter().filter(|patch| patch.count >= PATCH as f64);
        let mut variances: Vec<f32> = large.filter_map(Patch::variance).collect();
        if variances.len() * 4 >= (0.76 * (side * side) as f32) as usize && !variances.is_empty() {
            return quantile(&mut variances, 0.5).map(|median| median.sqrt().max(MIN_SCATTER));
        }
    }
    None
}

/// Sums over the observations of a patch of the disk.
#[derive(Clone, Default)]
struct Patch {
    count: f64,
    /// Sums of `x`, `y` and the value.
    sums: [f64; 3],
    /// Sums of the products of the deviations from the means, in the order xx, xy, yy, xv, yv, vv.
    moments: [f64; 6],
}

impl Patch {
    fn add_to_sums(&mut self, sample: &Sample) {
        self.count += 1.0;
        let values = [sample.x, sample.y, sample.value];
        self.sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += f64::from(value));
    }

    /// Adds an observation after all of them have been added to the sums.
    fn add_to_moments(&mut self, sample: &Sample) {
        let [x, y, v] = self.sums.map(|sum| sum / self.count);
        let (a, b, c) = (f64::from(sample.x) - x, f64::from(sample.y) - y, f64::from(sample.value) - v);
        let products = [a * a, a * b, b * b, a * c, b * c, c * c];
        self.moments.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
    }

    /// Returns the variance about a least-squares plane over the squared mean; `None` for a black
    /// patch.
    fn variance(&self) -> Option<f32> {
        let value = self.sums[2] / self.count;
        let [xx, xy, yy, xv, yv, vv] = self.moments;
        let determinant = xx * yy - xy * xy;
        let explained = if determinant > 1e-9 * (xx + yy).powi(2) {
            (yy * xv * xv - 2.0 * xy * xv * yv + xx * yv * yv) / determinant
        } else {
            0.0
        };
        (value > 0.0).then(|| (((vv - explained).max(0.0) / (self.count - 3.0)) / (value * value)) as f32)
    }
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
