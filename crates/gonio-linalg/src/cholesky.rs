//! Cholesky factors of dense matrices, independent of the number of threads.

use faer::{Accum, Mat, MatMut, MatRef};
use rayon::prelude::*;

use crate::columns::{column_bands, each_column};
use crate::products::{factorise, multiply, solve_lower, solve_upper};

/// Number of columns that one sequential product or solve computes; constant, so that results do
/// not depend on the number of threads.
const BAND: usize = 128;

/// Lower factor `L` of a symmetric positive definite `L L'` (n x n); entries above its diagonal are
/// undefined.
#[derive(Clone, Debug)]
pub struct Cholesky {
    lower: Mat<f64>,
}

impl Cholesky {
    /// Returns the factor; entries above its diagonal are undefined.
    pub fn lower(&self) -> MatRef<'_, f64> {
        self.lower.as_ref()
    }

    /// Factorises the matrix whose lower triangle is given, band by band. Returns `None` if it is
    /// not positive definite or not finite.
    pub fn new(mut lower: Mat<f64>) -> Option<Self> {
        let size = lower.nrows();
        for first in (0..size).step_by(BAND) {
            let width = BAND.min(size - first);
            let rest = lower.as_mut().submatrix_mut(first, first, size - first, size - first);
            let (left, mut right) = rest.split_at_col_mut(width);
            let (mut corner, below) = left.split_at_row_mut(width);
            factorise(corner.as_mut())?;
            // Below the corner, `L_21 = A_21 L_11^-T`; to the right of that, `A_22 - L_21 L_21'`.
            let (corner, mut below) = (corner.as_ref(), below.transpose_mut());
            bands_of(below.as_mut()).into_par_iter().for_each(|(_, band)| {
                solve_lower(corner, band);
            });
            let below = below.as_ref();
            let trailing = right.as_mut().subrows_mut(width, size - first - width);
            bands_of(trailing).into_par_iter().for_each(|(at, band)| {
                let rows = below.ncols() - at;
                let (a, b) = (below.subcols(at, rows).transpose(), below.subcols(at, band.ncols()));
                multiply(band.subrows_mut(at, rows), Accum::Add, a, b, -1.0);
            });
        }
        (0..size).all(|i| lower[(i, i)].is_finite()).then_some(Self { lower })
    }

    /// Factorises a symmetric `h` with `extra` (n) added to its diagonal.
    pub fn of_sum(h: &Mat<f64>, extra: &[f64]) -> Option<Self> {
        let mut lower = Mat::zeros(h.nrows(), h.ncols());
        each_column(lower.as_mut(), &|j, column| {
            column[j..].copy_from_slice(&h.col_as_slice(j)[j..]);
            column[j] += extra[j];
        });
        Self::new(lower)
    }

    /// `L^-T L^-1 x` (n).
    pub fn solve(&self, x: &[f64]) -> Vec<f64> {
        let mut x = Mat::from_fn(x.len(), 1, |i, _| x[i]);
        solve_lower(self.lower.as_ref(), x.as_mut());
        solve_upper(self.lower.transpose(), x.as_mut());
        x.col(0).iter().copied().collect()
    }

    /// `L^-T L^-1 X`.
    pub fn solve_all(&self, x: &Mat<f64>) -> Mat<f64> {
        let mut x = x.clone();
        solve_lower(self.lower.as_ref(), x.as_mut());
        solve_upper(self.lower.transpose(), x.as_mut());
        x
    }

    /// Replaces `X` by `L^-1 X`.
    pub fn whiten(&self, x: &mut Mat<f64>) {
        bands_of(x.as_mut()).into_par_iter().for_each(|(_, band)| {
            solve_lower(self.lower.as_ref(), band);
        });
    }

    /// `L^-T x` (n), which has covariance `(L L')^-1` if `x` is white.
    pub fn colour(&self, x: &[f64]) -> Vec<f64> {
        let mut x = Mat::from_fn(x.len(), 1, |i, _| x[i]);
        solve_upper(self.lower.transpose(), x.as_mut());
        x.col(0).iter().copied().collect()
    }

    /// `L^-1` (n x n). The squared norms of its columns are the diagonal of the inverse of the
    /// matrix.
    pub fn inverse_of_lower(&self) -> Mat<f64> {
        let n = self.lower.nrows();
        let mut inverse = Mat::identity(n, n);
        bands_of(inverse.as_mut()).into_par_iter().for_each(|(first, band)| {
            // The columns of an inverse are zero above the diagonal.
            let rest = n - first;
            let part = self.lower.as_ref().submatrix(first, first, rest, rest);
            solve_lower(part, band.subrows_mut(first, rest));
        });
        inverse
    }
}

/// Columns of a matrix in bands, with the index of the first column of each.
pub fn bands_of<T>(matrix: MatMut<'_, T>) -> Vec<(usize, MatMut<'_, T>)> {
    let count = matrix.ncols().div_ceil(BAND).max(1);
    column_bands(matrix, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factor_by_bands_reproduces_the_matrix() {
        for n in [1, 5, BAND, BAND + 1, 3 * BAND + 7] {
            // Any entries without structure.
            let a: Vec<f64> = (0..n * n).map(|i| (1.7 * (i * i % 1013) as f64).sin()).collect();
            let x = Mat::from_fn(n, n, |i, j| a[i * n + j]);
            let h = &x * x.transpose() + Mat::<f64>::identity(n, n);
            let factor = Cholesky::new(h.clone()).unwrap();
            let lower = Mat::from_fn(n, n, |i, j| if j > i { 0.0 } else { factor.lower[(i, j)] });
            let off = &lower * lower.transpose() - &h;
            assert!(off.norm_max() < 1e-12 * h.norm_max() * n as f64, "{n}: {}", off.norm_max());
        }
        let saddle = Mat::from_fn(300, 300, |i, j| {
            if i != j {
                0.0
            } else if i == 200 {
                -1.0
            } else {
                1.0
            }
        });
        assert!(Cholesky::new(saddle).is_none());
    }
}
