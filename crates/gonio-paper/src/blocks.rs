//! Minimises `C_KL` by block updates and Newton steps: the minima of Algorithm 1 in a fraction of
//! the time.

use super::component_switch::component_switch;
use super::coordinate::round;
use super::grams::Grams;
use super::variational::{Run, SETTLED, VariationalSettings};
use super::{Expectations, Problem, VariationalParameters};

/// Change of `C_KL`, in nats, below which the noise is lowered.
const ROUGH: f64 = 1.0;
/// Change of `Phi_5` below which the noise becomes one of the blocks.
const NOISE_SETTLED: f64 = 0.1;
/// Number of rounds between component switches.
const SWITCH_INTERVAL: usize = 4;

/// Runs rounds of exact minimisation and Newton steps, with component switches between them.
///
/// As in Algorithm 1, the noise is lowered only when all other variables have converged at the
/// present level, to within [`ROUGH`]. Once `Phi_5` changes little, it becomes one of the blocks,
/// and the rounds continue to the tolerance.
pub(super) fn run(
    problem: &Problem<'_>,
    ensemble: VariationalParameters,
    grams: &Grams,
    settings: &VariationalSettings,
    progress: &dyn Fn(f64),
) -> Run {
    let start = Expectations::new(problem, &ensemble).cost(problem);
    let (mut ensemble, mut cost) = switch_all_components(problem, &ensemble, grams);
    let mut trace = vec![start];
    let (mut near, mut small_steps) = (false, 0);
    while trace.len() <= settings.max_iterations {
        let before = cost;
        (ensemble, cost) = round(problem, &ensemble, grams, near);
        trace.push(cost);
        progress(trace.len() as f64 / (settings.max_iterations + 1) as f64);
        let (tolerance, enough) = if near { (settings.tolerance, SETTLED) } else { (settings.tolerance.max(ROUGH), 1) };
        small_steps = if (before - cost).abs() < tolerance { small_steps + 1 } else { 0 };
        if small_steps >= enough || trace.len() % SWITCH_INTERVAL == 0 {
            let before = cost;
            (ensemble, cost) = switch_all_components(problem, &ensemble, grams);
            if before - cost >= tolerance {
                small_steps = 0;
            }
        }
        if small_steps < enough {
            continue;
        }
        if near {
            return Run { ensemble, trace, converged: true };
        }
        let noise = ensemble.log_noise();
        (ensemble, cost) = round(problem, &ensemble, grams, true);
        trace.push(cost);
        small_steps = 0;
        near = (ensemble.log_noise() - noise).abs() < NOISE_SETTLED;
    }
    Run { ensemble, trace, converged: false }
}

/// Moves every light coefficient to its best component. Returns the ensemble and its cost.
fn switch_all_components(
    problem: &Problem<'_>,
    ensemble: &VariationalParameters,
    grams: &Grams,
) -> (VariationalParameters, f64) {
    let now = Expectations::new(problem, ensemble);
    let (ensemble, now) = component_switch(problem, ensemble, now, &grams.columns);
    let cost = now.cost(problem);
    (ensemble, cost)
}
