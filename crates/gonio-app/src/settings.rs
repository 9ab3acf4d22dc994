//! Settings of an inference.

use gonio::colour::{Chroma, white_chroma};
use gonio::estimate::{Alignment, ColouringRule, EstimateSettings};
use gonio::inference::Solver;
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::remedy::Remedy;
use gonio::sphere::OctahedralMap;

use crate::{Problem, Source, Spaces, Words};

/// Settings of an inference: method, grid, colours, and which outputs are made.
pub struct Settings<'a> {
    /// How the material is found.
    pub method: Method,
    /// Texels along a side of the light's grid.
    pub side: usize,
    /// Model self-shadowing.
    pub shadows: bool,
    /// Rule for the colours.
    pub colours: Colours,
    /// Colour spaces of light maps and outputs.
    pub spaces: Spaces,
    /// Draw the pictures.
    pub pictures: bool,
    /// Make the page, which needs the pictures.
    pub report: bool,
    /// How the front end words remedies.
    pub words: Words<'a>,
}

/// Ways to find a material.
#[derive(Clone, Debug)]
pub enum Method {
    /// The learnt posterior of materials, then the light given its mean.
    Learnt,
    /// The posterior of materials under a light that is known.
    KnownLight(KnownLight),
    /// The separable posterior of light and reflectance: Algorithm 1 of the paper.
    Variational(Search),
    /// The joint maximum of light and reflectance.
    JointMaximum(Search),
    /// Coefficients in the basis under a light that is known: the paper's estimate.
    KnownLightBasis(Search, Source<EnvironmentMap>),
}

/// A light that is known.
#[derive(Clone, Debug)]
pub struct KnownLight {
    /// Its lat-long map in camera space.
    pub map: Source<EnvironmentMap>,
    /// How far it may lie from where the map has it.
    pub alignment: Alignment,
    /// Map and photograph are on one scale, so that reflectance is absolute.
    pub absolute: bool,
}

/// How coefficients of reflectance are searched for.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    /// Solver of the separable posterior.
    pub solver: Solver,
    /// Random starts, at least one.
    pub starts: usize,
    /// Their seed.
    pub seed: u64,
    /// The paper's own version: its map of light, its normals, its starts, Algorithm 1 as printed.
    pub paper: bool,
    /// Run on all observations instead of their projection.
    pub full_rows: bool,
}

impl Method {
    /// Its name in results.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Learnt => "learnt",
            Self::Variational(_) => "variational",
            Self::JointMaximum(_) => "map",
            Self::KnownLight(_) => "known-light",
            Self::KnownLightBasis(..) => "known-light-basis",
        }
    }

    /// How it searches, if it does.
    pub(crate) fn search(&self) -> Option<&Search> {
        match self {
            Self::Learnt | Self::KnownLight(_) => None,
            Self::Variational(search) | Self::JointMaximum(search) | Self::KnownLightBasis(search, _) => Some(search),
        }
    }

    /// The known light.
    pub(crate) fn light(&self) -> Option<&Source<EnvironmentMap>> {
        match self {
            Self::KnownLight(KnownLight { map, .. }) | Self::KnownLightBasis(_, map) => Some(map),
            _ => None,
        }
    }

    /// Whether it starts from the learnt posterior of materials.
    fn is_learnt(&self) -> bool {
        matches!(self, Self::Learnt | Self::KnownLight(_))
    }
}

/// Rule for the colours of a BRDF.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Colours {
    /// A colour of the body and one of the highlight; the light's is as captured lights have it.
    #[default]
    Estimate,
    /// As [`Self::Estimate`], with the known colour of the light, that of a white matte ball.
    Under(Chroma),
    /// The median colour of the photograph for all: how the paper displays its results.
    Median,
    /// Three equal channels.
    Grey,
}

/// Assumption on the colour of an unknown light.
pub const AS_CAPTURED: &str = "the light has a colour as captured lights have, around white";

impl Colours {
    /// Under a light of this linear colour; `None` unless all numbers are positive and finite.
    pub fn under(light: [f64; 3]) -> Option<Self> {
        let sound = light.iter().all(|x| x.is_finite() && *x > 0.0);
        sound.then(|| Self::Under(Chroma::of(light.into())))
    }

    /// The rule, and in words what is taken for the light's colour.
    pub fn rule(self, known: Option<&EnvironmentMap>) -> (ColouringRule, &'static str) {
        let (light, assumption) = match (self, known) {
            (Self::Grey, _) => return (ColouringRule::Grey, ""),
            (Self::Median, _) => return (ColouringRule::Median, ""),
            (Self::Under(light), _) => (Some(light), "the light has the colour that was given"),
            (Self::Estimate, Some(map)) => {
                // Four pixels to a texel are enough for a mean.
                let grid = map.reduced(128).to_grid(OctahedralMap::EqualArea, 32);
                (Some(white_chroma(&grid, glam::DQuat::IDENTITY)), "the light has the mean colour of the map given")
            }
            (Self::Estimate, None) => (None, AS_CAPTURED),
        };
        (ColouringRule::Estimate { light }, assumption)
    }
}

impl Settings<'_> {
    /// Checks that a model can serve the settings. `name` is the name of the model in messages.
    ///
    /// # Errors
    /// If the model lacks what the method needs, or its prior does not cover the grid.
    pub(crate) fn check(&self, model: &Model, name: &str) -> Result<(), Problem> {
        let covered = model.light.finest_side();
        if !self.side.is_power_of_two() || !(4..=covered).contains(&self.side) {
            let of_model = "which the model's prior of light covers";
            return Err(Problem::new(format!(
                "grid {}: give a power of two from 4 to {covered}, {of_model}",
                self.side
            )));
        }
        if self.method.is_learnt() && model.learnt.is_none() {
            return Err(Problem::of(name, "has no posterior of materials").with(Remedy::LearnPosterior));
        }
        Ok(())
    }

    /// How [`estimate`](gonio::estimate::estimate) is asked.
    pub(crate) fn estimate(&self, colouring: ColouringRule) -> EstimateSettings {
        EstimateSettings { side: self.side, colouring, ..EstimateSettings::default() }
    }
}
