//! `C_KL` minimised by blocks: the same minima as Algorithm 1's in a fraction of the time.

use super::acceleration::Anderson;
use super::coordinate::round;
use super::grams::Grams;
use super::leap::leap;
use super::variational::{Run, SETTLED, VariationalSettings};
use super::{Ensemble, Expectations, Problem};

/// Change of `C_KL`, in nats, below which the noise is lowered.
const ROUGH: f64 = 0.1;
/// Change of `Phi_5` from which on the noise is one of the blocks.
const NEAR: f64 = 0.1;

/// Rounds of exact minimisation over blocks with Anderson acceleration.
///
/// As in Algorithm 1 the noise is lowered only when the rest has settled at the present level, by
/// [`ROUGH`]; where that changes it little, it becomes one of the blocks, and the rounds go on to
/// the tolerance.
pub(super) fn run(
    problem: &Problem<'_>,
    ensemble: Ensemble,
    grams: &Grams,
    settings: &VariationalSettings,
    progress: &dyn Fn(f64),
) -> Run {
    let cost = Expectations::new(problem, &ensemble).cost(problem);
    let mut trace = vec![cost];
    let mut climb = Descent { problem, grams, ensemble, cost, ahead: None, anderson: Anderson::new() };
    climb.leap();
    let (mut near, mut settled) = (false, 0);
    while trace.len() <= settings.max_iterations {
        let before = climb.cost;
        climb.round(near);
        trace.push(climb.cost);
        progress(trace.len() as f64 / (settings.max_iterations + 1) as f64);
        let (tolerance, enough) = if near { (settings.tolerance, SETTLED) } else { (settings.tolerance.max(ROUGH), 1) };
        settled = if (before - climb.cost).abs() < tolerance { settled + 1 } else { 0 };
        if settled < enough {
            continue;
        }
        settled = 0;
        if climb.leap() >= tolerance {
            continue;
        }
        if near {
            return Run { ensemble: climb.ensemble, trace, converged: true };
        }
        let noise = climb.ensemble.log_noise();
        climb.restart();
        climb.round(true);
        trace.push(climb.cost);
        climb.restart();
        near = (climb.ensemble.log_noise() - noise).abs() < NEAR;
    }
    Run { ensemble: climb.ensemble, trace, converged: false }
}

/// Where the rounds are.
struct Descent<'a> {
    problem: &'a Problem<'a>,
    grams: &'a Grams,
    ensemble: Ensemble,
    cost: f64,
    /// Where the next round starts, if not at `ensemble`.
    ahead: Option<Ensemble>,
    anderson: Anderson,
}

impl Descent<'_> {
    /// A round from where Anderson acceleration points, or from where the last one ended if that
    /// leads higher.
    fn round(&mut self, noise: bool) {
        let mut from = self.ahead.take();
        let mut end = from.as_ref().map(|from| round(self.problem, from, self.grams, noise));
        // Not a number where the step left the range of exponentials.
        if end.as_ref().is_none_or(|(_, cost)| !(*cost <= self.cost)) {
            if from.is_some() {
                self.anderson.forget();
            }
            end = Some(round(self.problem, &self.ensemble, self.grams, noise));
            from = Some(self.ensemble.clone());
        }
        let (Some(from), Some((ensemble, cost))) = (from, end) else { return };
        let metric = ensemble.precisions(self.problem.pixels);
        let ahead = self.anderson.next(&from.locations(), &ensemble.locations(), &metric);
        self.ahead = ahead.map(|locations| ensemble.with_locations(&locations));
        (self.ensemble, self.cost) = (ensemble, cost);
    }

    /// Forgets the steps so far.
    fn restart(&mut self) {
        self.anderson.forget();
        self.ahead = None;
    }

    /// Every light coefficient in the component that is best for it. Returns what the cost fell by.
    fn leap(&mut self) -> f64 {
        let now = Expectations::new(self.problem, &self.ensemble);
        let (ensemble, now) = leap(self.problem, &self.ensemble, now, &self.grams.columns);
        let (before, cost) = (self.cost, now.cost(self.problem));
        (self.ensemble, self.cost) = (ensemble, cost);
        self.restart();
        before - cost
    }
}
