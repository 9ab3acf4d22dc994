//! Material of the object.

use super::colouring::DiskImages;
use super::{Colouring, ColouringRule, Diagnostic, Ends, EstimateError, Highlight};
use crate::appearance::{DiskImage, fineness};
use crate::colour::ChromaField;
use crate::inference::learnt::{
    self, LearntPosterior, MaterialPosterior, SphereEquivalent, peak_height, to_sphere_equivalent,
};
use crate::inference::{Embedding, Likelihood};
use crate::model::Model;
use crate::reflectance::{BivariateTable, trusted_cells};
use crate::scene::Observations;
use crate::transfer::TransferSettings;

/// Albedo along the normal to which estimates are scaled, since a photograph under unknown
/// illumination does not determine it.
pub const ALBEDO: f64 = 0.5;

/// Shares of the quantiles in [`MaterialEstimate::quantiles`].
pub const QUANTILE_LEVELS: [f64; 4] = [0.05, 0.25, 0.75, 0.95];

/// Number of draws from which the ends are computed.
const DRAWS: usize = 128;

/// A material with its uncertainty, in luminance.
#[derive(Clone, Debug)]
pub struct MaterialEstimate {
    /// The mean of the posterior ([`MaterialPosterior::mean`]), in 1/sr, with a normal albedo of
    /// [`ALBEDO`].
    pub table: BivariateTable,
    /// Factor from [`MaterialPosterior::mean`] to the table.
    pub scale: f64,
    /// Quantiles of each cell at [`QUANTILE_LEVELS`], `[quantile][cell]`, on the scale of the
    /// table.
    pub quantiles: Vec<Vec<f32>>,
    /// Cells that the photograph does not determine ([`MaterialPosterior::undetermined`]).
    pub undetermined: Vec<bool>,
    /// Share of the trusted cells (both angles below 80 degrees) that are undetermined, 0..=1.
    pub undetermined_share: f64,
    /// Dull and glossy end of the interval.
    pub ends: Ends,
    /// 5, 50 and 95 % quantiles of the [`peak_height`].
    pub peak_height: [f64; 3],
    /// The same quantiles of other measures: width of a GGX lobe, gloss units.
    pub highlight: Highlight,
    /// Share of the photograph's features outside their range in the training data
    /// ([`EncoderOutput::out_of_distribution`](crate::inference::learnt::EncoderOutput::out_of_distribution)).
    pub out_of_distribution: f64,
    /// Standard deviation of pixels that share a normal, relative to their mean
    /// ([`DiskImage::scatter`](crate::appearance::DiskImage::scatter)).
    pub scatter: f64,
    /// Detail of the photograph that is finer than the texels of a light of 32 x 32, relative to
    /// the photograph ([`fineness`]); one if unknown.
    pub fineness: f64,
    /// Number of cells of the disk of normals to which the photograph was mapped.
    pub disk_cells: usize,
    /// Number of these cells without an observation, which are interpolated.
    pub filled_cells: usize,
    /// Mean absolute log ratio between the values of an equivalent sphere and the observed ones
    /// ([`to_sphere_equivalent`]).
    pub self_shadowing: f64,
    /// Posterior of the material, and draws from it.
    pub posterior: MaterialPosterior,
}

impl MaterialEstimate {
    /// Infers the material from observations.
    ///
    /// `side` is the side of the light grid. It matters only for shapes with self-shadowing or a
    /// near camera.
    ///
    /// # Errors
    /// If the model has no posterior of materials, the image is black, or nothing is observed.
    pub fn of(model: &Model, observations: &Observations, side: usize) -> Result<Self, EstimateError> {
        Ok(MaterialDraft::of(model, observations, side)?.describe())
    }

