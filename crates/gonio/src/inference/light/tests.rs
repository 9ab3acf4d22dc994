//! Tests of the bound and its ascent on problems small enough for other methods.

use std::f64::consts::TAU;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::factor::Design;
use super::point::State;
use super::*;
use crate::lighting::{CoefficientPrior, RectifiedGaussian, ScaleMixture};
use crate::testing::{on_threads, random, toy_prior};

pub(super) fn identity(n: usize) -> Vec<Vec<f64>> {
    (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect()
}

/// Inverse and log determinant by Gauss-Jordan elimination without pivoting, for positive definite
/// matrices.
pub(super) fn inverse_and_log_det(mut a: Vec<Vec<f64>>) -> (Vec<Vec<f64>>, f64) {
    let n = a.len();
    let (mut inverse, mut log_det) = (identity(n), 0.0);
    for i in 0..n {
        let pivot = a[i][i];
        log_det += pivot.ln();
        for j in 0..n {
            a[i][j] /= pivot;
            inverse[i][j] /= pivot;
        }
        let (row, inverse_row) = (a[i].clone(), inverse[i].clone());
        for k in (0..n).filter(|k| *k != i) {
            let factor = a[k][i];
            for j in 0..n {
                a[k][j] -= factor * row[j];
                inverse[k][j] -= factor * inverse_row[j];
            }
        }
    }
    (inverse, log_det)
}

/// Small image and priors, without scaling.
pub(super) struct Toy {
    priors: Vec<CoefficientPrior>,
    pub(super) target: Vec<f64>,
    pub(super) design: Design,
    pub(super) entries: Vec<f64>,
}

const DC: f64 = 0.3;

fn mixture(weights: &[f64], variances: &[f64]) -> CoefficientPrior {
    CoefficientPrior::Mixture(ScaleMixture { weights: weights.to_vec(), variances: variances.to_vec() })
}

fn cut() -> CoefficientPrior {
    CoefficientPrior::Rectified(RectifiedGaussian { location: 0.1, variance: 0.3, threshold: -0.1 })
}

fn one_component(m: usize) -> Vec<CoefficientPrior> {
    (1..m).map(|i| mixture(&[1.0], &[0.1 + 0.2 * i as f64])).collect()
}

pub(super) fn mixed(m: usize) -> Vec<CoefficientPrior> {
    (1..m)
        .map(|i| if i == 2 { cut() } else { mixture(&[0.5, 0.3, 0.2], &[0.002 * i as f64, 0.1, 1.0 + i as f64]) })
        .collect()
}

impl Toy {
    pub(super) fn new(rows: usize, priors: Vec<CoefficientPrior>, noise: f64, seed: u64) -> Self {
        let m = priors.len() + 1;
        let entries = random(rows * m, seed);
        let l: Vec<f64> = random(m, seed + 1).iter().enumerate().map(|(i, x)| if i == 0 { DC } else { *x }).collect();
        let target = entries
            .chunks(m)
            .zip(random(rows, seed + 2))
            .map(|(b, e)| 1.5 * b.iter().zip(&l).map(|(b, l)| b * l).sum::<f64>() + noise * e);
        Self { target: target.collect(), design: Design::of_rows(rows, m, &entries, None), entries, priors }
    }

    pub(super) fn inference(&self) -> LightInference<'_> {
        let priors: Vec<&CoefficientPrior> = self.priors.iter().collect();
        LightInference {
            target: self.target.clone(),
            scale: 1.0,
            scales: Scales::new(DC, &priors),
            hyper: Hyperparameters { exposure_rate: 0.2, noise_shape: 2.0, noise_rate: 0.01 },
        }
    }

    pub(super) fn posterior(&self, settings: &InferenceSettings) -> LightPosterior {
        self.inference().posterior(&self.design, settings, None).unwrap()
    }

    /// Logarithm of the Gaussian density of an image, with light of given means and variances, by
    /// dense algebra.
    fn dense(&self, means: &[f64], variances: &[f64], g: f64, b: f64) -> f64 {
        let (rows, m) = (self.target.len(), means.len());
        let row = |i: usize| &self.entries[i * m..][..m];
        let covariance = |i: usize, j: usize| {
            let signal = row(i).iter().zip(row(j)).zip(variances).map(|((p, q), v)| p * q * v).sum::<f64>();
            g * g * signal + if i == j { 1.0 / b } else { 0.0 }
        };
        let s = (0..rows).map(|i| (0..rows).map(|j| covariance(i, j)).collect()).collect();
        let (inverse, log_det) = inverse_and_log_det(s);
        let y: Vec<f64> = (self.target.iter().zip(self.entries.chunks(m)))
            .map(|(t, b)| t - g * b.iter().zip(means).map(|(b, l)| b * l).sum::<f64>())
            .collect();
        let square: f64 = (0..rows).map(|i| (0..rows).map(|j| y[i] * inverse[i][j] * y[j]).sum::<f64>()).sum();
        -0.5 * (rows as f64 * TAU.ln() + log_det + square)
    }

    /// `log p(t)` by a sum over a grid of all unknown light coefficients.
    fn integrated(&self, g: f64, b: f64) -> f64 {
        let (m, n, reach) = (self.priors.len() + 1, 1500, 8.0);
        let step = 2.0 * reach / f64::from(n);
        // The centres of the cells are symmetric about the threshold of the rectified prior, -0.1.
        let grid: Vec<f64> = (0..n).map(|i| -reach - 0.1 + step * (f64::from(i) + 0.5)).collect();
        let log_prior: Vec<Vec<f64>> =
            self.priors.iter().map(|p| grid.iter().map(|x| p.log_density(*x)).collect()).collect();
        let log_joint = |at: &[usize]| {
            let mut total = 0.5 * self.target.len() as f64 * (b / TAU).ln();
            for (t, row) in self.target.iter().zip(self.entries.chunks(m)) {
                let y = row[0] * DC + at.iter().zip(&row[1..]).map(|(i, b)| b * grid[*i]).sum::<f64>();
                total -= 0.5 * b * (t - g * y).powi(2);
            }
            total + at.iter().zip(&log_prior).map(|(i, p)| p[*i]).sum::<f64>()
        };
        let n = n as usize;
        let terms: Vec<f64> = match m {
            2 => (0..n).map(|i| log_joint(&[i])).collect(),
            3 => (0..n * n).map(|i| log_joint(&[i / n, i % n])).collect(),
            _ => unreachable!("one or two dimensions"),
        };
        let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        top + terms.iter().map(|t| (t - top).exp()).sum::<f64>().ln() + (m - 1) as f64 * step.ln()
    }
}

