//! Algorithm 1: fitting the ensemble of approximating distributions.

use std::sync::atomic::{AtomicU64, Ordering};

use rand::SeedableRng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::grams::Grams;
use super::{Posterior, Problem, StartReport, VariationalParameters, blocks, printed};

/// Algorithm that computes the next ensemble. The cost and its fixed points are the same for all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Algorithm 1 as printed: all parameters updated in parallel, then a line search on `C_KL`
    /// along `Phi + alpha (Phi* - Phi)`; a noise level has converged after one change below the
    /// threshold.
    Printed,
    /// Component switches, exact minimisation over light, reflectance and exposure in turn, and
    /// Newton steps in all of them: the same minima in a fraction of the time.
    #[default]
    Blocks,
}

/// Settings of the separable posterior.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariationalSettings {
    /// Algorithm of the steps.
    pub solver: Solver,
    /// Number of random starts; the one with the lowest `C_KL` is kept.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// Initial variance of every coefficient (paper: 0.1), in the units of the coefficients.
    pub variance: f64,
    /// Stopping threshold (paper: 1e-4): of the change of `C_KL` at one noise level, in nats, and
    /// of the change of `Phi_5` from level to level.
    pub tolerance: f64,
    /// Largest number of iterations of one start.
    pub max_iterations: usize,
}

impl Default for VariationalSettings {
    fn default() -> Self {
        Self { solver: Solver::Blocks, starts: 4, seed: 1, variance: 0.1, tolerance: 1e-4, max_iterations: 2000 }
    }
}

impl VariationalSettings {
    /// Returns the settings of Algorithm 1 as printed, with this many starts.
    pub fn of_paper(starts: usize, seed: u64) -> Self {
        Self { solver: Solver::Printed, starts, seed, max_iterations: 20_000, ..Self::default() }
    }
}

/// Number of consecutive changes below the tolerance after which a noise level has converged.
pub(super) const SETTLED: usize = 3;

/// Result of one random start.
pub(super) struct Run {
    pub(super) ensemble: VariationalParameters,
    /// Cost at the start and after every iteration.
    pub(super) trace: Vec<f64>,
    pub(super) converged: bool,
}

impl Run {
    pub(super) fn cost(&self) -> f64 {
        self.trace.last().copied().unwrap_or(f64::INFINITY)
    }
}

pub(super) fn infer(
    problem: &Problem<'_>,
    settings: &VariationalSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Posterior {
    let grams = (settings.solver == Solver::Blocks).then(|| Grams::new(problem));
    let starts = settings.starts.max(1);
    let done: Vec<AtomicU64> = (0..starts).map(|_| AtomicU64::new(0)).collect();
    let report = |start: usize, fraction: f64| {
        done[start].store(fraction.to_bits(), Ordering::Relaxed);
        let sum: f64 = done.iter().map(|x| f64::from_bits(x.load(Ordering::Relaxed))).sum();
        progress(sum / starts as f64);
    };
    let runs: Vec<Run> = (0..starts)
        .into_par_iter()
        .map(|start| {
            let mut rng =
                rand_pcg::Pcg64::seed_from_u64(settings.seed.wrapping_mul(1_000_003).wrapping_add(start as u64));
            let ensemble = VariationalParameters::random(problem, settings.variance, &mut rng);
            run(problem, ensemble, grams.as_ref(), settings, &|x| report(start, x))
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

/// Runs one start.
fn run(
    problem: &Problem<'_>,
    ensemble: VariationalParameters,
    grams: Option<&Grams>,
    settings: &VariationalSettings,
    progress: &dyn Fn(f64),
) -> Run {
    match grams {
        Some(grams) => blocks::run(problem, ensemble, grams, settings, progress),
        None => printed::run(problem, ensemble, settings, progress),
    }
}

/// Runs one start with the variance of the settings, and returns its ensemble, cost and iterations.
#[cfg(test)]
pub(super) fn end(problem: &Problem<'_>, settings: &VariationalSettings) -> (VariationalParameters, f64, usize) {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(settings.seed);
    let ensemble = VariationalParameters::random(problem, settings.variance, &mut rng);
    let grams = (settings.solver == Solver::Blocks).then(|| Grams::new(problem));
    let run = run(problem, ensemble, grams.as_ref(), settings, &|_| ());
    assert!(run.converged, "{settings:?}");
    let cost = run.cost();
    (run.ensemble, cost, run.trace.len() - 1)
}
