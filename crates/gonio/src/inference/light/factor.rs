//! Algebra of `S = I + rho B V B'`, the covariance of an image in units of its noise, in the
//! smaller of two spaces.

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

use super::dense::{Cholesky, bands_of};
use crate::linalg::squared_norms;
use crate::transfer::kernels::{axpy, dot};

/// Rows of an image, and least number of coefficients, that one thread computes at a time.
const ROWS: usize = 256;
const COLUMNS: usize = 32;

/// Matrix that is factorised, of two with the same determinant; `X = B V^(1/2)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// `S = I + rho X X'`, as large as the image has rows.
    Rows,
    /// `I + rho X' X`, as large as the light has coefficients.
    Light,
}

impl Form {
    /// Chooses the smaller matrix: it is cheaper, and no worse conditioned, since the larger one
    /// has the same eigenvalues and additional ones of one.
    pub(super) fn smaller(rows: usize, m: usize) -> Self {
        if rows <= m { Self::Rows } else { Self::Light }
    }
}

/// Parts of an operator that are reused at other variances: `B`, and `B'B` where the form needs it.
pub(super) struct Design {
    /// `B` (rows x M).
    pub(super) matrix: Mat<f64>,
    gram: Option<Mat<f64>>,
}

impl Design {
    pub(super) fn new(matrix: Mat<f64>, form: Form) -> Self {
        let gram = (form == Form::Light).then(|| lower_of_product(matrix.transpose(), matrix.as_ref()));
        Self { matrix, gram }
    }

    /// `B x` (rows).
    pub(super) fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.matrix.nrows()];
        out.par_chunks_mut(ROWS).enumerate().for_each(|(part, out)| {
            let rows = part * ROWS..part * ROWS + out.len();
            for (m, x) in x.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                axpy(*x, &self.matrix.col_as_slice(m)[rows.clone()], out);
            }
        });
        out
    }

    /// `B' e` (M).
    pub(super) fn adjoint(&self, e: &[f64]) -> Vec<f64> {
        let columns = (0..self.matrix.ncols()).into_par_iter().with_min_len(COLUMNS);
        columns.map(|m| dot(self.matrix.col_as_slice(m), e)).collect()
    }

    /// `rho B'B + diag(d)` (M x M): the precision of the posterior under prior precisions `d`.
    pub(super) fn precision(&self, rho: f64, d: &[f64]) -> Mat<f64> {
        let made = self.gram.is_none().then(|| lower_of_product(self.matrix.transpose(), self.matrix.as_ref()));
        let gram = self.gram.as_ref().or(made.as_ref()).expect("one of the two");
        Mat::from_fn(d.len(), d.len(), |i, j| rho * gram[(i.max(j), i.min(j))] + if i == j { d[i] } else { 0.0 })
    }
}

/// A factorised `S` at prior variances `V` and a ratio `rho = b g^2` of signal to noise.
pub(super) struct Factor<'a> {
    design: &'a Design,
    variances: Vec<f64>,
    rho: f64,
    /// `B V^(1/2)` (rows x M), in the form by rows.
    scaled: Option<Mat<f64>>,
    /// Cholesky factor of the form's matrix.
    cholesky: Cholesky,
    /// `L^-1 X` (rows x M) in the form by rows, `L^-1` (M x M) in the form by light.
    solved: Option<Mat<f64>>,
}

