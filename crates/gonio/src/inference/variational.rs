//! Algorithm 1: fitting the ensemble of approximating distributions.

use rand::SeedableRng;
use serde::{Deserialize, Serialize};

use super::acceleration::Anderson;
use super::grams::Grams;
use super::leap::{leap, leap_at_once};
use super::{Ensemble, Expectations, Posterior, Problem, StartReport, coordinate};

/// How the next ensemble is found from the present one. The cost and its fixed points are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Algorithm 1 to the letter: all parameters updated in parallel, then a line search on `C_KL`
    /// along `Phi + alpha (Phi* - Phi)`; one change below the threshold settles a noise level.
    Printed,
    /// [`Self::Printed`] with what makes it converge: leaps of the light between the components of
    /// its prior, momentum, a second search in the natural parameters where the first finds
    /// nothing, and three changes below the threshold.
    Parallel,
    /// Leaps, then exact minimisation over light, reflectance and exposure in turn with Anderson
    /// acceleration: the same minima in a fraction of the time.
    #[default]
    Blocks,
}

/// Settings of the separable posterior.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariationalSettings {
    /// How steps are made.
    pub solver: Solver,
    /// Random starts, of which the one of least `C_KL` is kept.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// Variance that every coefficient starts with (paper: 0.1), in the units of the coefficients.
    pub variance: f64,
    /// Stopping threshold (paper: 1e-4): of the change of `C_KL` at one noise level, in nats, and
    /// of the change of `Phi_5` from level to level.
    pub tolerance: f64,
    /// Iterations of one start at most.
    pub max_iterations: usize,
}

impl Default for VariationalSettings {
    fn default() -> Self {
        Self { solver: Solver::Blocks, starts: 3, seed: 1, variance: 0.1, tolerance: 1e-4, max_iterations: 2000 }
    }
}

/// Changes below the tolerance, one after the other, that settle a noise level.
const SETTLED: usize = 3;
/// Change of `C_KL`, in nats, that lets [`Solver::Blocks`] lower the noise.
const ROUGH: f64 = 0.1;
/// Change of `Phi_5` from which on the noise is one of the blocks.
const NEAR: f64 = 0.1;
/// Share of the last search direction that the next one of [`Solver::Parallel`] keeps: that of the
/// code that the paper builds on.
const MOMENTUM: f64 = 0.9;

/// A finished start.
struct Run {
    ensemble: Ensemble,
    trace: Vec<f64>,
    converged: bool,
}

impl Run {
    fn cost(&self) -> f64 {
        self.trace.last().copied().unwrap_or(f64::INFINITY)
    }
}

pub(super) fn infer(
    problem: &Problem<'_>,
    settings: &VariationalSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Posterior {
    let grams = Grams::of(problem, settings.solver);
    let starts = settings.starts.max(1);
    let runs: Vec<Run> = (0..starts)
        .map(|start| {
            let mut rng =
                rand_pcg::Pcg64::seed_from_u64(settings.seed.wrapping_mul(1_000_003).wrapping_add(start as u64));
            let ensemble = Ensemble::random(problem, settings.variance, &mut rng);
            run(problem, ensemble, grams.as_ref(), settings, &|x| progress((start as f64 + x) / starts as f64))
        })
        .collect();
    let best = (0..runs.len()).min_by(|&a, &b| runs[a].cost().total_cmp(&runs[b].cost())).expect("at least one start");
    let starts = runs
        .iter()
        .map(|r| StartReport { cost: r.cost(), iterations: r.trace.len() - 1, converged: r.converged })
        .collect();
    let m = runs[best].ensemble.moments(problem);
    let sd = |variance: f64| variance.sqrt();
    Posterior {
        reflectance: m.f_means(),
        reflectance_sd: m.f.iter().map(|f| sd(f.variance)).collect(),
        light: m.l_means(),
        light_sd: m.l.iter().map(|l| sd(l.variance)).collect(),
        exposure: m.g.mean / problem.scale,
        exposure_sd: sd(m.g.variance) / problem.scale,
        noise: m.precision.powf(-0.5) / problem.scale,
        trace: runs[best].trace.clone(),
        starts,
        best_start: best,
    }
}

/// The two nested loops of Algorithm 1.
///
/// The noise of [`Solver::Blocks`] is lowered as soon as a change of the cost falls below
/// [`ROUGH`], until it changes little; from then on it is one of the blocks.
fn run(
    problem: &Problem<'_>,
    ensemble: Ensemble,
    grams: Option<&Grams>,
    settings: &VariationalSettings,
    progress: &dyn Fn(f64),
) -> Run {
    let now = Expectations::new(problem, &ensemble);
    let printed = settings.solver == Solver::Printed;
    let mut state = State { cost: now.cost(problem), ensemble, now };
    let mut trace = vec![state.cost];
    let mut search = LineSearch { alpha: 1.0, printed, last: Vec::new() };
    let mut anderson = Anderson::new();
    let mut last = false;
    if !printed {
        state = state.leapt(problem, grams);
    }
    let mut converged = false;
    'noise: loop {
        // At the present noise level.
        let (tolerance, enough) = match (grams, last) {
            _ if printed => (settings.tolerance, 1),
            (Some(_), false) => (settings.tolerance.max(ROUGH), 1),
            _ => (settings.tolerance, SETTLED),
        };
        let mut settled = 0;
        anderson.forget();
        loop {
            if trace.len() > settings.max_iterations {
                break 'noise;
            }
            let before = state.cost;
            state = match grams {
                Some(grams) => state.round(problem, grams, last, &mut anderson),
                None => {
                    let next = search.step(problem, &state.ensemble, &state.now, before);
                    state.at(problem, next)
                }
            };
            trace.push(state.cost);
            progress(trace.len() as f64 / (settings.max_iterations + 1) as f64);
            settled = if (before - state.cost).abs() < tolerance { settled + 1 } else { 0 };
            if settled < enough {
                continue;
            }
            if printed {
                break;
            }
            let before = state.cost;
            state = state.leapt(problem, grams);
            if before - state.cost < tolerance {
                break;
            }
            settled = 0;
            anderson.forget();
            search.last.clear();
        }
        if last {
            converged = true;
            break;
        }
        // Only when all else has converged is the noise lowered, by the step that the line search
        // ended with.
        let share = if printed { search.alpha } else { search.alpha.clamp(0.1, 1.0) };
        let change = share * (state.now.best_log_noise(problem) - state.ensemble.log_noise());
        let mut next = state.ensemble.clone();
        next.set_log_noise(next.log_noise() + change);
        state = state.at(problem, next);
        trace.push(state.cost);
        last = grams.is_some() && change.abs() < NEAR;
        if change.abs() < settings.tolerance && grams.is_none() {
            converged = true;
            break;
        }
    }
    Run { ensemble: state.ensemble, trace, converged }
}

