//! The most probable material, by damped Gauss-Newton steps.

use std::ops::Range;

use faer::{Accum, Mat};
use gonio_linalg::{Cholesky, multiply};

use super::error_model::ErrorModel;
use super::light::Operator;
use super::space::ParameterSpace;
use super::{KnownLightError, ObservedPoints};
use crate::parallel;
use crate::reflectance::CELLS;
use crate::statistics::median;

/// Number of rounds. The error model is re-estimated before the steps of a round and fixed during
/// them, so that all steps of a round lower the same cost.
const ROUNDS: usize = 4;

/// Largest number of steps of each round.
const ROUND_STEPS: usize = 25;

/// Decrease of the cost, in nats, below which a round ends.
const SETTLED: f64 = 0.01;

/// Largest change of the logarithm of reflectance in one step.
const MAX_STEP: f64 = 3.0;

/// Share of the mean value that is added to values before taking logarithms, since camera noise
/// dominates dark pixels.
pub(super) const LOG_FLOOR: f64 = 0.01;

/// Prior standard deviation of the logarithm of the ratio of the true radiance of clipped pixels to
/// that in the map. Half a stop is common; up to five stops occur.
const GAIN: f64 = 1.5;

/// Prior of the coefficients and of the errors of an image.
#[derive(Clone, Copy, Debug)]
pub(super) struct FitPrior {
    /// Initial standard deviation of the spline coefficients, in the logarithm of reflectance.
    pub(super) deviation: f64,
    /// Range of that standard deviation.
    pub(super) deviations: (f64, f64),
    /// Range of the standard deviation of the coefficients of the axes, whose initial value is one.
    pub(super) axis_deviations: (f64, f64),
    /// Precision of the constant.
    pub(super) constant_precision: f64,
    /// Smallest standard deviation of the discrepancy.
    pub(super) min_discrepancy: f64,
}

impl FitPrior {
    /// Prior of a material. The smallest discrepancy is the residual of the best bivariate table
    /// for a rendering of a measured material (docs/trials.md).
    pub(super) const MATERIAL: Self = Self {
        deviation: 0.2,
        deviations: (0.1, 1.0),
        axis_deviations: (1.0, 1.0),
        constant_precision: 0.0,
        min_discrepancy: 0.045,
    };
}

/// Logarithm of an image under a known light, and the prior of its material.
///
/// `I_i = sum_c (R_ic + g S_ic) F_c`, where `S` is the matrix of the clipped pixels of the light,
/// and `R` that of the others. The last coefficient is `ln g` if the light has clipped pixels.
pub(super) struct ImageModel<'a> {
    operator: &'a Operator,
    logs: Vec<f64>,
    floor: f64,
    space: &'a ParameterSpace,
    prior: FitPrior,
    precisions: Vec<f64>,
}

/// Coefficients, with the reflectance, image and residuals that follow from them.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub(super) coefficients: Vec<f64>,
    pub(super) values: Vec<f64>,
    pub(super) predicted: Vec<f64>,
    pub(super) residuals: Vec<f64>,
}

/// Result of a fit.
#[derive(Clone, Debug)]
pub(super) struct LaplaceFit {
    pub(super) state: State,
    /// Factor of the inverse covariance of the coefficients.
    pub(super) curvature: Cholesky,
    pub(super) errors: ErrorModel,
    /// Standard deviation of the spline coefficients in `curvature`.
    pub(super) deviation: f64,
    /// Costs of each round: before its first step, then after every step.
    #[cfg(test)]
    pub(super) trace: Vec<Vec<f64>>,
    pub(super) converged: bool,
}

impl<'a> ImageModel<'a> {
    /// Builds the log image of the observed rows.
    ///
    /// # Errors
    /// If the light or the photograph is black.
    pub(super) fn of(
        operator: &'a Operator,
        rows: &ObservedPoints<'_>,
        space: &'a ParameterSpace,
        prior: FitPrior,
    ) -> Result<Self, KnownLightError> {
        let count = operator.len();
        assert!(count == rows.points.len() && count == rows.values.len() && count == rows.weights.len());
        if operator.apply(&vec![1.0; CELLS], 1.0).into_iter().all(|v| v <= 0.0) {
            return Err(KnownLightError::Dark);
        }
        if rows.values.iter().all(|v| *v <= 0.0) {
            return Err(KnownLightError::Black);
        }
        Ok(Self::new(operator, rows.values, space, prior))
    }

    /// Builds the image of values, at least one of them positive, under a light that is not black.
    fn new(operator: &'a Operator, values: &[f64], space: &'a ParameterSpace, prior: FitPrior) -> Self {
        let floor = LOG_FLOOR * values.iter().sum::<f64>() / values.len() as f64;
        let logs = values.iter().map(|v| (v.max(0.0) + floor).ln()).collect();
        let mut image = Self { operator, logs, floor, space, prior, precisions: Vec::new() };
        image.expect(prior.deviation, 1.0);
        image
    }

