//! Mean of a Gaussian truncated to `x >= 0`, by expectation propagation.

use faer::Mat;
use gonio_linalg::{Cholesky, squared_norms};

use crate::lighting::RectifiedGaussian;

/// Gaussians `exp(-t x^2 / 2 + s x)` that replace the n bounds.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sites {
    /// `t` (n), not negative.
    precisions: Vec<f64>,
    /// `s` (n).
    shifts: Vec<f64>,
}

impl Sites {
    /// Returns the initial sites for a Gaussian of precision `h` (n x n) and mean `mean` (n).
    ///
    /// Sites of positive means are empty; the others pull to zero with the precision that `h`
    /// assigns to the value.
    pub(super) fn of_mean(h: &Mat<f64>, mean: &[f64]) -> Self {
        let pull = |(i, x): (usize, &f64)| if *x > 0.0 { 0.0 } else { h[(i, i)] };
        Self { precisions: mean.iter().enumerate().map(pull).collect(), shifts: vec![0.0; mean.len()] }
    }
}

/// Moments of the truncated Gaussian, and the state of the iteration.
pub(super) struct Truncated {
    /// Means (n), positive.
    pub(super) mean: Vec<f64>,
    /// `R` (n x n) with `R'R` the covariance.
    pub(super) root: Mat<f64>,
    /// Norm of the change of the means in the last step, relative to their norm.
    pub(super) change: f64,
    /// Number of steps made.
    pub(super) steps: usize,
}

/// Initial damping: the share of the distance to its new value by which every site moves.
/// Simultaneous full steps of all sites would overshoot.
const DAMPING: f64 = 0.7;

/// Smallest damping.
const MIN_DAMPING: f64 = 0.2;

/// Approximates `exp(-x'Hx / 2 + c'x)` on `x >= 0` by a Gaussian.
///
/// The method is expectation propagation of all sites at once (Minka 2001, "Expectation propagation
/// for approximate Bayesian inference", UAI). Cunningham, Hennig and Lacoste-Julien (2011,
/// arXiv:1111.6832) apply it to truncated Gaussians. Each mean and variance is that of the Gaussian
/// with the exact bound in place of its site. Each step takes one factorisation and its inverse.
/// The iteration ends when the means change by no more than `tolerance` of their norm, or after
/// `max_steps`, at least one; `sites` holds the last state.
///
/// Returns `None` if `h` (n x n, symmetric) is not finite and positive definite.
pub(super) fn truncated(
    h: &Mat<f64>,
    c: &[f64],
    sites: &mut Sites,
    tolerance: f64,
    max_steps: usize,
) -> Option<Truncated> {
    let n = c.len();
    assert!(h.nrows() == n && h.ncols() == n && sites.shifts.len() == n);
    let mut damping = DAMPING;
    let mut last = f64::INFINITY;
    let mut before: Option<Vec<f64>> = None;
    let mut steps = 0;
    loop {
        let factor = Cholesky::of_sum(h, &sites.precisions)?;
        let root = factor.inverse_of_lower();
        let variances: Vec<f64> = squared_norms(root.as_ref());
        let right: Vec<f64> = c.iter().zip(&sites.shifts).map(|(c, s)| c + s).collect();
        let joint = factor.solve(&right);
        let mut mean = Vec::with_capacity(n);
        for (i, (joint, variance)) in joint.iter().zip(&variances).enumerate() {
            // Cavity: all but the site itself. Its precision is positive except for round-off,
            // where the site alone determines the value.
            let precision = (1.0 / variance - sites.precisions[i]).max(1e-12 / variance);
            let shift = joint / variance - sites.shifts[i];
            let cavity = RectifiedGaussian { location: shift / precision, variance: 1.0 / precision, threshold: 0.0 };
            let moments = cavity.moments();
            mean.push(moments.mean);
            // A bound can only narrow a distribution.
            let narrower = (1.0 / moments.variance - precision).max(0.0);
            sites.precisions[i] += damping * (narrower - sites.precisions[i]);
            sites.shifts[i] += damping * (moments.mean / moments.variance - shift - sites.shifts[i]);
        }
        steps += 1;
        let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
        let moved = before.map(|before| norm(&mut mean.iter().zip(&before).map(|(a, b)| a - b)));
        let change = moved.map_or(f64::INFINITY, |moved| moved / norm(&mut mean.iter().copied()));
        if !mean.iter().all(|m| m.is_finite()) {
            return None;
        }
        if change <= tolerance || steps >= max_steps {
            return Some(Truncated { mean, root, change, steps });
        }
        if change > last {
            damping = (0.7 * damping).max(MIN_DAMPING);
        }
        last = change;
        before = Some(mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_of(h: &Mat<f64>, c: &[f64]) -> Truncated {
        let unbounded = Cholesky::new(h.clone()).unwrap().solve(c);
        truncated(h, c, &mut Sites::of_mean(h, &unbounded), 1e-9, 200).unwrap()
    }

    #[test]
    fn independent_values_are_exact() {
        let h = Mat::from_fn(3, 3, |i, j| if i == j { [1.0, 4.0, 100.0][i] } else { 0.0 });
        let c = [0.3, -8.0, 500.0];
        let got = mean_of(&h, &c);
        assert!(got.change <= 1e-9);
        for i in 0..3 {
            let exact = RectifiedGaussian { location: c[i] / h[(i, i)], variance: 1.0 / h[(i, i)], threshold: 0.0 };
            assert!((got.mean[i] / exact.moments().mean - 1.0).abs() < 1e-8, "{i}: {}", got.mean[i]);
        }
    }

    /// Compares with sums over a fine grid, for correlations of both signs and means on both sides
    /// of the bounds.
    #[test]
    fn two_dependent_values_are_accurate() {
        for (correlation, c) in [(0.8, [0.5, -1.0]), (-0.8, [1.0, 0.3]), (0.5, [-2.0, -2.0]), (-0.9, [-1.0, 2.0])] {
            let h = Mat::from_fn(2, 2, |i, j| if i == j { 1.0 } else { correlation });
            let (mut mass, mut first) = (0.0, [0.0; 2]);
            for i in 0..1500 {
                for j in 0..1500 {
                    let x = [i, j].map(|k| (f64::from(k) + 0.5) * 0.02);
                    let q = 0.5 * (x[0] * x[0] + x[1] * x[1]) + correlation * x[0] * x[1] - c[0] * x[0] - c[1] * x[1];
                    let p = (-q).exp();
                    mass += p;
                    first = [first[0] + p * x[0], first[1] + p * x[1]];
                }
            }
            let got = mean_of(&h, &c);
            for (got, first) in got.mean.iter().zip(first) {
                let want = first / mass;
                assert!((got / want - 1.0).abs() < 0.05, "{correlation} {c:?}: {got} {want}");
            }
        }
    }
}