impl Grams {
    /// None for the solvers that update in parallel.
    fn of(problem: &Problem<'_>, solver: Solver) -> Option<Self> {
        (solver == Solver::Blocks).then(|| Self::new(problem))
    }
}

/// An ensemble with what belongs to it.
struct State {
    ensemble: Ensemble,
    now: Expectations,
    cost: f64,
}

impl State {
    fn at(self, problem: &Problem<'_>, ensemble: Ensemble) -> Self {
        let now = self.now.after(problem, &ensemble);
        Self { cost: now.cost(problem), ensemble, now }
    }

    /// Every light coefficient in the component that is best for it.
    fn leapt(self, problem: &Problem<'_>, grams: Option<&Grams>) -> Self {
        let (ensemble, now) = match grams {
            Some(grams) => leap(problem, &self.ensemble, self.now, &grams.columns),
            None => leap_at_once(problem, &self.ensemble, self.now),
        };
        Self { cost: now.cost(problem), ensemble, now }
    }

    /// A round of exact minimisation over blocks, and the step that Anderson acceleration makes of
    /// it and of those before if that is lower still.
    fn round(self, problem: &Problem<'_>, grams: &Grams, noise: bool, anderson: &mut Anderson) -> Self {
        let (ensemble, now) = coordinate::round(problem, &self.ensemble, self.now, grams, noise);
        let next = Self { cost: now.cost(problem), ensemble, now };
        let (from, to) = (self.ensemble.locations(), next.ensemble.locations());
        let Some(locations) = anderson.next(&from, &to, &next.ensemble.precisions(problem.pixels)) else { return next };
        let ensemble = next.ensemble.with_locations(&locations);
        let now = Expectations::new(problem, &ensemble);
        let cost = now.cost(problem);
        // Not a number where the step left the range of exponentials.
        if cost < next.cost {
            return Self { ensemble, now, cost };
        }
        anderson.forget();
        next
    }
}

/// `alpha* = argmin C_KL(Phi + alpha dPhi)`: a bracket grown or shrunk from the last step, then
/// parabolas.
///
/// In the paper's variables `(u/w, log 1/w)` the parallel update need not be a direction of
/// descent: just after the noise was lowered all precisions want to grow by a large factor, and the
/// search stalls. In the natural parameters `(u/w, 1/w)` it always is one, since there the gradient
/// of `C_KL` is the Fisher matrix times `Phi - Phi*`. So a search that finds nothing is repeated
/// along that line.
struct LineSearch {
    alpha: f64,
    /// Nothing but the search along the update.
    printed: bool,
    /// The last direction.
    last: Vec<f64>,
}

impl LineSearch {
    fn step(&mut self, problem: &Problem<'_>, ensemble: &Ensemble, now: &Expectations, cost: f64) -> Ensemble {
        let mut target = now.update(problem, ensemble);
        target.set_log_noise(ensemble.log_noise());
        let update = target.minus(ensemble);
        let evaluate = |e: &Ensemble| {
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

/// Minimiser of `at` near `start`, at most about `limit`; `None` if nothing down to a
/// ten-thousandth of it falls below `cost`, the value at zero.
fn search(start: f64, limit: f64, cost: f64, at: impl Fn(f64) -> f64) -> Option<f64> {
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
    // Or grow while it falls.
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

/// Where the parabola through three points has its extremum; NaN when they lie on a line.
fn vertex(a: (f64, f64), b: (f64, f64), c: (f64, f64)) -> f64 {
    let (p, q) = ((b.0 - a.0) * (b.1 - c.1), (b.0 - c.0) * (b.1 - a.1));
    b.0 - 0.5 * ((b.0 - a.0) * p - (b.0 - c.0) * q) / (p - q)
}

/// The end of one start from given variances: its ensemble, cost and iterations.
#[cfg(test)]
pub(super) fn end(problem: &Problem<'_>, settings: &VariationalSettings) -> (Ensemble, f64, usize) {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(settings.seed);
    let ensemble = Ensemble::random(problem, settings.variance, &mut rng);
    let run = run(problem, ensemble, Grams::of(problem, settings.solver).as_ref(), settings, &|_| ());
    assert!(run.converged, "{settings:?}");
    let cost = run.cost();
    (run.ensemble, cost, run.trace.len() - 1)
}
