//! The joint maximum of eq. 10 over light, reflectance, exposure and noise: the estimate of eq. 2,
//! which prefers a mirror in a blurry world and is here to be compared with.

use rand::SeedableRng;
use serde::{Deserialize, Serialize};

use super::acceleration::Anderson;
use super::coordinate::{ReflectanceSystem, light_step};
use super::ensemble::AllMoments;
use super::grams::{Grams, pull_weights};
use super::{Ensemble, Expectations, Posterior, Problem, StartReport};
use crate::lighting::{CoefficientPrior, Moments};
use crate::transfer::kernels::dot;

/// Settings of the joint maximum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointMapSettings {
    /// Random starts, of which the most probable end is kept.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// A start ends when the log posterior grows by less than this three times in a row.
    pub tolerance: f64,
    /// Iterations of one start at most.
    pub max_iterations: usize,
}

impl Default for JointMapSettings {
    fn default() -> Self {
        Self { starts: 3, seed: 1, tolerance: 1e-4, max_iterations: 3000 }
    }
}

fn point(mean: f64) -> Moments {
    Moments { mean, variance: 0.0, mean_log: 0.0 }
}

/// Logarithm of eq. 10 up to the evidence, at the means of `now`.
pub fn log_posterior(problem: &Problem<'_>, now: &Expectations) -> f64 {
    let m = &now.moments;
    let reflectance: f64 = m.f.iter().zip(&problem.rates).map(|(f, rate)| rate.ln() - rate * f.mean).sum();
    let light: f64 = problem.light.iter().zip(&m.l[1..]).map(|(prior, l)| prior.log_density(l.mean)).sum();
    let exposure = problem.hyper.exposure_rate.ln() - problem.hyper.exposure_rate * m.g.mean;
    let (a0, b0) = (problem.hyper.noise_shape, problem.hyper.noise_rate);
    let noise = a0 * b0.ln() - puruspe::ln_gamma(a0) + (a0 - 1.0) * m.precision.ln() - b0 * m.precision;
    let likelihood =
        0.5 * problem.pixels * (m.precision / std::f64::consts::TAU).ln() - 0.5 * m.precision * now.residual(problem);
    reflectance + light + exposure + noise + likelihood
}

pub(super) fn infer(problem: &Problem<'_>, settings: &JointMapSettings, progress: &(dyn Fn(f64) + Sync)) -> Posterior {
    let grams = Grams::of_points(problem);
    let starts = settings.starts.max(1);
    let runs: Vec<(AllMoments, Vec<f64>, bool)> = (0..starts)
        .map(|start| {
            let mut rng =
                rand_pcg::Pcg64::seed_from_u64(settings.seed.wrapping_mul(1_000_003).wrapping_add(start as u64));
            let random = Ensemble::random(problem, 0.1, &mut rng).moments(problem);
            let at = AllMoments {
                f: random.f.iter().map(|f| point(f.mean)).collect(),
                l: random.l.iter().map(|l| point(l.mean)).collect(),
                g: point(random.g.mean),
                precision: random.precision,
            };
            ascend(problem, at, &grams, settings, &|x| progress((start as f64 + x) / starts as f64))
        })
        .collect();
    let cost = |run: &(AllMoments, Vec<f64>, bool)| run.1.last().copied().unwrap_or(f64::INFINITY);
    let best = (0..runs.len()).min_by(|&a, &b| cost(&runs[a]).total_cmp(&cost(&runs[b]))).expect("at least one start");
    let m = &runs[best].0;
    Posterior {
        reflectance: m.f_means(),
        reflectance_sd: vec![0.0; problem.k()],
        light: m.l_means(),
        light_sd: vec![0.0; problem.m()],
        exposure: m.g.mean / problem.scale,
        exposure_sd: 0.0,
        noise: m.precision.powf(-0.5) / problem.scale,
        trace: runs[best].1.clone(),
        starts: runs.iter().map(|r| StartReport { cost: cost(r), iterations: r.1.len() - 1, converged: r.2 }).collect(),
        best_start: best,
    }
}

/// A point estimate with what belongs to it.
struct State {
    at: AllMoments,
    now: Expectations,
    /// Minus the log posterior.
    cost: f64,
}

impl State {
    fn new(problem: &Problem<'_>, at: AllMoments) -> Self {
        let now = Expectations::of_moments(problem, at.clone());
        Self { cost: -log_posterior(problem, &now), at, now }
    }

