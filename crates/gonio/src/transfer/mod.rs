//! Bilinear operator of eq. 8: the image of a known shape for given coefficients (paper 3.3).
//!
//! * [`Quadrature`] integrates every basis function over every texel of the light grid for one
//!   point of the surface.
//! * [`Plan::build`] does so for all points and keeps the leading left singular directions of the
//!   result.
//! * [`Bilinear`] is the operator on those directions, which the inference uses.

mod bilinear;
pub(crate) mod kernels;
mod plan;
mod predict;
mod quadrature;
mod reference;
mod sketch;

pub use bilinear::Bilinear;
pub(crate) use plan::observed_rows;
pub use plan::{Plan, PlanError, PlanSettings, Projected};
pub use predict::{Prediction, predict};
pub use quadrature::{InterleavedTables, Quadrature, QuadratureSettings};
pub use reference::polar_reference;

#[cfg(test)]
pub(crate) use plan::tests::{sphere_points, toy_prior, toy_sky, toy_tables};
pub(crate) use sketch::column_bands;
