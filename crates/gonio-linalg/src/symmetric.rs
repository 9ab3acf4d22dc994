//! Eigenvectors, linear systems and principal axes of symmetric matrices, on one thread.

use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{Mat, MatRef, Par};

use crate::products::{clear_registers, factorise, product, solve_lower, solve_upper};

/// Returns the eigenvalues, ascending, and the eigenvectors of a symmetric matrix.
///
/// Runs on one thread, since the parallel tridiagonalisation splits its sums by the number of
/// threads.
pub fn eigenvectors(a: MatRef<'_, f64>) -> (Vec<f64>, Mat<f64>) {
    let n = a.nrows();
    let mut values = vec![0.0; n];
    let mut vectors = Mat::zeros(n, n);
    let scratch = self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    self_adjoint_evd(
        a,
        DiagMut::from_slice_mut(&mut values),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut memory),
        Default::default(),
    )
    .expect("a finite symmetric matrix has eigenvectors");
    clear_registers();
    (values, vectors)
}

/// Solves a symmetric system on one thread; `None` if it is not positive definite.
pub fn solve_positive(mut matrix: Mat<f64>, right: &[f64]) -> Option<Vec<f64>> {
    let size = matrix.nrows();
    factorise(matrix.as_mut())?;
    let mut x = Mat::from_fn(size, 1, |i, _| right[i]);
    solve_lower(matrix.as_ref(), x.as_mut());
    solve_upper(matrix.transpose(), x.as_mut());
    let solution: Vec<f64> = x.col(0).iter().copied().collect();
    solution.iter().all(|v| v.is_finite()).then_some(solution)
}

/// Returns `A W A'` (m x m) for a column-major `A` (m x n) and non-negative weights (n), on one
/// thread.
pub fn weighted_gram(a: MatRef<'_, f64>, weights: &[f64]) -> Mat<f64> {
    let mut scaled = a.to_owned();
    for (column, weight) in scaled.as_mut().col_iter_mut().zip(weights) {
        let root = weight.sqrt();
        let column = column.try_as_col_major_mut().expect("columns of a column-major matrix are contiguous");
        column.as_slice_mut().iter_mut().for_each(|x| *x *= root);
    }
    product(scaled.as_ref(), scaled.transpose())
}

/// Returns the inner product of `x - mean` and an axis.
pub fn project(x: &[f64], mean: &[f64], axis: &[f64]) -> f64 {
    x.iter().zip(mean).zip(axis).map(|((x, m), a)| (x - m) * a).sum()
}

/// Returns the mean of rows of equal length, their principal axes, and the variance along each.
///
/// The axes are orthonormal and computed from the Gram matrix of the rows.
pub fn principal_axes(rows: &[Vec<f64>], rank: usize) -> (Vec<f64>, Vec<Vec<f64>>, Vec<f64>) {
    let (n, length) = (rows.len(), rows[0].len());
    let mean: Vec<f64> = (0..length).map(|c| rows.iter().map(|r| r[c]).sum::<f64>() / n as f64).collect();
    let centred = Mat::<f64>::from_fn(n, length, |i, c| rows[i][c] - mean[c]);
    let (values, vectors) = eigenvectors(product(centred.as_ref(), centred.transpose()).as_ref());
    let mut axes = Vec::new();
    let mut variances = Vec::new();
    let largest = values.last().copied().unwrap_or(0.0);
    for k in (0..n).rev().take(rank).filter(|&k| values[k] > 1e-12 * largest) {
        let norm = values[k].sqrt();
        let axis: Vec<f64> =
            (0..length).map(|c| (0..n).map(|i| vectors[(i, k)] * centred[(i, c)]).sum::<f64>() / norm).collect();
        axes.push(axis);
        variances.push(values[k] / n as f64);
    }
    (mean, axes, variances)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weighted_gram_matches_sums_of_products() {
        let a = Mat::from_fn(3, 50, |i, j| ((7 * i + 3 * j) % 11) as f64 - 4.0);
        let weights: Vec<f64> = (0..50).map(|j| (j % 4) as f64).collect();
        let gram = weighted_gram(a.as_ref(), &weights);
        for (i, k) in (0..3).flat_map(|i| (0..3).map(move |k| (i, k))) {
            let want: f64 = (0..50).map(|j| weights[j] * a[(i, j)] * a[(k, j)]).sum();
            assert!((gram[(i, k)] - want).abs() < 1e-10 * want.abs().max(1.0), "{i} {k}");
        }
    }
}
