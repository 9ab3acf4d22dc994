//! Appearance of an object as a function of the normal, independent of its shape. Under distant
//! light, the brightness of a convex surface depends only on its normal.
//!
//! [`inference::learnt`](crate::inference::learnt) infers the material from a [`DiskImage`];
//! a [`Lattice`] chooses points that represent a photograph.

pub(crate) mod detail;
pub mod disk;
mod fineness;
mod lattice;
mod scatter;
mod statistics;

pub use disk::{DiskImage, Sample};
pub use fineness::fineness;
pub use lattice::Lattice;
pub use scatter::scatter;
