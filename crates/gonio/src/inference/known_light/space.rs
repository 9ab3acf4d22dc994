//! Search space of tables.

use std::ops::Range;

use faer::MatRef;
use gonio_linalg::{axpy, dispatch, product};

use crate::reflectance::{BivariateTable, CELLS, LatentSpace, THETA_D, THETA_H, nearest_trusted};

/// Number of splines along the half angle and along the difference angle. Half angles are measured
/// in samples of a table, which are dense where highlights are sharp.
const SPLINES: [usize; 2] = [20, 7];

/// Largest absolute value of the logarithm of reflectance; no measured value exceeds it.
const LIMIT: f64 = 25.0;

/// Number of splines that are not zero in a cell, along each angle.
const SUPPORT: usize = 4;

/// Logarithms of tables: `mean + sum_k z_k a_k + sum_j w_j s_j + c`, with the principal axes `a_k`
/// of the prior, products `s_j` of cubic splines for deviations from the axes, and a constant `c`
/// for the exposure. The prior variance of the coefficients `z_k` is one, that of `w_j` is small,
/// and `c` is free.
///
/// The mean and the axes are those of the prior of materials, or a luminance table and the axes
/// along which channels differ from it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ParameterSpace {
    mean: Vec<f64>,
    /// `[cell][axis]`.
    axes: Vec<f64>,
    pub(super) dimensions: usize,
    /// For each sample of the half angle and of the difference angle, the index of the first
    /// non-zero spline, and the values of this spline and its successors.
    splines: [Vec<(usize, [f64; SUPPORT])>; 2],
}

impl ParameterSpace {
    pub(super) fn new(coordinates: &LatentSpace) -> Self {
        Self::around(&coordinates.mean, &coordinates.directions())
    }

    /// Creates the space around a mean logarithm (by cell), with axes `[axis][cell]`.
    pub(super) fn around(mean: &[f32], axes: &[Vec<f32>]) -> Self {
        let nearest: Vec<usize> = (0..CELLS).map(nearest_trusted).collect();
        let last = nearest[CELLS - 1];
        let along = |samples: usize, last: usize, count: usize| -> Vec<_> {
            (0..samples).map(|index| splines(index.min(last) as f64 / last as f64, count)).collect()
        };
        Self {
            mean: nearest.iter().map(|&c| f64::from(mean[c])).collect(),
            axes: nearest.iter().flat_map(|&c| axes.iter().map(move |axis| f64::from(axis[c]))).collect(),
            dimensions: axes.len(),
            splines: [along(THETA_H, last / THETA_D, SPLINES[0]), along(THETA_D, last % THETA_D, SPLINES[1])],
        }
    }

    /// Number of coefficients without the constant.
    pub(super) const fn free(axes: usize) -> usize {
        axes + SPLINES[0] * SPLINES[1]
    }

    fn constant(&self) -> usize {
        self.len() - 1
    }

    /// Number of coefficients; the constant is the last.
    pub(super) fn len(&self) -> usize {
        self.dimensions + SPLINES[0] * SPLINES[1] + 1
    }

    /// Returns the coefficients of a material at the given prior coordinates.
    pub(super) fn at(&self, coordinates: &[f64]) -> Vec<f64> {
        let mut coefficients = vec![0.0; self.len()];
        coefficients[..self.dimensions].copy_from_slice(coordinates);
        coefficients
    }

    /// Indices of the coefficients of the splines.
    pub(super) fn splines(&self) -> Range<usize> {
        self.dimensions..self.len() - 1
    }

    /// Sums the derivatives of the logarithms in cells, with these weights.
    pub(super) fn sum_of_derivatives(&self, weights: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
        let mut sum = vec![0.0; self.len()];
        dispatch(DerivativeSum { space: self, weights, sum: &mut sum });
        sum
    }