impl<'a> Factor<'a> {
    /// Factorises at the variances of the M light coefficients (zero for a constant) and `rho > 0`.
    /// `None` where the matrix is not finite.
    pub(super) fn new(design: &'a Design, variances: &[f64], rho: f64) -> Option<Self> {
        let m = design.matrix.ncols();
        assert_eq!(variances.len(), m);
        let roots: Vec<f64> = variances.iter().map(|v| v.sqrt()).collect();
        let scaled = design.gram.is_none().then(|| {
            let mut scaled = design.matrix.clone();
            for (column, root) in scaled.as_mut().col_iter_mut().zip(&roots) {
                column.iter_mut().for_each(|x| *x *= root);
            }
            scaled
        });
        let mut lower = match (&design.gram, &scaled) {
            (_, Some(scaled)) => lower_of_product(scaled.as_ref(), scaled.transpose()),
            (None, None) => unreachable!("one of the two"),
            (Some(gram), None) => {
                Mat::from_fn(m, m, |i, j| if i < j { 0.0 } else { gram[(i, j)] * (roots[i] * roots[j]) })
            }
        };
        for (j, column) in lower.as_mut().col_iter_mut().enumerate() {
            for (i, x) in column.iter_mut().enumerate().skip(j) {
                *x = rho * *x + f64::from(u8::from(i == j));
            }
        }
        let cholesky = Cholesky::new(lower)?;
        Some(Self { design, variances: variances.to_vec(), rho, scaled, cholesky, solved: None })
    }

    fn by_rows(&self) -> bool {
        self.design.gram.is_none()
    }

    /// `log det S`.
    pub(super) fn log_det(&self) -> f64 {
        let lower = &self.cholesky.lower;
        2.0 * (0..lower.nrows()).map(|i| lower[(i, i)].ln()).sum::<f64>()
    }

    /// `V^(1/2) B' e` (M).
    fn scaled_adjoint(&self, e: &[f64]) -> Vec<f64> {
        let root = self.variances.iter().map(|v| v.sqrt());
        self.design.adjoint(e).into_iter().zip(root).map(|(x, root)| x * root).collect()
    }

    /// `S^-1 x` (rows).
    pub(super) fn solve(&self, x: &[f64]) -> Vec<f64> {
        if self.by_rows() {
            return self.cholesky.solve(x);
        }
        let mut solution = self.deflated(x);
        // The difference cancels where the light explains nearly all, so it is refined once.
        let explained = self.design.times(&self.gain(&solution));
        let left: Vec<f64> = x.iter().zip(&solution).zip(explained).map(|((x, e), y)| x - e - y).collect();
        solution.iter_mut().zip(self.deflated(&left)).for_each(|(e, more)| *e += more);
        solution
    }

    /// `S^-1 x = x - rho X (I + rho X'X)^-1 X' x` (rows), in the form by light.
    fn deflated(&self, x: &[f64]) -> Vec<f64> {
        let fitted = self.design.times(&self.root_times(self.cholesky.solve(&self.scaled_adjoint(x))));
        x.iter().zip(fitted).map(|(x, fit)| x - self.rho * fit).collect()
    }

    fn root_times(&self, mut x: Vec<f64>) -> Vec<f64> {
        x.iter_mut().zip(&self.variances).for_each(|(x, v)| *x *= v.sqrt());
        x
    }

    /// `rho V B' e` (M): for `e = S^-1 t`, the posterior mean of a light of prior mean zero whose
    /// image is `t`.
    pub(super) fn gain(&self, e: &[f64]) -> Vec<f64> {
        let back = self.design.adjoint(e);
        back.iter().zip(&self.variances).map(|(x, v)| self.rho * v * x).collect()
    }

    /// Column `c` of the posterior covariance `Sigma = (V^-1 + rho B'B)^-1` (M).
    pub(super) fn covariance_column(&self, c: usize) -> Vec<f64> {
        if self.by_rows() {
            let column: Vec<f64> = self.design.matrix.col(c).iter().copied().collect();
            let mut out = self.gain(&self.cholesky.solve(&column));
            out.iter_mut().for_each(|x| *x *= -self.variances[c]);
            out[c] += self.variances[c];
            return out;
        }
        let mut unit = vec![0.0; self.variances.len()];
        unit[c] = self.variances[c].sqrt();
        self.root_times(self.cholesky.solve(&unit))
    }

