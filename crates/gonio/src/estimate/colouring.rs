//! Colours of a material whose luminance is known.

use glam::Vec3;

use super::Tint;
use crate::colour::{Chroma, ClueFinder, ColourPosterior, TwoColours, is_grey};
use crate::model::Model;
use crate::picture::Plane;
use crate::reflectance::BivariateTable;
use crate::render::median_colour;
use crate::scene::Observations;

/// Standard deviation of the error of the chromas of body and highlight over the difference that
/// they leave from green to magenta (docs/trials.md).
const ERROR_PER_GAP: f64 = 2.0;

/// Ways to colour a BRDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColouringRule {
    /// A colour of the body and one of the highlight, each with the light's colour removed as far
    /// as the photograph determines it.
    Estimate {
        /// The light's colour, where it is known.
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
    /// The colours of body, highlight and light.
    Estimate {
        /// Colours with their uncertainty.
        posterior: Box<ColourPosterior>,
        /// Share of the highlight in the image, by which the clues were read
        /// ([`highlight_share`](crate::colour::highlight_share)).
        share: f64,
    },
}

impl Colouring {
    /// Finds the colours of a BRDF whose luminance is `table`. A model without a model of colours
    /// gives the median colour instead of an estimate.
    pub fn of(model: &Model, observations: &Observations, table: &BivariateTable, rule: &ColouringRule) -> Self {
        let light = match rule {
            ColouringRule::Grey => return Self::Grey,
            ColouringRule::Median => None,
            ColouringRule::Estimate { light } => *light,
        };
        let seen: Vec<Vec3> = observations.colours.iter().flatten().copied().collect();
        if is_grey(&seen) {
            return Self::GreyPhotograph;
        }
        let learnt = model.colours().filter(|_| *rule != ColouringRule::Median);
        let Some(learnt) = learnt else {
            let median = median_colour(&Plane::from_vec(seen.len(), 1, seen), |_| true);
            return Self::Median(Chroma::of(median.as_dvec3()));
        };
        let clues = ClueFinder::new().read(&observations.points, &observations.colours, table);
        Self::Estimate { posterior: Box::new(learnt.posterior(&clues, light)), share: clues.share }
    }

    /// These colours, less certain by what a light of natural colours leaves of the photograph's.
    pub fn less_certain(&self, tint: &Tint) -> Self {
        let mut out = self.clone();
        if let Self::Estimate { posterior, .. } = &mut out {
            posterior.add_error((ERROR_PER_GAP * tint.apart[1]).powi(2));
        }
        out
    }

    /// Colours of body and highlight.
    pub fn colours(&self) -> TwoColours {
        match self {
            Self::Grey | Self::GreyPhotograph => TwoColours::default(),
            Self::Median(chroma) => TwoColours::same(*chroma),
            Self::Estimate { posterior, .. } => posterior.colours(),
        }
    }

    /// Linear RGB of the light, of luminance one; white where it is not estimated.
    pub fn light(&self) -> Vec3 {
        match self {
            Self::Estimate { posterior, .. } => posterior.light().rgb().as_vec3(),
            _ => Vec3::ONE,
        }
    }
}
