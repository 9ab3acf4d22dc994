//! Compares the separable posterior with samples of the exact one (eq. 10).

use std::collections::HashMap;

use gonio::inference::Hyperparameters;
use gonio::lighting::CoefficientPrior;
use nuts_rs::{Chain, CpuLogpFunc, CpuMath, CpuMathError, DiagNutsSettings, HasDims, LogpError, Settings};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::tests::planted;
use super::*;
use crate::testing::inner;

/// `log p(l, f, g, sigma^-2 | I)` up to a constant, as a function of free coordinates
/// `[log f_k][l_m, or log(l_m - T) where rectified][log g][log sigma^-2]`, Jacobian included.
///
/// With `z = f (x) l`, the residual is `sum I^2 - 2 g c'z + g^2 z'Gz`. The inference computes it in
/// another way.
#[derive(Clone)]
struct Exact {
    /// `G = sum_i A_i (x) A_i`, over `[k][m]`.
    gram: Vec<f64>,
    /// `c = sum_i I_i A_i`.
    target: Vec<f64>,
    energy: f64,
    pixels: f64,
    light: Vec<CoefficientPrior>,
    dc: f64,
    rates: Vec<f64>,
    hyper: Hyperparameters,
}

/// Point of the posterior in the variables of the model.
#[derive(Clone, Debug)]
struct Point {
    f: Vec<f64>,
    /// DC first.
    l: Vec<f64>,
    g: f64,
    precision: f64,
}

impl Exact {
    fn new(problem: &Problem<'_>) -> Self {
        let n = problem.k() * problem.m();
        let (mut gram, mut target) = (vec![0.0; n * n], vec![0.0; n]);
        for (i, &value) in problem.target.iter().enumerate() {
            let row = problem.bilinear.row(i);
            for (x, &a) in row.iter().enumerate() {
                target[x] += f64::from(a) * value;
                for (y, &b) in row.iter().enumerate() {
                    gram[x * n + y] += f64::from(a) * f64::from(b);
                }
            }
        }
        let light = problem.light.iter().copied().cloned().collect();
        let (energy, pixels, dc) = (problem.energy, problem.pixels, problem.dc);
        Self { gram, target, energy, pixels, light, dc, rates: problem.rates.clone(), hyper: problem.hyper }
    }

    fn len(&self) -> usize {
        self.rates.len() + self.light.len() + 2
    }

    fn point(&self, x: &[f64]) -> Point {
        let (k, m) = (self.rates.len(), self.light.len());
        let l = self.light.iter().zip(&x[k..]).map(|(prior, &x)| match prior {
            CoefficientPrior::Mixture(_) => x,
            CoefficientPrior::Rectified(r) => r.threshold + x.exp(),
        });
        Point {
            f: x[..k].iter().map(|x| x.exp()).collect(),
            l: std::iter::once(self.dc).chain(l).collect(),
            g: x[k + m].exp(),
            precision: x[k + m + 1].exp(),
        }
    }

    /// Returns the value and writes the gradient.
    fn evaluate(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let Point { f, l, g, precision } = self.point(x);
        let (k_count, m_count) = (f.len(), l.len());
        let z: Vec<f64> = f.iter().flat_map(|f| l.iter().map(move |l| f * l)).collect();
        let gz: Vec<f64> = self.gram.chunks_exact(z.len()).map(|row| inner(row, &z)).collect();
        let (cz, zgz) = (inner(&self.target, &z), inner(&z, &gz));
        let residual = self.energy - 2.0 * g * cz + g * g * zgz;
        // In the log of the precision, the Jacobian cancels the minus one of the shape.
        let shape = self.hyper.noise_shape + 0.5 * self.pixels;
        let fall = precision * (self.hyper.noise_rate + 0.5 * residual);
        let mut value = shape * precision.ln() - fall;
        gradient[k_count + m_count] = shape - fall;
        value += g.ln() - self.hyper.exposure_rate * g;
        gradient[k_count + m_count - 1] = 1.0 - self.hyper.exposure_rate * g + precision * (g * cz - g * g * zgz);
        // Gradient of the likelihood in z.
        let w: Vec<f64> = self.target.iter().zip(&gz).map(|(c, gz)| precision * (g * c - g * g * gz)).collect();
        for (k, (f, rate)) in f.iter().zip(&self.rates).enumerate() {
            value += f.ln() - rate * f;
            gradient[k] = 1.0 - rate * f + f * inner(&w[k * m_count..][..m_count], &l);
        }
        for (m, prior) in self.light.iter().enumerate().map(|(i, prior)| (i + 1, prior)) {
            let likelihood: f64 = f.iter().enumerate().map(|(k, f)| f * w[k * m_count + m]).sum();
            value += prior.log_density(l[m]);
            gradient[k_count + m - 1] = match prior {
                CoefficientPrior::Mixture(mixture) => {
                    let density = prior.log_density(l[m]);
                    let parts = mixture.log_joint(l[m] * l[m]).zip(&mixture.variances);
                    likelihood - l[m] * parts.map(|(joint, v)| (joint - density).exp() / v).sum::<f64>()
                }
                CoefficientPrior::Rectified(r) => {
                    let above = l[m] - r.threshold;
                    value += above.ln();
                    (likelihood - (l[m] - r.location) / r.variance) * above + 1.0
                }
            };
        }
        value
    }

