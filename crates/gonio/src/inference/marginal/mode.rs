//! The mode of a Gaussian among `x >= 0`: a convex quadratic program with bounds, by an interior
//! point method.

use faer::Mat;

use super::dense::{Cholesky, times};
use crate::transfer::kernels::dot;

/// Where the search ended.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mode {
    /// The point (n), all values positive.
    pub(super) x: Vec<f64>,
    /// `x'z` at the start and after every step; with dual feasibility, how far `q(x)` can be above
    /// its minimum.
    pub(super) gaps: Vec<f64>,
    /// Whether the gap fell below the tolerance.
    pub(super) converged: bool,
}

/// How far towards the nearest bound a step goes at most.
const SHORT: f64 = 0.995;

/// The dual residual counts as none at this share of the gradient's terms.
const FEASIBLE: f64 = 1e-9;

/// Minimises `q(x) = x'Hx / 2 - c'x` over `x >= 0` for a symmetric positive definite `h` (n x n),
/// from `start` (n), until the duality gap is no more than `tolerance` (in units of `q`) or for
/// `max_steps`.
///
/// Each step is one factorisation of `H + diag(z / x)`, solved for the predictor and the corrector
/// of Mehrotra (1992, "On the implementation of a primal-dual interior point method", SIAM J.
/// Optim. 2), `z` the multipliers of the bounds. Unlike those of active sets their number hardly
/// depends on the problem.
///
/// `None` if `h` is not finite and positive definite.
pub(super) fn mode(h: &Mat<f64>, c: &[f64], start: &[f64], tolerance: f64, max_steps: usize) -> Option<Mode> {
    let n = c.len();
    assert!(h.nrows() == n && h.ncols() == n && start.len() == n);
    let floor = 0.1 * start.iter().map(|x| x.abs()).sum::<f64>() / n as f64;
    let mut x: Vec<f64> = start.iter().map(|x| x.max(floor.max(f64::MIN_POSITIVE))).collect();
    let mut product = times(h, &x);
    // As large as what pulls up, so that texels far from their place do not start at a bound of the
    // multipliers.
    let typical = product.iter().zip(c).map(|(p, c)| (p - c).abs()).sum::<f64>() / n as f64;
    let mut z: Vec<f64> = product.iter().zip(c).map(|(p, c)| (p - c).max(typical.max(f64::MIN_POSITIVE))).collect();
    let mut gaps = vec![dot(&x, &z)];
    let mut converged = false;
    while gaps.len() <= max_steps && !converged {
        let gap = dot(&x, &z);
        let dual: Vec<f64> = (0..n).map(|i| product[i] - c[i] - z[i]).collect();
        let stiff: Vec<f64> = z.iter().zip(&x).map(|(z, x)| z / x).collect();
        let factor = Cholesky::of_sum(h, &stiff)?;
        // Towards x_i z_i = aim_i.
        let towards = |aim: &dyn Fn(usize) -> f64| -> (Vec<f64>, Vec<f64>) {
            let right: Vec<f64> = (0..n).map(|i| aim(i) / x[i] - z[i] - dual[i]).collect();
            let dx = factor.solve(&right);
            let dz = (0..n).map(|i| (aim(i) - z[i] * dx[i]) / x[i] - z[i]).collect();
            (dx, dz)
        };
        let longest = |values: &[f64], change: &[f64]| {
            let steps = values.iter().zip(change).filter(|(_, d)| **d < 0.0).map(|(v, d)| -v / d);
            steps.fold(f64::INFINITY, f64::min)
        };
        let (dx, dz) = towards(&|_| 0.0);
        let step = longest(&x, &dx).min(longest(&z, &dz)).min(1.0);
        let left: f64 = (0..n).map(|i| (x[i] + step * dx[i]) * (z[i] + step * dz[i])).sum();
        let centre = (left / gap).powi(3) * gap / n as f64;
        let (dx, dz) = towards(&|i| centre - dx[i] * dz[i]);
        let step = (SHORT * longest(&x, &dx).min(longest(&z, &dz))).min(1.0);
        if !step.is_finite() || step <= 0.0 {
            break;
        }
        for i in 0..n {
            x[i] += step * dx[i];
            z[i] += step * dz[i];
        }
        product = times(h, &x);
        let off = (0..n).map(|i| (product[i] - c[i] - z[i]).abs()).fold(0.0, f64::max);
        let scale = product.iter().chain(c).map(|g| g.abs()).fold(0.0, f64::max);
        gaps.push(dot(&x, &z));
        converged = gaps[gaps.len() - 1] <= tolerance && off <= FEASIBLE * scale;
    }
    x.iter().all(|x| x.is_finite()).then_some(Mode { x, gaps, converged })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::marginal::tests::random;

    /// `A'A` of a random matrix with a small diagonal, and a vector.
    fn quadratic(n: usize, seed: u64) -> (Mat<f64>, Vec<f64>) {
        let a = random((n + 1) * n, seed);
        let h = Mat::from_fn(n, n, |i, j| {
            let sum: f64 = (0..=n).map(|k| a[k * n + i] * a[k * n + j]).sum();
            sum + if i == j { 0.01 } else { 0.0 }
        });
        (h, random(n, seed + 100))
    }

    /// The minimum of the quadratic with each set of values held at zero, and of those that are
    /// feasible the least.
    fn by_enumeration(h: &Mat<f64>, c: &[f64]) -> Vec<f64> {
        let n = c.len();
        let value = |x: &[f64]| -> f64 { times(h, x).iter().zip(c).zip(x).map(|((p, c), x)| x * (0.5 * p - c)).sum() };
        let mut best = vec![0.0; n];
        for set in 1_usize..1 << n {
            let free: Vec<usize> = (0..n).filter(|i| set >> i & 1 == 1).collect();
            let part = Mat::from_fn(free.len(), free.len(), |i, j| h[(free[i], free[j])]);
            let right: Vec<f64> = free.iter().map(|&i| c[i]).collect();
            let mut x = vec![0.0; n];
            free.iter().zip(Cholesky::new(part).unwrap().solve(&right)).for_each(|(&i, value)| x[i] = value);
            if x.iter().all(|x| *x >= 0.0) && value(&x) < value(&best) {
                best = x;
            }
        }
        best
    }

    #[test]
    fn it_is_the_best_of_all_active_sets() {
        for seed in 0..20 {
            let (h, c) = quadratic(9, seed);
            let want = by_enumeration(&h, &c);
            let got = mode(&h, &c, &[1.0; 9], 1e-12, 60).unwrap();
            assert!(got.converged, "{seed}: {:?}", got.gaps);
            let top = want.iter().copied().fold(1e-3, f64::max);
            for (got, want) in got.x.iter().zip(&want) {
                assert!((got - want).abs() < 1e-4 * top, "{seed}: {got} {want}");
            }
        }
    }

    /// Karush, Kuhn and Tucker: no gradient below zero, none where there is a value. The gap, which
    /// bounds the error, falls at every step.
    #[test]
    fn the_gradient_vanishes_or_pushes_against_the_bound() {
        let n = 120;
        let (h, c) = quadratic(n, 3);
        let got = mode(&h, &c, &vec![0.1; n], 1e-10, 60).unwrap();
        assert!(got.converged && got.gaps.windows(2).all(|pair| pair[1] < pair[0]), "{:?}", got.gaps);
        let gradient: Vec<f64> = times(&h, &got.x).iter().zip(&c).map(|(p, c)| p - c).collect();
        let lit = got.x.iter().filter(|x| **x > 1e-4).count();
        assert!((10..110).contains(&lit), "{lit}");
        for (x, g) in got.x.iter().zip(&gradient) {
            assert!(*x > 0.0 && *g > -1e-6 && x.min(g.abs()) < 1e-4, "{x} {g}");
        }
    }

    #[test]
    fn what_is_not_finite_has_no_mode() {
        let h = Mat::from_fn(2, 2, |_, _| f64::NAN);
        assert!(mode(&h, &[1.0; 2], &[1.0; 2], 1e-6, 10).is_none());
    }
}
