//! Light transport of eq. 8: the image of a known shape for given light and reflectance.
//!
//! * [`Quadrature`] integrates every table over every texel of the light grid for one point of the
//!   surface.
//! * [`TransferRows`] computes the rows of all points in the Haar domain.
//! * [`predict`] predicts the pixels of a surface from a BRDF and a light.

mod kernels;
mod predict;
mod quadrature;
mod reference;
mod rows;
mod sparse;

pub use predict::{Prediction, predict};
pub use quadrature::{InterleavedTables, Quadrature, QuadratureSettings};
pub use reference::polar_reference;
pub use rows::{MIN_POINTS, TransferError, TransferRows, TransferSettings, observed_rows};
pub use sparse::SparseTransfer;
