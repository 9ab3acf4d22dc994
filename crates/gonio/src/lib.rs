//! Blind reflectometry: the BRDF of an object of known shape from one photograph under unknown
//! illumination, with its uncertainty.
//!
//! The default method, step by step:
//!
//! 1. [`picture::Picture`]: linear RGB radiance, decoded by `gonio-io`; [`bracket::merge`] makes
//!    one of several exposures.
//! 2. [`scene::Sighting::of`] finds the object in it and gives [`scene::Observations`]: points with
//!    a normal, a view direction and a luminance.
//! 3. [`inference::learnt::unshadow`] brings them to a disk of normals as a sphere would show them:
//!    [`appearance::DiskImage`].
//! 4. [`inference::learnt::LearntPosterior::posterior`] is the posterior of the material with the
//!    light integrated out, learnt from simulated photographs ([`simulation`]).
//! 5. [`inference::light::LightProblem`] finds the posterior of the light given that material.
//! 6. [`colour`] gives both their colours, and [`estimate::Doubt`] says what speaks against the
//!    answer.
//!
//! [`estimate::estimate`] does 3 to 6. The steps need a [`model::Model`].
//!
//! The methods of the paper leave after 2: [`transfer::Plan`] makes the bilinear operator of
//! eq. 8, [`transfer::Plan::project`] puts an image on its leading directions,
//! [`inference::Problem`] adds the priors, and [`inference::infer`] finds an
//! [`inference::Posterior`] by Algorithm 1 ([`inference::Method::Variational`]), as the joint
//! maximum, or under a known light.
//!
//! The other way round, [`render`] makes pictures of a BRDF ([`reflectance`]) on a sphere or a
//! surface ([`shape`]) in a light ([`lighting`]). [`probe`] unwraps photographs of a mirror ball to
//! such a light.
//!
//! Examples of a dozen lines each are in `crates/gonio-app/examples`, beside the crate that reads
//! and writes files with them: a photograph to its BRDF, a BRDF to a picture, the light of a known
//! BRDF, training.

#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod appearance;
pub mod bracket;
pub mod colour;
pub mod estimate;
pub mod gloss;
pub mod inference;
pub mod lighting;
mod linalg;
pub mod model;
pub mod picture;
pub mod probe;
pub mod reference;
pub mod reflectance;
pub mod remedy;
pub mod render;
pub mod scene;
pub mod shading;
pub mod shape;
pub mod simulation;
pub mod sphere;
#[cfg(test)]
mod testing;
pub mod transfer;
