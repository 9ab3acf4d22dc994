//! Detection of uniform regions with the shape of a parallelogram.

use glam::{DVec2, Vec3};

use crate::picture::Plane;

/// Ratio of the area to that of a parallelogram with the same second moments.
const FILLED: std::ops::Range<f64> = 0.86..1.12;
/// Largest ratio of the longer to the shorter axis.
const MAX_ASPECT: f64 = 2.0;
/// Smallest number of pixels. A square loses a rim of one or two pixels to its edges.
const MIN_PIXELS: usize = 9;
/// Largest fraction of the picture that a region covers.
const MAX_SHARE: f64 = 0.03;

/// A uniform region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Square {
    /// Centroid in pixels from the top left corner.
    pub(super) centre: DVec2,
    /// Side of a square of equal area, in pixels.
    pub(super) side: f64,
}

/// Detects uniform regions with the shape of a parallelogram in a picture of logarithms.
///
/// A pixel is uniform if its left and right neighbours, and its upper and lower ones, differ by
/// less than `threshold` in every channel.
pub(super) fn squares(log: &Plane<Vec3>, threshold: f32) -> Vec<Square> {
    let (width, height) = log.size();
    if width < 3 || height < 3 {
        return Vec::new();
    }
    let uniform = |x: usize, y: usize| {
        let inside = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
        let steps = |a: (usize, usize), b: (usize, usize)| (log[a] - log[b]).abs().max_element() < threshold;
        inside && steps((x - 1, y), (x + 1, y)) && steps((x, y - 1), (x, y + 1))
    };
    let mut open: Vec<bool> = (0..width * height).map(|i| uniform(i % width, i / width)).collect();
    let most = (MAX_SHARE * (width * height) as f64) as usize;
    let (mut found, mut stack) = (Vec::new(), Vec::new());
    for start in 0..width * height {
        if !std::mem::take(&mut open[start]) {
            continue;
        }
        let mut moments = Moments::default();
        stack.push(start);
        while let Some(at) = stack.pop() {
            let (x, y) = (at % width, at / width);
            moments.add(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            // Uniform pixels are never at the border, so all four neighbours exist.
            for next in [at - 1, at + 1, at - width, at + width] {
                if std::mem::take(&mut open[next]) {
                    stack.push(next);
                }
            }
        }
        found.extend(moments.square().filter(|_| moments.count <= most));
    }
    found
}

/// Sums over the pixels of a region.
#[derive(Default)]
struct Moments {
    count: usize,
    sum: DVec2,
    squares: DVec2,
    product: f64,
}

impl Moments {
    fn add(&mut self, p: DVec2) {
        self.count += 1;
        self.sum += p;
        self.squares += p * p;
        self.product += p.x * p.y;
    }

    /// Returns the region if it has the shape of a parallelogram.
    ///
    /// The determinant of the covariance of a parallelogram is the square of its area over 144.
    fn square(&self) -> Option<Square> {
        if self.count < MIN_PIXELS {
            return None;
        }
        let n = self.count as f64;
        let mean = self.sum / n;
        // Adds the variance 1/12 of the unit area of a pixel.
        let variance = self.squares / n - mean * mean + 1.0 / 12.0;
        let covariance = self.product / n - mean.x * mean.y;
        let (half, determinant) = (0.5 * (variance.x + variance.y), variance.x * variance.y - covariance * covariance);
        let root = (half * half - determinant).max(0.0).sqrt();
        let (long, short) = (half + root, half - root);
        let fits = determinant > 0.0 && FILLED.contains(&(n / (12.0 * determinant.sqrt())));
        (fits && long <= MAX_ASPECT * MAX_ASPECT * short).then(|| Square { centre: mean, side: n.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detects_squares_and_no_other_shapes() {
        // A square, a parallelogram, a ring, an L and a bar on a rough background.
        let shape = |x: f64, y: f64| {
            let ring = (x - 130.0).hypot(y - 30.0);
            let slanted = (x - 0.4 * (y - 20.0) - 70.0, y - 20.0);
            (10.0..30.0).contains(&x) && (15.0..35.0).contains(&y)
                || (0.0..18.0).contains(&slanted.0) && (0.0..20.0).contains(&slanted.1)
                || (10.0..18.0).contains(&ring)
                || (20.0..50.0).contains(&x) && (60.0..95.0).contains(&y) && (x < 30.0 || y > 85.0)
                || (80.0..150.0).contains(&x) && (70.0..80.0).contains(&y)
        };
        let log = Plane::from_fn(160, 100, |x, y| {
            let rough = ((x * 7 + y * 13) % 5) as f32;
            Vec3::splat(if shape(x as f64 + 0.5, y as f64 + 0.5) { -1.0 } else { rough })
        });
        let mut found = squares(&log, 0.1);
        found.sort_by(|a, b| a.centre.x.total_cmp(&b.centre.x));
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].centre.distance(DVec2::new(20.0, 25.0)) < 0.1 && (found[0].side - 18.0).abs() < 0.1);
        assert!(found[1].centre.distance(DVec2::new(83.0, 30.0)) < 0.5, "{found:?}");
        assert!(squares(&log.map(|_| Vec3::ZERO), 0.1).is_empty());
        assert!(squares(&Plane::from_vec(1, 1, vec![Vec3::ZERO]), 0.1).is_empty());
    }
}
