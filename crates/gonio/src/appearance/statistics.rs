//! The numbers that an image on the lattice is reduced to.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use glam::DVec3;
use rayon::prelude::*;

use super::Lattice;

/// Standard deviations of the smoothing Gaussians in degrees. Between one and the next lies a band of detail.
const SMOOTHINGS: [f64; 5] = [2.5, 5.0, 10.0, 20.0, 40.0];

/// Standard deviations of the neighbourhoods that gradients are taken over, in degrees.
const GRADIENTS: [f64; 2] = [4.0, 10.0];

/// Ends of the regions in which bands and gradients are looked at, as cosines of the angle to the view: centre, middle, rim.
const REGIONS: [(f64, f64); 3] = [(0.8, 1.0), (0.5, 0.8), (0.0, 0.5)];

/// Ends of the rings in which levels are looked at.
const RINGS: [(f64, f64); 6] = [(0.95, 1.0), (0.85, 0.95), (0.7, 0.85), (0.5, 0.7), (0.3, 0.5), (0.0, 0.3)];

/// Quantiles of the logarithm.
const QUANTILES: [f64; 13] = [0.0, 0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.98, 0.995, 1.0];

/// Added to values relative to the mean before their logarithm is taken: what is darker is black.
const BLACK: f32 = 0.003;

/// How many numbers [`Statistics::of`] gives.
pub const STATISTICS: usize = QUANTILES.len()
    + 4 * RINGS.len()
    + 2 * (5 * SMOOTHINGS.len() * REGIONS.len() + 2 * (SMOOTHINGS.len() - 1) + 2 * GRADIENTS.len() * REGIONS.len())
    + 1;

/// Linear filters on a [`Lattice`], and the statistics of their responses. None depends on the scale of the image, and turning
/// an image about the view or mirroring it changes none but the last.
#[derive(Clone, Debug)]
pub struct Statistics {
    normals: usize,
    /// Smoothings, then radial and tangential gradients, one filter after the other: `filters * normals` rows.
    filters: Mat<f32>,
    regions: Vec<Vec<usize>>,
    rings: Vec<Vec<usize>>,
    /// `y` of the normals: up in the image.
    up: Vec<f64>,
}

impl Statistics {
    /// Filters for a lattice; 100 MB.
    pub fn new(lattice: &Lattice) -> Self {
        let normals = lattice.normals();
        let n = normals.len();
        let rows: Vec<Vec<(usize, usize, f32)>> = normals.par_iter().map(|normal| rows_of(*normal, normals)).collect();
        let mut filters = Mat::<f32>::zeros((SMOOTHINGS.len() + 2 * GRADIENTS.len()) * n, n);
        for (i, entries) in rows.into_iter().enumerate() {
            for (block, j, weight) in entries {
                filters[(block * n + i, j)] = weight;
            }
        }
        let within =
            |&(low, high): &(f64, f64)| (0..n).filter(|&i| normals[i].z > low && normals[i].z <= high).collect();
        Self {
            normals: n,
            filters,
            regions: REGIONS.iter().map(within).collect(),
            rings: RINGS.iter().map(within).collect(),
            up: normals.iter().map(|n| n.y).collect(),
        }
    }

