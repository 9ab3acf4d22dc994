//! Compares `C_KL` with the evidence: `C_KL` is minus the log evidence plus a divergence, including
//! all constants.

use std::f64::consts::TAU;

use gonio::inference::Hyperparameters;
use gonio::lighting::{CoefficientPrior, RectifiedGaussian, ScaleMixture};
use puruspe::ln_gamma;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Gamma, StandardNormal};
use rand_pcg::Pcg64;

use super::tests::planted;
use super::*;
use crate::{Bilinear, Projected};

/// `log p(I | theta)` of eq. 9 plus the logarithms of all priors, including all constants.
fn log_joint(problem: &Problem<'_>, f: &[f64], l: &[f64], g: f64, precision: f64) -> f64 {
    let y = problem.bilinear.apply(l, f);
    // The energy outside the rows is part of every residual.
    let outside = problem.energy - problem.target.iter().map(|i| i * i).sum::<f64>();
    let residual = outside + problem.target.iter().zip(&y).map(|(i, y)| (i - g * y).powi(2)).sum::<f64>();
    let likelihood = 0.5 * problem.pixels * (precision / TAU).ln() - 0.5 * precision * residual;
    let exponential = |rate: f64, x: f64| rate.ln() - rate * x;
    let reflectance: f64 = problem.rates.iter().zip(f).map(|(rate, f)| exponential(*rate, *f)).sum();
    let light: f64 = problem.light.iter().zip(&l[1..]).map(|(prior, l)| prior.log_density(*l)).sum();
    let Hyperparameters { exposure_rate, noise_shape, noise_rate } = problem.hyper;
    likelihood + reflectance + light + exponential(exposure_rate, g) + log_gamma(precision, noise_shape, noise_rate)
}

fn log_gamma(x: f64, shape: f64, rate: f64) -> f64 {
    shape * rate.ln() - ln_gamma(shape) + (shape - 1.0) * x.ln() - rate * x
}

/// Minimises the cost over all factors. The cost is a bound at any stopping point.
fn converged(problem: &Problem<'_>, mut ensemble: VariationalParameters) -> (VariationalParameters, f64) {
    let grams = grams::Grams::new(problem);
    let mut cost = f64::INFINITY;
    for _ in 0..1000 {
        let next;
        (ensemble, next) = coordinate::round(problem, &ensemble, &grams, true);
        if cost - next < 1e-9 {
            return (ensemble, next);
        }
        cost = next;
    }
    (ensemble, cost)
}

/// The image of one basis function under a known light, with noise relative to its brightness.
fn single(pixels: usize, noise: f64) -> Projected {
    let mut rng = Pcg64::seed_from_u64(17);
    let data: Vec<f32> = (0..pixels).map(|_| rng.random_range(0.5..1.5)).collect();
    let target = data.iter().map(|a| f64::from(*a) + noise * Distribution::<f64>::sample(&StandardNormal, &mut rng));
    let target = target.collect();
    Projected { bilinear: Bilinear::new(pixels, 1, 1, data), target, outside: 0.1 * noise * noise, pixels: pixels + 1 }
}

