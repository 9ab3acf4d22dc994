//! Functions over the unit square, bilinear between samples, and maps to uniform densities. There
//! is one function for each incident direction.

use std::path::Path;

use crate::Error;

/// Slices of a stack and their weights, which sum to one: linear interpolation over two axes.
pub(super) type Corners = [(usize, f64); 4];

/// Sampled incident directions: two axes of increasing angles in radians.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Directions {
    phi: Vec<f64>,
    theta: Vec<f64>,
}

impl Directions {
    /// # Errors
    /// If the angles of an axis do not increase.
    pub(super) fn new(path: &Path, phi: &[f32], theta: &[f32]) -> Result<Self, Error> {
        for (name, axis) in [("phi_i", phi), ("theta_i", theta)] {
            if !axis.is_sorted_by(|a, b| a < b) {
                return Err(Error::damaged(path, format!("has angles {name} that are not increasing")));
            }
        }
        let wide = |axis: &[f32]| axis.iter().copied().map(f64::from).collect();
        Ok(Self { phi: wide(phi), theta: wide(theta) })
    }

    /// Returns the slices to interpolate between. Beyond the ends of an axis, the last sample
    /// applies.
    pub(super) fn corners(&self, phi: f64, theta: f64) -> Corners {
        let ((i, s), (j, t)) = (bracket(&self.phi, phi), bracket(&self.theta, theta));
        let n = self.theta.len();
        let (up, right) = ((i + 1).min(self.phi.len() - 1) * n, (j + 1).min(n - 1));
        [
            (i * n + j, (1.0 - s) * (1.0 - t)),
            (i * n + right, (1.0 - s) * t),
            (up + j, s * (1.0 - t)),
            (up + right, s * t),
        ]
    }
}

/// Returns the last sample that is not above `x`, and the weight of the next one.
fn bracket(axis: &[f64], x: f64) -> (usize, f64) {
    let i = axis.partition_point(|a| *a <= x).saturating_sub(1);
    match axis.get(i + 1) {
        Some(next) => (i, ((x - axis[i]) / (next - axis[i])).clamp(0.0, 1.0)),
        None => (i, 0.0),
    }
}

/// Slices of `height` rows of `width` samples each; the first sample lies at 0, the last at 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stack {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

/// A point between four samples of a slice. It consists of the indices of the sample with the
/// lowest coordinates and the fractions of the distance to the others.
struct Cell {
    column: usize,
    row: usize,
    s: f64,
    t: f64,
}

impl Stack {
    /// # Errors
    /// If there are fewer than two samples along an axis.
    ///
    /// # Panics
    /// If the number of values is not a multiple of the size of a slice.
    pub(super) fn new(path: &Path, name: &str, [height, width]: [usize; 2], values: Vec<f32>) -> Result<Self, Error> {
        if width < 2 || height < 2 {
            return Err(Error::damaged(
                path,
                format!("has {height} x {width} samples for {name}, but at least 2 x 2 are required"),
            ));
        }
        assert_eq!(values.len() % (width * height), 0, "the values must fill whole slices");
        Ok(Self { width, height, values })
    }

    fn cell(&self, x: f64, y: f64) -> Cell {
        let axis = |x: f64, n: usize| {
            let x = x.clamp(0.0, 1.0) * (n - 1) as f64;
            let i = (x as usize).min(n - 2);
            (i, x - i as f64)
        };
        let ((column, s), (row, t)) = (axis(x, self.width), axis(y, self.height));
        Cell { column, row, s, t }
    }

    /// Returns the four samples around a point: lower row, then upper row.
    fn around(&self, slice: usize, cell: &Cell) -> [f64; 4] {
        let low = (slice * self.height + cell.row) * self.width + cell.column;
        [low, low + 1, low + self.width, low + self.width + 1].map(|i| f64::from(self.values[i]))
    }

    /// Evaluates a slice at a point of the unit square, bilinear between samples.
    pub(super) fn at(&self, slice: usize, x: f64, y: f64) -> f64 {
        let cell = self.cell(x, y);
        let [a, b, c, d] = self.around(slice, &cell);
        lerp(lerp(a, b, cell.s), lerp(c, d, cell.s), cell.t)
    }
}