pub(super) fn known(g: f64, b: f64) -> InferenceSettings {
    InferenceSettings { exposure: Some(g), noise: Some(b.powf(-0.5)), tolerance: 1e-10, max_steps: 400 }
}

fn tight() -> InferenceSettings {
    InferenceSettings { tolerance: 1e-10, max_steps: 2000, ..Default::default() }
}

#[test]
fn bound_matches_the_dense_gaussian_for_one_component() {
    for (rows, m) in [(5, 9), (9, 5), (40, 6)] {
        let toy = Toy::new(rows, one_component(m), 0.1, 7);
        let mut means = vec![0.0; m];
        means[0] = DC;
        let variances: Vec<f64> = (0..m).map(|i| if i == 0 { 0.0 } else { 0.1 + 0.2 * i as f64 }).collect();
        for (g, b) in [(1.5, 100.0), (0.3, 4.0)] {
            let (got, want) = (toy.posterior(&known(g, b)), toy.dense(&means, &variances, g, b));
            assert!((got.bound - want).abs() < 1e-9 * want.abs(), "{rows} {m}: {} {want}", got.bound);
        }
    }
}

#[test]
fn the_bound_is_below_the_integral_and_equal_for_one_component() {
    for (noise, b) in [(0.1, 60.0), (0.5, 3.0)] {
        for (priors, exact) in [
            (vec![mixture(&[1.0], &[0.5])], true),
            (vec![cut()], true),
            (vec![mixture(&[1.0], &[0.5]), cut()], true),
            (vec![mixture(&[0.6, 0.4], &[0.02, 0.9])], false),
            (vec![mixture(&[0.6, 0.4], &[0.02, 0.9]), cut()], false),
            (vec![mixture(&[0.6, 0.4], &[0.02, 0.9]), mixture(&[0.3, 0.3, 0.4], &[0.01, 0.2, 1.0])], false),
        ] {
            let toy = Toy::new(3, priors, noise, 12);
            let (got, want) = (toy.posterior(&known(1.2, b)), toy.integrated(1.2, b));
            let gap = want - got.bound;
            if exact {
                assert!(gap.abs() < 1e-4, "{:?}: {} {want}", toy.priors, got.bound);
            } else {
                assert!((-1e-5..1.5).contains(&gap), "{:?}: {} {want}", toy.priors, got.bound);
            }
        }
    }
}

