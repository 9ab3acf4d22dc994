//! Algorithm 1 as printed in the paper: parallel updates of all parameters and a line search.

use super::variational::{Run, VariationalSettings};
use super::{Expectations, Problem, VariationalParameters};

/// Runs the two nested loops of Algorithm 1.
pub(super) fn run(
    problem: &Problem<'_>,
    mut ensemble: VariationalParameters,
    settings: &VariationalSettings,
    progress: &dyn Fn(f64),
) -> Run {
    let mut now = Expectations::new(problem, &ensemble);
    let mut trace = vec![now.cost(problem)];
    // The last step of the line search.
    let mut alpha = 1.0;
    loop {
        // Minimises at the present noise level.
        loop {
            if trace.len() > settings.max_iterations {
                return Run { ensemble, trace, converged: false };
            }
            let before = trace[trace.len() - 1];
            (ensemble, alpha) = line_search(problem, &ensemble, &now, before, alpha);
            now = now.after(problem, &ensemble);
            trace.push(now.cost(problem));
            progress(trace.len() as f64 / (settings.max_iterations + 1) as f64);
            if (before - trace[trace.len() - 1]).abs() < settings.tolerance {
                break;
            }
        }
        // The noise is lowered only when all else has converged, by the last step of the line
        // search.
        let best = now.sums.best_log_noise(problem, &now.moments.g);
        let change = alpha * (best - ensemble.log_noise());
        ensemble.set_log_noise(ensemble.log_noise() + change);
        now = now.after(problem, &ensemble);
        trace.push(now.cost(problem));
        if change.abs() < settings.tolerance {
            return Run { ensemble, trace, converged: true };
        }
    }
}

/// Searches for `alpha* = argmin C_KL(Phi + alpha dPhi)`, beginning with the step of the last
/// search. Returns the new ensemble and `alpha*`: zero if no step along the update lowers the cost.
///
/// In the paper's variables `(u/w, log 1/w)`, the parallel update is not always a direction of
/// descent. Immediately after the noise is lowered, all precisions grow by a large factor, and the
/// search stalls.
fn line_search(
    problem: &Problem<'_>,
    ensemble: &VariationalParameters,
    now: &Expectations,
    cost: f64,
    last: f64,
) -> (VariationalParameters, f64) {
    let mut target = now.update(problem, ensemble);
    target.set_log_noise(ensemble.log_noise());
    let update = target.minus(ensemble);
    let cost_at = |alpha: f64| {
        let cost = Expectations::new(problem, &ensemble.moved(alpha, &update)).cost(problem);
        if cost.is_finite() { cost } else { f64::INFINITY }
    };
    let alpha = search(if last > 0.0 { last } else { 1.0 }, 64.0, cost, cost_at).unwrap_or(0.0);
    (ensemble.moved(alpha, &update), alpha)
}

/// Returns the minimiser of `at` near `start`, at most about `limit`.
///
/// `cost` is the value at zero. Returns `None` if no step down to a ten-thousandth of `start`
/// lowers it.
pub(super) fn search(start: f64, limit: f64, cost: f64, at: impl Fn(f64) -> f64) -> Option<f64> {
    let mut middle = (start, at(start));
    let mut right = None;
    while middle.1 >= cost {
        right = Some(middle);
        if middle.0 < 1e-4 * start {
            return None;
        }
        let alpha = 0.3 * middle.0;
        middle = (alpha, at(alpha));
    }
    let mut left = (0.0, cost);
    // If the first step lowered the cost, grows the bracket while the cost falls.
    let mut right = match right {
        Some(right) => right,
        None => loop {
            if 2.0 * middle.0 > limit {
                return Some(middle.0);
            }
            let next = (2.0 * middle.0, at(2.0 * middle.0));
            if next.1 >= middle.1 {
                break next;
            }
            (left, middle) = (middle, next);
        },
    };
    for _ in 0..2 {
        let alpha = vertex(left, middle, right);
        if !(left.0 < alpha && alpha < right.0) || (alpha - middle.0).abs() < 0.02 * middle.0 {
            break;
        }
        let next = (alpha, at(alpha));
        let (low, high) = if alpha < middle.0 { (next, middle) } else { (middle, next) };
        if low.1 <= high.1 {
            (middle, right) = (low, high);
        } else {
            (left, middle) = (low, high);
        }
    }
    Some(middle.0)
}

/// Abscissa of the extremum of the parabola through three points; NaN when they lie on a line.
fn vertex(a: (f64, f64), b: (f64, f64), c: (f64, f64)) -> f64 {
    let (p, q) = ((b.0 - a.0) * (b.1 - c.1), (b.0 - c.0) * (b.1 - a.1));
    b.0 - 0.5 * ((b.0 - a.0) * p - (b.0 - c.0) * q) / (p - q)
}
