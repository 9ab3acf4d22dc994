//! Estimation from observations, by the posterior of materials with the light integrated out.
//!
//! [`estimate`] performs all steps. [`ColouredMaterial`] divides them into two: first the material
//! and its colours, then the light. [`estimate_known_light`] uses a known light, [`combine`]
//! combines several photographs, and [`estimate_regions`] estimates several materials under one
//! light. The methods of the paper, which estimate basis coefficients, are in the crate
//! `gonio-paper`.

mod chromatic_light;
mod colouring;
mod combine;
mod diagnostic;
mod ends;
mod highlight;
mod known_light;
mod light;
mod material;
mod misfit;
mod regions;
mod spots;
#[cfg(test)]
mod tests;

use thiserror::Error;

pub use crate::inference::known_light::Alignment;
pub use chromatic_light::ChromaticLight;
use chromatic_light::Rows;
pub use colouring::{Colouring, ColouringRule};
pub use combine::{Combined, combine};
pub use diagnostic::Diagnostic;
pub use ends::{BrdfRegion, Ends};
pub use highlight::{Finish, Highlight, WIDE, two_digits};
pub use known_light::{KnownLightEstimate, estimate_known_light};
pub use light::{Light, LightEstimator};
pub use material::{ALBEDO, MaterialEstimate, QUANTILE_LEVELS, draws, predictive_draws};
pub use misfit::{MAX_MISFIT, MisfitCause, NORMAL_REFINEMENT_MISFIT, expected_misfit};
pub use regions::{RegionEstimate, estimate_regions, irradiance};
pub use spots::without_misleading_spots;

use crate::inference::ProductError;
use crate::inference::known_light::KnownLightError;
use crate::inference::light::LightError;
use crate::lighting::{LightGrid, LightPrior};
use crate::model::Model;
use crate::reflectance::BivariateTable;
use crate::scene::Observations;
use material::MaterialDraft;

/// Settings of [`estimate`].
#[derive(Clone, Debug, PartialEq)]
pub struct EstimateSettings {
    /// Texels along a side of the light's grid before refinement ([`Light::grid`]): a power of two
    /// from 4 to what the model's prior covers
    /// ([`LightPrior::finest_side`](crate::lighting::LightPrior::finest_side)).
    pub side: usize,
    /// Approximate number of observations for the estimate of the light. With 1,600 observations,
    /// one or two of them see each texel of a 32 x 32 light in a mirror. With fewer observations
    /// than texels, only the prior determines the unseen texels, which produces a checkerboard.
    pub observations: usize,
    /// Rule for the colours.
    pub colouring: ColouringRule,
}

impl Default for EstimateSettings {
    fn default() -> Self {
        Self { side: 32, observations: 1600, colouring: ColouringRule::default() }
    }
}

/// Estimate from a photograph.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Material of the object, in luminance.
    pub material: MaterialEstimate,
    /// Light, in luminance, on the scale that corresponds to [`MaterialEstimate::table`].
    pub light: Light,
    /// Colours of both. The intervals include the chroma residual of the light's colours.
    pub colouring: Colouring,
    /// Colours of the light in each direction; `None` if the photograph or the requested BRDF is
    /// grey, or all observations are black.
    pub chromatic_light: Option<ChromaticLight>,
}

impl Estimate {
    /// Returns the BRDF of red, green and blue in 1/sr: linear Rec. 709, with a luminance albedo of
    /// [`ALBEDO`] at normal incidence.
    pub fn brdf(&self) -> [BivariateTable; 3] {
        self.colouring.field().tables(&self.material.table)
    }

    /// Returns the light in linear Rec. 709, on the scale that corresponds to [`Self::brdf`]. If
    /// its colours were not estimated by direction, the light has one colour.
    pub fn light_in_colour(&self) -> LightGrid {
        match &self.chromatic_light {
            Some(chromatic) => chromatic.grid.clone(),
            None => self.light.grid.coloured(self.colouring.light()),
        }
    }

    /// Returns the diagnostics of the estimate.
    pub fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut diagnostics = diagnostics(&self.material, &self.light);
        diagnostics.extend(self.chromatic_light.as_ref().and_then(ChromaticLight::diagnostic));
        diagnostics
    }
}

/// Returns the diagnostics of a material and its light, misfit first.
pub fn diagnostics(material: &MaterialEstimate, light: &Light) -> Vec<Diagnostic> {
    misfit::diagnostic(material, light).into_iter().chain(material.diagnostics()).collect()
}

/// Stages of [`estimate`], in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum EstimateStage {
    /// Maps the observations to standard normals and computes the posterior of materials.
    Material,
    /// Integrates the BRDF over the texels of the light.
    Transfer,
    /// Estimates the light.
    Light,
    /// Estimates the colours.
    Colours,
}

impl EstimateStage {
    /// Returns the name of the stage.
    pub fn name(self) -> &'static str {
        match self {
            Self::Material => "posterior",
            Self::Transfer => "transfer",
            Self::Light => "light",
            Self::Colours => "colour",
        }
    }
}