/// Twelve coefficients of two components each: the evidence is the sum over all 4096 choices of
/// components, each a Gaussian.
#[test]
fn the_bound_is_near_the_sum_over_all_components() {
    for (seed, rows, noise, b) in [(1, 6, 0.1, 50.0), (2, 16, 0.1, 50.0), (3, 6, 1.0, 1.0)] {
        let (weights, variances) = ([0.6, 0.4], [0.02, 0.9]);
        let toy = Toy::new(rows, vec![mixture(&weights, &variances); 12], noise, seed);
        let mut means = vec![0.0; 13];
        means[0] = DC;
        let terms: Vec<f64> = (0..1 << 12)
            .map(|choice: usize| {
                let bit = |m: usize| choice >> m & 1;
                let log_weight: f64 = (0..12).map(|m| f64::ln(weights[bit(m)])).sum();
                let chosen: Vec<f64> = std::iter::once(0.0).chain((0..12).map(|m| variances[bit(m)])).collect();
                log_weight + toy.dense(&means, &chosen, 1.3, b)
            })
            .collect();
        let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let want = top + terms.iter().map(|t| (t - top).exp()).sum::<f64>().ln();
        let got = toy.posterior(&known(1.3, b));
        assert!(got.bound < want, "{} {want}", got.bound);
        // With only the components that the ascent starts from, the bound would be 10 and 12 lower
        // in the first and last case.
        assert!(want - got.bound < 7.0, "{} {want}", got.bound);
    }
}

/// With rectification the posterior of the light is a truncated Gaussian; its moments are compared
/// with integration.
#[test]
fn rectified_posterior_matches_integration() {
    let toy = Toy::new(2, vec![mixture(&[1.0], &[0.5]), cut()], 0.6, 4);
    let (g, b) = (1.2, 2.0);
    let got = toy.posterior(&known(g, b));
    // Sums over a grid.
    let (mut total, mut first, mut second) = (0.0, [0.0; 2], [0.0; 2]);
    let n = 1200;
    for i in 0..n {
        for j in 0..n {
            let l =
                [-6.0 + 12.0 * (f64::from(i) + 0.5) / f64::from(n), -0.1 + 6.0 * (f64::from(j) + 0.5) / f64::from(n)];
            let mut log = toy.priors[0].log_density(l[0]) + toy.priors[1].log_density(l[1]);
            for (t, row) in toy.target.iter().zip(toy.entries.chunks(3)) {
                log -= 0.5 * b * (t - g * (row[0] * DC + row[1] * l[0] + row[2] * l[1])).powi(2);
            }
            let p = log.exp();
            total += p;
            for k in 0..2 {
                first[k] += p * l[k];
                second[k] += p * l[k] * l[k];
            }
        }
    }
    for k in 0..2 {
        let mean = first[k] / total;
        let sd = (second[k] / total - mean * mean).sqrt();
        assert!((got.light[k + 1] - mean).abs() < 1e-4, "{} {mean}", got.light[k + 1]);
        assert!((got.light_sd[k + 1] - sd).abs() < 1e-4, "{} {sd}", got.light_sd[k + 1]);
    }
}

