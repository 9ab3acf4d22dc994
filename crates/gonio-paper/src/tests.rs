//! Tests of the inference on small problems.

use gonio::inference::{Hyperparameters, ImageError};
use gonio::lighting::{LightPrior, ScaleMixture};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use super::ensemble::{AllMoments, Part};
use super::*;
use crate::testing::{inner, on_threads, toy_prior};

const SIDE: usize = 4;
const M: usize = SIDE * SIDE;

/// A random operator and the image of planted coefficients with noise.
pub(super) struct Planted {
    pub(super) image: Projected,
    pub(super) prior: LightPrior,
    pub(super) rates: Vec<f64>,
    l: Vec<f64>,
    pub(super) f: Vec<f64>,
}

pub(super) fn planted(rows: usize, k: usize, noise: f64, seed: u64) -> Planted {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let data = (0..rows * k * M).map(|_| rng.random_range(-1.0_f32..1.0)).collect();
    let bilinear = Bilinear::new(rows, k, M, data);
    let prior = toy_prior(SIDE);
    let mut l: Vec<f64> = prior
        .mean_and_variance(SIDE)
        .iter()
        .map(|(mean, variance)| {
            let z: f64 = StandardNormal.sample(&mut rng);
            mean + 0.7 * z * variance.sqrt()
        })
        .collect();
    l[2] = l[2].abs();
    let f: Vec<f64> = (0..k).map(|k| if k == 1 { 0.02 } else { 0.5 + 0.3 * k as f64 }).collect();
    let mut target = bilinear.apply(&l, &f);
    let rms = (target.iter().map(|x| x * x).sum::<f64>() / rows as f64).sqrt();
    for t in &mut target {
        let z: f64 = StandardNormal.sample(&mut rng);
        *t += noise * rms * z;
    }
    let image = Projected { bilinear, target, outside: 0.0, pixels: rows };
    Planted { image, prior, rates: vec![1.0; k], l, f }
}

impl Planted {
    pub(super) fn problem(&self) -> Problem<'_> {
        Problem::blind(&self.image, &self.prior, &self.rates, Hyperparameters::default()).unwrap()
    }

    fn cost(&self, ensemble: &VariationalParameters) -> f64 {
        let problem = self.problem();
        Expectations::new(&problem, ensemble).cost(&problem)
    }
}

pub(super) fn start(planted: &Planted, seed: u64) -> VariationalParameters {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let mut ensemble = VariationalParameters::random(&planted.problem(), 0.1, &mut rng);
    ensemble.set_log_noise(-2.0);
    ensemble
}

fn all(k: usize) -> Vec<Part> {
    let mut all: Vec<Part> = (0..k).map(Part::F).chain((1..M).map(Part::L)).collect();
    all.extend([Part::G, Part::Noise]);
    all
}

/// `ensemble` with one coordinate replaced by its update.
fn updated(problem: &Problem<'_>, ensemble: &VariationalParameters, which: Part) -> VariationalParameters {
    let now = Expectations::new(problem, ensemble);
    let full = now.update(problem, ensemble);
    let mut out = ensemble.clone();
    match which {
        Part::L(m) => {
            let (pull, l, g) = (now.pull(problem), &now.moments.l, &now.moments.g);
            let curvature = now.moments.precision * g.mean_square() * pull.curvature[m];
            let push = now.moments.precision * pull.light[m] + curvature * l[m].mean;
            light_system::minimise_coefficient(problem, &mut out, m, (curvature, push), l[m]);
        }
        part => out.copy(&full, part),
    }
    out
}

#[test]
fn a_coordinate_update_never_raises_the_cost() {
    for seed in 1..4 {
        let planted = planted(60, 3, 0.05, seed);
        let problem = planted.problem();
        let mut ensemble = start(&planted, seed);
        let mut cost = planted.cost(&ensemble);
        for sweep in 0..4 {
            for which in all(3) {
                ensemble = updated(&problem, &ensemble, which);
                let next = planted.cost(&ensemble);
                assert!(next <= cost + 1e-9 * cost.abs(), "sweep {sweep} {which:?}: {cost} -> {next}");
                cost = next;
            }
        }
    }
}

