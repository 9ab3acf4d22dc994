//! Bilinear operator `(l, f) -> l' A_i f` on a stack of rows, and its contractions for inference.

use gonio_linalg::{add_product, axpy, dispatch, dot};
use rayon::prelude::*;

/// Number of rows in a group.
///
/// Groups are summed in order, so that results do not depend on the number of threads.
const GROUP: usize = 32;

/// Matrices `A_i` (M x K) of eq. 8, one per row, stored as `[row][k][m]`.
#[derive(Clone, Debug)]
pub struct Bilinear {
    rows: usize,
    k: usize,
    m: usize,
    data: Vec<f32>,
    squares: Vec<f64>,
}

impl Bilinear {
    /// Wraps `rows * k * m` entries, `[row][k][m]`.
    ///
    /// # Panics
    /// If there are not `rows * k * m` entries.
    pub fn new(rows: usize, k: usize, m: usize, data: Vec<f32>) -> Self {
        assert_eq!(data.len(), rows * k * m);
        let mut bilinear = Self { rows, k, m, data, squares: Vec::new() };
        bilinear.squares = bilinear.sum_over_rows(k * m, |_, row, sum| add_squares(row, sum));
        bilinear
    }

    /// Returns the number of rows: pixels, or directions of a projection.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the number of reflectance coefficients.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Returns the number of light coefficients.
    pub fn m(&self) -> usize {
        self.m
    }

    /// Returns the matrix of one row, `[k][m]`.
    pub fn row(&self, i: usize) -> &[f32] {
        &self.data[i * self.k * self.m..][..self.k * self.m]
    }

    /// Returns `W[k][m] = sum_i A_imk^2`.
    pub fn squares(&self) -> &[f64] {
        &self.squares
    }

    /// Computes `a_ik = sum_m A_imk l_m` (rows x K), the images of the basis under light `l`.
    pub(crate) fn under_light(&self, l: &[f64]) -> Vec<f64> {
        assert_eq!(l.len(), self.m);
        let mut out = vec![0.0; self.rows * self.k];
        out.par_chunks_mut(GROUP * self.k).enumerate().for_each(|(group, out)| {
            dispatch(|| {
                for (i, out) in out.chunks_exact_mut(self.k).enumerate() {
                    let row = self.row(group * GROUP + i);
                    for (out, a) in out.iter_mut().zip(row.chunks_exact(self.m)) {
                        *out = dot(a, l);
                    }
                }
            });
        });
        out
    }

    /// Computes `b_im = sum_k A_imk f_k` (rows x M), the map from light to image for BRDF `f`.
    pub fn of_reflectance(&self, f: &[f64]) -> Vec<f64> {
        assert_eq!(f.len(), self.k);
        let mut out = vec![0.0; self.rows * self.m];
        out.par_chunks_mut(GROUP * self.m).enumerate().for_each(|(group, out)| {
            dispatch(|| {
                for (i, out) in out.chunks_exact_mut(self.m).enumerate() {
                    let row = self.row(group * GROUP + i);
                    for (a, &f) in row.chunks_exact(self.m).zip(f) {
                        axpy(f, a, out);
                    }
                }
            });
        });
        out
    }

    /// Computes `y_i = l' A_i f` (eq. 8 without exposure and noise).
    pub fn apply(&self, l: &[f64], f: &[f64]) -> Vec<f64> {
        let a = self.under_light(l);
        a.chunks_exact(self.k).map(|a| a.iter().zip(f).map(|(a, f)| a * f).sum()).collect()
    }

    /// Computes `sum_i x_i A_imk` (`[k][m]`), the adjoint of the operator at `x`.
    pub(crate) fn adjoint(&self, x: &[f64]) -> Vec<f64> {
        assert_eq!(x.len(), self.rows);
        self.sum_over_rows(self.k * self.m, |i, row, sum| axpy(x[i], row, sum))
    }

    /// Computes `sum_ik x_ik A_imk` (M), with `x` rows x K: the adjoint of [`Self::under_light`].
    pub(crate) fn light_adjoint(&self, x: &[f64]) -> Vec<f64> {
        assert_eq!(x.len(), self.rows * self.k);
        self.sum_over_rows(self.m, |i, row, sum| {
            for (k, a) in row.chunks_exact(self.m).enumerate() {
                axpy(x[i * self.k + k], a, sum);
            }
        })
    }

    /// Computes `sum_i A_imk A_imj` (`[k][j][m]`, for `j <= k` only).
    ///
    /// These are the inner products of the images of two basis functions for each light
    /// coefficient.
    pub fn reflectance_grams(&self) -> Vec<f64> {
        let (k, m) = (self.k, self.m);
        self.sum_over_rows(k * k * m, |_, row, sum| {
            for a in 0..k {
                for b in 0..=a {
                    let pair = row[a * m..(a + 1) * m].iter().zip(&row[b * m..(b + 1) * m]);
                    for (sum, (x, y)) in sum[(a * k + b) * m..][..m].iter_mut().zip(pair) {
                        *sum += f64::from(*x) * f64::from(*y);
                    }
                }
            }
        })
    }

