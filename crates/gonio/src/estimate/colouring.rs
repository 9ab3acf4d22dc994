//! Colours of a material whose luminance is known.

use glam::Vec3;

use crate::appearance::DiskImage;
use crate::colour::{ChannelReading, Chroma, ChromaField, ColourEstimate, ColourModel, is_grey};
use crate::inference::learnt::LearntPosterior;
use crate::model::Model;
use crate::picture::Plane;
use crate::reflectance::BivariateTable;
use crate::render::median_colour;
use crate::scene::Observations;

use super::{ChromaticLight, MaterialEstimate};

/// Number of draws of the colours.
pub(super) const COLOUR_DRAWS: usize = 128;

/// Seed of these draws.
pub(super) const COLOUR_SEED: u64 = 2;

/// Ratio of the standard deviation of the chroma error to the residual along the green-magenta axis
/// (docs/trials.md).
const ERROR_PER_GAP: f64 = 1.0;

/// Rule for the colours of a BRDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColouringRule {
    /// The estimated channels, without the colour of the light if it is known.
    Estimate {
        /// Colour of the light, if known; otherwise neutral.
        light: Option<Chroma>,
    },
    /// The median colour of the photograph for light and reflectance together, as in the figures of
    /// the paper.
    Median,
    /// Three equal channels.
    Grey,
}

impl Default for ColouringRule {
    fn default() -> Self {
        Self::Estimate { light: None }
    }
}

/// Colours of a material, with their origin.
#[derive(Clone, Debug, PartialEq)]
pub enum Colouring {
    /// No colours were requested.
    Grey,
    /// The photograph is grey.
    GreyPhotograph,
    /// The median colour of the photograph.
    Median(Chroma),
    /// The channels of the material.
    Estimate(Box<ColourEstimate>),
}

/// Images of a photograph on the disk of normals.
pub(super) struct DiskImages<'a> {
    pub(super) luminance: &'a DiskImage,
    /// Red, green and blue; `None` for a black channel.
    pub(super) channels: &'a [Option<DiskImage>; 3],
}

impl Colouring {
    /// Estimates the colours of a BRDF with luminance `table`.
    ///
    /// The observations must be free of self-shadowing. If `model` has no colour model, the result
    /// is the median colour.
    pub fn of(model: &Model, observations: &Observations, table: &BivariateTable, rule: &ColouringRule) -> Self {
        let samples = observations.samples();
        let image = DiskImage::gather(&samples);
        let channels = image.as_ref().map(|image| [0, 1, 2].map(|c| DiskImage::gather_channel(&samples, c, image)));
        let images = image.as_ref().zip(channels.as_ref());
        let images = images.map(|(luminance, channels)| DiskImages { luminance, channels });
        Self::of_images(model, observations, images.as_ref(), table, rule)
    }

    /// Estimates the colours from disk images of the observations, if available.
    pub(super) fn of_images(
        model: &Model,
        observations: &Observations,
        images: Option<&DiskImages<'_>>,
        table: &BivariateTable,
        rule: &ColouringRule,
    ) -> Self {
        if *rule == ColouringRule::Grey {
            return Self::Grey;
        }
        let observed: Vec<Vec3> = observations.colours.iter().flatten().copied().collect();
        if is_grey(&observed) {
            return Self::GreyPhotograph;
        }
        let found = || {
            let ColouringRule::Estimate { light } = rule else { return None };
            let (learnt, colours) = (model.learnt.as_ref()?, model.colours()?);
            estimate(learnt, colours, images?, table, *light)
        };
        match found() {
            Some(found) => Self::Estimate(Box::new(found)),
            None => {
                let median = median_colour(&Plane::from_vec(observed.len(), 1, observed), |_| true);
                Self::Median(Chroma::of(median.as_dvec3()))
            }
        }
    }

    /// Widens the intervals by the residual that a light of natural colours leaves.
    ///
    /// `table` is the luminance of the material.
    #[must_use]
    pub fn less_certain(mut self, table: &BivariateTable, light: &ChromaticLight) -> Self {
        if let Self::Estimate(found) = &mut self {
            found.add_error(table, ERROR_PER_GAP * light.chroma_residual[1], COLOUR_SEED);
        }
        self
    }

    /// Returns the chroma of every cell.
    pub fn field(&self) -> ChromaField {
        match self {
            Self::Grey | Self::GreyPhotograph => ChromaField::GREY,
            Self::Median(chroma) => ChromaField::uniform(*chroma),
            Self::Estimate(found) => found.field.clone(),
        }
    }

    /// Returns the linear RGB colour of the light, with luminance one; white if unknown.
    pub fn light(&self) -> Vec3 {
        match self {
            Self::Estimate(found) => found.light.chroma.rgb().as_vec3(),
            _ => Vec3::ONE,
        }
    }

    /// Returns the quantiles of every cell of red, green and blue.
    ///
    /// The layout is `[channel][quantile][cell]`, with the levels
    /// [`QUANTILE_LEVELS`](super::QUANTILE_LEVELS), in 1/sr on the scale of
    /// [`MaterialEstimate::table`]. Without estimated colours, the quantiles are those of the
    /// luminance times the uniform colour.
    pub fn quantiles(&self, material: &MaterialEstimate) -> [Vec<Vec<f32>>; 3] {
        let field = self.field();
        match self {
            Self::Estimate(found) => [0, 1, 2].map(|c| material.channel_quantiles(&found.draws, c)),
            _ => [0, 1, 2].map(|c| {
                let scaled = |values: &Vec<f32>| match field.ratios(c) {
                    None => values.clone(),
                    Some(ratios) => values.iter().zip(ratios).map(|(value, ratio)| value * ratio).collect(),
                };
                material.quantiles.iter().map(scaled).collect()
            }),
        }
    }
}

/// Estimates the colours; the channels are encoded in the same way as the luminance.
fn estimate(
    learnt: &LearntPosterior,
    colours: &ColourModel,
    images: &DiskImages<'_>,
    table: &BivariateTable,
    light: Option<Chroma>,
) -> Option<ColourEstimate> {
    let luminance = ChannelReading::of(learnt, images.luminance);
    let channels =
        images.channels.each_ref().map(|image| image.as_ref().map(|image| ChannelReading::of(learnt, image)));
    let posterior = colours.posterior(&luminance, &channels, light)?;
    let draws = posterior.draws(&learnt.latent_space, table, COLOUR_DRAWS, COLOUR_SEED);
    let (fields, lights): (Vec<ChromaField>, Vec<Chroma>) = draws.into_iter().unzip();
    let of_light = (posterior.light(), &lights[..], light.is_some());
    Some(ColourEstimate::of(table, posterior.field(&learnt.latent_space, table), fields, of_light))
}
