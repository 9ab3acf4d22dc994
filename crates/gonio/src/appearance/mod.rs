//! What a photograph shows of each normal, whatever the shape: light from far away makes the
//! brightness of a convex surface a function of its normal.
//!
//! [`DiskImage`] is what [`inference::learnt`](crate::inference::learnt) reads the material
//! from, [`Lattice`] what [`colour`](crate::colour) reads.

pub(crate) mod detail;
pub mod disk;
mod lattice;
mod scatter;
mod statistics;

pub use disk::{DiskImage, Sample};
pub use lattice::Lattice;
pub use scatter::scatter;
