//! Settings of an inference.

use gonio::colour::{Chroma, white_chroma};
use gonio::estimate::{Alignment, ColouringRule, EstimateSettings};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::sphere::OctahedralMap;
use gonio::suggestion::Suggestion;
use gonio_paper::{PaperMethod, PaperSettings};

use crate::{AppError, MirrorBall, Source, Spaces, SuggestionFormatter};

/// Settings of an inference: method, grid, colours and outputs.
pub struct Settings<'a> {
    /// Estimation method.
    pub method: Method,
    /// Texels along a side of the light's grid.
    pub side: usize,
    /// Model self-shadowing.
    pub shadows: bool,
    /// Rule for the colours.
    pub colours: ColourMode,
    /// Colour spaces of environment maps and outputs.
    pub spaces: Spaces,
    /// Draw the pictures.
    pub pictures: bool,
    /// Write the report, which requires the pictures.
    pub report: bool,
    /// Wording of suggestions in the front end.
    pub words: SuggestionFormatter<'a>,
}

/// Estimation methods.
#[derive(Clone, Debug)]
pub enum Method {
    /// Learnt posterior of materials, then the light given its mean.
    Learnt,
    /// Posterior of materials under a known light.
    KnownLight(KnownLight),
    /// A method of the paper under unknown light. [`Settings::side`] replaces the side.
    Paper(PaperSettings),
    /// Basis coefficients under a known light, as in the paper. [`Settings::side`] replaces the
    /// side.
    KnownLightBasis(PaperSettings, Source<EnvironmentMap>),
}

/// A known light.
#[derive(Clone, Debug)]
pub struct KnownLight {
    /// Its lat-long map in camera space.
    pub map: EnvironmentSource,
    /// Rotations of the map to search.
    pub alignment: Alignment,
    /// Map and photograph have the same scale, so that the reflectance is absolute.
    pub absolute: bool,
}

/// Source of the map of a known light.
#[derive(Clone, Debug)]
pub enum EnvironmentSource {
    /// A map.
    Map(Source<EnvironmentMap>),
    /// A mirror ball in the photograph.
    MirrorBall(MirrorBall),
}

impl EnvironmentSource {
    /// Returns the name in messages.
    pub(crate) fn name(&self) -> String {
        match self {
            Self::Map(map) => map.name("the light"),
            Self::MirrorBall(_) => "the mirror ball in the photograph".to_owned(),
        }
    }
}

impl Method {
    /// Returns the name of the method in results.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Learnt => "learnt",
            Self::Paper(PaperSettings { method: PaperMethod::Variational, .. }) => "variational",
            Self::Paper(PaperSettings { method: PaperMethod::JointMap, .. }) => "joint-map",
            Self::KnownLight(_) => "known-light",
            Self::KnownLightBasis(..) => "known-light-basis",
        }
    }

    /// Returns the settings of a method of the paper.
    pub(crate) fn paper(&self) -> Option<&PaperSettings> {
        match self {
            Self::Learnt | Self::KnownLight(_) => None,
            Self::Paper(paper) | Self::KnownLightBasis(paper, _) => Some(paper),
        }
    }

    /// Returns the map of the known light, unless the photograph shows it.
    pub(crate) fn light(&self) -> Option<&Source<EnvironmentMap>> {
        match self {
            Self::KnownLight(KnownLight { map: EnvironmentSource::Map(map), .. }) | Self::KnownLightBasis(_, map) => {
                Some(map)
            }
            _ => None,
        }
    }

    /// Returns the suggestion for a known light that the photograph contradicts.
    pub(crate) fn light_suggestion(&self) -> Option<Suggestion> {
        if self.mirror_ball().is_some() {
            return Some(Suggestion::MirrorBall);
        }
        self.light().map(|_| Suggestion::AlignLight)
    }

    /// Returns the mirror ball that shows the light.
    pub(crate) fn mirror_ball(&self) -> Option<&MirrorBall> {
        match self {
            Self::KnownLight(KnownLight { map: EnvironmentSource::MirrorBall(ball), .. }) => Some(ball),
            _ => None,
        }
    }

    /// Whether the method uses the learnt posterior of materials.
    fn is_learnt(&self) -> bool {
        matches!(self, Self::Learnt | Self::KnownLight(_))
    }
}

/// Rule for the colours of a BRDF.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ColourMode {
    /// Estimated chroma for every pair of angles; a light of unknown colour counts as neutral.
    #[default]
    Estimate,
    /// Estimated chroma under a light of known colour: that of a white matte ball.
    LightChroma(Chroma),
    /// The median colour of the photograph, as in the paper.
    Median,
    /// Three equal channels.
    Grey,
}

/// Assumption on the colour of an unknown light.
pub const AS_CAPTURED: &str = "the light is neutral; the intervals include the colours of captured lights";

impl ColourMode {
    /// Creates the rule for a light of this linear colour; `None` unless all numbers are positive
    /// and finite.
    pub fn under(light: [f64; 3]) -> Option<Self> {
        let sound = light.iter().all(|x| x.is_finite() && *x > 0.0);
        sound.then(|| Self::LightChroma(Chroma::of(light.into())))
    }

    /// Returns the rule, and the assumption on the colour of the light in words.
    pub fn rule(self, known: Option<&EnvironmentMap>) -> (ColouringRule, &'static str) {
        let (light, assumption) = match (self, known) {
            (Self::Grey, _) => return (ColouringRule::Grey, ""),
            (Self::Median, _) => return (ColouringRule::Median, ""),
            (Self::LightChroma(light), _) => (Some(light), "the light has the specified colour"),
            (Self::Estimate, Some(map)) => {
                // Four pixels per texel are enough for a mean.
                let grid = map.reduced(128).to_grid(OctahedralMap::EqualArea, 32);
                (
                    Some(white_chroma(&grid, glam::DQuat::IDENTITY)),
                    "the light has the mean colour of the environment map",
                )
            }
            (Self::Estimate, None) => (None, AS_CAPTURED),
        };
        (ColouringRule::Estimate { light }, assumption)
    }
}

impl Settings<'_> {
    /// Checks that a model supports the settings. `name` is the name of the model in messages.
    ///
    /// # Errors
    /// If the model has no posterior of materials and the method requires one, or if the model's
    /// light prior does not cover the grid.
    pub(crate) fn check(&self, model: &Model, name: &str) -> Result<(), AppError> {
        let covered = model.light.finest_side();
        if !self.side.is_power_of_two() || !(4..=covered).contains(&self.side) {
            let of_model = "the range of the model's prior of light";
            return Err(AppError::new(format!(
                "grid {}: must be a power of two from 4 to {covered}, {of_model}",
                self.side
            )));
        }
        if self.method.is_learnt() && model.learnt.is_none() {
            return Err(AppError::of(name, "has no posterior of materials").with([Suggestion::LearnPosterior]));
        }
        Ok(())
    }

    /// Returns the settings of [`estimate`](gonio::estimate::estimate).
    pub(crate) fn estimate(&self, colouring: ColouringRule) -> EstimateSettings {
        EstimateSettings { side: self.side, colouring, ..EstimateSettings::default() }
    }
}