    /// The [`STATISTICS`] of each of a list of images on the lattice, one image after the other in both lists.
    ///
    /// In order: quantiles of the logarithm; mean, deviation, least and largest logarithm in each ring; then, of the image
    /// over its mean and again of its logarithm, for each band the logarithm of its mean square, its skewness, the
    /// logarithm of its kurtosis, its largest and least value in each region, how its magnitude and its sign go
    /// with the next finer band's, and for each gradient the logarithms of its radial and tangential mean squares in each region; at
    /// last how much brighter the upper half is.
    ///
    /// # Panics
    /// If `images` is not a whole number of images.
    pub fn of(&self, images: &[f32]) -> Vec<f32> {
        let n = self.normals;
        assert_eq!(images.len() % n, 0, "not a whole number of images");
        let count = images.len() / n;
        let mut fields = Vec::with_capacity(2 * images.len());
        for image in images.chunks_exact(n) {
            let mean = (image.iter().map(|v| f64::from(*v)).sum::<f64>() / n as f64).max(1e-30) as f32;
            fields.extend(image.iter().map(|v| v / mean));
            let relative = fields.len() - n;
            fields.extend_from_within(relative..);
            fields[relative + n..].iter_mut().for_each(|v| *v = (*v + BLACK).ln());
        }
        let mut responses = Mat::<f32>::zeros(self.filters.nrows(), 2 * count);
        let columns = MatRef::from_column_major_slice(&fields, n, 2 * count);
        // One thread: callers parallelise over images, and sums do not depend on how many there are.
        matmul(responses.as_mut(), Accum::Replace, self.filters.as_ref(), columns, 1.0, Par::Seq);
        let mut out = Vec::with_capacity(count * STATISTICS);
        for image in 0..count {
            let field = |which: usize| &fields[(2 * image + which) * n..][..n];
            let response = |which: usize| {
                let column = responses.col(2 * image + which);
                column.try_as_col_major().expect("a column of an owned matrix").as_slice()
            };
            let log = field(1);
            self.levels(log, &mut out);
            for which in 0..2 {
                self.detail(field(which), response(which), &mut out);
            }
            out.push((log.iter().zip(&self.up).map(|(v, y)| f64::from(*v) * y).sum::<f64>() / n as f64) as f32);
        }
        out
    }

    fn levels(&self, log: &[f32], out: &mut Vec<f32>) {
        let mut sorted = log.to_vec();
        sorted.sort_by(f32::total_cmp);
        out.extend(QUANTILES.map(|q| {
            let at = q * (sorted.len() - 1) as f64;
            let (low, share) = (at as usize, at.fract() as f32);
            let high = (low + 1).min(sorted.len() - 1);
            sorted[low] + share * (sorted[high] - sorted[low])
        }));
        for ring in &self.rings {
            let moments = Moments::of(ring.iter().map(|&i| log[i]));
            let variance = (moments.square - moments.mean * moments.mean).max(0.0);
            out.extend([moments.mean as f32, variance.sqrt() as f32, moments.least, moments.largest]);
        }
    }

    fn detail(&self, field: &[f32], response: &[f32], out: &mut Vec<f32>) {
        let n = self.normals;
        let mut finer: Vec<f32> = Vec::new();
        for band in 0..SMOOTHINGS.len() {
            let sharp = if band == 0 { field } else { &response[(band - 1) * n..][..n] };
            let detail: Vec<f32> = sharp.iter().zip(&response[band * n..][..n]).map(|(a, b)| a - b).collect();
            for region in &self.regions {
                let m = Moments::of(region.iter().map(|&i| detail[i]));
                let square = m.square + 1e-9;
                let deviation = square.sqrt();
                out.extend([
                    square.ln() as f32,
                    (m.cube / (deviation * square)) as f32,
                    (m.fourth / (square * square) + 1e-3).ln() as f32,
                    m.largest / deviation as f32,
                    m.least / deviation as f32,
                ]);
            }
            if band > 0 {
                let magnitude = |v: &[f32]| v.iter().map(|x| x.abs()).collect::<Vec<f32>>();
                out.push(correlation(&centred(&magnitude(&detail)), &centred(&magnitude(&finer))));
                out.push(correlation(&detail, &finer));
            }
            finer = detail;
        }
        for gradients in response[SMOOTHINGS.len() * n..].chunks_exact(2 * n) {
            for region in &self.regions {
                for part in gradients.chunks_exact(n) {
                    let square = Moments::of(region.iter().map(|&i| part[i])).square;
                    out.push((square + 1e-9).ln() as f32);
                }
            }
        }
    }
}

