//! `C_KL` minimised by blocks: the same minima as Algorithm 1's in a fraction of the time.

use super::acceleration::Anderson;
use super::coordinate::{Round, round};
use super::grams::Grams;
use super::leap::leap;
use super::parallel::search;
use super::variational::{Run, SETTLED, VariationalSettings};
use super::{Ensemble, Expectations, Problem};
use crate::lighting::CoefficientPrior;

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
    let mut climb = Descent { problem, grams, ensemble, cost, anderson: Anderson::new() };
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
        climb.anderson.forget();
        climb.round(true);
        trace.push(climb.cost);
        climb.anderson.forget();
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
    anderson: Anderson,
}

impl Descent<'_> {
    /// A round, and a step from its end along the line to where Anderson acceleration points, as
    /// far as that lowers the cost.
    fn round(&mut self, noise: bool) {
        let problem = self.problem;
        let end = round(problem, &self.ensemble, self.grams, noise);
        let (from, to) = (self.ensemble.locations(), end.ensemble.locations());
        let ahead = self.anderson.next(&from, &to, &end.ensemble.precisions(problem.pixels));
        (self.ensemble, self.cost) = (end.ensemble.clone(), end.cost);
        if let Some(ahead) = ahead {
            self.go(&end, ahead.iter().zip(&to).map(|(x, y)| x - y).collect(), noise);
        }
    }

    /// From the end of a round along a direction, to the least cost.
    fn go(&mut self, end: &Round, mut direction: Vec<f64>, noise: bool) {
        let problem = self.problem;
        // The image is linear in the means of the light, and a rectified mean is not linear in its
        // location.
        let light = problem.k()..problem.k() + problem.light.len();
        for (d, prior) in direction[light.clone()].iter_mut().zip(&problem.light) {
            if matches!(prior, CoefficientPrior::Rectified(_)) {
                *d = 0.0;
            }
        }
        if !noise {
            *direction.last_mut().expect("there is the noise") = 0.0;
        }
        let means: Vec<f64> = std::iter::once(0.0).chain(direction[light].iter().copied()).collect();
        let by = problem.bilinear.under_light(&means);
        let along = end.system.moved(problem, &end.a, &by);
        let to = end.ensemble.locations();
        let at = |alpha: f64| {
            let locations: Vec<f64> = to.iter().zip(&direction).map(|(x, d)| x + alpha * d).collect();
            let ensemble = end.ensemble.with_locations(&locations);
            let moments = ensemble.moments(problem);
            let cost = along(alpha).sums(&moments.f).cost(problem, &moments);
            (ensemble, if cost.is_finite() { cost } else { f64::INFINITY })
        };
        if let Some(alpha) = search(1.0, 64.0, end.cost, |alpha| at(alpha).1) {
            (self.ensemble, self.cost) = at(alpha);
        }
    }

    /// Every light coefficient in the component that is best for it. Returns what the cost fell by.
    fn leap(&mut self) -> f64 {
        let now = Expectations::new(self.problem, &self.ensemble);
        let (ensemble, now) = leap(self.problem, &self.ensemble, now, &self.grams.columns);
        let (before, cost) = (self.cost, now.cost(self.problem));
        (self.ensemble, self.cost) = (ensemble, cost);
        self.anderson.forget();
        before - cost
    }
}
