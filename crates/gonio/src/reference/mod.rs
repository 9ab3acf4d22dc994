//! Neutral references in a photograph: a white patch, a grey card, a grey ball or a colour chart.
//!
//! A matte surface of reflectance `r` under irradiance `E` has the radiance `r E / pi`. A neutral
//! reference therefore gives the colour of the light that falls on it. If the reference faces the
//! camera, `E` is also the irradiance of a point of the object whose normal faces the camera, which
//! fixes the scale of the reflectance ([`ReferenceLight::scale`]). A ball shows `E` for all visible
//! normals.
//!
//! [`PatchReading`] measures one patch of known pixels, [`BallReading`] a matte ball.
//! [`ChartReading`] measures a 24-patch ColorChecker Classic at given corners, and [`find_chart`]
//! detects the chart.

mod ball;
mod chart;
mod colours;
mod detect;
mod error;
mod homography;
mod lattice;
mod light;
mod patch;
mod squares;
#[cfg(test)]
mod testing;

pub use ball::BallReading;
pub use chart::{ChartReading, Corners};
pub use colours::patch_colours;
pub use detect::find_chart;
pub use error::ReferenceError;
pub use light::{AbsoluteScale, ReferenceLight};
pub use patch::{PatchReading, check_apart, disk};
