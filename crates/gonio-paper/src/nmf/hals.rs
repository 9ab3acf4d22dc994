//! Hierarchical alternating least squares for one start.

use faer::{Accum, Mat, MatRef};
use gonio_linalg::{dispatch, multiply, product};

use super::{NmfSettings, StartReport};

/// Factors `X ~ w v'`: `w` is cells x rank, `v` samples x rank.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    pub(super) w: Mat<f64>,
    pub(super) v: Mat<f64>,
}

/// Number of rows that one pass of [`sweep`] keeps in the first-level cache.
const BLOCK: usize = 128;
/// Number of iterations over which the decrease of the cost is averaged.
///
/// Single steps of an extrapolated iteration vary strongly.
const WINDOW: usize = 10;
/// Number of rounds of column updates of the functions per product with `X`.
const FUNCTION_SWEEPS: usize = 3;
/// Number of rounds of column updates of the coefficients per product with `X`.
const COEFFICIENT_SWEEPS: usize = 10;

/// Returns the sum of the products of the entries of two matrices of equal shape.
pub(super) fn dot(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    (0..a.ncols()).map(|k| a.col_as_slice(k).iter().zip(b.col_as_slice(k)).map(|(x, y)| x * y).sum::<f64>()).sum()
}

/// Minimises `|X - u f'|^2` exactly over each column of `u >= 0` in turn, in `times` rounds.
///
/// `target` is `X f` and `gram` is `f'f`. Column `k` of `u` becomes
/// `max(0, u_k + (target_k - u gram_k) / gram_kk)`. A column whose partner is zero does not affect
/// the cost and becomes zero.
pub(super) fn sweep(u: &mut Mat<f64>, target: &Mat<f64>, gram: &Mat<f64>, times: usize) {
    // Compiled for the available vector units. Without sums across lanes, the result does not
    // depend on their width.
    dispatch(|| sweep_lanes(u, target, gram, times));
}

#[inline(always)]
fn sweep_lanes(u: &mut Mat<f64>, target: &Mat<f64>, gram: &Mat<f64>, times: usize) {
    let (rows, rank) = (u.nrows(), u.ncols());
    let mut step = [0.0; BLOCK];
    for start in (0..rows).step_by(BLOCK) {
        let range = start..rows.min(start + BLOCK);
        let step = &mut step[..range.len()];
        for _ in 0..times {
            for k in 0..rank {
                let diagonal = gram[(k, k)];
                if diagonal <= 0.0 {
                    u.col_as_slice_mut(k)[range.clone()].fill(0.0);
                    continue;
                }
                step.copy_from_slice(&target.col_as_slice(k)[range.clone()]);
                for l in 0..rank {
                    let g = gram[(l, k)];
                    for (s, u) in step.iter_mut().zip(&u.col_as_slice(l)[range.clone()]) {
                        *s -= g * u;
                    }
                }
                let scale = 1.0 / diagonal;
                for (u, s) in u.col_as_slice_mut(k)[range.clone()].iter_mut().zip(&*step) {
                    *u = (*u + s * scale).max(0.0);
                }
            }
        }
    }
}

/// Computes `max(0, new + beta (new - old))`.
fn extrapolate(new: &Mat<f64>, old: &Mat<f64>, beta: f64) -> Mat<f64> {
    if beta == 0.0 {
        return new.clone();
    }
    let mut out = new.clone();
    for k in 0..out.ncols() {
        for (out, old) in out.col_as_slice_mut(k).iter_mut().zip(old.col_as_slice(k)) {
            *out = (*out + beta * (*out - old)).max(0.0);
        }
    }
    out
}

/// Extrapolation of the iterates, adapted to success and failure (Ang & Gillis 2019, algorithm 2).
struct Momentum {
    beta: f64,
    ceiling: f64,
    previous: f64,
}

impl Momentum {
    const START: f64 = 0.5;
    const GROWTH: f64 = 1.01;
    const CEILING_GROWTH: f64 = 1.005;
    const SHRINK: f64 = 1.5;

    fn new(on: bool) -> Self {
        let beta = if on { Self::START } else { 0.0 };
        Self { beta, ceiling: 1.0, previous: beta }
    }

    fn succeeded(&mut self) {
        self.previous = self.beta;
        self.ceiling = (self.ceiling * Self::CEILING_GROWTH).min(1.0);
        self.beta = (self.beta * Self::GROWTH).min(self.ceiling);
    }

