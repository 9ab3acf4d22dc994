//! Material of the object.

use super::colouring::DiskImages;
use super::{Colouring, ColouringRule, Diagnostic, Ends, EstimateError, Highlight};
use crate::appearance::{DiskImage, fineness};
use crate::colour::ChromaField;
use crate::inference::learnt::{
    self, LearntPosterior, MaterialPosterior, Neighbour, SphereEquivalent, SphereEquivalentSettings, peak_over_base,
    to_sphere_equivalent,
};
use crate::inference::{Embedding, Likelihood};
use crate::model::Model;
use crate::reflectance::{BivariateTable, trusted_cells};
use crate::scene::Observations;
use crate::transfer::PlanSettings;

/// Albedo along the normal to which estimates are scaled, since a photograph under unknown
/// illumination does not determine it.
pub const ALBEDO: f64 = 0.5;

/// Shares of the quantiles in [`Material::quantiles`].
pub const SHARES: [f64; 4] = [0.05, 0.25, 0.75, 0.95];

/// Largest number of [`Material::neighbours`], and the smallest weight of each.
const NAMED: (usize, f64) = (10, 0.005);

/// Number of draws from which the ends are computed.
const DRAWS: usize = 128;

/// A material with its uncertainty, in luminance.
#[derive(Clone, Debug)]
pub struct Material {
    /// The mean of the posterior ([`MaterialPosterior::mean`]), in 1/sr, with a normal albedo of
    /// [`ALBEDO`].
    pub table: BivariateTable,
    /// Factor from [`MaterialPosterior::mean`] to the table.
    pub scale: f64,
    /// Quantiles of each cell at [`SHARES`], `[quantile][cell]`, on the scale of the table.
    pub quantiles: Vec<Vec<f32>>,
    /// Cells that the photograph does not determine ([`MaterialPosterior::undetermined`]).
    pub undetermined: Vec<bool>,
    /// Share of the trusted cells (both angles below 80 degrees) that are undetermined, 0..=1.
    pub open: f64,
    /// Measured materials of the largest weights, in descending order, at most ten. The weights of
    /// all measured materials sum to one.
    pub neighbours: Vec<Neighbour>,
    /// Dull and glossy end of the interval.
    pub ends: Ends,
    /// 5, 50 and 95 % quantiles of the gloss, [`peak_over_base`].
    pub gloss: [f64; 3],
    /// The same quantiles of other measures: width of a GGX lobe, gloss units.
    pub highlight: Highlight,
    /// Share of the photograph's features outside their range in the training data
    /// ([`Reading::strangeness`](crate::inference::learnt::Reading::strangeness)).
    pub strangeness: f64,
    /// Standard deviation of pixels that share a normal, relative to their mean
    /// ([`DiskImage::scatter`](crate::appearance::DiskImage::scatter)).
    pub scatter: f64,
    /// Detail of the photograph that is finer than the texels of a light of 32 x 32, relative to
    /// the photograph ([`fineness`]); one if unknown.
    pub fineness: f64,
    /// Number of cells of the disk of normals to which the photograph was mapped.
    pub normals: usize,
    /// Number of these cells without an observation, which are interpolated.
    pub filled: usize,
    /// Mean absolute log ratio between the values of an equivalent sphere and the observed ones
    /// ([`to_sphere_equivalent`]).
    pub unshadowed: f64,
    /// Posterior of the material, and draws from it.
    pub posterior: MaterialPosterior,
}

impl Material {
    /// Infers the material from observations.
    ///
    /// `side` is the side of the light grid. It matters only for shapes with self-shadowing or a
    /// near camera.
    ///
    /// # Errors
    /// If the model has no posterior of materials, or the image is black.
    ///
    /// # Panics
    /// If nothing is observed.
    pub fn of(model: &Model, observations: &Observations, side: usize) -> Result<Self, EstimateError> {
        Ok(MaterialDraft::of(model, observations, side)?.describe())
    }