/// Densities over the unit square, each with the map that makes it uniform. The map transforms the
/// second coordinate by its marginal distribution, then the first given the second.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Warp {
    density: Stack,
    /// Cumulative integral of each row of each slice, up to each sample.
    conditional_cdf: Vec<f64>,
    /// Cumulative integral of each slice, up to each row.
    marginal_cdf: Vec<f64>,
    /// Reciprocal of the integral of each slice.
    scale: Vec<f64>,
}

impl Warp {
    /// Builds the maps of non-negative densities of any scale.
    ///
    /// # Errors
    /// If a density vanishes everywhere.
    pub(super) fn new(path: &Path, name: &str, density: Stack) -> Result<Self, Error> {
        let Stack { width, height, ref values } = density;
        let mut along = Vec::with_capacity(values.len());
        for row in values.chunks_exact(width) {
            cumulate(row.iter().copied().map(f64::from), &mut along);
        }
        let mut below = Vec::with_capacity(values.len() / width);
        for slice in along.chunks_exact(width * height) {
            cumulate(slice.chunks_exact(width).map(|row| row[width - 1]), &mut below);
        }
        let scale: Vec<f64> = below.chunks_exact(height).map(|slice| 1.0 / slice[height - 1]).collect();
        match scale.iter().position(|s| !s.is_finite()) {
            Some(at) => Err(Error::damaged(path, format!("has only zeros in slice {at} of {name}"))),
            None => Ok(Self { density, conditional_cdf: along, marginal_cdf: below, scale }),
        }
    }

    /// Maps a point of the square by the density interpolated between slices. Each slice is
    /// normalised to integral one.
    pub(super) fn flatten(&self, corners: &Corners, x: f64, y: f64) -> [f64; 2] {
        let Stack { width, height, .. } = self.density;
        let cell = self.density.cell(x, y);
        let mut around = [0.0; 4];
        // For the rows below and above: the integral up to the column, and that of the whole row.
        let (mut part, mut whole) = ([0.0; 2], [0.0; 2]);
        let mut v = 0.0;
        for &(slice, weight) in corners.iter().filter(|c| c.1 > 0.0) {
            let weight = weight * self.scale[slice];
            for (sum, value) in around.iter_mut().zip(self.density.around(slice, &cell)) {
                *sum += weight * value;
            }
            for side in 0..2 {
                let row = &self.conditional_cdf[(slice * height + cell.row + side) * width..][..width];
                part[side] += weight * row[cell.column];
                whole[side] += weight * row[width - 1];
            }
            v += weight * self.marginal_cdf[slice * height + cell.row];
        }
        let [a, b, c, d] = around;
        let (step_x, step_y) = (1.0 / (width - 1) as f64, 1.0 / (height - 1) as f64);
        let reached =
            lerp(part[0], part[1], cell.t) + step_x * integral(lerp(a, c, cell.t), lerp(b, d, cell.t), cell.s);
        let row = lerp(whole[0], whole[1], cell.t);
        // A row without density contains no measurements, so its points stay unchanged.
        let u = if row > 0.0 { reached / row } else { x };
        [u, v + step_y * integral(whole[0], whole[1], cell.t)]
    }
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + t * (b - a)
}

/// Returns the integral from 0 to `t` of a linear function from `a` at 0 to `b` at 1.
fn integral(a: f64, b: f64, t: f64) -> f64 {
    t * (a + 0.5 * t * (b - a))
}

/// Appends the integral up to each of the samples, which are evenly spaced from 0 to 1.
fn cumulate(samples: impl ExactSizeIterator<Item = f64>, out: &mut Vec<f64>) {
    let step = 1.0 / (samples.len() - 1) as f64;
    let (mut sum, mut last) = (0.0, None);
    out.extend(samples.map(|sample| {
        if let Some(last) = last.replace(sample) {
            sum += 0.5 * step * (last + sample);
        }
        sum
    }));
}