#[test]
fn the_posterior_mean_is_ridge_regression() {
    let toy = Toy::new(12, one_component(6), 0.2, 9);
    let (g, b) = (1.5, 25.0);
    let got = toy.posterior(&known(g, b));
    // (b g^2 B'B + D) (l - mu) = b g B'(t - g B mu), over the coefficients after DC.
    let column = |j: usize| toy.entries.iter().skip(j).step_by(6);
    let entry = |i: usize, j: usize| {
        let own = if i == j { 1.0 / (0.1 + 0.2 * (i + 1) as f64) } else { 0.0 };
        own + b * g * g * column(i + 1).zip(column(j + 1)).map(|(x, y)| x * y).sum::<f64>()
    };
    let normal = (0..5).map(|i| (0..5).map(|j| entry(i, j)).collect()).collect();
    let (covariance, _) = inverse_and_log_det(normal);
    let rest: Vec<f64> = toy.target.iter().zip(column(0)).map(|(t, x)| t - g * x * DC).collect();
    let right: Vec<f64> = (0..5).map(|j| b * g * column(j + 1).zip(&rest).map(|(x, r)| x * r).sum::<f64>()).collect();
    assert_eq!((got.light[0], got.light_sd[0]), (DC, 0.0));
    for (i, row) in covariance.iter().enumerate() {
        let mean: f64 = row.iter().zip(&right).map(|(c, r)| c * r).sum();
        assert!((got.light[i + 1] - mean).abs() < 1e-10, "{} {mean}", got.light[i + 1]);
        assert!((got.light_sd[i + 1] - row[i].sqrt()).abs() < 1e-10);
    }
}

#[test]
fn no_step_lowers_the_objective() {
    for seed in 0..6 {
        for (rows, m) in [(10, 16), (30, 16)] {
            let toy = Toy::new(rows, mixed(m), 0.05, seed);
            for settings in [
                tight(),
                known(1.5, 400.0),
                InferenceSettings { noise: Some(0.05), ..tight() },
                InferenceSettings { exposure: Some(1.5), ..tight() },
            ] {
                let got = toy.posterior(&settings);
                assert!(got.trace.windows(2).all(|w| w[1] >= w[0]), "{:?}", got.trace);
                assert!(got.converged && got.trace.len() > 3, "{:?}", got.trace);
                assert_eq!(*got.trace.last().unwrap(), got.objective);
            }
        }
    }
}

/// At convergence, the derivatives of the bound by exposure and noise (finite differences at the
/// same posterior of the light) and those of their priors sum to zero.
#[test]
fn exposure_and_noise_reach_their_optimum() {
    let toy = Toy::new(30, mixed(16), 0.05, 3);
    let inference = toy.inference();
    let got = toy.posterior(&InferenceSettings { tolerance: 1e-13, ..tight() });
    let (g, b) = (got.exposure, got.noise.powi(-2));
    let bound = |g: f64, b: f64| {
        let (log_g, log_b) = (g.ln(), b.ln());
        let start = State { log_g, log_b, ..got.state.clone() };
        inference.maximise(&toy.design, start, &known(g, b)).unwrap().bound
    };
    let step = 1e-4_f64.exp();
    let by_g = (bound(g * step, b) - bound(g / step, b)) / 2e-4 + 1.0 - inference.hyper.exposure_rate * g;
    let by_b =
        (bound(g, b * step) - bound(g, b / step)) / 2e-4 + inference.hyper.noise_shape - inference.hyper.noise_rate * b;
    assert!(by_g.abs() < 2e-4 && by_b.abs() < 2e-4, "{by_g} {by_b}");
}

