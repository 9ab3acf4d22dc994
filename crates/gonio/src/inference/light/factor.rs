//! Algebra of `S = I + rho B V B'`, the covariance of an image in units of its noise, in the
//! smaller of two spaces.

use faer::{Accum, Mat, MatRef};
use gonio_linalg::{Cholesky, axpy, bands_of, column_bands, dispatch, dot, each_column, multiply, squared_norms};
use rayon::prelude::*;

use crate::parallel;

/// Number of coefficients whose images are summed together; constant, so that results do not depend
/// on the number of threads.
const GROUP: usize = 64;

/// Smallest number of coefficients that one task computes.
const COLUMNS: usize = 32;

/// Matrix to factorise, out of two with the same determinant; `X = B V^(1/2)`.
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

/// Linear map `B` from light to image for one reflectance, and `B'B` if the form requires it.
#[derive(Clone, Debug)]
pub(super) struct Design {
    /// `B` (rows x M).
    pub(super) matrix: Mat<f64>,
    gram: Option<Mat<f64>>,
}

impl Design {
    /// Builds the design from the `entries` of `B`, row by row (rows x m), with each row multiplied
    /// by its factor.
    ///
    /// # Panics
    /// If there are not `rows * m` entries, or not as many factors as rows.
    pub(super) fn of_rows<A: Copy + Into<f64> + Sync>(
        rows: usize,
        m: usize,
        entries: &[A],
        factors: Option<&[f64]>,
    ) -> Self {
        assert_eq!(entries.len(), rows * m);
        assert!(factors.is_none_or(|factors| factors.len() == rows));
        let mut matrix = Mat::zeros(rows, m);
        // A band has as many columns as values of a row share a cache line.
        column_bands(matrix.as_mut(), m.div_ceil(16).max(1)).into_par_iter().for_each(|(first, mut band)| {
            for i in 0..rows {
                let factor = factors.map_or(1.0, |factors| factors[i]);
                for (j, entry) in entries[i * m + first..][..band.ncols()].iter().enumerate() {
                    band[(i, j)] = factor * (*entry).into();
                }
            }
        });
        Self::new(matrix, Form::smaller(rows, m))
    }

    fn new(matrix: Mat<f64>, form: Form) -> Self {
        let gram = (form == Form::Light).then(|| lower_of_product(matrix.transpose(), matrix.as_ref()));
        Self { matrix, gram }
    }

    /// Returns the design of the first `m` columns alone.
    pub(super) fn first(&self, m: usize) -> Self {
        let matrix = self.matrix.subcols(0, m).to_owned();
        match (&self.gram, Form::smaller(matrix.nrows(), m)) {
            (Some(gram), Form::Light) => Self { matrix, gram: Some(gram.submatrix(0, 0, m, m).to_owned()) },
            (_, form) => Self::new(matrix, form),
        }
    }

    /// `B x` (rows).
    pub(super) fn times(&self, x: &[f64]) -> Vec<f64> {
        let [out] = self.times_all([x]);
        out
    }

    /// `B x` (rows) of several vectors, in one pass over the design.
    pub(super) fn times_all<const N: usize>(&self, x: [&[f64]; N]) -> [Vec<f64>; N] {
        let (rows, columns) = self.matrix.shape();
        let parts: Vec<[Vec<f64>; N]> = parallel::map_range(columns.div_ceil(GROUP), |group| {
            let mut sums = std::array::from_fn(|_| vec![0.0; rows]);
            for m in group * GROUP..columns.min((group + 1) * GROUP) {
                let column = self.matrix.col_as_slice(m);
                for (x, sum) in x.iter().zip(&mut sums).filter(|(x, _)| x[m] != 0.0) {
                    dispatch(|| axpy(x[m], column, sum));
                }
            }
            sums
        });
        // Sums in the order of the groups, which does not depend on the threads.
        let mut sums = std::array::from_fn(|_| vec![0.0; rows]);
        for part in &parts {
            for (sum, part) in sums.iter_mut().zip(part) {
                sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
            }
        }
        sums
    }

    /// `B' e` (M).
    pub(super) fn adjoint(&self, e: &[f64]) -> Vec<f64> {
        let [out] = self.adjoint_all([e]);
        out
    }

    /// `B' e` (M) of several images, in one pass over the design.
    pub(super) fn adjoint_all<const N: usize>(&self, e: [&[f64]; N]) -> [Vec<f64>; N] {
        let columns = (0..self.matrix.ncols()).into_par_iter().with_min_len(COLUMNS);
        let products: Vec<[f64; N]> =
            columns.map(|m| e.map(|e| dispatch(|| dot(self.matrix.col_as_slice(m), e)))).collect();
        std::array::from_fn(|which| products.iter().map(|p| p[which]).collect())
    }