    /// Draws the start of a chain roughly from the prior, so that chains start far from each other
    /// and from any solution.
    fn start(&self, rng: &mut Pcg64) -> Vec<f64> {
        let light = self.light.iter().map(|prior| match prior {
            CoefficientPrior::Mixture(m) => rng.random_range(-1.0..1.0) * m.variance().sqrt(),
            CoefficientPrior::Rectified(r) => (r.moments().mean - r.threshold).ln() + rng.random_range(-0.5..0.5),
        });
        let light: Vec<f64> = light.collect();
        let f = self.rates.iter().map(|rate| rng.random_range(-1.5..0.5) - rate.ln());
        let mut x: Vec<f64> = f.collect();
        x.extend(light);
        x.extend([rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)]);
        x
    }
}

/// Error of a density or gradient that overflows; the sampler rejects such a step.
#[derive(Debug, thiserror::Error)]
#[error("not finite")]
struct NotFinite;

impl LogpError for NotFinite {
    fn is_recoverable(&self) -> bool {
        true
    }
}

impl HasDims for Exact {
    fn dim_sizes(&self) -> HashMap<String, u64> {
        HashMap::from([("unconstrained_parameter".to_owned(), self.len() as u64)])
    }
}

impl CpuLogpFunc for Exact {
    type LogpError = NotFinite;
    type FlowParameters = ();
    type ExpandedVector = Vec<f64>;

    fn dim(&self) -> usize {
        self.len()
    }

    fn logp(&mut self, x: &[f64], gradient: &mut [f64]) -> Result<f64, NotFinite> {
        let value = self.evaluate(x, gradient);
        if value.is_finite() && gradient.iter().all(|g| g.is_finite()) { Ok(value) } else { Err(NotFinite) }
    }

    fn expand_vector<R: rand::Rng + ?Sized>(&mut self, _: &mut R, x: &[f64]) -> Result<Vec<f64>, CpuMathError> {
        Ok(x.to_vec())
    }
}

/// Draws of all chains, one chain after the other.
struct Draws {
    chains: Vec<Vec<Point>>,
    divergences: usize,
}

/// Mean of a function of the posterior, its standard deviation, and the Monte Carlo error of the
/// mean.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    mean: f64,
    sd: f64,
    error: f64,
}

const BATCHES: usize = 5;

impl Draws {
    fn of(exact: &Exact, chains: u64, tune: u64, count: usize) -> Self {
        let settings = DiagNutsSettings { num_tune: tune, maxdepth: 8, ..DiagNutsSettings::default() };
        let mut divergences = 0;
        let run = |chain: u64| {
            let mut rng = Pcg64::seed_from_u64(100 + chain);
            let start = exact.start(&mut rng);
            let mut sampler = settings.new_chain(chain, CpuMath::new(exact.clone()), &mut rng).unwrap();
            sampler.set_position(&start).unwrap();
            for _ in 0..tune {
                sampler.draw().unwrap();
            }
            let draw = |_| {
                let (x, info) = sampler.draw().unwrap();
                divergences += usize::from(info.diverging);
                exact.point(&x)
            };
            (0..count).map(draw).collect()
        };
        let chains = (0..chains).map(run).collect();
        Self { chains, divergences }
    }

    /// Estimates a function of the posterior, with the Monte Carlo error from the means of batches
    /// that are many autocorrelation times long.
    fn estimate(&self, of: impl Fn(&Point) -> f64) -> Estimate {
        let values: Vec<Vec<f64>> = self.chains.iter().map(|chain| chain.iter().map(&of).collect()).collect();
        let moments = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64;
            (mean, square.sqrt())
        };
        let (mean, sd) = moments(&values.concat());
        let batches: Vec<f64> =
            values.iter().flat_map(|c| c.chunks_exact(c.len() / BATCHES).map(|b| moments(b).0)).collect();
        Estimate { mean, sd, error: moments(&batches).1 / (batches.len() as f64).sqrt() }
    }
}