    /// Computes `solved` unless it is there already.
    fn ensure_solved(&mut self) {
        if self.solved.is_some() {
            return;
        }
        let solved = if let Some(scaled) = &self.scaled {
            let mut solved = scaled.clone();
            let lower = self.cholesky.lower.as_ref();
            bands_of(solved.as_mut()).into_par_iter().for_each(|(_, band)| {
                solve_lower_triangular_in_place(lower, band, Par::Seq);
            });
            solved
        } else {
            self.cholesky.inverse_of_lower()
        };
        self.solved = Some(solved);
    }

    /// Diagonal of the posterior covariance `Sigma` (M).
    pub(super) fn posterior_variances(&mut self) -> Vec<f64> {
        self.ensure_solved();
        let solved = self.solved.as_ref().expect("just solved");
        let squares = squared_norms(solved.as_ref());
        let by_rows = self.by_rows();
        // Keeps the variance positive where the image determines a coefficient beyond round-off.
        let share = |s: f64| if by_rows { (1.0 - self.rho * s).max(1e-14) } else { s };
        squares.into_iter().zip(&self.variances).map(|(s, v)| v * share(s)).collect()
    }
}

/// Lower triangle of the symmetric `a b`, band by band; a part above it is computed too.
fn lower_of_product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let n = a.nrows();
    let mut out = Mat::zeros(n, n);
    bands_of(out.as_mut()).into_par_iter().for_each(|(first, band)| {
        let (width, rest) = (band.ncols(), n - first);
        let (a, b) = (a.subrows(first, rest), b.subcols(first, width));
        matmul(band.subrows_mut(first, rest), Accum::Replace, a, b, 1.0, Par::Seq);
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::light::tests::{identity, inverse_and_log_det};
    use crate::testing::random;

    /// Checks every quantity of both forms against dense algebra, for fewer and for more rows than
    /// coefficients.
    #[test]
    fn both_forms_are_the_dense_algebra() {
        for (rows, m) in [(7, 12), (12, 7), (300, 40)] {
            let b = random(rows * m, 3);
            let mut v: Vec<f64> = random(m, 4).iter().map(|x| 10.0_f64.powf(3.0 * x)).collect();
            v[0] = 0.0;
            let (rho, x) = (40.0, random(rows, 5));
            let mut s = identity(rows);
            for i in 0..rows {
                for j in 0..rows {
                    s[i][j] += rho * (0..m).map(|k| b[i * m + k] * v[k] * b[j * m + k]).sum::<f64>();
                }
            }
            let (inverse, log_det) = inverse_and_log_det(s);
            // Sigma = V - rho V B' S^-1 B V.
            let sigma = |p: usize, q: usize| {
                let mut sum = 0.0;
                for i in 0..rows {
                    for j in 0..rows {
                        sum += b[i * m + p] * inverse[i][j] * b[j * m + q];
                    }
                }
                f64::from(u8::from(p == q)) * v[p] - rho * v[p] * v[q] * sum
            };
            for form in [Form::Rows, Form::Light] {
                let design = Design::new(Mat::from_fn(rows, m, |i, j| b[i * m + j]), form);
                let mut factor = Factor::new(&design, &v, rho).unwrap();
                assert!((factor.log_det() - log_det).abs() < 1e-9 * log_det.abs(), "{form:?}");
                for (i, got) in factor.solve(&x).iter().enumerate() {
                    let want: f64 = inverse[i].iter().zip(&x).map(|(a, x)| a * x).sum();
                    assert!((got - want).abs() < 1e-9, "{form:?} {got} {want}");
                }
                let column = factor.covariance_column(2);
                let variances = factor.posterior_variances();
                for p in 0..m {
                    let near = |got: f64, want: f64| (got - want).abs() < 1e-8 * (1.0 + v[p]);
                    assert!(near(column[p], sigma(p, 2)) && near(variances[p], sigma(p, p)), "{form:?} {p}");
                }
            }
        }
    }
}
