//! Estimation of the light, given the material.

use super::{EstimateError, EstimateSettings, EstimateStage};
use crate::inference::light::{LightProblem, cut_off_at_zero};
use crate::lighting::LightGrid;
use crate::model::Model;
use crate::reflectance::BivariateTable;
use crate::scene::Observations;
use crate::transfer::TransferSettings;

/// Largest side of a grid whose posterior is restricted to non-negative lights, which takes a
/// minute at this side. On finer grids, whose dense matrices do not fit in memory, the mean is
/// clamped at zero.
const MAX_BOUNDED_SIDE: usize = 64;

/// Method that ensured a non-negative light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightEstimator {
    /// Posterior mean over lights without negative texels: the most accurate of the methods that
    /// `gonio-eval lights` compares.
    NonNegative {
        /// Number of refinement steps.
        steps: usize,
        /// Whether the refinement converged.
        converged: bool,
    },
    /// Posterior mean, clamped at zero; for grids beyond 64 x 64.
    Clamped,
}

/// Light of a photograph, in luminance, given a BRDF.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Radiance on the scale of the photograph, given the BRDF table.
    pub grid: LightGrid,
    /// Coefficients of the light in units of the prior: radiance over [`Self::exposure`].
    pub coefficients: Vec<f64>,
    /// Standard deviations of the coefficients.
    pub sd: Vec<f64>,
    /// Radiance of a coefficient of one.
    pub exposure: f64,
    /// Method that ensured a non-negative light.
    pub estimator: LightEstimator,
    /// Number of observations used.
    pub observations: usize,
    /// Final objective of the evidence
    /// ([`LightPosterior::objective`](crate::inference::light::LightPosterior::objective)).
    pub objective: f64,
    /// Effective number of coefficients
    /// ([`LightPosterior::effective`](crate::inference::light::LightPosterior::effective)).
    pub effective: f64,
    /// Objective after each step.
    pub trace: Vec<f64>,
    /// Whether the maximisation of the evidence converged.
    pub converged: bool,
    /// Standard deviation of the residual of light and table, estimated by the evidence, on the
    /// scale of the photograph.
    pub noise: f64,
    /// Standard deviation of the residual over the root mean square of the observations.
    pub relative_noise: f64,
    /// Root mean square of the residual of light and table, relative to that of the photograph.
    pub misfit: f64,
}

impl Light {
    /// Estimates the light, given a BRDF (1/sr). `progress` receives [`EstimateStage::Transfer`]
    /// and [`EstimateStage::Light`].
    ///
    /// # Errors
    /// If the prior does not cover the grid of the settings, or the image is black.
    pub fn of(
        model: &Model,
        observations: &Observations,
        table: &BivariateTable,
        settings: &EstimateSettings,
        progress: &(dyn Fn(EstimateStage) + Sync),
    ) -> Result<Self, EstimateError> {
        settings.check(model)?;
        progress(EstimateStage::Transfer);
        let transfer = TransferSettings::of_side(settings.side);
        let problem = LightProblem::of_observations(
            &observations.thinned(settings.observations),
            table,
            &model.light,
            &transfer,
        )?;
        progress(EstimateStage::Light);
        let evidence = problem.posterior()?;
        let (coefficients, sd, exposure, estimator) = if settings.side <= MAX_BOUNDED_SIDE {
            let found = problem.non_negative(&evidence)?;
            let how = LightEstimator::NonNegative { steps: found.steps, converged: found.converged };
            (found.light, found.light_sd, found.exposure, how)
        } else {
            let light = cut_off_at_zero(&evidence.light);
            (light, evidence.light_sd.clone(), evidence.exposure, LightEstimator::Clamped)
        };
        let radiance: Vec<f64> = coefficients.iter().map(|l| l * exposure).collect();
        Ok(Self {
            grid: LightGrid::from_coefficients(model.light.map, &radiance).non_negative(),
            misfit: problem.misfit(&radiance),
            coefficients,
            sd,
            exposure,
            estimator,
            observations: problem.rows(),
            objective: evidence.objective,
            effective: evidence.effective,
            converged: evidence.converged,
            noise: evidence.noise,
            relative_noise: evidence.noise / problem.rms(),
            trace: evidence.trace,
        })
    }
}