/// Error of an estimate.
#[derive(Debug, Error)]
pub enum EstimateError {
    /// The model was made for other methods.
    #[error("the model has no posterior of materials")]
    NotLearnt,
    /// No point has a value and a weight.
    #[error("no usable pixel lies on the object; check the mask and the exposure")]
    Unobserved,
    /// The side of the grid is invalid, or finer than the prior.
    #[error(
        "a light grid of {side} texels per side is not supported; use a power of two from 4 to {max}, the range of \
         the model's prior of light"
    )]
    Grid {
        /// Requested side.
        side: usize,
        /// Largest side that the prior covers.
        max: usize,
    },
    /// The image is black or not finite, or its equations have no solution.
    #[error(transparent)]
    Light(#[from] LightError),
    /// The photographs cannot be combined.
    #[error(transparent)]
    Product(#[from] ProductError),
    /// The estimation under the given light failed.
    #[error(transparent)]
    KnownLight(#[from] KnownLightError),
}

/// Estimates the material, its light and their colours from observations. `progress` is called when
/// a stage begins.
///
/// # Errors
/// If the model has no posterior of materials or does not cover the grid, the image is black, or
/// nothing is observed.
pub fn estimate(
    model: &Model,
    observations: &Observations,
    settings: &EstimateSettings,
    progress: &(dyn Fn(EstimateStage) + Sync),
) -> Result<Estimate, EstimateError> {
    let found = estimate_with_task(model, observations, settings, progress, |_, _| ());
    found.map(|(estimate, ())| estimate)
}

/// Estimates like [`estimate`], and calls `beside` in parallel with the estimation of the light.
///
/// `beside` receives the material, in luminance, and its colours. The estimation of the light
/// leaves a core idle half of the time.
///
/// # Errors
/// Those of [`estimate`].
pub fn estimate_with_task<T: Send>(
    model: &Model,
    observations: &Observations,
    settings: &EstimateSettings,
    progress: &(dyn Fn(EstimateStage) + Sync),
    beside: impl FnOnce(&MaterialEstimate, &Colouring) -> T + Send,
) -> Result<(Estimate, T), EstimateError> {
    settings.check(&model.light)?;
    progress(EstimateStage::Material);
    let draft = MaterialDraft::of(model, observations, settings.side)?;
    let table = draft.table.clone();
    // The quantiles and colours of the posterior are computed in parallel with the light.
    let (light, (material, colouring, made, rows)) = rayon::join(
        || Light::of(&model.light, observations, &table, settings, progress),
        || {
            let colouring = draft.colouring(model, observations, &settings.colouring);
            let rows = Rows::of(&model.light, observations, &table, &colouring, settings.side);
            let material = draft.describe();
            let made = beside(&material, &colouring);
            (material, colouring, made, rows)
        },
    );
    let light = light?;
    progress(EstimateStage::Colours);
    let chromatic_light = rows?.and_then(|rows| rows.under(&colouring, &light));
    Ok((ColouredMaterial { material, colouring }.under(light, chromatic_light), made))
}

/// Material and colours of an object, before its light is estimated.
#[derive(Clone, Debug)]
pub struct ColouredMaterial {
    /// Material of the object, in luminance.
    pub material: MaterialEstimate,
    /// Its colours. The intervals do not include the chroma residual of the light.
    pub colouring: Colouring,
}

impl ColouredMaterial {
    /// Estimates material and colours, as the first step of [`estimate`].
    ///
    /// # Errors
    /// Those of [`estimate`].
    pub fn of(model: &Model, observations: &Observations, settings: &EstimateSettings) -> Result<Self, EstimateError> {
        settings.check(&model.light)?;
        let draft = MaterialDraft::of(model, observations, settings.side)?;
        let colouring = draft.colouring(model, observations, &settings.colouring);
        Ok(Self { material: draft.describe(), colouring })
    }

    /// Estimates the light, as the second step of [`estimate`]. A coarser grid takes less time.
    ///
    /// # Errors
    /// Those of [`estimate`].
    pub fn with_light(
        &self,
        model: &Model,
        observations: &Observations,
        settings: &EstimateSettings,
        progress: &(dyn Fn(EstimateStage) + Sync),
    ) -> Result<Estimate, EstimateError> {
        settings.check(&model.light)?;
        let (table, colouring) = (&self.material.table, &self.colouring);
        let light = Light::of(&model.light, observations, table, settings, progress)?;
        progress(EstimateStage::Colours);
        let rows = Rows::of(&model.light, observations, table, colouring, settings.side)?;
        let chromatic_light = rows.and_then(|rows| rows.under(colouring, &light));
        Ok(self.clone().under(light, chromatic_light))
    }

    /// Adds a light. Its chroma residual widens the intervals of the colours.
    fn under(self, light: Light, chromatic_light: Option<ChromaticLight>) -> Estimate {
        let Self { material, colouring } = self;
        let colouring = match &chromatic_light {
            Some(light) => colouring.less_certain(&material.table, light),
            None => colouring,
        };
        Estimate { material, light, colouring, chromatic_light }
    }
}

/// # Errors
/// [`EstimateError::Unobserved`] if no point has a value and a weight.
fn check_observed(observations: &Observations) -> Result<(), EstimateError> {
    let weights = observations.effective_weights();
    let is_observed = observations.values.iter().zip(&weights).any(|(value, weight)| value.is_some() && *weight > 0.0);
    if is_observed { Ok(()) } else { Err(EstimateError::Unobserved) }
}

impl EstimateSettings {
    fn check(&self, prior: &LightPrior) -> Result<(), EstimateError> {
        let most = prior.finest_side();
        if self.side.is_power_of_two() && (4..=most).contains(&self.side) {
            Ok(())
        } else {
            Err(EstimateError::Grid { side: self.side, max: most })
        }
    }
}
