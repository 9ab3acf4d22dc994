//! Anderson acceleration of a fixed-point iteration (Anderson 1965; type II in Walker and Ni 2011).

use std::collections::VecDeque;

use nalgebra::{DMatrix, DVector};

use crate::transfer::kernels::dot;

/// Steps that are combined.
const MEMORY: usize = 8;
/// Ridge of the least squares, relative to the largest squared difference of residuals.
const RIDGE: f64 = 1e-12;

/// Differences of the last steps of an iteration `x -> G(x)`.
pub(super) struct Anderson {
    /// `G(x)` and the residual `G(x) - x` of the last step.
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// Changes of `G(x)` and of the residual from step to step.
    changes: VecDeque<(Vec<f64>, Vec<f64>)>,
}

impl Anderson {
    pub(super) fn new() -> Self {
        Self { last: None, changes: VecDeque::new() }
    }

    /// Takes in the step from `before` to `after = G(before)`. Returns the combination of the
    /// remembered `G(x)` whose combined residual is least in the norm `sum metric r^2`; `None`
    /// before there are two steps.
    pub(super) fn next(&mut self, before: &[f64], after: &[f64], metric: &[f64]) -> Option<Vec<f64>> {
        let residual: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
        if let Some((image, old)) = self.last.replace((after.to_vec(), residual.clone())) {
            let minus = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x - y).collect();
            self.changes.push_back((minus(after, &image), minus(&residual, &old)));
            if self.changes.len() > MEMORY {
                self.changes.pop_front();
            }
        }
        let n = self.changes.len();
        if n == 0 {
            return None;
        }
        let weighted: Vec<Vec<f64>> =
            self.changes.iter().map(|(_, r)| r.iter().zip(metric).map(|(r, w)| r * w).collect()).collect();
        let mut gram = DMatrix::from_fn(n, n, |i, j| dot(&weighted[i], &self.changes[j].1));
        let ridge = RIDGE * gram.diagonal().max();
        (0..n).for_each(|i| gram[(i, i)] += ridge);
        let right = DVector::from_fn(n, |i, _| dot(&weighted[i], &residual));
        let shares = gram.cholesky()?.solve(&right);
        let mut next = after.to_vec();
        for ((image, _), share) in self.changes.iter().zip(shares.iter()) {
            next.iter_mut().zip(image).for_each(|(x, d)| *x -= share * d);
        }
        next.iter().all(|x| x.is_finite()).then_some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear iteration of dimension n is solved in about n steps (it is GMRES), however slowly
    /// it converges alone.
    #[test]
    fn a_linear_iteration_is_solved_in_as_many_steps_as_it_has_dimensions() {
        let rates = [0.999, 0.99, 0.9, 0.5, -0.3];
        let target = [1.0, -2.0, 3.0, 0.5, 4.0];
        let step = |x: &[f64]| -> Vec<f64> { (0..5).map(|i| target[i] + rates[i] * (x[i] - target[i])).collect() };
        let mut anderson = Anderson::new();
        let mut x = vec![0.0; 5];
        for _ in 0..12 {
            let after = step(&x);
            x = anderson.next(&x, &after, &[1.0, 2.0, 0.5, 1.0, 3.0]).unwrap_or(after);
        }
        for (x, t) in x.iter().zip(target) {
            assert!((x - t).abs() < 1e-5, "{x} against {t}");
        }
    }

    #[test]
    fn a_settled_iteration_stays_where_it_is() {
        let mut anderson = Anderson::new();
        let x = [1.0, 2.0];
        assert!(anderson.next(&x, &x, &[1.0; 2]).is_none());
        // No difference at all: no combination, or the point itself.
        assert!(anderson.next(&x, &x, &[1.0; 2]).is_none_or(|y| y == x));
    }
}
