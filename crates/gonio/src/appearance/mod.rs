//! What a photograph shows of each normal, whatever the shape: light from far away makes the brightness of a convex surface a function of its normal.
//!
//! [`DiskImage`] is what [`inference::amortised`](crate::inference::amortised) reads the material from, [`Lattice`] what [`colour`](crate::colour) reads.

pub mod disk;
mod lattice;

pub use disk::{DiskImage, Sample, scatter};
pub use lattice::Lattice;
