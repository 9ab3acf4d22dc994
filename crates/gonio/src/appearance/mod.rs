//! What a photograph of a material looks like, apart from its light: statistics of the image over normals.
//!
//! Lights differ, but the lights of the world have something in common (lamps are small, edges run through all scales), and so do the images of one
//! material under them: how strong and how skewed they are at each scale, how they change towards the rim. [`inference::amortised`](crate::inference::amortised)
//! learns what these numbers say of the material.

pub mod disk;
mod lattice;

pub use disk::{DiskImage, Sample, scatter};
pub use lattice::{Gathered, Lattice};