    /// Computes `sum_i A_imk b_im` (`[k][m]`), with `b` rows x M.
    pub(crate) fn contract_light(&self, b: &[f64]) -> Vec<f64> {
        assert_eq!(b.len(), self.rows * self.m);
        self.sum_over_rows(self.k * self.m, |i, row, sum| {
            let b = &b[i * self.m..][..self.m];
            for (a, sum) in row.chunks_exact(self.m).zip(sum.chunks_exact_mut(self.m)) {
                add_product(a, b, sum);
            }
        })
    }

    /// Sums `g(i, row, partial)` over rows, in parallel over groups that are added in order.
    fn sum_over_rows(&self, length: usize, g: impl Fn(usize, &[f32], &mut [f64]) + Sync) -> Vec<f64> {
        // Uses few partial sums, since each is as long as a row.
        let parts = self.rows.div_ceil(GROUP).clamp(1, 8);
        let partial: Vec<Vec<f64>> = (0..parts)
            .into_par_iter()
            .map(|part| {
                let mut sum = vec![0.0; length];
                dispatch(|| {
                    for i in part * self.rows / parts..(part + 1) * self.rows / parts {
                        g(i, self.row(i), &mut sum);
                    }
                });
                sum
            })
            .collect();
        partial
            .into_iter()
            .reduce(|mut sum, part| {
                sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
                sum
            })
            .unwrap_or_else(|| vec![0.0; length])
    }
}

#[inline(always)]
fn add_squares(row: &[f32], sum: &mut [f64]) {
    for (sum, &a) in sum.iter_mut().zip(row) {
        *sum += f64::from(a) * f64::from(a);
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::testing::{inner, on_threads, random};

    pub(crate) fn random_bilinear(rows: usize, k: usize, m: usize) -> Bilinear {
        Bilinear::new(rows, k, m, random(rows * k * m, 42).into_iter().map(|x| x as f32).collect())
    }

    #[test]
    fn adjoint_identity_holds() {
        // <x, A(l, f)> = <A*(x), f l'>
        let op = random_bilinear(77, 5, 33);
        let (l, f, x) = (random(33, 1), random(5, 2), random(77, 3));
        let outer: Vec<f64> = f.iter().flat_map(|f| l.iter().map(move |l| f * l)).collect();
        let (left, right) = (inner(&x, &op.apply(&l, &f)), inner(&op.adjoint(&x), &outer));
        assert!((left - right).abs() < 1e-10 * left.abs().max(1.0), "{left} {right}");
    }

    #[test]
    fn contractions_match_their_definitions() {
        let op = random_bilinear(70, 3, 17);
        let (l, f) = (random(17, 1), random(3, 2));
        let entry = |i: usize, k: usize, m: usize| f64::from(op.row(i)[k * 17 + m]);
        let (a, b) = (op.under_light(&l), op.of_reflectance(&f));
        let light = op.contract_light(&b);
        for k in 0..3 {
            for m in 0..17 {
                let sum = |g: &dyn Fn(usize) -> f64| (0..70).map(g).sum::<f64>();
                let at = k * 17 + m;
                let expected = [
                    (op.squares()[at], sum(&|i| entry(i, k, m).powi(2))),
                    (light[at], sum(&|i| entry(i, k, m) * (0..3).map(|k| entry(i, k, m) * f[k]).sum::<f64>())),
                ];
                for (got, want) in expected {
                    assert!((got - want).abs() < 1e-10, "{k} {m}: {got} {want}");
                }
            }
        }
        let weights = random(70 * 3, 8);
        let (adjoint, grams) = (op.light_adjoint(&weights), op.reflectance_grams());
        assert!((inner(&adjoint, &l) - inner(&weights, &a)).abs() < 1e-10);
        for (k, j, m) in [(0, 0, 3), (2, 1, 16), (1, 0, 0)] {
            let want: f64 = (0..70).map(|i| entry(i, k, m) * entry(i, j, m)).sum();
            assert!((grams[(k * 3 + j) * 17 + m] - want).abs() < 1e-10);
        }
        let y = op.apply(&l, &f);
        for i in 0..70 {
            assert!((y[i] - inner(&b[i * 17..][..17], &l)).abs() < 1e-12);
        }
    }

    #[test]
    fn sums_do_not_depend_on_threads() {
        let op = random_bilinear(300, 4, 64);
        let b = random(300 * 64, 9);
        let run = |threads| on_threads(threads, || op.contract_light(&b));
        assert_eq!(run(1), run(3));
    }
}
