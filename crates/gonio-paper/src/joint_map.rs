//! Joint maximum of eq. 10 over light, reflectance, exposure and noise: the estimate of eq. 2,
//! which wrongly prefers a mirror under blurred illumination. It serves as a comparison.

use gonio::lighting::{CoefficientPrior, Moments};
use rand::SeedableRng;
use serde::{Deserialize, Serialize};

use super::coordinate::ReflectanceSystem;
use super::ensemble::AllMoments;
use super::expectations::Sums;
use super::grams::Grams;
use super::light_system::LightSystem;
use super::newton::Local;
use super::printed::search;
use super::{Posterior, Problem, StartReport, VariationalParameters};

/// Settings of the joint maximum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointMapSettings {
    /// Number of random starts; the most probable result is kept.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// A start ends when the log posterior grows by less than this three times in a row.
    pub tolerance: f64,
    /// Largest number of iterations of one start.
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

/// Logarithm of eq. 10 up to the evidence, at a point.
fn log_posterior(problem: &Problem<'_>, m: &AllMoments, sums: Sums) -> f64 {
    let reflectance: f64 = m.f.iter().zip(&problem.rates).map(|(f, rate)| rate.ln() - rate * f.mean).sum();
    let light: f64 = problem.light.iter().zip(&m.l[1..]).map(|(prior, l)| prior.log_density(l.mean)).sum();
    let exposure = problem.hyper.exposure_rate.ln() - problem.hyper.exposure_rate * m.g.mean;
    let (a0, b0) = (problem.hyper.noise_shape, problem.hyper.noise_rate);
    let noise = a0 * b0.ln() - puruspe::ln_gamma(a0) + (a0 - 1.0) * m.precision.ln() - b0 * m.precision;
    let likelihood = 0.5 * problem.pixels * (m.precision / std::f64::consts::TAU).ln()
        - 0.5 * m.precision * sums.residual(problem, &m.g);
    reflectance + light + exposure + noise + likelihood
}

pub(super) fn infer(problem: &Problem<'_>, settings: &JointMapSettings, progress: &(dyn Fn(f64) + Sync)) -> Posterior {
    let grams = Grams::of_points(problem);
    let starts = settings.starts.max(1);
    let runs: Vec<(AllMoments, Vec<f64>, bool)> = (0..starts)
        .map(|start| {
            let mut rng =
                rand_pcg::Pcg64::seed_from_u64(settings.seed.wrapping_mul(1_000_003).wrapping_add(start as u64));
            let random = VariationalParameters::random(problem, 0.1, &mut rng).moments(problem);
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
        starts: runs.iter().map(|r| StartReport { cost: cost(r), iterations: r.1.len(), converged: r.2 }).collect(),
        best_start: best,
    }
}

/// Maximises over the light given all else.
///
/// Coefficients with mixture priors are updated in one linear system by their EM majoriser;
/// rectified coefficients that are cut by their threshold are updated one by one.
fn settle_light(problem: &Problem<'_>, at: &mut AllMoments, grams: &Grams) -> LightSystem {
    let mut light = LightSystem::new(problem, at, grams);
    let (means, _) = light.minimise(problem, at, |m, curvature, push| {
        let CoefficientPrior::Rectified(p) = problem.light[m - 1] else {
            unreachable!("only rectified coefficients are cut")
        };
        ((push + p.location / p.variance) / (curvature + 1.0 / p.variance)).max(p.threshold)
    });
    at.l = means.into_iter().map(point).collect();
    light
}

/// Searches along Newton's direction for the highest density, starting from an optimal light.
///
/// Returns the point and the residual in the reflectance there.
fn advance(
    problem: &Problem<'_>,
    from: AllMoments,
    light: &LightSystem,
    grams: &Grams,
) -> (AllMoments, ReflectanceSystem) {
    let a = problem.bilinear.under_light(&from.l_means());
    let system = ReflectanceSystem::new(problem, &a, &from.l, grams);
    let k = problem.k();
    let local = Local::new(problem, &from, (&a, &system), light, Some(problem.noise_shape() - 1.0));
    let Some(mut step) = local.without_negative(&from.f).step(light) else { return (from, system) };
    // Rectified coefficients stay fixed: clipping them would make the image non-linear in the step.
    for (l, prior) in step.light[1..].iter_mut().zip(&problem.light) {
        if matches!(prior, CoefficientPrior::Rectified(_)) {
            *l = 0.0;
        }
    }
    let by = problem.bilinear.under_light(&step.light);
    let along = system.moved(problem, &a, &by);
    let at = |alpha: f64| AllMoments {
        f: from.f.iter().zip(step.rest.iter()).map(|(f, d)| point((f.mean + alpha * d).max(0.0))).collect(),
        l: from.l.iter().zip(&step.light).map(|(l, d)| point(l.mean + alpha * d)).collect(),
        g: point((from.g.mean + alpha * step.rest[k]).max(1e-12)),
        precision: from.precision * (-alpha * step.rest[k + 1]).exp(),
    };
    let cost = |alpha: f64| {
        let at = at(alpha);
        let cost = -log_posterior(problem, &at, along(alpha).sums(&at.f));
        if cost.is_finite() { cost } else { f64::INFINITY }
    };
    let here = -log_posterior(problem, &from, system.sums(&from.f));
    match search(1.0, 64.0, here, cost) {
        Some(alpha) => (at(alpha), along(alpha)),
        None => (from, system),
    }
}

/// Runs one round, and returns the point and minus its log posterior, which never increases.
///
/// A round maximises over the light, takes a Newton step in all variables, and maximises over
/// reflectance, exposure and noise in turn.
fn round(problem: &Problem<'_>, mut at: AllMoments, grams: &Grams) -> (AllMoments, f64) {
    let light = settle_light(problem, &mut at, grams);
    let (mut at, system) = advance(problem, at, &light, grams);
    // Coordinate ascent to convergence on the non-negative quadratic.
    at.f = system.descend(problem, &at, |_, natural, precision| point((natural / precision.max(1e-300)).max(0.0)));
    let sums = system.sums(&at.f);
    let natural = at.precision * sums.iy - problem.hyper.exposure_rate;
    at.g = point((natural / (at.precision * sums.q).max(1e-300)).max(1e-12));
    at.precision = (problem.noise_shape() - 1.0) / (problem.hyper.noise_rate + 0.5 * sums.residual(problem, &at.g));
    let cost = -log_posterior(problem, &at, sums);
    (at, cost)
}

/// Runs rounds of ascent until three changes in a row are below the tolerance. The trace holds
/// minus the log posterior.
fn ascend(
    problem: &Problem<'_>,
    mut at: AllMoments,
    grams: &Grams,
    settings: &JointMapSettings,
    progress: &dyn Fn(f64),
) -> (AllMoments, Vec<f64>, bool) {
    let mut trace: Vec<f64> = Vec::new();
    let mut small_steps = 0;
    for iteration in 0..settings.max_iterations.max(1) {
        let cost;
        (at, cost) = round(problem, at, grams);
        let fell = trace.last().map_or(f64::INFINITY, |before| before - cost);
        trace.push(cost);
        progress(iteration as f64 / settings.max_iterations as f64);
        small_steps = if fell.abs() < settings.tolerance { small_steps + 1 } else { 0 };
        if small_steps >= 3 {
            return (at, trace, true);
        }
    }
    (at, trace, false)
}
