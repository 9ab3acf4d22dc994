//! Colours of a material: its three channels beside its luminance (beyond the paper, which infers
//! luminance and displays it in one colour).
//!
//! A BRDF in colour is its luminance times a [`ChromaField`], a chroma for every pair of angles. A
//! material may have any number of colours.
//!
//! Each channel of a photograph is read as the luminance is. The [`ColourModel`], learnt from
//! measured materials and simulated photographs, knows how the channels of materials differ and how
//! far readings of the differences are off; both are Gaussian, and so is the posterior of the
//! differences ([`ColourModel::posterior`]). Under a known light the same prior holds the channels
//! together ([`KnownLightPosterior::channels`](crate::inference::known_light::KnownLightPosterior)).
//!
//! No photograph separates the mean chroma of the material from that of the light. Unless the
//! light's chroma is given, it counts as neutral, and the uncertainty of the material's chroma
//! contains the spread of captured lights.

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
pub(crate) use white::is_grey;
pub use white::white_chroma;