    /// Returns the diagnostics of the material.
    pub fn diagnostics(&self) -> Vec<Diagnostic> {
        let filled = self.filled_cells as f64 / self.disk_cells as f64;
        [
            (filled > 0.2).then_some(Diagnostic::Filled(filled)),
            (self.out_of_distribution > 0.05).then_some(Diagnostic::OutOfDistribution(self.out_of_distribution)),
            (self.undetermined_share > 0.5).then_some(Diagnostic::Undetermined(self.undetermined_share)),
            (self.scatter > 0.1).then_some(Diagnostic::Scatter(self.scatter)),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Returns the quantiles of every cell of a channel at [`QUANTILE_LEVELS`], `[quantile][cell]`.
    ///
    /// The values are on the scale of the table. `fields` are equally likely draws of the chroma.
    pub(super) fn channel_quantiles(&self, fields: &[ChromaField], channel: usize) -> Vec<Vec<f32>> {
        let quantiles = self.posterior.channel_quantiles(fields, channel, &QUANTILE_LEVELS);
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

/// Returns draws like [`MaterialEstimate::samples`], given only [`MaterialPosterior::likelihood`].
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
/// They include the error of the material coordinates, so their quantiles are approximately
/// [`MaterialEstimate::quantiles`]. Use them for intervals of quantities that are computed from a
/// BRDF, such as the radiance in a rendering. The same `seed` gives the same draws.
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
    out_of_distribution: f64,
    scatter: f64,
    fineness: f64,
    disk_cells: usize,
    filled_cells: usize,
    self_shadowing: f64,
}

impl<'a> MaterialDraft<'a> {
    pub(super) fn of(model: &'a Model, observations: &Observations, side: usize) -> Result<Self, EstimateError> {
        let learnt = model.learnt.as_ref().ok_or(EstimateError::NotLearnt)?;
        super::check_observed(observations)?;
        let transfer = TransferSettings::of_side(side);
        let equivalent = to_sphere_equivalent(observations, learnt, &model.light, &transfer)?;
        let reading = learnt.encode(&equivalent.image);
        let likelihood = Likelihood::Embedding(Embedding::of(reading.embedding));
        let posterior = MaterialPosterior::of(learnt, likelihood).ok_or(EstimateError::NotLearnt)?;
        let image = &equivalent.image;
        let cells = DiskImage::cells();
        Ok(Self {
            out_of_distribution: reading.out_of_distribution,
            fineness: fineness(image),
            filled_cells: cells - (f64::from(image.covered()) * cells as f64).round() as usize,
            self_shadowing: equivalent.change,
            ..Self::with(learnt, f64::from(image.scatter), posterior)
        }
        .seen(equivalent))
    }

    pub(super) fn posterior(&self) -> &MaterialPosterior {
        &self.posterior
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
            out_of_distribution: 0.0,
            scatter,
            fineness: 1.0,
            disk_cells: DiskImage::cells(),
            // No cell is interpolated: every observation is used directly.
            filled_cells: 0,
            self_shadowing: 0.0,
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

    pub(super) fn describe(self) -> MaterialEstimate {
        let posterior = self.posterior;
        let (table, scale) = (self.table, self.scale);
        let rescaled = |values: Vec<f32>| values.into_iter().map(|v| (f64::from(v) * scale) as f32).collect();
        let quantiles = posterior.quantiles(&QUANTILE_LEVELS).into_iter().map(rescaled).collect();
        let undetermined = posterior.undetermined(self.learnt);
        let trusted: Vec<usize> = trusted_cells().collect();
        let undetermined_share = trusted.iter().filter(|&&c| undetermined[c]).count() as f64 / trusted.len() as f64;
        let drawn = learnt::predict(self.learnt, &posterior.likelihood, DRAWS, 1);
        let ends = Ends::of(drawn.as_ref().unwrap_or(&posterior.draws));
        let peak = posterior.number_quantiles(peak_height, &[0.05, 0.5, 0.95]);
        MaterialEstimate {
            table,
            scale,
            quantiles,
            undetermined,
            undetermined_share,
            ends,
            peak_height: [peak[0], peak[1], peak[2]],
            highlight: Highlight::of(&posterior),
            out_of_distribution: self.out_of_distribution,
            scatter: self.scatter,
            fineness: self.fineness,
            disk_cells: self.disk_cells,
            filled_cells: self.filled_cells,
            self_shadowing: self.self_shadowing,
            posterior,
        }
    }
}