    /// Sets the standard deviations of the coefficients of the splines and of the axes.
    fn expect(&mut self, splines: f64, axes: f64) {
        self.precisions = vec![axes.powi(-2); self.space.len()];
        self.precisions[self.space.splines()].fill(splines.powi(-2));
        self.precisions[self.space.len() - 1] = self.prior.constant_precision;
        if self.operator.clips() {
            self.precisions.push(GAIN.powi(-2));
        }
    }

    /// Returns the number of coefficients.
    pub(super) fn len(&self) -> usize {
        self.precisions.len()
    }

    /// Returns the state of a material at the given prior coordinates, with the best constant.
    pub(super) fn start(&self, coordinates: &[f64], gain: f64) -> State {
        let mut coefficients = self.space.at(coordinates);
        if self.operator.clips() {
            coefficients.push(gain.ln());
        }
        let mut state = self.state(coefficients);
        state.coefficients[self.space.len() - 1] += median(state.residuals.iter().copied()).unwrap_or(0.0);
        self.state(state.coefficients)
    }

    /// Returns the gain of the clipped pixels.
    pub(super) fn gain(&self, coefficients: &[f64]) -> f64 {
        coefficients.get(self.space.len()).map_or(1.0, |log| log.exp())
    }

    pub(super) fn state(&self, coefficients: Vec<f64>) -> State {
        let values = self.space.values(&coefficients);
        let predicted = self.operator.apply(&values, self.gain(&coefficients));
        let residuals = self.logs.iter().zip(&predicted).map(|(log, p)| log - (p + self.floor).ln()).collect();
        State { coefficients, values, predicted, residuals }
    }

    /// Computes the derivatives of the logarithm of the image (N x n).
    fn all_derivatives(&self, state: &State) -> Mat<f64> {
        self.derivatives(state, &Vec::from_iter(0..state.predicted.len()))
    }

    /// Computes the derivatives of the logarithm of these rows of the image (N x n).
    pub(super) fn derivatives(&self, state: &State, rows: &[usize]) -> Mat<f64> {
        let (n, gain) = (self.len(), self.gain(&state.coefficients));
        let rows: Vec<Vec<f64>> = parallel::map(rows, |&at| {
            let scale = 1.0 / (state.predicted[at] + self.floor);
            let weights = self.operator.row(at, gain).map(|(cell, weight)| (cell, scale * weight * state.values[cell]));
            let mut row = self.space.sum_of_derivatives(weights);
            row.resize(n, 0.0);
            if self.operator.clips() {
                row[n - 1] = scale * gain * self.operator.under_clipped(at, &state.values);
            }
            row
        });
        Mat::from_fn(rows.len(), n, |i, j| rows[i][j])
    }

    /// Returns the precisions of the prior of the coefficients.
    pub(super) fn precisions(&self) -> &[f64] {
        &self.precisions
    }

    /// Returns the logarithm of a value plus the floor.
    pub(super) fn log(&self, value: f64) -> f64 {
        (value.max(0.0) + self.floor).ln()
    }

    fn prior(&self, coefficients: &[f64]) -> f64 {
        0.5 * self.precisions.iter().zip(coefficients).map(|(p, x)| p * x * x).sum::<f64>()
    }

    /// Computes the cost of a state: minus the logarithm of the posterior, without constants.
    fn cost(&self, state: &State, covariance: &Cholesky) -> f64 {
        0.5 * whitened(covariance, &state.residuals).iter().map(|r| r * r).sum::<f64>()
            + self.prior(&state.coefficients)
    }

    /// Fits the material to the rows from a state.
    ///
    /// # Errors
    /// If the equations have no solution.
    pub(super) fn fit_to(&mut self, rows: &ObservedPoints<'_>, start: State) -> Result<LaplaceFit, KnownLightError> {
        let errors = ErrorModel::new(&rows.normals(), rows.trusts(), self.prior.min_discrepancy);
        self.fit(start, errors).ok_or(KnownLightError::Unsolvable)
    }

