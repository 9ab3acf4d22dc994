//! Methods of estimating the channels of a material from a photograph.

use anyhow::Result;
use clap::ValueEnum;
use glam::Vec3;
use gonio::colour::{Chroma, ChromaField};
use gonio::estimate::{Alignment, Colouring, ColouringRule, MaterialEstimate, estimate_known_light};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::scene::Observations;

/// Texels along a side of the light's grid; the grid matters only for shapes with self-shadowing.
const GRID_SIDE: usize = 32;

/// A method of estimating the channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ColourEstimator {
    /// The luminance, in grey.
    Grey,
    /// The luminance in the median colour of the photograph: the paper's display rule.
    Median,
    /// Each channel by the luminance estimator, scaled to the mean of the channel.
    Separate,
    /// The default method.
    Blind,
    /// The default method, given the chroma of the light.
    LightColour,
    /// The luminance of the default method in the true chroma of every cell: an oracle.
    TrueChroma,
    /// Each channel by the luminance estimator under the channel of the true light.
    KnownLightSeparate,
    /// The default method for a known light.
    KnownLight,
    /// The luminance under the true light in the true chroma of every cell: an oracle.
    KnownLightTrueChroma,
}

/// A photograph of a ball with all inputs of the estimators and oracles.
pub(crate) struct Photograph<'a> {
    pub(crate) model: &'a Model,
    pub(crate) observations: Observations,
    /// The light, in the frame of the camera.
    pub(crate) light: &'a EnvironmentMap,
    /// Chroma of the light.
    pub(crate) light_chroma: Chroma,
    /// Channels of the material.
    pub(crate) truth: &'a [BivariateTable; 3],
}

/// Estimated channels.
pub(super) struct Found {
    pub(super) tables: [BivariateTable; 3],
    /// Quantiles at 5, 25, 75 and 95 % of every cell, `[channel][quantile][cell]`.
    pub(super) quantiles: Option<[Vec<Vec<f32>>; 3]>,
    /// 90 % interval of the chroma of the body.
    pub(super) body: Option<[[f64; 2]; 2]>,
    /// Whether the estimate has a warning.
    pub(super) warned: bool,
}

impl ColourEstimator {
    /// Returns the material and its colours by the default method, and whether they have a warning.
    /// Estimators other than blind, light colour and known light have the median colour.
    pub(crate) fn posterior(self, photograph: &Photograph<'_>) -> Result<(MaterialEstimate, Colouring, bool)> {
        let Photograph { model, observations, light, light_chroma, .. } = photograph;
        if self == Self::KnownLight {
            let rule = ColouringRule::default();
            let found = estimate_known_light(model, observations, (light, Alignment::Fixed), &rule, &|_| ())?;
            let warned = !found.diagnostics().is_empty();
            return Ok((found.material, found.colouring, warned));
        }
        let material = MaterialEstimate::of(model, observations, GRID_SIDE)?;
        let rule = match self {
            Self::Blind => ColouringRule::default(),
            Self::LightColour => ColouringRule::Estimate { light: Some(*light_chroma) },
            _ => ColouringRule::Median,
        };
        let colouring = Colouring::of(model, observations, &material.table, &rule);
        let warned = !material.diagnostics().is_empty();
        Ok((material, colouring, warned))
    }

    /// Estimates the channels.
    pub(super) fn estimate(self, photograph: &Photograph<'_>) -> Result<Found> {
        let Photograph { model, observations, light, truth, .. } = photograph;
        let luminance = || MaterialEstimate::of(model, observations, GRID_SIDE);
        let lit = |observations: &Observations, light: &EnvironmentMap, rule: &ColouringRule| {
            estimate_known_light(model, observations, (light, Alignment::Fixed), rule, &|_| ())
        };
        Ok(match self {
            Self::Grey => Found::plain(&luminance()?.table, &ChromaField::GREY),
            Self::Median | Self::Blind | Self::LightColour | Self::KnownLight => {
                let (material, colouring, warned) = self.posterior(photograph)?;
                Found::of(&material, &colouring, warned)
            }
            Self::Separate => {
                let channel = |c: usize| -> Result<BivariateTable> {
                    let alone = only(observations, c);
                    let mean = alone.values.iter().flatten().sum::<f64>();
                    Ok(MaterialEstimate::of(model, &alone, GRID_SIDE)?.table.scaled(mean))
                };
                Found::tables([channel(0)?, channel(1)?, channel(2)?])
            }
            Self::TrueChroma => Found::plain(&luminance()?.table, &ChromaField::of_tables(truth)),
            Self::KnownLightTrueChroma => {
                let found = lit(observations, light, &ColouringRule::Grey)?;
                Found::plain(&found.material.table, &ChromaField::of_tables(truth))
            }
            Self::KnownLightSeparate => {
                let channel = |c: usize| -> Result<BivariateTable> {
                    let map = EnvironmentMap::new(light.radiance().map(|rgb| Vec3::splat(rgb[c])))?;
                    let found = lit(&only(observations, c), &map, &ColouringRule::Grey)?;
                    Ok(found.material.table.scaled(found.exposure))
                };
                Found::tables([channel(0)?, channel(1)?, channel(2)?])
            }
        })
    }
}

/// Returns the observations of one channel, in grey.
fn only(observations: &Observations, channel: usize) -> Observations {
    let value = |rgb: &Option<Vec3>| rgb.map(|rgb| rgb[channel].max(0.0));
    let image: Vec<Option<f32>> = observations.colours.iter().map(value).collect();
    Observations {
        values: image.iter().map(|value| value.map(f64::from)).collect(),
        colours: image.iter().map(|value| value.map(Vec3::splat)).collect(),
        ..observations.clone()
    }
}

impl Found {
    fn tables(tables: [BivariateTable; 3]) -> Self {
        Self { tables, quantiles: None, body: None, warned: false }
    }

    fn plain(table: &BivariateTable, field: &ChromaField) -> Self {
        Self::tables(field.tables(table))
    }

    fn of(material: &MaterialEstimate, colouring: &Colouring, warned: bool) -> Self {
        let body = match colouring {
            Colouring::Estimate(found) => Some(found.body.interval),
            _ => None,
        };
        let quantiles = body.map(|_| colouring.quantiles(material));
        Self { tables: colouring.field().tables(&material.table), quantiles, body, warned }
    }
}
