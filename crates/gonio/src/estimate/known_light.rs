//! Estimation when the light is given.

use glam::DVec3;

use super::material::Impression;
use super::{Colouring, ColouringRule, Doubt, EstimateError, Material, Reason, Stage};
use crate::appearance::DiskImage;
use crate::inference::ProblemError;
use crate::inference::known_light::{KnownLightPosterior, ROWS, operator};
use crate::inference::light::LightError;
use crate::model::Model;
use crate::render::LightTree;
use crate::scene::Observations;

/// Residual, relative and as a root mean square, that a right light and a clean photograph leave:
/// about the 95 % quantile over left-out materials (`gonio-eval bench`, docs/results.md).
const EXPECTED: f64 = 0.1;

/// Ratio of a misfit to the expected one above which it is a reason to doubt.
const TOO_LARGE: f64 = 1.25;

/// Estimate from a photograph under a light that is given.
#[derive(Clone, Debug)]
pub struct LitEstimate {
    /// Material of the object, in luminance, of albedo [`ALBEDO`](super::ALBEDO).
    pub material: Material,
    /// Factor from [`Material::table`] to reflectance on the scale of photograph and light: its
    /// albedo is absolute if both have the same exposure.
    pub exposure: f64,
    /// Standard deviation of the independent error of the logarithm of the image.
    pub noise: f64,
    /// Standard deviation of the smooth error of the logarithm of the image.
    pub discrepancy: f64,
    /// Root mean square of the residual, relative to that of the observations.
    pub misfit: f64,
    /// Number of observations it was found from.
    pub rows: usize,
    /// Whether the steps settled.
    pub settled: bool,
    /// Colours of material and light.
    pub colouring: Colouring,
}

impl LitEstimate {
    /// Residual to expect from noise and texture if material and light are right.
    pub fn expected_misfit(&self) -> f64 {
        EXPECTED.hypot(self.material.scatter)
    }

    /// Reasons to doubt it, misfit first.
    pub fn doubts(&self) -> Vec<Doubt> {
        let (left, expected) = (self.misfit, self.expected_misfit());
        let misfit = (left > TOO_LARGE * expected).then_some(Doubt::Misfit { left, expected, reason: Reason::Light });
        misfit.into_iter().chain(self.material.doubts()).collect()
    }
}

/// Estimates the material and its colours under a light in camera space. `progress` is called when
/// a stage begins.
///
/// # Errors
/// If the model has no posterior of materials, or light or image are black.
///
/// # Panics
/// If nothing is observed.
pub fn estimate_under(
    model: &Model,
    observations: &Observations,
    light: &LightTree,
    colouring: &ColouringRule,
    progress: &(dyn Fn(Stage) + Sync),
) -> Result<LitEstimate, EstimateError> {
    let learnt = model.learnt.as_ref().ok_or(EstimateError::NotLearnt)?;
    progress(Stage::Transfer);
    let few = observations.thinned(ROWS);
    let seen: Vec<usize> = (0..few.points.len()).filter(|&i| few.values[i].is_some()).collect();
    let few = few.select(&seen);
    let places: Vec<Vec<f64>> =
        learnt.prior.places.iter().map(|place| place.iter().map(|z| f64::from(*z)).collect()).collect();
    let matrix = operator(&few.points, few.visibility.as_ref(), light, &learnt.coordinates, &places);
    progress(Stage::Material);
    let normals: Vec<DVec3> = few.points.iter().map(|p| p.in_view()).collect();
    let values: Vec<f64> = few.values.iter().flatten().copied().collect();
    let found = KnownLightPosterior::of(&matrix, (&normals, &values, &few.trust()), &learnt.coordinates, &places)?;
    let image = DiskImage::gather(&observations.samples()).ok_or(LightError::Image(ProblemError::Black))?;
    let material = Impression::under(learnt, &image, found.posterior(Some(learnt))).describe();
    progress(Stage::Colours);
    Ok(LitEstimate {
        exposure: found.table().normal_albedo() / material.table.normal_albedo(),
        colouring: Colouring::of(model, observations, &material.table, colouring),
        material,
        noise: found.noise,
        discrepancy: found.discrepancy,
        misfit: found.misfit,
        rows: values.len(),
        settled: found.settled,
    })
}
