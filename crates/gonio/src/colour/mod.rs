//! Colours of a material: its three channels relative to its luminance. This extends the paper,
//! which infers luminance and displays it in one colour.
//!
//! A BRDF in colour is its luminance times a [`ChromaField`], a chroma for every pair of angles. A
//! material may have any number of colours.
//!
//! Each channel of a photograph is evaluated like the luminance. The [`ColourModel`], trained on
//! measured materials and simulated photographs, describes the differences between channels of
//! materials and the errors of their estimates. Both are Gaussian, and so is the posterior of the
//! differences ([`ColourModel::posterior`]). Under a known light, the same prior couples the
//! channels ([`KnownLightPosterior::with_channels`]).
//!
//! [`KnownLightPosterior::with_channels`]: crate::inference::known_light::KnownLightPosterior::with_channels
//!
//! A photograph does not separate the mean chroma of the material from that of the light. Unless
//! the chroma of the light is known, it is assumed neutral, and the uncertainty of the material's
//! chroma includes the spread of captured lights.

mod chroma;
mod differences;
mod estimate;
mod field;
mod learn;
mod model;
mod white;

pub use chroma::Chroma;
pub(crate) use chroma::luminance_weights;
pub use differences::{ChannelReading, channel_difference, mean_log_difference};
pub use estimate::{ChromaInterval, ColourEstimate};
pub use field::{ChromaField, SavedChroma};
pub use learn::ColourSample;
#[cfg(test)]
pub(crate) use model::tests::plain;
pub use model::{ColourModel, DifferencePosterior, LightComponent};
pub(crate) use model::{DRAW_FREEDOM, DRAW_INFLATION};
#[cfg(test)]
pub(crate) use white::mean_irradiance;
pub use white::{is_grey, white_chroma};
