//! Blind reflectometry: estimates the BRDF of an object of known shape, with its uncertainty, from
//! one photograph under unknown light.
//!
//! ```
//! use gonio::estimate::{EstimateSettings, estimate};
//! use gonio::model::Model;
//! use gonio::picture::Picture;
//! use gonio::reflectance::BivariateTable;
//! use gonio::scene::{Detection, ObjectShape, ObservationSettings};
//!
//! /// Returns the BRDF of a ball (red, green and blue) from a photograph of it. `clip` is the
//! /// radiance at which the camera clips.
//! fn brdf(
//!     model: &Model,
//!     photograph: &Picture,
//!     clip: Option<f32>,
//! ) -> Result<[BivariateTable; 3], Box<dyn std::error::Error>> {
//!     let settings = ObservationSettings { clip, ..ObservationSettings::default() };
//!     let ball = Detection::of(photograph, None, ObjectShape::Sphere(None), &settings)?;
//!     let found = estimate(model, &ball.observations, &EstimateSettings::default(), &|_| ())?;
//!     found.diagnostics().iter().for_each(|warning| eprintln!("warning: {warning}"));
//!     Ok(found.brdf())
//! }
//! ```
//!
//! `gonio_io::picture::read` reads photographs, and `gonio_io::model::embedded` the model.
//!
//! Steps of the default method:
//!
//! 1. [`picture::Picture`]: linear RGB radiance, decoded by `gonio-io`; [`bracket::merge`] makes
//!    one of several exposures.
//! 2. [`scene::Detection::of`] detects the object and returns [`scene::Observations`]: points with
//!    a normal, a view direction and a luminance.
//! 3. [`inference::learnt::to_sphere_equivalent`] converts them to the image of a sphere on the
//!    disk of normals, [`appearance::DiskImage`].
//! 4. [`inference::learnt::LearntPosterior::posterior`] evaluates the posterior of the material,
//!    marginalised over the light. It is learnt from simulated photographs ([`simulation`]).
//! 5. [`inference::light::LightProblem`] computes the posterior of the light given that material.
//! 6. [`colour`] estimates the colours of both, and [`estimate::Diagnostic`] reports diagnostics.
//!
//! [`estimate::estimate`] performs steps 3 to 6. The steps require a [`model::Model`].
//!
//! Under a known light, [`estimate::estimate_known_light`] replaces steps 3 to 5. The crate
//! `gonio-paper` contains the methods of the paper, which also start from step 2.
//!
//! In the forward direction, [`render`] renders a BRDF ([`reflectance`]) on a sphere or a surface
//! ([`shape`]) under a light ([`lighting`]). [`probe`] converts photographs of a mirror ball to
//! such a light.
//!
//! `crates/gonio-app/examples` contains short examples: inference, rendering, estimation of the
//! light for a known BRDF, and training.

#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod appearance;
pub mod bracket;
pub mod colour;
pub mod estimate;
pub mod gloss;
pub mod inference;
pub mod lighting;
pub mod model;
mod parallel;
pub mod picture;
pub mod probe;
pub mod reference;
pub mod reflectance;
pub mod render;
pub mod scene;
mod search;
pub mod shading;
pub mod shape;
pub mod simulation;
pub mod sphere;
mod statistics;
pub mod suggestion;
#[cfg(test)]
mod testing;
pub mod transfer;
