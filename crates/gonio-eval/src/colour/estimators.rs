//! Ways to find the channels of a material from a photograph of it.

use anyhow::Result;
use clap::ValueEnum;
use glam::Vec3;
use gonio::colour::{Chroma, ChromaField};
use gonio::estimate::{Alignment, Colouring, ColouringRule, Material, estimate_under};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::picture::luminance;
use gonio::reflectance::BivariateTable;
use gonio::scene::{ObservationReport, Observations};
use gonio::shape::SurfacePoint;

/// Texels along a side of the light's grid; it matters for shapes with self-shadowing alone.
const SIDE: usize = 32;

/// A way to find the channels.
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

/// A photograph of a ball with everything that an estimator or an oracle may look at.
pub(super) struct Photograph<'a> {
    pub(super) model: &'a Model,
    pub(super) observations: Observations,
    /// The light, in the frame of the camera.
    pub(super) light: &'a EnvironmentMap,
    /// Chroma of the light.
    pub(super) light_chroma: Chroma,
    /// Channels of the material.
    pub(super) truth: &'a [BivariateTable; 3],
}

/// Channels that were found.
pub(super) struct Found {
    pub(super) tables: [BivariateTable; 3],
    /// Quantiles at 5, 25, 75 and 95 % of every cell, `[channel][quantile][cell]`.
    pub(super) quantiles: Option<[Vec<Vec<f32>>; 3]>,
    /// 90 % interval of the chroma of the body.
    pub(super) body: Option<[[f64; 2]; 2]>,
    /// Whether the answer carries a warning.
    pub(super) warned: bool,
}

/// Observations of points, each of a linear RGB value.
pub(super) fn observed(points: &[SurfacePoint], image: &[Vec3]) -> Observations {
    let count = points.len();
    Observations {
        points: points.to_vec(),
        pixels: vec![(0.0, 0.0); count],
        values: image.iter().map(|rgb| Some(f64::from(luminance(*rgb)))).collect(),
        colours: image.iter().copied().map(Some).collect(),
        weights: vec![1.0; count],
        visibility: None,
        open: vec![1.0; count],
        report: ObservationReport::default(),
        fates: None,
        dense: Vec::new(),
    }
}

impl ColourEstimator {
    /// Finds the channels.
    pub(super) fn estimate(self, photograph: &Photograph<'_>) -> Result<Found> {
        let Photograph { model, observations, light, light_chroma, truth } = photograph;
        let luminance = || Material::of(model, observations, SIDE);
        let lit = |observations: &Observations, light: &EnvironmentMap, rule: &ColouringRule| {
            estimate_under(model, observations, (light, Alignment::Fixed), rule, &|_| ())
        };
        Ok(match self {
            Self::Grey => Found::plain(&luminance()?.table, &ChromaField::GREY),
            Self::Median | Self::Blind | Self::LightColour => {
                let material = luminance()?;
                let given = (self == Self::LightColour).then_some(*light_chroma);
                let rule = match self {
                    Self::Median => ColouringRule::Median,
                    _ => ColouringRule::Estimate { light: given },
                };
                let colouring = Colouring::of(model, observations, &material.table, &rule);
                Found::of(&material, &colouring, !material.doubts().is_empty())
            }
            Self::Separate => {
                let channel = |c: usize| -> Result<BivariateTable> {
                    let alone = only(observations, c);
                    let mean = alone.values.iter().flatten().sum::<f64>();
                    Ok(Material::of(model, &alone, SIDE)?.table.scaled(mean))
                };
                Found::tables([channel(0)?, channel(1)?, channel(2)?])
            }
            Self::TrueChroma => Found::plain(&luminance()?.table, &ChromaField::of_tables(truth)),
            Self::KnownLight => {
                let found = lit(observations, light, &ColouringRule::default())?;
                Found::of(&found.material, &found.colouring, !found.doubts().is_empty())
            }
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

/// The observations of a channel alone, in grey.
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

    fn of(material: &Material, colouring: &Colouring, warned: bool) -> Self {
        let body = match colouring {
            Colouring::Estimate(found) => Some(found.body.interval),
            _ => None,
        };
        let quantiles = body.map(|_| colouring.quantiles(material));
        Self { tables: colouring.field().tables(&material.table), quantiles, body, warned }
    }
}
