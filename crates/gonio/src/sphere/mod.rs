//! Directions and functions on the sphere: half/difference angles, lat-long and octahedral maps,
//! the Haar transform.
//!
//! Axes: right-handed, x right, y up (gravity is -y), z from the object towards the camera.

mod direction;
mod haar;
mod octahedral;

pub use direction::{HalfDifference, direction_of_lat_long, fibonacci_hemisphere, half_difference};
pub(crate) use direction::{lat_long_of_direction, lat_long_solid_angle};
pub use haar::{Haar, Orientation, Real, Wavelet};
pub use octahedral::OctahedralMap;