/// The row of every filter for one normal: filter, column, weight.
fn rows_of(normal: DVec3, normals: &[DVec3]) -> Vec<(usize, usize, f32)> {
    let angles: Vec<f64> = normals.iter().map(|n| n.dot(normal).clamp(-1.0, 1.0).acos()).collect();
    let mut rows = Vec::new();
    for (block, width) in SMOOTHINGS.iter().enumerate() {
        rows.extend(smoothing(&angles, width.to_radians()).into_iter().map(|(j, weight)| (block, j, weight)));
    }
    for (pair, width) in GRADIENTS.iter().enumerate() {
        let block = SMOOTHINGS.len() + 2 * pair;
        for (j, [radial, tangential]) in gradient(normal, normals, &angles, width.to_radians()) {
            rows.extend([(block, j, radial), (block + 1, j, tangential)]);
        }
    }
    rows
}

/// Weights of a Gaussian mean over normals at these angles, with sum one.
fn smoothing(angles: &[f64], width: f64) -> Vec<(usize, f32)> {
    let near = neighbours(angles, width, 3.5);
    let total: f64 = near.iter().map(|(_, w)| w).sum();
    near.into_iter().map(|(j, w)| (j, (w / total) as f32)).collect()
}

/// Indices and unnormalised Gaussian weights of all normals within `reach` standard deviations.
fn neighbours(angles: &[f64], width: f64, reach: f64) -> Vec<(usize, f64)> {
    let near = angles.iter().map(|a| a / width).enumerate().filter(|(_, a)| *a < reach);
    near.map(|(j, a)| (j, (-0.5 * a * a).exp())).collect()
}

/// Weights of the slope of a weighted least-squares plane, a change per `width`: towards the rim and across.
fn gradient(normal: DVec3, normals: &[DVec3], angles: &[f64], width: f64) -> Vec<(usize, [f32; 2])> {
    let radius = normal.x.hypot(normal.y);
    let radial = if radius > 1e-9 {
        DVec3::new(normal.x * normal.z, normal.y * normal.z, -radius * radius) / radius
    } else {
        DVec3::X
    };
    let tangential = normal.cross(radial);
    let near: Vec<(usize, f64, DVec3)> = neighbours(angles, width, 2.5)
        .into_iter()
        .map(|(j, w)| (j, w, DVec3::new(1.0, normals[j].dot(radial), normals[j].dot(tangential))))
        .collect();
    let outer = |a: DVec3, w: f64| glam::DMat3::from_cols(a * a.x, a * a.y, a * a.z) * w;
    let normal_matrix = near.iter().fold(glam::DMat3::ZERO, |sum, (_, w, a)| sum + outer(*a, *w));
    let inverse = normal_matrix.inverse();
    near.iter()
        .map(|(j, w, a)| {
            let slope = inverse * *a * *w * width;
            (*j, [slope.y as f32, slope.z as f32])
        })
        .collect()
}

/// Raw moments and extremes of a list.
struct Moments {
    mean: f64,
    square: f64,
    cube: f64,
    fourth: f64,
    least: f32,
    largest: f32,
}

impl Moments {
    fn of(values: impl Iterator<Item = f32>) -> Self {
        let (mut count, mut sums, mut least, mut largest) = (0.0, [0.0; 4], f32::INFINITY, f32::NEG_INFINITY);
        for value in values {
            let (x, square) = (f64::from(value), f64::from(value) * f64::from(value));
            for (sum, power) in sums.iter_mut().zip([x, square, x * square, square * square]) {
                *sum += power;
            }
            (least, largest) = (least.min(value), largest.max(value));
            count += 1.0;
        }
        let [mean, square, cube, fourth] = sums.map(|s| s / count);
        Self { mean, square, cube, fourth, least, largest }
    }
}

fn centred(values: &[f32]) -> Vec<f32> {
    let mean = (values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64) as f32;
    values.iter().map(|v| v - mean).collect()
}