    /// Returns the diagnostics of the material.
    pub fn diagnostics(&self) -> Vec<Diagnostic> {
        let filled = self.filled as f64 / self.normals as f64;
        [
            (filled > 0.2).then_some(Diagnostic::Filled(filled)),
            (self.strangeness > 0.05).then_some(Diagnostic::Strange(self.strangeness)),
            (self.open > 0.5).then_some(Diagnostic::Open(self.open)),
            (self.scatter > 0.1).then_some(Diagnostic::Scatter(self.scatter)),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Returns the quantiles of every cell of a channel at [`SHARES`], `[quantile][cell]`.
    ///
    /// The values are on the scale of the table. `fields` are equally likely draws of the chroma.
    pub(super) fn channel_quantiles(&self, fields: &[ChromaField], channel: usize) -> Vec<Vec<f32>> {
        let quantiles = self.posterior.channel_quantiles(fields, channel, &SHARES);
        let rescaled = |values: Vec<f32>| values.into_iter().map(|v| (f64::from(v) * self.scale) as f32).collect();
        quantiles.into_iter().map(rescaled).collect()
    }

    /// Returns draws from the posterior, each with albedo [`ALBEDO`].
    ///
    /// The same `seed` gives the same draws. [`Self::quantiles`] are wider than those of the draws,
    /// since they include the error of the material coordinates.
    ///
    /// # Errors
    /// [`EstimateError::NotLearnt`] if `model` is not the model of this estimate.
    pub fn samples(&self, model: &Model, count: usize, seed: u64) -> Result<Vec<BivariateTable>, EstimateError> {
        draws(model, &self.posterior.likelihood, count, seed)
    }
}

/// Returns draws like [`Material::samples`], given only [`MaterialPosterior::likelihood`].
///
/// # Errors
/// [`EstimateError::NotLearnt`] if the likelihood belongs to another model.
pub fn draws(
    model: &Model,
    likelihood: &Likelihood,
    count: usize,
    seed: u64,
) -> Result<Vec<BivariateTable>, EstimateError> {
    drawn(model, |learnt| learnt::sample(learnt, likelihood, count, seed))
}

/// Returns draws from the posterior predictive distribution, each with albedo [`ALBEDO`].
///
/// They include the error of the material coordinates, so their quantiles are
/// [`Material::quantiles`]. Use them for intervals of quantities that are computed from a BRDF,
/// such as the radiance in a rendering. The same `seed` gives the same draws.
///
/// # Errors
/// [`EstimateError::NotLearnt`] if the likelihood belongs to another model.
pub fn predictive_draws(
    model: &Model,
    likelihood: &Likelihood,
    count: usize,
    seed: u64,
) -> Result<Vec<BivariateTable>, EstimateError> {
    drawn(model, |learnt| learnt::predict(learnt, likelihood, count, seed))
}

/// Returns tables of albedo one that `draw` computes, scaled to [`ALBEDO`].
fn drawn(
    model: &Model,
    draw: impl FnOnce(&LearntPosterior) -> Option<Vec<BivariateTable>>,
) -> Result<Vec<BivariateTable>, EstimateError> {
    let tables = model.learnt.as_ref().and_then(draw).ok_or(EstimateError::NotLearnt)?;
    Ok(tables.into_iter().map(|table| table.scaled(ALBEDO)).collect())
}

/// Posterior of the material, before the slow computation of its quantiles and gloss.
pub(super) struct MaterialDraft<'a> {
    learnt: &'a LearntPosterior,
    posterior: MaterialPosterior,
    /// Estimate, at the normal albedo [`ALBEDO`].
    pub(super) table: BivariateTable,
    /// Encoded images; `None` for several photographs or a known light.
    images: Option<SphereEquivalent>,
    scale: f64,
    strangeness: f64,
    scatter: f64,
    fineness: f64,
    normals: usize,
    filled: usize,
    unshadowed: f64,
}

impl<'a> MaterialDraft<'a> {
    pub(super) fn of(model: &'a Model, observations: &Observations, side: usize) -> Result<Self, EstimateError> {
        let learnt = model.learnt.as_ref().ok_or(EstimateError::NotLearnt)?;
        let plan = PlanSettings { side, ..PlanSettings::default() };
        let settings = SphereEquivalentSettings::default();
        let unshadowed = to_sphere_equivalent(observations, learnt, &model.light, &plan, &settings)?;
        let reading = learnt.read(&unshadowed.image);
        let likelihood = Likelihood::Embedding(Embedding::of(reading.embedding));
        let posterior = MaterialPosterior::of(learnt, likelihood).ok_or(EstimateError::NotLearnt)?;
        let image = &unshadowed.image;
        let normals = DiskImage::cells();
        Ok(Self {
            strangeness: reading.strangeness,
            fineness: fineness(image),
            filled: normals - (f64::from(image.covered()) * normals as f64).round() as usize,
            unshadowed: unshadowed.change,
            ..Self::with(learnt, f64::from(image.scatter), posterior)
        }
        .seen(unshadowed))
    }

    /// Wraps a posterior; `scatter` is that of its photographs.
    pub(super) fn with(learnt: &'a LearntPosterior, scatter: f64, posterior: MaterialPosterior) -> Self {
        let (table, scale) = posterior.mean.with_normal_albedo(ALBEDO);
        Self {
            learnt,
            posterior,
            table,
            images: None,
            scale,
            strangeness: 0.0,
            scatter,
            fineness: 1.0,
            normals: DiskImage::cells(),
            // No cell is interpolated: every observation is used directly.
            filled: 0,
            unshadowed: 0.0,
        }
    }

    fn seen(self, images: SphereEquivalent) -> Self {
        Self { images: Some(images), ..self }
    }

    /// Estimates the colours by a rule.
    pub(super) fn colouring(&self, model: &Model, observations: &Observations, rule: &ColouringRule) -> Colouring {
        let images = self
            .images
            .as_ref()
            .map(|SphereEquivalent { image, channels, .. }| DiskImages { luminance: image, channels });
        Colouring::of_images(model, observations, images.as_ref(), &self.table, rule)
    }

    pub(super) fn describe(self) -> Material {
        let posterior = self.posterior;
        let (table, scale) = (self.table, self.scale);
        let rescaled = |values: Vec<f32>| values.into_iter().map(|v| (f64::from(v) * scale) as f32).collect();
        let quantiles = posterior.quantiles(&SHARES).into_iter().map(rescaled).collect();
        let undetermined = posterior.undetermined(self.learnt);
        let trusted: Vec<usize> = trusted_cells().collect();
        let open = trusted.iter().filter(|&&c| undetermined[c]).count() as f64 / trusted.len() as f64;
        let (most, least) = NAMED;
        let neighbours = posterior.neighbours.iter().take(most).filter(|n| n.weight >= least).cloned().collect();
        let ranking = posterior.ranking(peak_over_base);
        let drawn = learnt::predict(self.learnt, &posterior.likelihood, DRAWS, 1);
        let ends = Ends::of(drawn.as_ref().unwrap_or(&posterior.draws));
        let gloss = ranking.quantiles(&[0.05, 0.5, 0.95]);
        Material {
            table,
            scale,
            quantiles,
            undetermined,
            open,
            neighbours,
            ends,
            gloss: [gloss[0], gloss[1], gloss[2]],
            highlight: Highlight::of(&posterior),
            strangeness: self.strangeness,
            scatter: self.scatter,
            fineness: self.fineness,
            normals: self.normals,
            filled: self.filled,
            unshadowed: self.unshadowed,
            posterior,
        }
    }
}