fn norm(x: &[f64]) -> f64 {
    inner(x, x).sqrt()
}

#[test]
fn gradient_matches_finite_differences_of_the_density() {
    let planted = planted(50, 3, 0.05, 21);
    let exact = Exact::new(&planted.problem());
    let mut rng = Pcg64::seed_from_u64(3);
    for _ in 0..5 {
        let x = exact.start(&mut rng);
        let mut gradient = vec![0.0; exact.len()];
        exact.evaluate(&x, &mut gradient);
        let scale = norm(&gradient);
        for i in 0..x.len() {
            let at = |h: f64| {
                let mut y = x.clone();
                y[i] += h;
                exact.evaluate(&y, &mut vec![0.0; x.len()])
            };
            let h = 1e-5;
            let slope = (at(h) - at(-h)) / (2.0 * h);
            assert!((slope - gradient[i]).abs() < 1e-6 * scale, "{i}: {slope} {}", gradient[i]);
        }
    }
}

/// Compares the exact posterior with the solver on one problem.
///
/// The DC of the light is fixed, but the image determines the pair `(f, g)` only up to a common
/// scale. The priors leave a ridge `g f = const`, along which the exact posterior spreads over a
/// factor of two. A separable q covers a small part of the ridge. The compared quantities are
/// therefore constant along the ridge: `f / |f|`, `g f`, the light, the noise.
///
/// Across the ridge, with at least 50 pixels per unknown, the posterior is nearly Gaussian. A
/// separable q has the exact mean of a Gaussian, but standard deviations that are too small. The
/// remaining difference is the bias from the truncation at zero and from the product of `l` and
/// `f`, measured to be below a twentieth of a standard deviation. The tolerance is twice that plus
/// five Monte Carlo errors.
fn compare(rows: usize, noise: f64) {
    let planted = planted(rows, 3, noise, 21);
    let problem = planted.problem();
    let draws = Draws::of(&Exact::new(&problem), 4, 500, 1000);
    assert_eq!(draws.divergences, 0);
    let fits = |e: Estimate, value: f64| (value - e.mean).abs() < 0.1 * e.sd + 5.0 * e.error;
    let directions = [0, 1, 2].map(|k| draws.estimate(|p| p.f[k] / norm(&p.f)));
    let agrees = |f: &[f64]| (0..3).all(|k| fits(directions[k], f[k] / norm(f)));
    for e in directions {
        // Four chains from different starts agree, and their error is small against the spread that
        // they measure.
        assert!(e.error < 0.05 * e.sd, "{e:?}");
    }
    let settings = VariationalSettings { starts: 3, tolerance: 1e-7, max_iterations: 6000, ..Default::default() };
    let got = infer(&problem, &Method::Variational(settings), &|_| ());
    assert!(agrees(&got.reflectance), "{:?} {directions:?}", got.reflectance);
    let exposure = got.exposure * problem.scale;
    for (k, f) in got.reflectance.iter().enumerate() {
        let e = draws.estimate(|p| p.g * p.f[k]);
        assert!(fits(e, exposure * f), "g f_{k}: {} {e:?}", exposure * f);
    }
    for (m, (l, sd)) in got.light.iter().zip(&got.light_sd).enumerate().skip(1) {
        let e = draws.estimate(|p| p.l[m]);
        assert!(fits(e, *l), "l_{m}: {l} {e:?}");
        assert!((0.75..1.05).contains(&(sd / e.sd)), "l_{m}: {sd} {e:?}");
    }
    let e = draws.estimate(|p| p.precision);
    assert!(fits(e, (got.noise * problem.scale).powi(-2)), "noise {} {e:?}", got.noise * problem.scale);
    // The exact posterior spreads along the ridge; q covers little of it.
    assert!(draws.estimate(|p| p.g.ln()).sd > 0.4 && got.exposure_sd < 0.05 * got.exposure);
    // The comparison rejects other solutions: the same numbers in another order, the prior mean,
    // and even the truth, since the noise of this image shifts the posterior.
    assert!(!agrees(&[planted.f[1], planted.f[2], planted.f[0]]));
    assert!(!agrees(&[1.0; 3]));
    assert!(!agrees(&planted.f), "{:?} {directions:?}", planted.f);
}

#[test]
fn the_solver_finds_the_mean_of_the_exact_posterior() {
    compare(200, 0.05);
}

#[test]
fn the_solver_finds_the_mean_in_a_noisy_image() {
    compare(100, 0.2);
}
