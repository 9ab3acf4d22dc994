//! Algorithm 1: fitting the ensemble of approximating distributions.

use rand::SeedableRng;
use serde::{Deserialize, Serialize};

use super::{Ensemble, Expectations, Posterior, Problem, StartReport, coordinate};

/// How the next ensemble is found from the present one. The cost and its fixed points are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// As printed: all parameters updated in parallel, then a line search on `C_KL` along
    /// `Phi + alpha (Phi* - Phi)`.
    Parallel,
    /// Exact minimisation over light, reflectance and exposure in turn: lower `C_KL` in a fraction
    /// of the time, hence the default.
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
    /// Stopping threshold (paper: 1e-4): of the change of `C_KL` per pixel at one noise level,
    /// three times in a row, and of the change of `Phi_5` from level to level. Per pixel, because
    /// `C_KL` grows with their number.
    pub tolerance: f64,
    /// Share of the last search direction that the next one keeps ([`Solver::Parallel`]); zero is
    /// Algorithm 1 to the letter,
    /// 0.9 that of the older code that the paper builds on.
    pub momentum: f64,
    /// Iterations of one start at most.
    pub max_iterations: usize,
}

impl Default for VariationalSettings {
    fn default() -> Self {
        Self { solver: Solver::Blocks, starts: 3, seed: 1, tolerance: 1e-4, momentum: 0.0, max_iterations: 1500 }
    }
}

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
    let grams = match settings.solver {
        Solver::Blocks => problem.bilinear.reflectance_grams(),
        Solver::Parallel => Vec::new(),
    };
    let starts = settings.starts.max(1);
    let runs: Vec<Run> = (0..starts)
        .map(|start| {
            let mut rng =
                rand_pcg::Pcg64::seed_from_u64(settings.seed.wrapping_mul(1_000_003).wrapping_add(start as u64));
            let ensemble = Ensemble::random(problem, &mut rng);
            run(problem, ensemble, &grams, settings, &|x| progress((start as f64 + x) / starts as f64))
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
fn run(
    problem: &Problem<'_>,
    mut ensemble: Ensemble,
    grams: &[f64],
    settings: &VariationalSettings,
    progress: &dyn Fn(f64),
) -> Run {
    let mut now = Expectations::new(problem, &ensemble);
    let mut trace = vec![now.cost(problem)];
    let mut search = LineSearch { alpha: 1.0, momentum: settings.momentum, last: Vec::new() };
    let mut converged = false;
    'noise: loop {
        // At the present noise level.
        let mut settled = 0;
        while settled < 3 {
            if trace.len() > settings.max_iterations {
                break 'noise;
            }
            let before = *trace.last().expect("the trace starts with one entry");
            (ensemble, now) = match settings.solver {
                Solver::Parallel => {
                    let next = search.step(problem, &ensemble, &now, before);
                    let moved = now.after(problem, &next);
                    (next, moved)
                }
                Solver::Blocks => coordinate::round(problem, &ensemble, now, grams, 12),
            };
            let cost = now.cost(problem);
            trace.push(cost);
            progress(trace.len() as f64 / (settings.max_iterations + 1) as f64);
            settled = if (before - cost).abs() < settings.tolerance * problem.pixels { settled + 1 } else { 0 };
        }
        // Only when all else has converged is the noise lowered, by the step that the line search
        // ended with.
        let change = search.noise_step() * (now.best_log_noise(problem) - ensemble.log_noise());
        ensemble.set_log_noise(ensemble.log_noise() + change);
        now = now.after(problem, &ensemble);
        trace.push(now.cost(problem));
        if change.abs() < settings.tolerance {
            converged = true;
            break;
        }
    }
    Run { ensemble, trace, converged }
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
    momentum: f64,
    /// The last direction.
    last: Vec<f64>,
}

impl LineSearch {
    /// The share of the way to the best noise level that an update of the noise takes.
    fn noise_step(&self) -> f64 {
        self.alpha.clamp(0.1, 1.0)
    }

    fn step(&mut self, problem: &Problem<'_>, ensemble: &Ensemble, now: &Expectations, cost: f64) -> Ensemble {
        let mut target = now.update(problem, ensemble);
        target.set_log_noise(ensemble.log_noise());
        let update = target.minus(ensemble);
        let evaluate = |e: &Ensemble| {
            let cost = Expectations::new(problem, e).cost(problem);
            if cost.is_finite() { cost } else { f64::INFINITY }
        };
        let mut directions = Vec::with_capacity(2);
        if !self.last.is_empty() && self.momentum > 0.0 {
            directions.push(update.iter().zip(&self.last).map(|(u, l)| u + self.momentum * l).collect::<Vec<f64>>());
        }
        directions.push(update);
        for direction in directions {
            let along = |alpha: f64| ensemble.moved(alpha, &direction);
            if let Some(alpha) = search(self.alpha, 64.0, cost, |alpha| evaluate(&along(alpha))) {
                self.alpha = alpha;
                let next = along(alpha);
                self.last = direction;
                return next;
            }
            self.alpha = 1.0;
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