    /// `rho B'B + diag(d)` (M x M): the precision of the posterior under prior precisions `d`.
    pub(super) fn precision(&self, rho: f64, d: &[f64]) -> Mat<f64> {
        let made = self.gram.is_none().then(|| lower_of_product(self.matrix.transpose(), self.matrix.as_ref()));
        let gram = self.gram.as_ref().or(made.as_ref()).expect("the Gram matrix is stored or was just computed");
        let mut out = Mat::zeros(d.len(), d.len());
        each_column(out.as_mut(), &|j, column| {
            for (i, x) in column.iter_mut().enumerate() {
                *x = rho * gram[(i.max(j), i.min(j))];
            }
            column[j] += d[j];
        });
        out
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
    /// Returns `None` if the matrix is not finite.
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
        let made = scaled.as_ref().map(|scaled| lower_of_product(scaled.as_ref(), scaled.transpose()));
        let gram = made.as_ref().or(design.gram.as_ref()).expect("the Gram matrix is stored or was just computed");
        let mut lower = Mat::zeros(gram.nrows(), gram.ncols());
        each_column(lower.as_mut(), &|j, column| {
            let gram = &gram.col_as_slice(j)[j..];
            let below = column[j..].iter_mut().zip(gram);
            if scaled.is_some() {
                below.for_each(|(x, g)| *x = rho * g);
            } else {
                below.zip(&roots[j..]).for_each(|((x, g), root)| *x = rho * (g * (root * roots[j])));
            }
            column[j] += 1.0;
        });
        let cholesky = Cholesky::new(lower)?;
        Some(Self { design, variances: variances.to_vec(), rho, scaled, cholesky, solved: None })
    }

    fn by_rows(&self) -> bool {
        self.design.gram.is_none()
    }

    /// `log det S`.
    pub(super) fn log_det(&self) -> f64 {
        let lower = self.cholesky.lower();
        2.0 * (0..lower.nrows()).map(|i| lower[(i, i)].ln()).sum::<f64>()
    }

    /// `S^-1 x` (rows) of several images.
    pub(super) fn solve<const N: usize>(&self, x: [&[f64]; N]) -> [Vec<f64>; N] {
        if self.by_rows() {
            return x.map(|x| self.cholesky.solve(x));
        }
        let mut solutions = self.deflated(x);
        // The difference suffers from cancellation if the light explains nearly the whole image, so
        // the solution is refined once.
        let gains = self.gain(solutions.each_ref().map(Vec::as_slice));
        let explained = self.design.times_all(gains.each_ref().map(Vec::as_slice));
        let left: [Vec<f64>; N] = std::array::from_fn(|which| {
            let parts = x[which].iter().zip(&solutions[which]).zip(&explained[which]);
            parts.map(|((x, e), y)| x - e - y).collect()
        });
        for (solution, more) in solutions.iter_mut().zip(self.deflated(left.each_ref().map(Vec::as_slice))) {
            solution.iter_mut().zip(more).for_each(|(e, more)| *e += more);
        }
        solutions
    }

    /// `S^-1 x = x - rho X (I + rho X'X)^-1 X' x` (rows), in the form by light.
    fn deflated<const N: usize>(&self, x: [&[f64]; N]) -> [Vec<f64>; N] {
        let back = self.design.adjoint_all(x).map(|back| self.cholesky.solve(&self.root_times(back)));
        let light = back.map(|light| self.root_times(light));
        let mut fitted = self.design.times_all(light.each_ref().map(Vec::as_slice));
        for (fitted, x) in fitted.iter_mut().zip(x) {
            fitted.iter_mut().zip(x).for_each(|(fit, x)| *fit = x - self.rho * *fit);
        }
        fitted
    }

    fn root_times(&self, mut x: Vec<f64>) -> Vec<f64> {
        x.iter_mut().zip(&self.variances).for_each(|(x, v)| *x *= v.sqrt());
        x
    }

    /// `rho V B' e` (M) of several images: for `e = S^-1 t`, the posterior mean of a light of prior
    /// mean zero whose image is `t`.
    pub(super) fn gain<const N: usize>(&self, e: [&[f64]; N]) -> [Vec<f64>; N] {
        self.design.adjoint_all(e).map(|mut back| {
            back.iter_mut().zip(&self.variances).for_each(|(x, v)| *x *= self.rho * v);
            back
        })
    }

    /// Column `c` of the posterior covariance `Sigma = (V^-1 + rho B'B)^-1` (M).
    pub(super) fn covariance_column(&self, c: usize) -> Vec<f64> {
        if self.by_rows() {
            let column: Vec<f64> = self.design.matrix.col(c).iter().copied().collect();
            let [mut out] = self.gain([&self.cholesky.solve(&column)]);
            out.iter_mut().for_each(|x| *x *= -self.variances[c]);
            out[c] += self.variances[c];
            return out;
        }
        let mut unit = vec![0.0; self.variances.len()];
        unit[c] = self.variances[c].sqrt();
        self.root_times(self.cholesky.solve(&unit))
    }

    /// Computes `solved` if it is missing.
    fn ensure_solved(&mut self) {
        if self.solved.is_some() {
            return;
        }
        let solved = if let Some(scaled) = &self.scaled {
            let mut solved = scaled.clone();
            self.cholesky.whiten(&mut solved);
            solved
        } else {
            self.cholesky.inverse_of_lower()
        };
        self.solved = Some(solved);
    }

    /// Diagonal of the posterior covariance `Sigma` (M).
    pub(super) fn posterior_variances(&mut self) -> Vec<f64> {
        self.ensure_solved();
        let solved = self.solved.as_ref().expect("the line above computes it");
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
        multiply(band.subrows_mut(first, rest), Accum::Replace, a, b, 1.0);
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
    fn both_forms_match_dense_algebra() {
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
                for (i, got) in factor.solve([&x])[0].iter().enumerate() {
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