#[test]
fn the_gradient_vanishes_after_an_update() {
    let planted = planted(60, 3, 0.05, 7);
    let problem = planted.problem();
    let mut ensemble = start(&planted, 5);
    for which in all(3).into_iter().chain(all(3)) {
        ensemble = updated(&problem, &ensemble, which);
        for at in ensemble.indices_of(which) {
            let step = 1e-5;
            let mut direction = ensemble.minus(&ensemble);
            direction[at] = 1.0;
            let gradient = (planted.cost(&ensemble.moved(step, &direction))
                - planted.cost(&ensemble.moved(-step, &direction)))
                / (2.0 * step);
            // The cost is accurate to about 14 digits, so the error of a central difference is
            // about 1e-8 of it.
            assert!(gradient.abs() < 3e-7 * planted.cost(&ensemble).abs().max(1.0), "{which:?} at {at}: {gradient}");
        }
    }
}

#[test]
fn block_rounds_never_raise_the_cost() {
    let planted = planted(80, 3, 0.02, 3);
    let problem = planted.problem();
    let grams = grams::Grams::new(&problem);
    let mut ensemble = start(&planted, 2);
    let mut cost = planted.cost(&ensemble);
    for round in 0..30 {
        let next;
        (ensemble, next) = coordinate::round(&problem, &ensemble, &grams, round % 7 == 6);
        // The cost that the round returns equals that computed anew.
        let anew = planted.cost(&ensemble);
        assert!((anew - next).abs() < 1e-9 * next.abs(), "{anew} {next}");
        assert!(next <= cost + 1e-9 * cost.abs(), "round {round}: {cost} -> {next}");
        cost = next;
    }
}

