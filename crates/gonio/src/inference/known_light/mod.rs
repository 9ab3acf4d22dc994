//! Posterior of the material under a known light.
//!
//! Given the light, the image is linear in the reflectance of the 8,100 cells of a table
//! ([`Relighter`](crate::render::Relighter)), at the full resolution of the light. The logarithm of
//! the table is a sum of principal axes of the material prior and of splines for deviations from
//! the axes. The environment map may be rotated by a few degrees, and its brightest pixels may be
//! clipped; the fit estimates rotation and true brightness together with the table.
//!
//! The error of the logarithm of the image has two parts, both estimated from the image. One part
//! is smooth, because bivariate tables and environment maps are inexact. The other part is
//! independent, with heavy tails. Gauss-Newton steps from the best of a thousand materials of the
//! prior find the most probable table, and the posterior is the Gaussian around it (Laplace's
//! approximation). The learnt posterior of the same photograph is an additional likelihood.
//!
//! The crate `gonio-paper` contains the paper's estimate under a known light, coefficients of ten
//! functions.

mod align;
mod channels;
mod error_model;
mod fit;
mod gaussian;
mod learnt_likelihood;
mod light;
mod rotation;
mod space;
mod start;
#[cfg(test)]
mod tests;

use faer::Mat;
use glam::{DQuat, DVec3};
use gonio_linalg::Cholesky;
use thiserror::Error;

use crate::reflectance::{BivariateTable, CELLS, LatentSpace};
use crate::render::IntegratorSettings;
use crate::shape::{SurfacePoint, Visibility};
pub use channels::ChannelPosterior;
use fit::{FitPrior, ImageModel, LaplaceFit};
pub use gaussian::Gaussian;
pub(crate) use learnt_likelihood::EncoderLikelihood;
pub use light::{KnownLight, Operator, clipped};
use space::ParameterSpace;
use start::start;

/// Largest number of materials of the prior that are compared for the start.
const STARTS: usize = 1000;

/// Largest number of materials of the prior that determine how finely the light is divided.
const EXAMPLES: usize = 200;

/// Default number of observations for the posterior. More of them take longer and add little, since
/// their errors are correlated.
pub const ROWS: usize = 1000;

/// Accuracy of the renderings of a material.
const ACCURACY: IntegratorSettings = IntegratorSettings { tolerance: 0.3, max_cells: 8_000 };

/// Error of a posterior under a known light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum KnownLightError {
    /// No light of the map reaches the object.
    #[error("the environment map does not illuminate the object; check the orientation of the map")]
    Dark,
    /// The photograph is black.
    #[error("the object is black in the photograph; check the exposure and the mask")]
    Black,
    /// The equations have no solution.
    #[error("no material explains the photograph under this light; check that the environment map is correct")]
    Unsolvable,
}

/// The observations of a photograph, one for each point.
#[derive(Clone, Copy, Debug)]
pub struct ObservedPoints<'a> {
    /// Normals and views.
    pub points: &'a [SurfacePoint],
    /// Visible part of the light for each point.
    pub visibility: Option<&'a Visibility>,
    /// Luminance, positive and linear.
    pub values: &'a [f64],
    /// Inverse variance of each value relative to the others, in 0..=1.
    pub weights: &'a [f64],
}

/// Rotations of the environment map that are searched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alignment {
    /// None: the map is aligned.
    Fixed,
    /// A few degrees about any axis.
    #[default]
    Small,
    /// Any angle about the vertical, and a few degrees about any axis.
    Vertical,
}

/// Materials that a photograph is compared with, computed once for all lights.
#[derive(Clone, Debug)]
pub struct PriorMaterials<'a> {
    latent_space: &'a LatentSpace,
    /// Coordinates of the candidates for the start.
    starts: Vec<Vec<f64>>,
    /// Their tables (cells x candidates).
    tables: Mat<f32>,
    /// Materials that determine how finely the light is divided.
    examples: Vec<BivariateTable>,
}

impl<'a> PriorMaterials<'a> {
    /// Selects from materials of the prior, given by their coordinates.
    ///
    /// # Panics
    /// If there are no materials.
    pub fn of(latent_space: &'a LatentSpace, materials: &[Vec<f64>]) -> Self {
        assert!(!materials.is_empty(), "at least one material is required");
        let some = |most: usize| -> Vec<Vec<f64>> {
            materials.iter().step_by(materials.len().div_ceil(most)).cloned().collect()
        };
        let starts = some(STARTS);
        let tables = latent_space.tables(&starts);
        let tables = Mat::from_fn(CELLS, tables.len(), |cell, at| tables[at].as_slice()[cell]);
        Self { tables, examples: latent_space.tables(&some(EXAMPLES)), latent_space, starts }
    }

    /// Returns the coordinates of the prior.
    pub(super) fn coordinates(&self) -> &'a LatentSpace {
        self.latent_space
    }
}

