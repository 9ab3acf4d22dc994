//! Appearance of an object by normal, independent of its shape: under light from far away the
//! brightness of a convex surface is a function of its normal.
//!
//! [`inference::learnt`](crate::inference::learnt) infers the material from a [`DiskImage`], and
//! [`colour`](crate::colour) the colours from a [`Lattice`].

pub(crate) mod detail;
pub mod disk;
mod lattice;
mod scatter;
mod statistics;

pub use disk::{DiskImage, Sample};
pub use lattice::Lattice;
pub use scatter::scatter;
