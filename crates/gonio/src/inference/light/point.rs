//! Bound at one state of the ascent, from one factorisation, and the next state of expectation
//! maximisation.

use std::f64::consts::TAU;

use gonio_linalg::dot;

use super::factor::{Design, Factor};
use super::scales::ConditionalPrior;
use super::{InferenceSettings, LightInference};
use crate::lighting::RectifiedGaussian;
use crate::search::golden_section;

/// State of an ascent.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct State {
    /// `<l_m^2>` (M), which determine the responsibilities.
    pub(super) squares: Vec<f64>,
    pub(super) log_g: f64,
    pub(super) log_b: f64,
}

impl State {
    pub(super) fn log_rho(&self) -> f64 {
        self.log_b + 2.0 * self.log_g
    }

    /// Returns the state with `by` added to `log rho`, through `b` if unknown, otherwise through
    /// `g`.
    pub(super) fn stretched(&self, by: f64, settings: &InferenceSettings) -> Self {
        let mut moved = self.clone();
        match (settings.noise, settings.exposure) {
            (None, _) => moved.log_b += by,
            (Some(_), None) => moved.log_g += 0.5 * by,
            _ => {}
        }
        moved
    }
}

/// Effect of rectification: the posterior of coefficient `c` is truncated at a threshold, and all
/// others follow by regression.
pub(super) struct Truncation {
    /// `Sigma_mc / Sigma_cc` (M).
    pub(super) regression: Vec<f64>,
    /// `Sigma_cc` minus the variance after the cut.
    pub(super) lost_variance: f64,
    /// Mean after the cut minus mean before.
    shift: f64,
    /// Logarithm of the mass above the threshold, after the image over before.
    log_mass: f64,
}

/// Bound at a state, from one factorisation.
pub(super) struct Point<'a> {
    pub(super) state: State,
    pub(super) factor: Factor<'a>,
    pub(super) given: ConditionalPrior,
    pub(super) bound: f64,
    pub(super) objective: f64,
    /// `<l>` (M).
    pub(super) light: Vec<f64>,
    /// `B <l>` (r).
    pub(super) image: Vec<f64>,
    pub(super) cut: Option<Truncation>,
    /// `B` times the regression of the cut (r), empty without one.
    cut_image: Vec<f64>,
    /// `Sigma_mm` before any cut (M); empty until [`Self::find_variances`].
    variances: Vec<f64>,
}

impl<'a> Point<'a> {
    /// Factorises at `state`. If neither exposure nor noise is known, `g` is set to its optimum for
    /// the state's `rho = b g^2`, which requires no factorisation.
    pub(super) fn new(
        inference: &LightInference<'_>,
        design: &'a Design,
        mut state: State,
        settings: &InferenceSettings,
    ) -> Option<Self> {
        let given = inference.scales.given(&state.squares);
        let log_rho = state.log_rho();
        let factor = Factor::new(design, &given.variances, log_rho.exp())?;
        let means = inference.scales.means();
        let mean_image = design.times(&means);
        let [from_target, from_mean] = factor.solve([&inference.target, &mean_image]);
        let [gain_target, gain_mean] = factor.gain([&from_target, &from_mean]);
        let misfit = Misfit {
            target: dot(&inference.target, &from_target),
            mixed: dot(&mean_image, &from_target),
            mean: dot(&mean_image, &from_mean),
        };
        let rectified = inference.scales.rectified.map(|(c, prior)| {
            let column = factor.covariance_column(c);
            (c, prior, column)
        });
        let marginal_of = |c: usize, prior: &RectifiedGaussian, variance: f64, log_g: f64| RectifiedGaussian {
            location: means[c] + gain_target[c] * (-log_g).exp() - gain_mean[c],
            variance,
            threshold: prior.threshold,
        };
        if settings.finds_both() {
            let log_mass = |log_g: f64| {
                let mass = |(c, prior, column): &(usize, RectifiedGaussian, Vec<f64>)| {
                    marginal_of(*c, prior, column[*c], log_g).log_mass()
                };
                rectified.as_ref().map_or(0.0, mass)
            };
            state.log_g = misfit.best_exposure(inference, log_rho, state.log_g, rectified.is_some(), &log_mass);
            state.log_b = log_rho - 2.0 * state.log_g;
        }
        let (g, b) = (state.log_g.exp(), state.log_b.exp());
        let mut light: Vec<f64> =
            means.iter().zip(gain_target.iter().zip(&gain_mean)).map(|(mu, (t, m))| mu + t / g - m).collect();
        let cut = rectified.map(|(c, prior, column)| {
            let before = marginal_of(c, &prior, column[c], state.log_g);
            let after = before.moments();
            let regression: Vec<f64> = column.iter().map(|s| s / column[c]).collect();
            Truncation {
                regression,
                lost_variance: column[c] - after.variance,
                shift: after.mean - before.location,
                log_mass: before.log_mass() - prior.log_mass(),
            }
        });
        if let Some(cut) = &cut {
            light.iter_mut().zip(&cut.regression).for_each(|(l, k)| *l += k * cut.shift);
        }
        let noise = 0.5 * inference.rows() * (state.log_b - TAU.ln());
        let bound = noise - 0.5 * (factor.log_det() + b * misfit.at(g))
            + given.constant
            + cut.as_ref().map_or(0.0, |cut| cut.log_mass);
        let mut objective = bound;
        if settings.exposure.is_none() {
            objective += inference.log_exposure_prior(state.log_g);
        }
        if settings.noise.is_none() {
            objective += inference.log_noise_prior(state.log_b);
        }
        let (image, cut_image) = match &cut {
            Some(cut) => {
                let [image, cut_image] = design.times_all([&light, &cut.regression]);
                (image, cut_image)
            }
            None => (design.times(&light), Vec::new()),
        };
        let variances = Vec::new();
        objective.is_finite().then_some(Self {
            state,
            factor,
            given,
            bound,
            objective,
            light,
            image,
            cut,
            cut_image,
            variances,
        })
    }