/// Compares the expected residual with samples of q: checks every term of `E`.
#[test]
fn the_expected_residual_matches_sampling() {
    let planted = planted(20, 2, 0.1, 11);
    let problem = planted.problem();
    let ensemble = start(&planted, 3);
    let expected = Expectations::new(&problem, &ensemble);
    let expected = expected.sums.residual(&problem, &expected.moments.g);
    let AllMoments { f, l, g, .. } = ensemble.moments(&problem);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(8);
    // Only means and variances matter, so Gaussians with the same moments suffice.
    let mut draw = |m: &gonio::lighting::Moments| {
        let z: f64 = StandardNormal.sample(&mut rng);
        m.mean + z * m.variance.sqrt()
    };
    let n = 60_000;
    let (mut sum, mut square) = (0.0, 0.0);
    for _ in 0..n {
        let (f, l): (Vec<f64>, Vec<f64>) = (f.iter().map(&mut draw).collect(), l.iter().map(&mut draw).collect());
        let g = draw(&g);
        let y = planted.image.bilinear.apply(&l, &f);
        let e: f64 = problem.target.iter().zip(&y).map(|(i, y)| (i - g * y).powi(2)).sum();
        sum += e;
        square += e * e;
    }
    let mean = sum / f64::from(n);
    let error = ((square / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
    assert!((mean - expected).abs() < 4.0 * error, "{mean} +- {error} against {expected}");
}

/// Cosine between two vectors.
fn alike(a: &[f64], b: &[f64]) -> f64 {
    inner(a, b) / (inner(a, a) * inner(b, b)).sqrt()
}

fn solved(planted: &Planted, method: &Method) -> Posterior {
    infer(&planted.problem(), method, &|_| ())
}

#[test]
fn a_planted_solution_is_recovered() {
    let planted = planted(400, 3, 0.01, 21);
    let settings = VariationalSettings { starts: 3, max_iterations: 6000, ..Default::default() };
    let got = solved(&planted, &Method::Variational(settings));
    assert!(alike(&got.reflectance, &planted.f) > 0.9995, "{:?} {:?}", got.reflectance, planted.f);
    let light = alike(&got.light, &planted.l);
    assert!(light > 0.999, "light {light}, {:?}", got.starts);
    let rms = (planted.image.energy() / 400.0).sqrt();
    assert!((got.noise / rms / 0.01 - 1.0).abs() < 0.2, "noise {}", got.noise / rms);
    assert!(got.starts[got.best_start].converged, "{:?}", got.starts);
}

#[test]
fn line_searches_never_raise_the_cost() {
    let planted = planted(100, 3, 0.05, 5);
    let settings = VariationalSettings { solver: Solver::Printed, starts: 1, ..VariationalSettings::default() };
    let got = solved(&planted, &Method::Variational(settings));
    for w in got.trace.windows(2) {
        assert!(w[1] <= w[0] + 1e-9 * w[0].abs(), "{} -> {}", w[0], w[1]);
    }
}

#[test]
fn joint_maximum_ascends_and_recovers_a_planted_solution() {
    let planted = planted(400, 3, 0.01, 21);
    let got = solved(&planted, &Method::JointMap(JointMapSettings { max_iterations: 500, ..Default::default() }));
    for w in got.trace.windows(2) {
        assert!(w[1] <= w[0] + 1e-8 * w[0].abs(), "{} -> {}", w[0], w[1]);
    }
    assert!(alike(&got.reflectance, &planted.f) > 0.999, "{:?} {:?}", got.reflectance, planted.f);
}

#[test]
fn known_light_matches_non_negative_least_squares() {
    // Rows are images of the basis functions; noise so small that the priors do not matter.
    let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
    let (rows, truth) = (200, [0.8, 0.0, 0.3, 1.7]);
    let data: Vec<f32> = (0..rows * 4).map(|_| rng.random_range(0.0..1.0)).collect();
    let target = data.chunks(4).map(|a| a.iter().zip(truth).map(|(a, f)| f64::from(*a) * f).sum()).collect();
    let image = Projected { bilinear: Bilinear::new(rows, 4, 1, data), target, outside: 0.0, pixels: rows };
    let problem = Problem::with_known_light(&image, &[1.0; 4], Hyperparameters::default()).unwrap();
    let settings = VariationalSettings { solver: Solver::Blocks, starts: 1, ..Default::default() };
    let got = infer(&problem, &Method::Variational(settings), &|_| ());
    let f: Vec<f64> = got.reflectance.iter().map(|f| f * got.exposure).collect();
    for (got, want) in f.iter().zip(truth) {
        assert!((got - want).abs() < 5e-3, "{f:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_posterior_on_any_number_of_threads() {
    let planted = planted(120, 3, 0.05, 5);
    let run = |threads, seed| {
        let settings = VariationalSettings { seed, starts: 2, max_iterations: 60, ..Default::default() };
        on_threads(threads, || solved(&planted, &Method::Variational(settings)))
    };
    assert_eq!(run(1, 4), run(3, 4));
    assert_ne!(run(2, 4).trace, run(2, 5).trace);
}

#[test]
fn scaling_the_image_scales_exposure_and_noise_alone() {
    let mut planted = planted(120, 3, 0.05, 5);
    let method = Method::Variational(VariationalSettings { starts: 1, max_iterations: 60, ..Default::default() });
    let one = solved(&planted, &method);
    planted.image.target.iter_mut().for_each(|t| *t *= 1024.0);
    let two = solved(&planted, &method);
    assert_eq!(one.reflectance, two.reflectance);
    assert!((two.exposure / one.exposure / 1024.0 - 1.0).abs() < 1e-12);
    assert!((two.noise / one.noise / 1024.0 - 1.0).abs() < 1e-12);
}

#[test]
fn rejects_invalid_images_and_rates() {
    let mut p = planted(60, 2, 0.1, 1);
    assert_eq!(
        Problem::blind(&p.image, &p.prior, &[1.0], Hyperparameters::default()).unwrap_err(),
        ProblemError::Rates { rates: 1, k: 2 }
    );
    p.image.target[3] = f64::NAN;
    assert_eq!(
        Problem::blind(&p.image, &p.prior, &p.rates, Hyperparameters::default()).unwrap_err(),
        ImageError::NotFinite.into()
    );
    p.image.target.fill(0.0);
    assert_eq!(
        Problem::blind(&p.image, &p.prior, &p.rates, Hyperparameters::default()).unwrap_err(),
        ImageError::Black.into()
    );
}

#[test]
fn the_bound_of_the_mixture_prior_is_tight_at_a_point() {
    // With zero variance <log p> is log p itself.
    let mixture = ScaleMixture { weights: vec![0.3, 0.7], variances: vec![0.1, 3.0] };
    let prior = gonio::lighting::CoefficientPrior::Mixture(mixture.clone());
    let at = gonio::lighting::Moments { mean: 0.4, variance: 0.0, mean_log: 0.0 };
    assert!((expectations::expected_log_prior(&prior, &at) - mixture.log_density(0.4)).abs() < 1e-12);
}