/// An orthogonal transform of the rows has no effect.
#[test]
fn bound_is_invariant_to_rotation_of_rows() {
    let mut toy = Toy::new(20, mixed(9), 0.1, 8);
    let one = toy.posterior(&tight());
    let m = 9;
    let normal = random(20, 77);
    let square: f64 = normal.iter().map(|x| x * x).sum();
    let reflect = |x: &mut dyn FnMut(usize) -> f64| -> Vec<f64> {
        let x: Vec<f64> = (0..20).map(x).collect();
        let along = 2.0 * x.iter().zip(&normal).map(|(x, n)| x * n).sum::<f64>() / square;
        x.iter().zip(&normal).map(|(x, n)| x - along * n).collect()
    };
    let columns: Vec<Vec<f64>> = (0..m).map(|j| reflect(&mut |i| toy.entries[i * m + j])).collect();
    toy.target = reflect(&mut |i| toy.target[i]);
    toy.entries = (0..20).flat_map(|i| columns.iter().map(move |c| c[i])).collect();
    toy.design = Design::of_rows(20, m, &toy.entries, None);
    let two = toy.posterior(&tight());
    assert!((one.objective - two.objective).abs() < 1e-7, "{} {}", one.objective, two.objective);
    assert!((one.exposure / two.exposure - 1.0).abs() < 1e-5 && (one.noise / two.noise - 1.0).abs() < 1e-5);
    assert!(one.light.iter().zip(&two.light).all(|(a, b)| (a - b).abs() < 1e-5));
}

#[test]
fn scaling_the_image_scales_exposure_and_noise_alone() {
    let (rows, m) = (60, 16);
    let (design, prior) = (Design::of_rows(rows, m, &random(rows * m, 3), None), toy_prior(4));
    let light: Vec<f64> =
        prior.mean_and_variance(4).iter().map(|(mean, variance)| mean + 0.5 * variance.sqrt()).collect();
    let image: Vec<f64> = design.times(&light).iter().zip(random(rows, 4)).map(|(y, e)| y + 0.02 * e).collect();
    let evidence = |factor: f64| {
        let target: Vec<f64> = image.iter().map(|t| factor * t).collect();
        let inference = LightInference::new(&target, m, &prior, Hyperparameters::default()).unwrap();
        inference.posterior(&design, &tight(), None).unwrap()
    };
    let (one, two) = (evidence(1.0), evidence(1024.0));
    assert!((two.exposure / one.exposure / 1024.0 - 1.0).abs() < 1e-9);
    assert!((two.noise / one.noise / 1024.0 - 1.0).abs() < 1e-9);
    assert!((one.objective - two.objective).abs() < 1e-9 * one.objective.abs());
}

#[test]
fn result_is_independent_of_threads() {
    // More rows and columns than one band.
    let (rows, m) = (160, 256);
    let design = Design::of_rows(rows, m, &random(rows * m, 2), None);
    let mut rng = Pcg64::seed_from_u64(1);
    let light: Vec<f64> = (0..m).map(|_| 0.1 * Distribution::<f64>::sample(&StandardNormal, &mut rng)).collect();
    let (target, prior) = (design.times(&light), toy_prior(16));
    let inference = LightInference::new(&target, m, &prior, Hyperparameters::default()).unwrap();
    let settings = InferenceSettings { max_steps: 5, ..Default::default() };
    let run = || inference.posterior(&design, &settings, None).unwrap();
    assert_eq!(on_threads(1, run), on_threads(3, run));
}

/// With known light the image has a single, constant coefficient, and only the noise remains.
#[test]
fn a_known_light_has_the_evidence_of_its_residual() {
    let toy = Toy::new(12, Vec::new(), 0.2, 3);
    let (g, b) = (1.4, 20.0);
    let residual: f64 = toy.target.iter().zip(&toy.entries).map(|(t, x)| (t - g * x * DC).powi(2)).sum();
    let want = 0.5 * (12.0 * (b / TAU).ln() - b * residual);
    assert!((toy.posterior(&known(g, b)).bound - want).abs() < 1e-9 * want.abs());
    assert!(toy.posterior(&tight()).converged);
}

#[test]
fn rejects_designs_that_are_not_finite() {
    let toy = Toy::new(4, one_component(3), 0.1, 1);
    let mut entries = toy.entries.clone();
    entries[5] = f64::NAN;
    let design = Design::of_rows(4, 3, &entries, None);
    let got = toy.inference().posterior(&design, &InferenceSettings::default(), None);
    assert_eq!(got.unwrap_err(), LightInferenceError::NotFinite);
    // A black design explains nothing, but its evidence exists.
    let black = Design::of_rows(4, 3, &[0.0; 12], None);
    assert!(
        toy.inference().posterior(&black, &InferenceSettings::default(), None).unwrap().objective
            < toy.posterior(&tight()).objective
    );
}