    /// Descends from a state; `None` if the equations have no solution.
    ///
    /// The equations of finite images always have one.
    fn fit(&mut self, start: State, mut errors: ErrorModel) -> Option<LaplaceFit> {
        let mut state = start;
        // At `state`. They are expensive, and a round needs them several times at the same state.
        let mut derivatives = self.all_derivatives(&state);
        #[cfg(test)]
        let mut trace = Vec::new();
        let (mut converged, mut curvature, mut deviation) = (false, None, self.prior.deviation);
        for _ in 0..ROUNDS {
            errors.estimate(&state.residuals);
            errors.reweigh(&state.residuals, &errors.factor()?);
            let covariance = errors.factor()?;
            let mut costs = vec![self.cost(&state, &covariance)];
            let mut damping = 1e-3;
            converged = false;
            for _ in 0..ROUND_STEPS {
                let (normal, gradient) = self.equations(&state, derivatives.clone(), &covariance);
                let before = costs[costs.len() - 1];
                let Some((next, cost)) = self.step(&state, &normal, &gradient, &covariance, before, &mut damping)
                else {
                    converged = true;
                    break;
                };
                state = next;
                derivatives = self.all_derivatives(&state);
                costs.push(cost);
                if before - cost < SETTLED {
                    converged = true;
                    break;
                }
            }
            #[cfg(test)]
            trace.push(costs);
            let (normal, _) = self.equations(&state, derivatives.clone(), &covariance);
            let found = Cholesky::of_sum(&normal, &self.precisions)?;
            deviation = self.precisions[self.space.splines().start].powf(-0.5);
            let inverse = found.inverse_of_lower();
            let splines = likely_deviation(&state, &inverse, self.space.splines(), self.prior.deviations);
            let axes = likely_deviation(&state, &inverse, 0..self.space.dimensions, self.prior.axis_deviations);
            self.expect(splines, axes);
            curvature = Some(found);
        }
        Some(LaplaceFit {
            state,
            curvature: curvature?,
            errors,
            deviation,
            #[cfg(test)]
            trace,
            converged,
        })
    }

    /// Computes the normal equations of the likelihood and the gradient of the posterior, from the
    /// derivatives of the state.
    fn equations(&self, state: &State, mut derivatives: Mat<f64>, covariance: &Cholesky) -> (Mat<f64>, Vec<f64>) {
        let n = self.len();
        covariance.whiten(&mut derivatives);
        let residuals = whitened(covariance, &state.residuals);
        let mut normal = Mat::zeros(n, n);
        multiply(normal.as_mut(), Accum::Replace, derivatives.transpose(), derivatives.as_ref(), 1.0);
        let gradient = (0..n).map(|j| {
            let along: f64 = derivatives.col(j).iter().zip(&residuals).map(|(d, r)| d * r).sum();
            along - self.precisions[j] * state.coefficients[j]
        });
        let gradient = gradient.collect();
        (normal, gradient)
    }

    /// Returns the first damped step that lowers the cost, if there is one.
    fn step(
        &self,
        state: &State,
        normal: &Mat<f64>,
        gradient: &[f64],
        covariance: &Cholesky,
        before: f64,
        damping: &mut f64,
    ) -> Option<(State, f64)> {
        for _ in 0..10 {
            let diagonal: Vec<f64> = self
                .precisions
                .iter()
                .enumerate()
                .map(|(i, p)| p + *damping * (p + normal[(i, i)]).max(1e-12))
                .collect();
            if let Some(factor) = Cholesky::of_sum(normal, &diagonal) {
                let step = factor.solve(gradient);
                let of_gain = step.get(self.space.len()).map_or(0.0, |x| x.abs());
                let largest = self.space.change(&step).into_iter().fold(of_gain, |m: f64, x| m.max(x.abs()));
                let scale = (MAX_STEP / largest).min(1.0);
                let next = state.coefficients.iter().zip(&step).map(|(x, d)| x + scale * d).collect();
                let next = self.state(next);
                let cost = self.cost(&next, covariance);
                if cost < before {
                    *damping = (*damping / 10.0).max(1e-9);
                    return Some((next, cost));
                }
            }
            *damping *= 10.0;
        }
        None
    }
}

/// Returns the most probable standard deviation of the coefficients with these indices.
///
/// This is a step of the EM algorithm, clamped to a range. Materials unlike those of the prior need
/// a larger standard deviation. `inverse` is the inverse of the factor of the curvature.
fn likely_deviation(state: &State, inverse: &Mat<f64>, indices: Range<usize>, range: (f64, f64)) -> f64 {
    let count = indices.len().max(1) as f64;
    let square = indices.map(|j| {
        let variance: f64 = inverse.col(j).iter().map(|x| x * x).sum();
        state.coefficients[j].powi(2) + variance
    });
    (square.sum::<f64>() / count).sqrt().clamp(range.0, range.1)
}

/// Computes `L^-1 x` for a covariance `L L'`.
pub(super) fn whitened(covariance: &Cholesky, x: &[f64]) -> Vec<f64> {
    let mut x = Mat::from_fn(x.len(), 1, |i, _| x[i]);
    covariance.whiten(&mut x);
    x.col(0).iter().copied().collect()
}

#[cfg(test)]
mod tests;