    /// Change of the logarithm in every cell along a step of the coefficients.
    pub(super) fn change(&self, step: &[f64]) -> Vec<f64> {
        let k = self.dimensions;
        let weights = &step[k..];
        let axes = MatRef::from_row_major_slice(&self.axes, CELLS, k);
        let along_axes = product(axes, MatRef::from_column_major_slice(&step[..k], k, 1));
        let mut out = Vec::with_capacity(CELLS);
        for (first_h, of_h) in &self.splines[0] {
            // Coefficients of the splines along the difference angle at this half angle.
            let along_d: [f64; SPLINES[1]] = std::array::from_fn(|d| {
                of_h.iter().enumerate().map(|(i, h)| h * weights[(first_h + i) * SPLINES[1] + d]).sum()
            });
            for (first_d, of_d) in &self.splines[1] {
                let of_splines: f64 = along_d[*first_d..].iter().zip(of_d).map(|(w, d)| w * d).sum();
                out.push(along_axes[(out.len(), 0)] + of_splines + step[self.constant()]);
            }
        }
        out
    }

    /// Reflectance in every cell.
    pub(super) fn values(&self, coefficients: &[f64]) -> Vec<f64> {
        let change = self.change(coefficients);
        self.mean.iter().zip(change).map(|(mean, change)| (mean + change).clamp(-LIMIT, LIMIT).exp()).collect()
    }

    /// Table of the coefficients.
    pub(super) fn table(&self, coefficients: &[f64]) -> BivariateTable {
        BivariateTable::from_vec(self.values(coefficients).into_iter().map(|v| v as f32).collect())
    }
}

/// A sum of derivatives with the vector instructions of the processor.
struct DerivativeSum<'a, W> {
    space: &'a ParameterSpace,
    weights: W,
    sum: &'a mut [f64],
}

impl<W: Iterator<Item = (usize, f64)>> pulp::NullaryFnOnce for DerivativeSum<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { space, weights, sum } = self;
        let k = space.dimensions;
        let (along_axes, others) = sum.split_at_mut(k);
        let (constant, of_splines) = others.split_last_mut().expect("the constant is the last coefficient");
        for (cell, weight) in weights {
            axpy(weight, &space.axes[cell * k..][..k], along_axes);
            let [(first_h, of_h), (first_d, of_d)] =
                [&space.splines[0][cell / THETA_D], &space.splines[1][cell % THETA_D]];
            for (i, h) in of_h.iter().enumerate() {
                let at = (first_h + i) * SPLINES[1] + first_d;
                of_splines[at..at + SUPPORT].iter_mut().zip(of_d).for_each(|(sum, d)| *sum += weight * h * d);
            }
            *constant += weight;
        }
    }
}

/// Returns the index of the first cubic B-spline that is not zero at `x`, and all non-zero values.
///
/// There are `count` splines over 0..=1, with equidistant knots and full multiplicity at the ends.
/// The values sum to one.
fn splines(x: f64, count: usize) -> (usize, [f64; SUPPORT]) {
    let pieces = count - 3;
    let knot = |i: usize| (i.saturating_sub(3).min(pieces)) as f64 / pieces as f64;
    let first = ((x * pieces as f64) as usize).min(pieces - 1);
    // The recursion of de Boor and Cox on the knots around the piece.
    let mut values = [0.0; SUPPORT];
    values[0] = 1.0;
    for degree in 1..SUPPORT {
        let mut saved = 0.0;
        for (i, value) in values.iter_mut().take(degree).enumerate() {
            let (right, left) = (knot(first + 4 + i), knot(first + 4 + i - degree));
            let part = *value / (right - left);
            *value = saved + (right - x) * part;
            saved = (x - left) * part;
        }
        values[degree] = saved;
    }
    (first, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splines_sum_to_one_and_reproduce_lines() {
        // The coefficients of a line are its values at the means of three knots (Greville).
        let count = 9;
        let pieces = count - 3;
        let knot = |i: usize| (i.saturating_sub(3).min(pieces)) as f64 / pieces as f64;
        let greville = |i: usize| (knot(i + 1) + knot(i + 2) + knot(i + 3)) / 3.0;
        for step in 0..=100 {
            let x = f64::from(step) / 100.0;
            let (first, values) = splines(x, count);
            assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-12 && values.iter().all(|v| *v >= -1e-12));
            let line: f64 = values.iter().enumerate().map(|(i, v)| v * greville(first + i)).sum();
            assert!((line - x).abs() < 1e-12, "{x}: {line}");
        }
    }
}
