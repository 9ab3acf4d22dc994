//! Non-negative least squares in Gram form, by an exact active-set method.
//!
//! The method is that of Lawson & Hanson (1974, ch. 23).

use faer::MatRef;
use thiserror::Error;

/// Error of the non-negative least squares.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum NnlsError {
    /// The Gram matrix is not square, or the right-hand side has another length.
    #[error("the Gram matrix is {rows} x {columns} and the right-hand side has {len} entries")]
    Shape {
        /// Number of rows of the Gram matrix.
        rows: usize,
        /// Number of columns of the Gram matrix.
        columns: usize,
        /// Number of entries of the right-hand side.
        len: usize,
    },
    /// An input is NaN or infinite.
    #[error("an entry of the Gram matrix or of the right-hand side is not finite")]
    NotFinite,
    /// The cost is unbounded below.
    ///
    /// This is only possible if `c` has negative entries, or if `G` and `h` correspond to no `A`
    /// and `b`.
    #[error("the cost is unbounded below along variable {0}")]
    Unbounded(usize),
    /// The active set did not converge.
    ///
    /// This happens only if the matrix is not positive semidefinite.
    #[error("the active set did not converge; check that the Gram matrix is positive semidefinite")]
    NoConvergence,
}

/// Relative size below which a gradient counts as zero.
const ROUND_OFF: f64 = 1e-13;
/// Fraction of a column's squared length outside the span of the others.
///
/// Below it, the column counts as dependent.
const DEPENDENT: f64 = 1e-12;

/// Minimises `|A x - b|^2 + 2 c'x` over `x >= 0`.
///
/// `gram` is `G = A'A` (`n x n`, symmetric positive semidefinite, both triangles filled) and `h` is
/// `A'b - c` (`n`).
///
/// The result satisfies the Karush-Kuhn-Tucker conditions up to round-off: `x >= 0`,
/// `g = G x - h >= 0`, `x_k g_k = 0`. With dependent columns the minimiser is not unique, and one
/// with a non-singular passive set is returned. The cost is `O(n^3)` per change of the active set:
/// meant for the tens of coefficients of a basis.
///
/// # Errors
/// See [`NnlsError`].
pub(crate) fn nnls(gram: MatRef<'_, f64>, h: &[f64]) -> Result<Vec<f64>, NnlsError> {
    let n = h.len();
    if gram.nrows() != n || gram.ncols() != n {
        return Err(NnlsError::Shape { rows: gram.nrows(), columns: gram.ncols(), len: n });
    }
    let finite = h.iter().all(|v| v.is_finite()) && (0..n).all(|i| (0..n).all(|j| gram[(i, j)].is_finite()));
    if !finite {
        return Err(NnlsError::NotFinite);
    }
    let mut state = ActiveSet { gram, h, x: vec![0.0; n], passive: Vec::new() };
    // A variable that round-off removes immediately may not return before something else has
    // changed.
    let mut barred = vec![false; n];
    for _ in 0..100 + 30 * n {
        let Some(entering) = state.most_promising(&barred) else {
            return Ok(state.x);
        };
        if state.admit(entering)? {
            barred.fill(false);
        } else {
            barred[entering] = true;
        }
    }
    Err(NnlsError::NoConvergence)
}

struct ActiveSet<'a> {
    gram: MatRef<'a, f64>,
    h: &'a [f64],
    x: Vec<f64>,
    /// Positive variables, in the order in which they entered.
    passive: Vec<usize>,
}

