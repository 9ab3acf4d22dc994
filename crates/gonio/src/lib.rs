//! Blind reflectometry: the BRDF of an object of known shape from one photograph under light that
//! nobody measured.

#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod appearance;
pub mod bracket;
pub mod colour;
pub mod estimate;
pub mod inference;
pub mod lighting;
mod linalg;
pub mod model;
pub mod picture;
pub mod reflectance;
pub mod remedy;
pub mod render;
pub mod scene;
pub mod shape;
pub mod simulation;
pub mod sphere;
pub mod transfer;