/// Cosine between two lists.
fn correlation(a: &[f32], b: &[f32]) -> f32 {
    let inner = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    (inner(a, b) / (inner(a, a) * inner(b, b) + 1e-12).sqrt()) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setup() -> (Lattice, Statistics) {
        let lattice = Lattice::new();
        let statistics = Statistics::new(&lattice);
        (lattice, statistics)
    }

    /// A ball with a lamp in it: `width` is that of the highlight.
    fn ball(lattice: &Lattice, lamp: DVec3, width: f64) -> Vec<f32> {
        let lamp = lamp.normalize();
        let value =
            |n: &DVec3| 0.2 + 0.5 * n.dot(lamp).max(0.0) + 3.0 * (-0.5 * (n.angle_between(lamp) / width).powi(2)).exp();
        lattice.normals().iter().map(|n| value(n) as f32).collect()
    }

    #[test]
    fn there_are_as_many_as_stated_and_they_are_finite() {
        let (lattice, statistics) = setup();
        let n = lattice.normals().len();
        let black = vec![0.0; n];
        let flat = vec![2.0; n];
        let images = [ball(&lattice, DVec3::new(0.2, 0.3, 0.9), 0.1), black, flat].concat();
        let got = statistics.of(&images);
        assert_eq!(got.len(), 3 * STATISTICS);
        assert!(got.iter().all(|v| v.is_finite()));
        // A batch is the images one by one.
        let alone = statistics.of(&images[..n]);
        assert!(got[..STATISTICS].iter().zip(&alone).all(|(a, b)| (a - b).abs() < 1e-4));
    }

    #[test]
    fn scale_does_not_matter_and_turning_hardly() {
        let (lattice, statistics) = setup();
        let image = ball(&lattice, DVec3::new(0.4, 0.0, 0.7), 0.15);
        let bright: Vec<f32> = image.iter().map(|v| 7.0 * v).collect();
        let turned = ball(&lattice, DVec3::new(-0.28, 0.28, 0.7), 0.15);
        let other = ball(&lattice, DVec3::new(0.4, 0.0, 0.7), 0.6);
        let [a, b, c, d] = [image, bright, turned, other].map(|i| statistics.of(&i));
        let distance = |x: &[f32], y: &[f32]| {
            let n = STATISTICS - 1;
            (x[..n].iter().zip(&y[..n]).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / n as f64).sqrt()
        };
        assert!(distance(&a, &b) < 1e-3);
        assert!(5.0 * distance(&a, &c) < distance(&a, &d), "{} {}", distance(&a, &c), distance(&a, &d));
    }

    #[test]
    fn gradients_are_those_of_a_slope() {
        let (lattice, statistics) = setup();
        let n = lattice.normals().len();
        // The angle to the view has slope one towards the rim, and none across.
        let image: Vec<f32> = lattice.normals().iter().map(|n| n.z.acos() as f32).collect();
        let field = MatRef::from_column_major_slice(&image, n, 1);
        let mut out = Mat::<f32>::zeros(statistics.filters.nrows(), 1);
        matmul(out.as_mut(), Accum::Replace, statistics.filters.as_ref(), field, 1.0, Par::Seq);
        let first = SMOOTHINGS.len() * n;
        for (i, normal) in lattice.normals().iter().enumerate().filter(|(_, n)| n.z < 0.9 && n.z > 0.3) {
            let width = GRADIENTS[0].to_radians();
            assert!((f64::from(out[(first + i, 0)]) / width - 1.0).abs() < 0.05, "{normal}");
            assert!(f64::from(out[(first + n + i, 0)]).abs() < 0.05 * width, "{normal}");
        }
    }

    #[test]
    fn smoothings_keep_a_constant() {
        let (lattice, statistics) = setup();
        let n = lattice.normals().len();
        for row in 0..SMOOTHINGS.len() * n {
            let sum: f64 = (0..n).map(|j| f64::from(statistics.filters[(row, j)])).sum();
            assert!((sum - 1.0).abs() < 1e-4);
        }
        let slopes = (SMOOTHINGS.len() * n..statistics.filters.nrows()).step_by(7);
        for row in slopes {
            let sum: f64 = (0..n).map(|j| f64::from(statistics.filters[(row, j)])).sum();
            assert!(sum.abs() < 1e-4);
        }
    }
}