impl ActiveSet<'_> {
    /// Returns the variable at zero whose increase lowers the cost fastest, if any.
    ///
    /// The speed is in units of the length of the variable's column.
    fn most_promising(&self, barred: &[bool]) -> Option<usize> {
        let mut best = None;
        let mut steepest = 0.0;
        for k in (0..self.h.len()).filter(|k| !barred[*k] && !self.passive.contains(k)) {
            let (mut descent, mut size) = (self.h[k], self.h[k].abs());
            for &p in &self.passive {
                let term = self.gram[(k, p)] * self.x[p];
                descent -= term;
                size += term.abs();
            }
            let diagonal = self.gram[(k, k)];
            let slope = if diagonal > 0.0 { descent / diagonal.sqrt() } else { descent };
            if descent > ROUND_OFF * size && slope > steepest {
                (best, steepest) = (Some(k), slope);
            }
        }
        best
    }

    /// Adds variable `t` and restores optimality over the passive set.
    ///
    /// Returns false if `t` immediately returned to zero.
    fn admit(&mut self, t: usize) -> Result<bool, NnlsError> {
        let column: Vec<f64> = self.passive.iter().map(|&p| self.gram[(p, t)]).collect();
        let z = self.solve(&column).ok_or(NnlsError::NoConvergence)?;
        let fit: f64 = column.iter().zip(&z).map(|(a, b)| a * b).sum();
        let diagonal = self.gram[(t, t)];
        if diagonal - fit <= DEPENDENT * diagonal.abs() {
            // Column t depends on the passive ones, so the cost is linear along (1, -z): moves
            // along this direction until one of the passive variables is zero.
            let leaving = (0..z.len())
                .filter(|&i| z[i] > 0.0)
                .min_by(|&a, &b| (self.x[self.passive[a]] / z[a]).total_cmp(&(self.x[self.passive[b]] / z[b])));
            let Some(leaving) = leaving else {
                return Err(NnlsError::Unbounded(t));
            };
            let step = self.x[self.passive[leaving]] / z[leaving];
            for (&p, z) in self.passive.iter().zip(&z) {
                self.x[p] = (self.x[p] - step * z).max(0.0);
            }
            let out = self.passive.remove(leaving);
            self.x[out] = 0.0;
            self.x[t] = step;
        }
        self.passive.push(t);
        loop {
            let rhs: Vec<f64> = self.passive.iter().map(|&p| self.h[p]).collect();
            let Some(target) = self.solve(&rhs) else {
                // Only the added variable can have made the set singular.
                self.passive.retain(|&p| p != t);
                self.x[t] = 0.0;
                return Ok(false);
            };
            if target.iter().all(|&v| v > 0.0) {
                for (&p, v) in self.passive.iter().zip(target) {
                    self.x[p] = v;
                }
                return Ok(true);
            }
            // Moves as far towards the unconstrained optimum as the bounds allow. Variables that
            // reach zero leave the set.
            let mut step = 1.0_f64;
            for (&p, &v) in self.passive.iter().zip(&target) {
                if v <= 0.0 {
                    step = step.min(self.x[p] / (self.x[p] - v).max(f64::MIN_POSITIVE));
                }
            }
            for (&p, &v) in self.passive.iter().zip(&target) {
                let moved = self.x[p] + step * (v - self.x[p]);
                let blocks = v <= 0.0 && self.x[p] / (self.x[p] - v).max(f64::MIN_POSITIVE) <= step;
                self.x[p] = if blocks { 0.0 } else { moved.max(0.0) };
            }
            let x = &self.x;
            self.passive.retain(|&p| x[p] > 0.0);
            if !self.passive.contains(&t) && step == 0.0 {
                return Ok(false);
            }
        }
    }

    /// Solves `G_PP y = rhs` over the passive set by Cholesky; `None` if a pivot vanishes.
    fn solve(&self, rhs: &[f64]) -> Option<Vec<f64>> {
        let n = self.passive.len();
        let mut l = vec![0.0; n * n];
        let mut y = rhs.to_vec();
        for i in 0..n {
            for j in 0..=i {
                let dot: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
                let rest = self.gram[(self.passive[i], self.passive[j])] - dot;
                if i == j {
                    if rest <= 0.1 * DEPENDENT * self.gram[(self.passive[i], self.passive[i])] {
                        return None;
                    }
                    l[i * n + i] = rest.sqrt();
                } else {
                    l[i * n + j] = rest / l[j * n + j];
                }
            }
            let dot: f64 = (0..i).map(|k| l[i * n + k] * y[k]).sum();
            y[i] = (y[i] - dot) / l[i * n + i];
        }
        for i in (0..n).rev() {
            let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * y[k]).sum();
            y[i] = (y[i] - dot) / l[i * n + i];
        }
        Some(y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;
    use proptest::prelude::*;

    fn cost(gram: &Mat<f64>, h: &[f64], x: &[f64]) -> f64 {
        let n = h.len();
        let quadratic: f64 = (0..n).map(|i| (0..n).map(|j| x[i] * gram[(i, j)] * x[j]).sum::<f64>()).sum();
        quadratic - 2.0 * h.iter().zip(x).map(|(a, b)| a * b).sum::<f64>()
    }

    /// Returns the smallest cost over all supports.
    ///
    /// The cost of a support is its unconstrained optimum, if that is not negative.
    fn brute_force(gram: &Mat<f64>, h: &[f64]) -> f64 {
        let n = h.len();
        let mut best = 0.0_f64;
        for mask in 1_u32..1 << n {
            let passive: Vec<usize> = (0..n).filter(|k| mask >> k & 1 == 1).collect();
            let rhs: Vec<f64> = passive.iter().map(|&p| h[p]).collect();
            let set = ActiveSet { gram: gram.as_ref(), h, x: vec![0.0; n], passive };
            if let Some(y) = set.solve(&rhs).filter(|y| y.iter().all(|v| *v >= 0.0)) {
                let mut x = vec![0.0; n];
                set.passive.iter().zip(y).for_each(|(&p, v)| x[p] = v);
                best = best.min(cost(gram, h, &x));
            }
        }
        best
    }

    fn check_kkt(gram: &Mat<f64>, h: &[f64], x: &[f64]) {
        let scale = h.iter().fold(1e-300_f64, |m, v| m.max(v.abs()));
        for k in 0..h.len() {
            let gradient: f64 = (0..h.len()).map(|j| gram[(k, j)] * x[j]).sum::<f64>() - h[k];
            assert!(x[k] >= 0.0, "x[{k}] = {}", x[k]);
            assert!(gradient >= -1e-9 * scale, "gradient[{k}] = {gradient}");
            assert!(x[k] == 0.0 || gradient.abs() <= 1e-8 * scale, "slackness {k}: {} {gradient}", x[k]);
        }
    }

    fn problem(rows: usize, n: usize, entries: &[f64], penalty: &[f64]) -> (Mat<f64>, Vec<f64>) {
        let a = Mat::from_fn(rows, n, |i, j| entries[i * n + j]);
        let b = &entries[rows * n..];
        let h = (0..n).map(|k| (0..rows).map(|i| a[(i, k)] * b[i]).sum::<f64>() - penalty[k]).collect();
        (a.transpose() * &a, h)
    }

    proptest! {
        #[test]
        fn small_problems_match_brute_force(
            entries in prop::collection::vec(-1.0..1.0_f64, 8 * 6 + 8),
            penalty in prop::collection::vec(0.0..0.5_f64, 6),
        ) {
            let (gram, h) = problem(8, 6, &entries, &penalty);
            let x = nnls(gram.as_ref(), &h).unwrap();
            check_kkt(&gram, &h, &x);
            let (got, want) = (cost(&gram, &h, &x), brute_force(&gram, &h));
            prop_assert!((got - want).abs() <= 1e-10 * (1.0 + want.abs()), "{got} {want}");
        }

        #[test]
        fn solves_problems_with_dependent_columns(
            entries in prop::collection::vec(-1.0..1.0_f64, 3 * 6 + 3),
            penalty in prop::collection::vec(0.0..0.5_f64, 6),
        ) {
            let (gram, h) = problem(3, 6, &entries, &penalty);
            let x = nnls(gram.as_ref(), &h).unwrap();
            for k in 0..6 {
                let gradient: f64 = (0..6).map(|j| gram[(k, j)] * x[j]).sum::<f64>() - h[k];
                prop_assert!(x[k] >= 0.0 && gradient > -1e-6 && (x[k] * gradient).abs() < 1e-6 * (1.0 + x[k]));
            }
        }

        #[test]
        fn solves_problems_with_twenty_correlated_columns(entries in prop::collection::vec(0.0..1.0_f64, 30 * 20 + 30)) {
            let (gram, h) = problem(30, 20, &entries, &[0.0; 20]);
            check_kkt(&gram, &h, &nnls(gram.as_ref(), &h).unwrap());
        }
    }

    #[test]
    fn interior_optimum_is_the_linear_solution() {
        let gram = Mat::from_fn(2, 2, |i, j| if i == j { 2.0 } else { 1.0 });
        let x = nnls(gram.as_ref(), &[4.0, 5.0]).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-14 && (x[1] - 2.0).abs() < 1e-14, "{x:?}");
    }

    #[test]
    fn repeated_column_is_used_once() {
        let gram = Mat::from_fn(2, 2, |_, _| 2.0);
        let x = nnls(gram.as_ref(), &[3.0, 3.0]).unwrap();
        assert!((x[0] + x[1] - 1.5).abs() < 1e-14, "{x:?}");
    }

    #[test]
    fn rejects_invalid_input() {
        let gram = Mat::<f64>::zeros(2, 2);
        assert_eq!(nnls(gram.as_ref(), &[0.0]), Err(NnlsError::Shape { rows: 2, columns: 2, len: 1 }));
        assert_eq!(nnls(gram.as_ref(), &[0.0, f64::NAN]), Err(NnlsError::NotFinite));
        assert_eq!(nnls(gram.as_ref(), &[0.0, 1.0]), Err(NnlsError::Unbounded(1)));
        assert_eq!(nnls(gram.as_ref(), &[0.0, -1.0]), Ok(vec![0.0, 0.0]));
        assert_eq!(nnls(Mat::<f64>::zeros(0, 0).as_ref(), &[]), Ok(vec![]));
    }
}
