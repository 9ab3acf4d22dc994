//! Algorithm 1 as printed in the paper: parallel updates of all parameters and a line search.

use super::component_switch::switch_components_jointly;
use super::variational::{Run, SETTLED, Solver, VariationalSettings};
use super::{Expectations, Problem, VariationalParameters};

/// Share of the last search direction that the next one of [`Solver::Parallel`] keeps, as in the
/// code that the paper builds on.
const MOMENTUM: f64 = 0.9;

/// Runs the two nested loops of Algorithm 1, exactly as printed for [`Solver::Printed`].
pub(super) fn run(
    problem: &Problem<'_>,
    ensemble: VariationalParameters,
    settings: &VariationalSettings,
    progress: &dyn Fn(f64),
) -> Run {
    let printed = settings.solver == Solver::Printed;
    let now = Expectations::new(problem, &ensemble);
    let mut state = State { cost: now.cost(problem), ensemble, now };
    let mut trace = vec![state.cost];
    let mut search = LineSearch { alpha: 1.0, printed, last: Vec::new() };
    if !printed {
        state = state.with_switched_components(problem);
    }
    let mut converged = false;
    'noise: loop {
        // Minimises at the present noise level.
        let mut settled = 0;
        loop {
            if trace.len() > settings.max_iterations {
                break 'noise;
            }
            let before = state.cost;
            let next = search.step(problem, &state.ensemble, &state.now, before);
            state = state.at(problem, next);
            trace.push(state.cost);
            progress(trace.len() as f64 / (settings.max_iterations + 1) as f64);
            settled = if (before - state.cost).abs() < settings.tolerance { settled + 1 } else { 0 };
            if printed && settled > 0 {
                break;
            }
            if settled >= SETTLED {
                let before = state.cost;
                state = state.with_switched_components(problem);
                if before - state.cost < settings.tolerance {
                    break;
                }
                settled = 0;
                search.last.clear();
            }
        }
        // The noise is lowered only when all else has converged, by the last step of the line
        // search.
        let share = if printed { search.alpha } else { search.alpha.clamp(0.1, 1.0) };
        let best = state.now.sums.best_log_noise(problem, &state.now.moments.g);
        let change = share * (best - state.ensemble.log_noise());
        let mut next = state.ensemble.clone();
        next.set_log_noise(next.log_noise() + change);
        state = state.at(problem, next);
        trace.push(state.cost);
        if change.abs() < settings.tolerance {
            converged = true;
            break;
        }
    }
    Run { ensemble: state.ensemble, trace, converged }
}

/// Ensemble with its expectations and its cost.
struct State {
    ensemble: VariationalParameters,
    now: Expectations,
    cost: f64,
}

impl State {
    fn at(self, problem: &Problem<'_>, ensemble: VariationalParameters) -> Self {
        let now = self.now.after(problem, &ensemble);
        Self { cost: now.cost(problem), ensemble, now }
    }

    /// State with every light coefficient in its best component.
    fn with_switched_components(self, problem: &Problem<'_>) -> Self {
        let (ensemble, now) = switch_components_jointly(problem, &self.ensemble, self.now);
        Self { cost: now.cost(problem), ensemble, now }
    }
}

/// Line search for `alpha* = argmin C_KL(Phi + alpha dPhi)`.
///
/// It grows or shrinks a bracket from the last step, then fits parabolas.
///
/// In the paper's variables `(u/w, log 1/w)`, the parallel update is not always a direction of
/// descent. Immediately after the noise is lowered, all precisions grow by a large factor, and the
/// search stalls. In the natural parameters `(u/w, 1/w)`, the update is always a direction of
/// descent, since the gradient of `C_KL` is the Fisher matrix times `Phi - Phi*`. A failed search
/// is therefore repeated along that line.
struct LineSearch {
    alpha: f64,
    /// Whether to search along the update only.
    printed: bool,
    /// The last direction.
    last: Vec<f64>,
}

impl LineSearch {
    fn step(
        &mut self,
        problem: &Problem<'_>,
        ensemble: &VariationalParameters,
        now: &Expectations,
        cost: f64,
    ) -> VariationalParameters {
        let mut target = now.update(problem, ensemble);
        target.set_log_noise(ensemble.log_noise());
        let update = target.minus(ensemble);
        let evaluate = |e: &VariationalParameters| {
            let cost = Expectations::new(problem, e).cost(problem);
            if cost.is_finite() { cost } else { f64::INFINITY }
        };
        let mut directions = Vec::with_capacity(2);
        if !self.last.is_empty() && !self.printed {
            directions.push(update.iter().zip(&self.last).map(|(u, l)| u + MOMENTUM * l).collect::<Vec<f64>>());
        }
        directions.push(update);
        for direction in directions {
            let along = |alpha: f64| ensemble.moved(alpha, &direction);
            if let Some(alpha) =
                search(if self.alpha > 0.0 { self.alpha } else { 1.0 }, 64.0, cost, |alpha| evaluate(&along(alpha)))
            {
                self.alpha = alpha;
                let next = along(alpha);
                self.last = direction;
                return next;
            }
            self.alpha = 1.0;
        }
        if self.printed {
            // No step along the update lowers the cost: alpha* is zero.
            self.alpha = 0.0;
            return ensemble.clone();
        }
        self.last.clear();
        let natural = |alpha: f64| ensemble.towards(alpha, &target);
        search(0.5, 1.0, cost, |alpha| evaluate(&natural(alpha))).map_or_else(|| ensemble.clone(), natural)
    }
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