/// Returns `log p(I)` of a problem with one unknown reflectance coefficient.
///
/// The integral is a sum over grids in the logarithms of `h = g f` (the only quantity that the
/// image determines), of `g`, and of the precision.
fn log_evidence(problem: &Problem<'_>) -> f64 {
    let (low, step, count) = (-12.0, 1e-3, 16_000);
    // Subtracts the largest term to avoid overflow; all terms of the sum are positive.
    let sum_exp = |terms: &[f64]| {
        let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        top + terms.iter().map(|t| (t - top).exp()).sum::<f64>().ln()
    };
    let grid = |low: f64, high: f64, n: usize| -> Vec<f64> {
        (0..n).map(|i| (low + (high - low) * (i as f64 + 0.5) / n as f64).exp()).collect()
    };
    let (g_grid, p_grid) = (grid(-16.0, 14.0, 300), grid(-14.0, 18.0, 400));
    let (rate, hyper) = (problem.rates[0], problem.hyper);
    let target: f64 = problem.bilinear.adjoint(&problem.target)[0];
    let square = problem.bilinear.squares()[0];
    let over_h: Vec<f64> = (0..count)
        .map(|i| {
            let h = (low + step * (i as f64 + 0.5)).exp();
            let residual = problem.energy - 2.0 * h * target + h * h * square;
            // Jacobian: df dg = (h / g) dlog h dg = h dlog h dlog g.
            let prior = |g: &f64| (rate * hyper.exposure_rate * h).ln() - rate * h / g - hyper.exposure_rate * g;
            let noise = |p: &f64| {
                0.5 * problem.pixels * (p / TAU).ln() - 0.5 * p * residual
                    + log_gamma(*p, hyper.noise_shape, hyper.noise_rate)
                    + p.ln()
            };
            let g: Vec<f64> = g_grid.iter().map(prior).collect();
            let p: Vec<f64> = p_grid.iter().map(noise).collect();
            sum_exp(&g) + sum_exp(&p)
        })
        .collect();
    sum_exp(&over_h) + (step * (30.0 / 300.0) * (32.0 / 400.0)).ln()
}

/// Gap between the cost at convergence and minus the log evidence.
fn gap(pixels: usize, noise: f64, rate: f64, hyper: Hyperparameters) -> f64 {
    let image = single(pixels, noise);
    let problem = Problem::with_known_light(&image, &[rate], hyper).unwrap();
    // Steps along the ridge `g f = const` are short, so the start is where the priors balance, with
    // g near its final value.
    let mut ensemble = VariationalParameters::at(&[1.0], &[], 0.1);
    let g = (rate / hyper.exposure_rate).sqrt();
    ensemble.set_g(1e4 / g, 1e4 / (g * g));
    converged(&problem, ensemble).1 + log_evidence(&problem)
}

#[test]
fn the_cost_is_never_below_minus_the_log_evidence() {
    for hyper in [Hyperparameters::default(), Hyperparameters { exposure_rate: 1.0, noise_shape: 2.0, noise_rate: 0.1 }]
    {
        for (rate, pixels, noise) in [(1.0, 20, 0.1), (5.0, 20, 1.0), (1.0, 4, 3.0), (5.0, 4, 0.3)] {
            let gap = gap(pixels, noise, rate, hyper);
            assert!((-1e-6..6.0).contains(&gap), "{hyper:?} {rate} {pixels} {noise}: {gap}");
        }
    }
}

/// If the posterior is nearly separable, q is nearly the posterior, and the bound nearly equals the
/// evidence. Here, this holds if the priors are more informative than the image, since only the
/// likelihood couples `f` and `g`.
#[test]
fn the_bound_is_tight_where_the_posterior_is_separable() {
    let hyper = Hyperparameters { exposure_rate: 5.0, noise_shape: 50.0, noise_rate: 50.0 };
    let gaps = [0.1, 1.0, 3.0].map(|noise| gap(4, noise, 5.0, hyper));
    assert!(gaps[0] < 0.05 && gaps[1] < 0.02 && gaps[2] < 1e-3, "{gaps:?}");
    assert!(gaps.iter().all(|g| *g > -1e-6), "{gaps:?}");
}

/// The opposite case: the exact posterior lies along the ridge `g f = const`, with a relative width
/// `s` proportional to the noise, and q has this width in every direction. q covers a part of the
/// ridge proportional to `s`, so that the gap is `-log s` plus a constant: one decade of noise adds
/// `log 10`.
#[test]
fn gap_grows_as_q_covers_less_of_the_ridge() {
    let gaps = [0.1, 0.01].map(|noise| gap(20, noise, 1.0, Hyperparameters::default()));
    assert!((gaps[1] - gaps[0] - std::f64::consts::LN_10).abs() < 0.05, "{gaps:?}");
}

