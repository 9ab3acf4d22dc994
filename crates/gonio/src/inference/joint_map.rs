//! The joint maximum of eq. 10 over light, reflectance, exposure and noise: the estimate of eq. 2,
//! which prefers a mirror in a blurry world and is here to be compared with.

use rand::SeedableRng;
use serde::{Deserialize, Serialize};

use super::coordinate::{ReflectanceSystem, light_step};
use super::ensemble::AllMoments;
use super::{Ensemble, Expectations, Posterior, Problem, StartReport};
use crate::lighting::{CoefficientPrior, Moments};

/// Settings of the joint maximum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointMapSettings {
    /// Random starts, of which the most probable end is kept.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// A start ends when the log posterior grows by less than this.
    pub tolerance: f64,
    /// Iterations of one start at most.
    pub max_iterations: usize,
}

impl Default for JointMapSettings {
    fn default() -> Self {
        Self { starts: 3, seed: 1, tolerance: 1e-4, max_iterations: 200 }
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
    let grams = vec![0.0; problem.k() * problem.k() * problem.m()];
    let starts = settings.starts.max(1);
    let runs: Vec<(AllMoments, Vec<f64>, bool)> = (0..starts)
        .map(|start| {
            let mut rng =
                rand_pcg::Pcg64::seed_from_u64(settings.seed.wrapping_mul(1_000_003).wrapping_add(start as u64));
            let random = Ensemble::random(problem, &mut rng).moments(problem);
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

/// Ascent over one block of variables at a time; the trace holds minus the log posterior.
fn ascend(
    problem: &Problem<'_>,
    mut at: AllMoments,
    grams: &[f64],
    settings: &JointMapSettings,
    progress: &dyn Fn(f64),
) -> (AllMoments, Vec<f64>, bool) {
    let mut now = Expectations::of_moments(problem, at.clone());
    let mut trace = vec![-log_posterior(problem, &now)];
    for iteration in 0..settings.max_iterations {
        // Light: mixtures by their EM majoriser, one linear system; the rectified coefficient
        // alone, cut off at its threshold.
        let (means, _) = light_step(problem, &now, 12);
        at.l = means.into_iter().map(point).collect();
        now = now.after_moments(problem, at.clone());
        for (i, prior) in problem.light.iter().enumerate() {
            if let CoefficientPrior::Rectified(p) = prior {
                let (m, pull) = (i + 1, now.pull(problem));
                let stiffness = at.precision * at.g.mean_square() * pull.stiffness[m];
                let natural = at.precision * pull.light[m] + stiffness * at.l[m].mean + p.location / p.variance;
                at.l[m] = point((natural / (stiffness + 1.0 / p.variance)).max(p.threshold));
                now = now.after_moments(problem, at.clone());
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
        let cost = -log_posterior(problem, &now);
        let fell = trace[trace.len() - 1] - cost;
        trace.push(cost);
        progress((iteration + 1) as f64 / settings.max_iterations as f64);
        if fell.abs() < settings.tolerance {
            return (at, trace, true);
        }
    }
    (at, trace, false)
}