    fn failed(&mut self) {
        self.ceiling = self.previous;
        self.beta /= Self::SHRINK;
    }
}

/// Replaces components that are zero by the positive part of the worst residual.
///
/// Their coefficients start at zero, so that the cost does not change until the next update lowers
/// it. Returns whether any component was zero.
fn revive(x: MatRef<'_, f64>, pair: &mut Pair) -> bool {
    let zero = |m: &Mat<f64>, k: usize| m.col_as_slice(k).iter().all(|v| *v == 0.0);
    let dead: Vec<usize> = (0..pair.w.ncols()).filter(|&k| zero(&pair.w, k) || zero(&pair.v, k)).collect();
    if dead.is_empty() {
        return false;
    }
    let mut residual = x.to_owned();
    for &k in &dead {
        pair.v.col_as_slice_mut(k).fill(0.0);
    }
    multiply(residual.as_mut(), Accum::Add, pair.w.as_ref(), pair.v.transpose(), -1.0);
    let mut size: Vec<(f64, usize)> =
        (0..x.ncols()).map(|j| (residual.col_as_slice(j).iter().map(|r| r.max(0.0).powi(2)).sum::<f64>(), j)).collect();
    size.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    for (&k, (_, j)) in dead.iter().zip(size) {
        for (w, r) in pair.w.col_as_slice_mut(k).iter_mut().zip(residual.col_as_slice(j)) {
            *w = r.max(0.0);
        }
    }
    true
}

/// Computes `|X - w v'|^2` by direct summation.
pub(super) fn cost(x: MatRef<'_, f64>, pair: &Pair) -> f64 {
    let mut residual = x.to_owned();
    multiply(residual.as_mut(), Accum::Add, pair.w.as_ref(), pair.v.transpose(), -1.0);
    residual.squared_norm_l2()
}

/// Runs HALS from `start` until the cost stops decreasing.
///
/// The cost of the kept factors never increases, with or without extrapolation.
pub(super) fn descend(x: MatRef<'_, f64>, start: Pair, settings: &NmfSettings) -> (Pair, StartReport) {
    let norm = x.squared_norm_l2();
    let mut kept = start;
    let (mut w_trial, mut v_trial) = (kept.w.clone(), kept.v.clone());
    let mut v_before = kept.v.clone();
    let mut momentum = Momentum::new(settings.extrapolate);
    let mut last = f64::INFINITY;
    let mut trace = Vec::new();
    let mut converged = false;
    while !converged && trace.len() < settings.max_iterations {
        if revive(x, &mut kept) {
            (w_trial, v_trial, v_before) = (kept.w.clone(), kept.v.clone(), kept.v.clone());
        }
        let target = product(x.transpose(), w_trial.as_ref());
        let gram = product(w_trial.transpose(), w_trial.as_ref());
        sweep(&mut v_trial, &target, &gram, COEFFICIENT_SWEEPS);
        let v_new = v_trial;
        v_trial = extrapolate(&v_new, &v_before, momentum.beta);

        let target = product(x, v_trial.as_ref());
        let gram = product(v_trial.transpose(), v_trial.as_ref());
        sweep(&mut w_trial, &target, &gram, FUNCTION_SWEEPS);
        // |X - w v'|^2 = |X|^2 - 2 <X v, w> + <w'w, v'v>, accurate to round-off of |X|^2.
        let own = product(w_trial.transpose(), w_trial.as_ref());
        let now = norm - 2.0 * dot(&target, &w_trial) + dot(&own, &gram);
        let slack = 1e-14 * norm;
        if now > last + slack && momentum.beta > 0.0 {
            (w_trial, v_trial, v_before) = (kept.w.clone(), kept.v.clone(), kept.v.clone());
            momentum.failed();
            trace.push(last);
        } else {
            let w_next = extrapolate(&w_trial, &kept.w, momentum.beta);
            kept.w = std::mem::replace(&mut w_trial, w_next);
            kept.v.clone_from(&v_trial);
            v_before = v_new;
            momentum.succeeded();
            last = now;
            trace.push(now);
        }
        let n = trace.len();
        let stalled = n > WINDOW && trace[n - 1 - WINDOW] - last <= WINDOW as f64 * settings.tolerance * last;
        converged = stalled || last <= slack;
    }
    let report = StartReport { cost: cost(x, &kept), iterations: trace.len(), converged, trace };
    (kept, report)
}
