//! Estimation of the light in an image whose BRDF is known or assumed.

use thiserror::Error;

use super::factor::Design;
use super::{InferenceSettings, LightInference, LightInferenceError, LightPosterior, NonNegativeLight};
use crate::inference::{Hyperparameters, ImageError};
use crate::lighting::LightPrior;
use crate::reflectance::BivariateTable;
use crate::scene::Observations;
use crate::shape::Points;
use crate::transfer::{TransferError, TransferSettings, observed_rows};

/// Estimation of the light in an image of one BRDF, with one row for every observation.
#[derive(Clone, Debug)]
pub struct LightProblem<'a> {
    design: Design,
    target: Vec<f64>,
    inference: LightInference<'a>,
}

/// Error in estimating the light.
#[derive(Debug, Error)]
pub enum LightError {
    /// No design can be built from points, table and grid.
    #[error(transparent)]
    Transfer(#[from] TransferError),
    /// The image is black or not finite.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Values of the inference overflow.
    #[error(transparent)]
    Inference(#[from] LightInferenceError),
}

impl<'a> LightProblem<'a> {
    /// Number of steps of expectation maximisation on the coarsest grid: the light is for display,
    /// and further steps have little visible effect.
    pub const STEPS: usize = 10;

    /// Number of steps on each finer grid, starting from the result on the one before.
    pub const FINER_STEPS: usize = 5;

    /// Number of coefficients of the coarsest grid, 16 x 16.
    const COARSEST: usize = 256;

    /// Builds the problem from the luminances of points of a BRDF (1/sr).
    ///
    /// `values` are the luminances (linear, `None` where not observed) of `points`. The light has
    /// `settings.side` squared texels. The noise is that of [`Hyperparameters::with_model_error`],
    /// with variance inversely proportional to the `weights` of the points, if there are any.
    ///
    /// # Panics
    /// If there are not as many weights as points.
    ///
    /// # Errors
    /// If points and values differ in number, the prior does not cover the grid, or the image is
    /// black or not finite.
    pub fn new<'b>(
        points: impl Into<Points<'b>>,
        values: &[Option<f64>],
        weights: Option<&[f64]>,
        table: &BivariateTable,
        prior: &'a LightPrior,
        settings: &TransferSettings,
    ) -> Result<Self, LightError> {
        let (rows, mut target) = observed_rows(points.into(), values, std::slice::from_ref(table), prior, settings)?;
        // Factors that scale the rows to equal noise.
        let roots: Option<Vec<f64>> = weights.map(|weights| {
            assert_eq!(weights.len(), values.len());
            let kept = weights.iter().zip(values).filter(|(_, value)| value.is_some());
            kept.map(|(w, _)| w.max(0.0).sqrt()).collect()
        });
        if let Some(roots) = &roots {
            target.iter_mut().zip(roots).for_each(|(t, root)| *t *= root);
        }
        let m = settings.side * settings.side;
        let inference = LightInference::new(&target, m, prior, Hyperparameters::with_model_error(target.len()))?;
        let design = Design::of_rows(target.len(), m, &rows, roots.as_deref());
        Ok(Self { design, target, inference })
    }

    /// Builds the problem from observations, with their weights and visibility.
    ///
    /// A subset of the observations suffices for a light: see [`Observations::thinned`].
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub(crate) fn of_observations(
        observations: &Observations,
        table: &BivariateTable,
        prior: &'a LightPrior,
        settings: &TransferSettings,
    ) -> Result<Self, LightError> {
        Self::new(
            observations.points_with_visibility(),
            &observations.values,
            Some(&observations.weights),
            table,
            prior,
            settings,
        )
    }

    /// Number of observations.
    pub fn rows(&self) -> usize {
        self.target.len()
    }

    /// Root mean square of the image.
    pub fn rms(&self) -> f64 {
        (self.target.iter().map(|t| t * t).sum::<f64>() / self.target.len() as f64).sqrt()
    }

    /// Computes the posterior of the light, from coarse to fine grids.
    ///
    /// The coarsest grid takes [`Self::STEPS`] steps, and each grid that is twice as fine takes
    /// [`Self::FINER_STEPS`].
    ///
    /// # Errors
    /// Those of `LightInference::posterior`.
    pub fn posterior(&self) -> Result<LightPosterior, LightError> {
        let all = self.design.matrix.ncols();
        let mut found: Option<LightPosterior> = None;
        let mut m = all.min(Self::COARSEST);
        loop {
            let max_steps = if found.is_none() { Self::STEPS } else { Self::FINER_STEPS };
            let settings = InferenceSettings { max_steps, tolerance: 0.1, ..Default::default() };
            if m == all {
                return Ok(self.inference.posterior(&self.design, &settings, found.as_ref())?);
            }
            // The coefficients of coarse scales come first.
            let coarse = LightInference { scales: self.inference.scales.first(m), ..self.inference.clone() };
            found = Some(coarse.posterior(&self.design.first(m), &settings, found.as_ref())?);
            m *= 4;
        }
    }

    /// Computes the mean of the light without negative texels.
    ///
    /// # Errors
    /// Those of `LightInference::non_negative_light`.
    pub fn non_negative(&self, posterior: &LightPosterior) -> Result<NonNegativeLight, LightError> {
        Ok(self.inference.non_negative_light(&self.design, posterior)?)
    }

    /// Returns the root mean square residual of a light, relative to that of the image.
    ///
    /// `light` are the coefficients (M) of the radiance, in units of the image.
    ///
    /// # Panics
    /// If there are not M coefficients.
    pub fn misfit(&self, light: &[f64]) -> f64 {
        let residual: f64 = self.design.times(light).iter().zip(&self.target).map(|(y, t)| (t - y).powi(2)).sum();
        (residual / self.target.len() as f64).sqrt() / self.rms()
    }
}