/// Parameters of every factor of q: `u` and `w`, and shape and rate for the noise.
struct Factors {
    f: Vec<RectifiedGaussian>,
    l: Vec<RectifiedGaussian>,
    g: RectifiedGaussian,
    noise: (f64, f64),
}

impl Factors {
    fn of(problem: &Problem<'_>, ensemble: &VariationalParameters) -> Self {
        let (k, light) = (problem.k(), problem.light.len());
        // All entries of its Phi are zero except those of the exposure, which are added back below.
        let zero = VariationalParameters::at(&vec![0.0; k], &vec![0.0; light], 1.0);
        let mut phi = ensemble.minus(&zero);
        let noise = ensemble.noise_index();
        phi[noise + 1] += 0.1;
        phi[noise + 2] += 0.1_f64.ln();
        let factor = |natural: usize, log_precision: usize, threshold: f64| {
            let variance = (-phi[log_precision]).exp();
            RectifiedGaussian { location: phi[natural] * variance, variance, threshold }
        };
        let threshold = |m: usize| match problem.light[m] {
            CoefficientPrior::Rectified(r) => r.threshold,
            // So low that it has no effect.
            CoefficientPrior::Mixture(_) => -1e6,
        };
        let shape = problem.noise_shape();
        Self {
            f: (0..k).map(|i| factor(i, k + i, 0.0)).collect(),
            l: (0..light).map(|m| factor(2 * k + m, 2 * k + light + m, threshold(m))).collect(),
            g: factor(noise + 1, noise + 2, 0.0),
            noise: (shape, shape * ensemble.log_noise().exp()),
        }
    }
}

/// Returns a draw and its log density.
fn draw(q: &RectifiedGaussian, rng: &mut Pcg64) -> (f64, f64) {
    loop {
        let z: f64 = StandardNormal.sample(rng);
        let x = q.location + z * q.variance.sqrt();
        if x >= q.threshold {
            return (x, q.log_density(x));
        }
    }
}

/// Checks every term of `C_KL`, light included, by sampling q: `<log q - log p(I, theta)>`.
#[test]
fn cost_matches_its_expectation_sampled_from_q() {
    let mut planted = planted(30, 2, 0.3, 21);
    for prior in &mut planted.prior.groups {
        // With one component the expectation of the log prior is exact instead of a bound.
        if let CoefficientPrior::Mixture(m) = prior {
            *m = ScaleMixture { weights: vec![1.0], variances: vec![m.variance()] };
        }
    }
    planted.rates = vec![0.7, 3.0];
    planted.image.outside = 0.02 * planted.image.energy();
    planted.image.pixels += 7;
    let hyper = Hyperparameters { exposure_rate: 0.4, noise_shape: 1.5, noise_rate: 0.2 };
    let problem = Problem::blind(&planted.image, &planted.prior, &planted.rates, hyper).unwrap();
    let (ensemble, cost) = converged(&problem, VariationalParameters::at(&[1.0, 1.0], &[0.0; 15], 0.1));
    let q = Factors::of(&problem, &ensemble);
    let mut rng = Pcg64::seed_from_u64(9);
    let gamma = Gamma::new(q.noise.0, 1.0 / q.noise.1).unwrap();
    let values: Vec<f64> = (0..40_000)
        .map(|_| {
            let mut log_q = 0.0;
            let mut take = |q: &RectifiedGaussian| {
                let (x, log) = draw(q, &mut rng);
                log_q += log;
                x
            };
            let f: Vec<f64> = q.f.iter().map(&mut take).collect();
            let l: Vec<f64> = std::iter::once(problem.dc).chain(q.l.iter().map(&mut take)).collect();
            let g = take(&q.g);
            let precision = gamma.sample(&mut rng);
            log_q += log_gamma(precision, q.noise.0, q.noise.1);
            log_q - log_joint(&problem, &f, &l, g, precision)
        })
        .collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let error = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n / n).sqrt();
    // A missing factor of two would shift the mean by 0.7.
    assert!(error < 0.03 && (mean - cost).abs() < 4.0 * error, "{mean} +- {error} against {cost}");
}
