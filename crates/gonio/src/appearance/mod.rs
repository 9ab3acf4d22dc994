//! Appearance of an object as a function of the normal, independent of its shape. Under distant
//! light, the brightness of a convex surface depends only on its normal.
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