    /// Computes the posterior variances, which the next step and the result require.
    pub(super) fn find_variances(&mut self) {
        if self.variances.is_empty() {
            self.variances = self.factor.posterior_variances();
        }
    }

    /// `Sigma_mm` after the cut (M).
    pub(super) fn final_variances(&self) -> Vec<f64> {
        match &self.cut {
            None => self.variances.clone(),
            Some(cut) => {
                let less = cut.regression.iter().map(|k| k * k * cut.lost_variance);
                self.variances.iter().zip(less).map(|(v, less)| (v - less).max(0.0)).collect()
            }
        }
    }

    /// `<l_m^2>` (M).
    pub(super) fn squares(&self) -> Vec<f64> {
        self.light.iter().zip(self.final_variances()).map(|(l, v)| l * l + v).collect()
    }

    /// `rho tr(B Sigma B')`, with the covariance after the cut.
    pub(super) fn effective(&self) -> f64 {
        let before: f64 = self
            .variances
            .iter()
            .zip(&self.given.variances)
            .filter(|(_, prior)| **prior > 0.0)
            .map(|(posterior, prior)| 1.0 - posterior / prior)
            .sum();
        let cut =
            |cut: &Truncation| self.state.log_rho().exp() * cut.lost_variance * dot(&self.cut_image, &self.cut_image);
        before - self.cut.as_ref().map_or(0.0, cut)
    }

    /// Next state of expectation maximisation: responsibilities from the posterior of the light;
    /// then `g` given `b`, and `b` given `g`, from the expected squared residual
    /// `E = |t|^2 - 2 g t'B<l> + g^2 (|B<l>|^2 + tr(B Sigma B'))`.
    pub(super) fn maximised(&self, inference: &LightInference<'_>, settings: &InferenceSettings) -> State {
        let mut state = self.state.clone();
        let spread = self.effective() / state.log_rho().exp();
        state.squares = self.squares();
        let (along, square) = (dot(&inference.target, &self.image), dot(&self.image, &self.image) + spread);
        if settings.exposure.is_none() {
            // Positive root of -A g + P + 1/g, in the form without cancellation.
            let b = state.log_b.exp();
            let (a, p) = (b * square, b * along - inference.hyper.exposure_rate);
            let root = (p * p + 4.0 * a).sqrt();
            state.log_g = if p > 0.0 { (p + root) / (2.0 * a) } else { 2.0 / (root - p) }.ln();
        }
        if settings.noise.is_none() {
            let g = state.log_g.exp();
            let residual: f64 = inference.target.iter().zip(&self.image).map(|(t, y)| (t - g * y).powi(2)).sum();
            let error = residual + g * g * spread;
            let shape = inference.hyper.noise_shape + 0.5 * inference.rows();
            state.log_b = (shape / (inference.hyper.noise_rate + 0.5 * error)).ln();
        }
        state
    }
}

/// `e' S^-1 e` for the residual `e = t - g B mu` of the prior mean, as a quadratic in `g`.
struct Misfit {
    target: f64,
    mixed: f64,
    mean: f64,
}

impl Misfit {
    fn at(&self, g: f64) -> f64 {
        (self.target - 2.0 * g * self.mixed + g * g * self.mean).max(0.0)
    }

    /// Returns `log g` of the highest objective for a fixed `rho`, so that `b = rho / g^2`.
    ///
    /// Returns `current` if no value is better.
    fn best_exposure(
        &self,
        inference: &LightInference<'_>,
        log_rho: f64,
        current: f64,
        rectified: bool,
        log_mass: &dyn Fn(f64) -> f64,
    ) -> f64 {
        let objective = |u: f64| {
            let log_b = log_rho - 2.0 * u;
            0.5 * (inference.rows() * log_b - log_b.exp() * self.at(u.exp()))
                + inference.log_exposure_prior(u)
                + inference.log_noise_prior(log_b)
                + log_mass(u)
        };
        // Without the mass, the derivative in u is a cubic in 1/g whose coefficients change sign
        // once, so it has one root.
        let hyper = &inference.hyper;
        let (rho, n) = (log_rho.exp(), inference.rows() + 2.0 * hyper.noise_shape - 1.0);
        let falls = |u: f64| {
            let z = (-u).exp();
            rho * z * ((self.target + 2.0 * hyper.noise_rate) * z - self.mixed) < n + hyper.exposure_rate / z
        };
        let (mut low, mut high) = (-60.0, 60.0);
        while high - low > 1e-13 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if falls(middle) { high = middle } else { low = middle }
        }
        let mut best = 0.5 * (low + high);
        if rectified {
            best = golden_section(objective, (best - 0.5, best + 0.5), 1e-9);
        }
        if objective(best) >= objective(current) { best } else { current }
    }
}
