//! The joint maximum of eq. 10 over light, reflectance, exposure and noise: the estimate of eq. 2,
//! which prefers a mirror in a blurry world and is here to be compared with.

use rand::SeedableRng;
use serde::{Deserialize, Serialize};

use super::acceleration::Anderson;
use super::coordinate::ReflectanceSystem;
use super::ensemble::AllMoments;
use super::expectations::Sums;
use super::grams::Grams;
use super::light_system::LightSystem;
use super::parallel::search;
use super::{Ensemble, Posterior, Problem, StartReport};
use crate::lighting::{CoefficientPrior, Moments};

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
        starts: runs.iter().map(|r| StartReport { cost: cost(r), iterations: r.1.len(), converged: r.2 }).collect(),
        best_start: best,
    }
}

/// Reflectance, light but DC, exposure.
fn coordinates(at: &AllMoments) -> Vec<f64> {
    at.f.iter().chain(&at.l[1..]).chain(std::iter::once(&at.g)).map(|x| x.mean).collect()
}

/// A point estimate at other coordinates, moved to where the prior has mass; same noise.
fn at_coordinates(problem: &Problem<'_>, at: &AllMoments, coordinates: &[f64]) -> AllMoments {
    let k = problem.k();
    let mut at = at.clone();
    at.f = coordinates[..k].iter().map(|f| point(f.max(0.0))).collect();
    for (i, (prior, l)) in problem.light.iter().zip(&coordinates[k..]).enumerate() {
        at.l[i + 1] = point(match prior {
            CoefficientPrior::Mixture(_) => *l,
            CoefficientPrior::Rectified(p) => l.max(p.threshold),
        });
    }
    at.g = point(coordinates[coordinates.len() - 1].max(1e-12));
    at
}

/// Where a round of ascent ends.
struct Round {
    at: AllMoments,
    /// Minus the log posterior.
    cost: f64,
    /// The curvatures of the cost in the [`coordinates`], about.
    metric: Vec<f64>,
    /// The image of each basis function under the light (rows x K).
    a: Vec<f64>,
    system: ReflectanceSystem,
}

/// Ascent over one block of variables at a time.
fn round(problem: &Problem<'_>, from: &AllMoments, grams: &Grams) -> Round {
    let mut at = from.clone();
    // Light: mixtures by their EM majoriser, one linear system; a rectified coefficient at its
    // threshold alone.
    let (means, precisions) = LightSystem::new(problem, &at, grams).settle(problem, &at, |m, stiffness, push| {
        let CoefficientPrior::Rectified(p) = problem.light[m - 1] else { unreachable!("only rectified ones are cut") };
        ((push + p.location / p.variance) / (stiffness + 1.0 / p.variance)).max(p.threshold)
    });
    at.l = means.into_iter().map(point).collect();
    // Reflectance: coordinate ascent to convergence on the non-negative quadratic.
    let a = problem.bilinear.under_light(&at.l_means());
    let system = ReflectanceSystem::new(problem, &a, &at.l, grams);
    at.f = system.descend(problem, &at, |_, natural, precision| point((natural / precision.max(1e-300)).max(0.0)));
    let sums = system.sums(&at.f);
    let natural = at.precision * sums.iy - problem.hyper.exposure_rate;
    at.g = point((natural / (at.precision * sums.q).max(1e-300)).max(1e-12));
    at.precision = (problem.noise_shape() - 1.0) / (problem.hyper.noise_rate + 0.5 * sums.residual(problem, &at.g));
    let stiffness = at.precision * at.g.mean_square();
    let reflectance = system.diagonal().into_iter().map(|x| stiffness * x);
    let metric = reflectance.chain(precisions.into_iter().skip(1)).chain([at.precision * sums.q]);
    let metric = metric.map(|x| x.max(1e-300)).collect();
    Round { cost: -log_posterior(problem, &at, sums), at, metric, a, system }
}

impl Round {
    /// The least cost on the line to other coordinates.
    fn towards(self, problem: &Problem<'_>, coordinates: &[f64], here: &[f64]) -> (AllMoments, f64) {
        let mut direction: Vec<f64> = coordinates.iter().zip(here).map(|(x, y)| x - y).collect();
        // The image is linear in the means of the light but where they are cut off.
        let light = problem.k()..problem.k() + problem.light.len();
        for (d, prior) in direction[light.clone()].iter_mut().zip(&problem.light) {
            if matches!(prior, CoefficientPrior::Rectified(_)) {
                *d = 0.0;
            }
        }
        let means: Vec<f64> = std::iter::once(0.0).chain(direction[light].iter().copied()).collect();
        let by = problem.bilinear.under_light(&means);
        let along = self.system.moved(problem, &self.a, &by);
        let at = |alpha: f64| {
            let there: Vec<f64> = here.iter().zip(&direction).map(|(x, d)| x + alpha * d).collect();
            let at = at_coordinates(problem, &self.at, &there);
            let cost = -log_posterior(problem, &at, along(alpha).sums(&at.f));
            (at, if cost.is_finite() { cost } else { f64::INFINITY })
        };
        search(1.0, 64.0, self.cost, |alpha| at(alpha).1).map(at).unwrap_or((self.at.clone(), self.cost))
    }
}

/// Rounds of ascent over blocks, each followed by a line search to where Anderson acceleration
/// points; the trace holds minus the log posterior. Ends after three changes below the tolerance.
fn ascend(
    problem: &Problem<'_>,
    mut at: AllMoments,
    grams: &Grams,
    settings: &JointMapSettings,
    progress: &dyn Fn(f64),
) -> (AllMoments, Vec<f64>, bool) {
    let mut trace: Vec<f64> = Vec::new();
    let mut anderson = Anderson::new();
    let mut settled = 0;
    for iteration in 0..settings.max_iterations.max(1) {
        let from = coordinates(&at);
        let end = round(problem, &at, grams);
        let here = coordinates(&end.at);
        let cost;
        (at, cost) = match anderson.next(&from, &here, &end.metric) {
            Some(there) => end.towards(problem, &there, &here),
            None => (end.at, end.cost),
        };
        let fell = trace.last().map_or(f64::INFINITY, |before| before - cost);
        trace.push(cost);
        progress(iteration as f64 / settings.max_iterations as f64);
        settled = if fell.abs() < settings.tolerance { settled + 1 } else { 0 };
        if settled >= 3 {
            return (at, trace, true);
        }
    }
    (at, trace, false)
}