    /// Reflectance, light but DC, exposure.
    fn coordinates(&self) -> Vec<f64> {
        let AllMoments { f, l, g, .. } = &self.at;
        f.iter().chain(&l[1..]).chain(std::iter::once(g)).map(|x| x.mean).collect()
    }

    /// About the curvature of the cost in each of them, without the factor of the noise.
    fn metric(&self, problem: &Problem<'_>) -> Vec<f64> {
        let g2 = self.at.g.mean_square();
        let scaled = |x: &f64| g2 * x;
        let light = self.now.stiffness(problem);
        let metric = self.now.a_square.iter().chain(&light[1..]).map(scaled).chain(std::iter::once(self.now.q));
        metric.map(|x| x.max(1e-300)).collect()
    }

    /// At other coordinates, moved to where the prior has mass, same noise.
    fn at_coordinates(&self, problem: &Problem<'_>, coordinates: &[f64]) -> Self {
        let k = problem.k();
        let mut at = self.at.clone();
        at.f = coordinates[..k].iter().map(|f| point(f.max(0.0))).collect();
        for (i, (prior, l)) in problem.light.iter().zip(&coordinates[k..]).enumerate() {
            at.l[i + 1] = point(match prior {
                CoefficientPrior::Mixture(_) => *l,
                CoefficientPrior::Rectified(p) => l.max(p.threshold),
            });
        }
        at.g = point(coordinates[coordinates.len() - 1].max(1e-12));
        Self::new(problem, at)
    }

    /// Ascent over one block of variables at a time.
    fn round(self, problem: &Problem<'_>, grams: &Grams) -> Self {
        let Self { mut at, mut now, .. } = self;
        // Light: mixtures by their EM majoriser, one linear system; the rectified coefficient
        // alone, cut off at its threshold.
        let (means, _) = light_step(problem, &now, grams);
        at.l = means.into_iter().map(point).collect();
        now = now.after_moments(problem, at.clone());
        let mut weights = vec![0.0; now.a.len()];
        for (i, prior) in problem.light.iter().enumerate() {
            if let CoefficientPrior::Rectified(p) = prior {
                let m = i + 1;
                pull_weights(problem, &now, &now.a, &now.y, &mut weights);
                let pull = dot(grams.columns.of(m), &weights);
                let stiffness = at.precision * at.g.mean_square() * now.stiffness(problem)[m];
                let natural = at.precision * pull + stiffness * at.l[m].mean + p.location / p.variance;
                at.l[m] = point((natural / (stiffness + 1.0 / p.variance)).max(p.threshold));
                now = now.with_light(problem, m, at.l[m], &grams.columns);
            }
        }
        // Reflectance: coordinate ascent to convergence on the non-negative quadratic.
        let system = ReflectanceSystem::new(problem, &now, grams);
        at.f = system.descend(problem, &at, |_, natural, precision| point((natural / precision.max(1e-300)).max(0.0)));
        now = now.after_moments(problem, at.clone());
        let natural = at.precision * now.iy - problem.hyper.exposure_rate;
        at.g = point((natural / (at.precision * now.q).max(1e-300)).max(1e-12));
        now = now.after_moments(problem, at.clone());
        at.precision = (problem.noise_shape() - 1.0) / (problem.hyper.noise_rate + 0.5 * now.residual(problem));
        now = now.after_moments(problem, at.clone());
        Self { cost: -log_posterior(problem, &now), at, now }
    }
}

/// Rounds of ascent over blocks with Anderson acceleration; the trace holds minus the log
/// posterior. Ends after three changes below the tolerance.
fn ascend(
    problem: &Problem<'_>,
    at: AllMoments,
    grams: &Grams,
    settings: &JointMapSettings,
    progress: &dyn Fn(f64),
) -> (AllMoments, Vec<f64>, bool) {
    let mut state = State::new(problem, at);
    let mut trace = vec![state.cost];
    let mut anderson = Anderson::new();
    let mut settled = 0;
    for iteration in 0..settings.max_iterations {
        let (before, from) = (state.cost, state.coordinates());
        state = state.round(problem, grams);
        if let Some(coordinates) = anderson.next(&from, &state.coordinates(), &state.metric(problem)) {
            let tried = state.at_coordinates(problem, &coordinates);
            if tried.cost < state.cost {
                state = tried;
            } else {
                anderson.forget();
            }
        }
        trace.push(state.cost);
        progress((iteration + 1) as f64 / settings.max_iterations as f64);
        settled = if (before - state.cost).abs() < settings.tolerance { settled + 1 } else { 0 };
        if settled >= 3 {
            return (state.at, trace, true);
        }
    }
    (state.at, trace, false)
}
