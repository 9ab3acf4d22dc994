//! Columns of matrices, processed concurrently.

use faer::{MatMut, MatRef};
use rayon::prelude::*;

/// Splits a matrix into bands of columns that can be written concurrently.
///
/// Each band is paired with the index of its first column.
pub fn column_bands<T>(matrix: MatMut<'_, T>, count: usize) -> Vec<(usize, MatMut<'_, T>)> {
    let columns = matrix.ncols();
    let (mut bands, mut rest, mut first) = (Vec::with_capacity(count), matrix, 0);
    for band in 0..count {
        let end = (band + 1) * columns / count;
        let (head, tail) = rest.split_at_col_mut(end - first);
        bands.push((first, head));
        (rest, first) = (tail, end);
    }
    bands
}

/// Largest number of columns that are processed as one task.
const COLUMNS: usize = 8;

/// Calls `work` with the index and values of every column of a column-major matrix.
///
/// Runs in the caller's thread pool. The parallel iterators of faer do not compile for browsers.
pub fn each_column(columns: MatMut<'_, f64>, work: &(impl Fn(usize, &mut [f64]) + Sync)) {
    each_column_from(0, columns, work);
}

fn each_column_from(first: usize, columns: MatMut<'_, f64>, work: &(impl Fn(usize, &mut [f64]) + Sync)) {
    if columns.ncols() > COLUMNS {
        let middle = columns.ncols() / 2;
        let (left, right) = columns.split_at_col_mut(middle);
        rayon::join(|| each_column_from(first, left, work), || each_column_from(first + middle, right, work));
    } else {
        for (i, column) in columns.col_iter_mut().enumerate() {
            let column = column.try_as_col_major_mut().expect("columns of a column-major matrix are contiguous");
            work(first + i, column.as_slice_mut());
        }
    }
}

/// Returns the squared Euclidean norm of every column.
pub fn squared_norms(matrix: MatRef<'_, f64>) -> Vec<f64> {
    (0..matrix.ncols()).into_par_iter().map(|c| matrix.col(c).squared_norm_l2()).collect()
}
