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

use super::{Material, Tint};

/// Number of draws of the colours.
pub(super) const COLOUR_DRAWS: usize = 128;

/// Seed of these draws.
pub(super) const COLOUR_SEED: u64 = 2;

/// Standard deviation of the error of the chroma over the difference that it leaves from green to
/// magenta (docs/trials.md).
const ERROR_PER_GAP: f64 = 1.0;

/// Ways to colour a BRDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColouringRule {
    /// The channels as they are estimated, with the light's colour removed as far as it is known.
    Estimate {
        /// The light's colour, where it is known; neutral otherwise.
        light: Option<Chroma>,
    },
    /// The median colour of the photograph for everything, light and reflectance together, as the
    /// paper displays its results.
    Median,
    /// Three equal channels.
    Grey,
}

impl Default for ColouringRule {
    fn default() -> Self {
        Self::Estimate { light: None }
    }
}

/// Colours, and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub enum Colouring {
    /// No colours were asked for.
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
    /// Finds the colours of a BRDF whose luminance is `table`, from observations without
    /// self-shadowing. A model without a model of colours gives the median colour.
    pub fn of(model: &Model, observations: &Observations, table: &BivariateTable, rule: &ColouringRule) -> Self {
        let samples = observations.samples();
        let image = DiskImage::gather(&samples);
        let channels = image.as_ref().map(|image| [0, 1, 2].map(|c| DiskImage::gather_channel(&samples, c, image)));
        let images = image.as_ref().zip(channels.as_ref());
        let images = images.map(|(luminance, channels)| DiskImages { luminance, channels });
        Self::of_images(model, observations, images.as_ref(), table, rule)
    }

    /// Finds the colours from images of the observations, if there are any.
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
        let seen: Vec<Vec3> = observations.colours.iter().flatten().copied().collect();
        if is_grey(&seen) {
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
                let median = median_colour(&Plane::from_vec(seen.len(), 1, seen), |_| true);
                Self::Median(Chroma::of(median.as_dvec3()))
            }
        }
    }

    /// These colours of a material of this luminance, less certain by what a light of natural
    /// colours leaves of the photograph's.
    #[must_use]
    pub fn less_certain(mut self, table: &BivariateTable, tint: &Tint) -> Self {
        if let Self::Estimate(found) = &mut self {
            found.add_error(table, ERROR_PER_GAP * tint.apart[1], COLOUR_SEED);
        }
        self
    }

    /// The chroma of every cell.
    pub fn field(&self) -> ChromaField {
        match self {
            Self::Grey | Self::GreyPhotograph => ChromaField::GREY,
            Self::Median(chroma) => ChromaField::uniform(*chroma),
            Self::Estimate(found) => found.field.clone(),
        }
    }

    /// Linear RGB of the light, of luminance one; white where it is not known.
    pub fn light(&self) -> Vec3 {
        match self {
            Self::Estimate(found) => found.light.chroma.rgb().as_vec3(),
            _ => Vec3::ONE,
        }
    }

    /// Quantiles of every cell of red, green and blue, `[channel][quantile][cell]` at
    /// [`SHARES`](super::SHARES), in 1/sr on the scale of [`Material::table`]. Without an estimate
    /// of the colours they are those of the luminance in the one colour that there is.
    pub fn quantiles(&self, material: &Material) -> [Vec<Vec<f32>>; 3] {
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

/// Reads the channels, each as the luminance is read.
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
    let draws = posterior.draws(&learnt.coordinates, table, COLOUR_DRAWS, COLOUR_SEED);
    let (fields, lights): (Vec<ChromaField>, Vec<Chroma>) = draws.into_iter().unzip();
    let of_light = (posterior.light(), &lights[..], light.is_some());
    Some(ColourEstimate::of(table, posterior.field(&learnt.coordinates, table), fields, of_light))
}
