//! Inference of material and light from observations.
//!
//! * [`learnt`] evaluates the posterior of the material for a photograph under unknown light.
//! * [`known_light`] fits the material to a photograph under a known light.
//! * [`light`] integrates the light out given one BRDF: it computes a bound on the evidence of the
//!   BRDF and the posterior of the light.
//!
//! A [`Likelihood`] of one photograph can be multiplied by those of others ([`LikelihoodProduct`]).

mod image_prior;
pub mod known_light;
pub mod learnt;
pub mod light;
mod likelihood;

pub use image_prior::{Hyperparameters, ImageError, MODEL_ERROR};
pub use likelihood::{Embedding, Likelihood, LikelihoodProduct, MIN_SAME_MATERIAL_LOG_ODDS, ProductError};