/// Posterior of the material under a known light.
#[derive(Clone, Debug)]
pub struct KnownLightPosterior {
    space: ParameterSpace,
    coefficients: Vec<f64>,
    curvature: Cholesky,
    /// Standard deviation of the independent error of the logarithm of the image: noise, texture,
    /// wrong normals.
    pub noise: f64,
    /// Standard deviation of the smooth error of the logarithm of the image.
    pub discrepancy: f64,
    /// Root mean square of the residual relative to that of the image.
    pub misfit: f64,
    /// Predicted value of each observation.
    pub predicted: Vec<f64>,
    /// Standard deviation of the coefficients of splines a priori.
    deviation: f64,
    /// Rotation from the given orientation of the map to the fitted one.
    pub rotation: DQuat,
    /// Ratio of the true radiance of the clipped map pixels to their values, and the standard
    /// deviation of its logarithm; `None` if no pixels are clipped.
    pub gain: Option<(f64, f64)>,
    /// Whether the iteration converged.
    pub converged: bool,
}

impl KnownLightPosterior {
    /// Computes the posterior and the rotation of a given light.
    ///
    /// # Errors
    /// If the light or the photograph is black, or the equations have no solution.
    ///
    /// # Panics
    /// If the numbers of rows differ, or there are no rows or no materials.
    pub fn of(
        rows: &ObservedPoints<'_>,
        light: KnownLight,
        alignment: Alignment,
        materials: &PriorMaterials<'_>,
    ) -> Result<Self, KnownLightError> {
        let space = ParameterSpace::new(materials.latent_space);
        align::aligned(rows, light, alignment, &space, materials)
    }

    /// Computes the posterior, given the matrix of the light, with a row for each point.
    ///
    /// # Errors
    /// If the light or the photograph is black, or the equations have no solution.
    ///
    /// # Panics
    /// If the numbers of rows differ, or there are no rows or no materials.
    pub fn under(
        operator: &Operator,
        rows: &ObservedPoints<'_>,
        materials: &PriorMaterials<'_>,
    ) -> Result<Self, KnownLightError> {
        let space = ParameterSpace::new(materials.latent_space);
        let mut image = ImageModel::of(operator, rows, &space, FitPrior::MATERIAL)?;
        let found = image.fit_to(rows, start(operator, rows.values, materials).state(&image))?;
        Ok(Self::found(&image, found, rows, &space, DQuat::IDENTITY))
    }

    fn found(
        image: &ImageModel<'_>,
        found: LaplaceFit,
        rows: &ObservedPoints<'_>,
        space: &ParameterSpace,
        turn: DQuat,
    ) -> Self {
        let misfit = relative_rms(rows.values, &found.state.predicted);
        let mut last = vec![0.0; image.len()];
        last[image.len() - 1] = 1.0;
        let gain = (image.len() > space.len()).then(|| {
            let variance = found.curvature.solve(&last)[image.len() - 1];
            (image.gain(&found.state.coefficients), variance.sqrt())
        });
        Self {
            coefficients: found.state.coefficients,
            curvature: found.curvature,
            noise: found.errors.noise,
            discrepancy: found.errors.discrepancy,
            misfit,
            predicted: found.state.predicted,
            deviation: found.deviation,
            // A rotation has two quaternions; use the one with the smaller angle.
            rotation: if turn.w < 0.0 { -turn } else { turn },
            gain,
            converged: found.converged,
            space: space.clone(),
        }
    }

    /// Returns the most probable table, on the scale of photograph and light.
    ///
    /// Its albedo is absolute if both have the same exposure.
    pub fn table(&self) -> BivariateTable {
        self.space.table(&self.coefficients)
    }

    /// Returns the posterior without the scale.
    ///
    /// # Errors
    /// If the equations have no solution.
    pub fn gaussian(&self) -> Result<Gaussian, KnownLightError> {
        let free = ParameterSpace::free(self.space.dimensions);
        let found = Gaussian::marginal(&self.coefficients, &self.curvature, free, self.deviation);
        found.ok_or(KnownLightError::Unsolvable)
    }
}

/// Returns at most `most` of the indices `0..count`, at equal steps.
fn thinned(count: usize, most: usize) -> Vec<usize> {
    (0..count).step_by(count.div_ceil(most).max(1)).collect()
}

/// Returns the root mean square difference of two images, relative to the first.
fn relative_rms(values: &[f64], others: &[f64]) -> f64 {
    let difference: f64 = values.iter().zip(others).map(|(v, other)| (v - other).powi(2)).sum();
    let square: f64 = values.iter().map(|v| v.powi(2)).sum();
    (difference / square.max(f64::MIN_POSITIVE)).sqrt()
}

impl ObservedPoints<'_> {
    /// Returns the normals in the frame of each point's view, so that views have no effect.
    fn normals(&self) -> Vec<DVec3> {
        self.points.iter().map(SurfacePoint::in_view).collect()
    }

    fn trusts(&self) -> Vec<f64> {
        self.weights.iter().map(|t| t.clamp(1e-3, 1.0)).collect()
    }
}
