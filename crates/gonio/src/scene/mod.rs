//! Observations for the inference, from an image of an object of known shape (paper section 4).
//!
//! 1. `find_sphere` detects the outline of a ball by a mask, an alpha channel, a uniform
//!    background, or else by edges.
//! 2. `of_sphere` samples the image at normals distributed uniformly over the visible hemisphere;
//!    [`Observations::of_normals`] samples any shape with a normal map.
//!
//! [`Detection::of`] performs both steps for any [`ObjectShape`].
//!
//! `Orientation` checks the channels of a normal map and suggests a [`Correction`].
//!
//! Without a camera, the view is orthographic along -z: the direction to the camera is +z at every
//! point.
//! Pictures have x to the right and y down, with the centre of the first pixel at (0.5, 0.5);
//! normals have y up.
//!
//! The points of the surface depend on settings and shape, but not on the radiance. An unobserved
//! point (clipped, masked, cropped) has the value `None`.

mod background;
mod ball_detection;
mod balls;
mod cells;
mod circle;
mod circle_detection;
mod circle_fit;
mod components;
mod consistency;
mod correction;
mod detection;
mod edges;
mod error;
mod flat_background;
mod normals;
mod observations;
mod observed;
mod orientation;
mod outliers;
mod outline;
mod paint_segmentation;
#[cfg(test)]
mod painted_ball;
mod pattern;
mod repair;
mod rim;
mod scene_warning;
mod shading;
mod shadowed;
mod small;
mod spots;
mod status;
mod thinned;
mod view;
mod weights;

pub(crate) use background::coverage_of;
pub(crate) use ball_detection::outlined;
pub use balls::{Extent, outline_of_ball, separate_balls};
pub(crate) use circle::find_sphere;
pub use circle_detection::{CircleCandidate, CircleDoubt, OutlineReliability};
pub use circle_fit::Circle;
pub use correction::Correction;
pub use detection::{DetectedShape, Detection, NormalMap, ObjectShape, PositionMap};
pub use error::SceneError;
pub use observations::{ObservationReport, ObservationSettings, Observations, sphere_points};
pub(crate) use observed::{COVERED, check_size, clip_level, is_clipped};
pub use orientation::Contradiction;
pub(crate) use orientation::Orientation;
pub use outline::Ellipse;
pub(crate) use outline::{find_ball, find_ellipse};
pub use scene_warning::SceneWarning;
pub(crate) use shading::ShadingBasis;
pub use status::PixelStatus;
pub use view::SurfaceView;
