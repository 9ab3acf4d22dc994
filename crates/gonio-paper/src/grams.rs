//! Quantities of the operator computed once for all iterations on an image: its columns and its
//! products with itself.

use faer::{Accum, Mat, MatRef};
use gonio::lighting::Moments;
use gonio_linalg::{axpy, column_bands, dispatch, dot, multiply};
use rayon::prelude::*;

use super::Problem;
use super::expectations::Expectations;

/// Number of columns of a product that one task computes; constant, so that results do not depend
/// on the number of threads.
const BAND: usize = 128;

/// Products of the operator with itself, and its transpose.
pub(crate) struct Grams {
    /// `sum_i A_imk A_imj` (`[k][j][m]`, for `j <= k` only).
    pub(super) reflectance: Vec<f64>,
    /// `A_k' A_k` (M x M) of each basis function; empty for point estimates.
    light: Vec<Mat<f32>>,
    pub(super) columns: Columns,
}

impl Grams {
    /// Builds the products for distributions of `f` and `l`.
    pub(crate) fn new(problem: &Problem<'_>) -> Self {
        let (op, m) = (problem.bilinear, problem.m());
        let block = |k: usize| Mat::from_fn(op.rows(), m, |i, j| op.row(i)[k * m + j]);
        let light = (0..problem.k()).map(|k| gram(block(k).as_ref())).collect();
        Self { reflectance: op.reflectance_grams(), light, columns: Columns::new(problem) }
    }

    /// Builds the products for point estimates, whose variances are zero.
    pub(crate) fn of_points(problem: &Problem<'_>) -> Self {
        let reflectance = vec![0.0; problem.k() * problem.k() * problem.m()];
        Self { reflectance, light: Vec::new(), columns: Columns::new(problem) }
    }

    /// `scale (B'B + sum_k vf_k A_k' A_k) + diag d` (M x M) for `B` row by row, on and below the
    /// diagonal: the curvature of the cost in the light.
    pub(super) fn light_curvature(&self, b: &[f64], f: &[Moments], scale: f64, d: &[f64]) -> Mat<f64> {
        let m = d.len();
        let b = MatRef::from_row_major_slice(b, b.len() / m, m);
        let mut sum = Mat::zeros(m, m);
        column_bands(sum.as_mut(), m.div_ceil(BAND)).into_par_iter().for_each(|(first, mut band)| {
            let (width, rest) = (band.ncols(), m - first);
            let (left, right) = (b.subcols(first, rest), b.subcols(first, width));
            multiply(band.as_mut().subrows_mut(first, rest), Accum::Replace, left.transpose(), right, scale);
            for (gram, f) in self.light.iter().zip(f) {
                let variance = scale * f.variance;
                for (j, column) in band.as_mut().col_iter_mut().enumerate() {
                    let column = column.try_as_col_major_mut().expect("a matrix is stored by columns").as_slice_mut();
                    let gram = gram.col(first + j).try_as_col_major().expect("a matrix is stored by columns");
                    let below = first + j..m;
                    dispatch(|| axpy(variance, &gram.as_slice()[below.clone()], &mut column[below]));
                }
            }
            for j in 0..width {
                band[(first + j, j)] += d[first + j];
            }
        });
        sum
    }
}

/// `X'X`, on and below the diagonal.
fn gram(x: MatRef<'_, f32>) -> Mat<f32> {
    let n = x.ncols();
    let mut gram = Mat::<f32>::zeros(n, n);
    column_bands(gram.as_mut(), n.div_ceil(BAND)).into_par_iter().for_each(|(first, mut band)| {
        let (width, rest) = (band.ncols(), n - first);
        let (left, right) = (x.subcols(first, rest), x.subcols(first, width));
        multiply(band.as_mut().subrows_mut(first, rest), Accum::Replace, left.transpose(), right, 1.0);
    });
    gram
}

/// `S p` for a symmetric `S` of which only the entries on and below the diagonal are read.
pub(super) fn symmetric_times(s: &Mat<f64>, p: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; p.len()];
    dispatch(|| {
        for j in 0..p.len() {
            let column = s.col(j).try_as_col_major().expect("a matrix is stored by columns").as_slice();
            axpy(p[j], &column[j..], &mut out[j..]);
            out[j] += dot(&column[j + 1..], &p[j + 1..]);
        }
    });
    out
}

/// The operator with the light coefficient as the slowest index, `[m][row][k]`.
pub(crate) struct Columns {
    length: usize,
    data: Vec<f32>,
}

impl Columns {
    fn new(problem: &Problem<'_>) -> Self {
        let (op, k_count, m_count) = (problem.bilinear, problem.k(), problem.m());
        let length = op.rows() * k_count;
        let mut data = vec![0.0; length * m_count];
        // Eight coefficients at a time, so that each cache line is read once.
        data.par_chunks_mut(8 * length).enumerate().for_each(|(group, columns)| {
            for i in 0..op.rows() {
                for (k, block) in op.row(i).chunks_exact(m_count).enumerate() {
                    for (column, x) in columns.chunks_exact_mut(length).zip(&block[8 * group..]) {
                        column[i * k_count + k] = *x;
                    }
                }
            }
        });
        Self { length, data }
    }

    /// `A_imk` of one light coefficient `m`, `[row][k]`.
    pub(super) fn of(&self, m: usize) -> &[f32] {
        &self.data[m * self.length..][..self.length]
    }
}

/// Writes `f_k ( <g> I_i - <g^2> y_i ) - <g^2> vf_k a_ik` into `out` (rows x K).
///
/// Its product with a column is the pull of the image on that coefficient of the light.
pub(super) fn pull_weights(problem: &Problem<'_>, now: &Expectations, a: &[f64], y: &[f64], out: &mut [f64]) {
    let (f, g) = (&now.moments.f, &now.moments.g);
    let (g1, g2) = (g.mean, g.mean_square());
    let rows = out.chunks_exact_mut(f.len()).zip(a.chunks_exact(f.len()));
    for (((out, a), y), i) in rows.zip(y).zip(&problem.target) {
        let w = g1 * i - g2 * y;
        for ((out, a), f) in out.iter_mut().zip(a).zip(f) {
            *out = f.mean * w - g2 * f.variance * a;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::VariationalParameters;
    use super::super::tests::{planted, start};
    use super::*;

    #[test]
    fn products_match_the_operator() {
        let planted = planted(60, 3, 0.05, 3);
        let problem = planted.problem();
        let ensemble: VariationalParameters = start(&planted, 2);
        let now = Expectations::new(&problem, &ensemble);
        let grams = Grams::new(&problem);
        let p: Vec<f64> = (0..problem.m()).map(|m| (m as f64).sin()).collect();
        let d = vec![0.3; problem.m()];
        let curved = symmetric_times(&grams.light_curvature(&now.b, &now.moments.f, 2.0, &d), &p);
        let f: Vec<(f64, f64)> = now.moments.f.iter().map(|f| (f.mean, f.variance)).collect();
        let mut want = vec![0.0; problem.m()];
        for i in 0..60 {
            let row = planted.image.bilinear.row(i);
            let along: Vec<f64> = row.chunks_exact(problem.m()).map(|a| dot(a, &p)).collect();
            let y: f64 = along.iter().zip(&f).map(|(a, f)| a * f.0).sum();
            for (k, a) in row.chunks_exact(problem.m()).enumerate() {
                want.iter_mut().zip(a).for_each(|(w, a)| *w += f64::from(*a) * (f[k].0 * y + f[k].1 * along[k]));
            }
        }
        for ((got, want), p) in curved.iter().zip(&want).zip(&p) {
            let want = 2.0 * want + 0.3 * p;
            assert!((got - want).abs() < 1e-5 * want.abs().max(1.0), "{got} {want}");
        }
        let mut weights = vec![0.0; 180];
        pull_weights(&problem, &now, &now.a, &now.y, &mut weights);
        let pull = now.pull(&problem);
        for m in 0..problem.m() {
            let got = dot(grams.columns.of(m), &weights);
            assert!((got - pull.light[m]).abs() < 1e-9 * got.abs().max(1.0), "{m}: {got} {}", pull.light[m]);
        }
    }
}
