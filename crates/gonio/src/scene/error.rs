//! Errors in a mask, a circle, a normal map or the picture itself.

use thiserror::Error;

use super::circle::{MIN_BALL_RADIUS, MIN_SPAN};
use super::{Circle, CircleCandidate, CircleDoubt, Contradiction, Extent, ObservationReport};
use crate::shape::{CameraError, MeshError};
use crate::suggestion::Suggestion;
use crate::transfer::MIN_POINTS;

/// Axis ratio below which an elliptic outline is not that of a ball in perspective.
const MIN_BALL_AXIS_RATIO: f64 = 0.85;

/// Error in detecting or sampling an object; [`SceneError::suggestions`] lists suggestions.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SceneError {
    /// No pixel of the mask is at least half covered.
    #[error("the mask is empty: no pixel has at least 50 % coverage; use a mask that is white on the object")]
    EmptyMask,
    /// The covered part fills the picture, so there is no outline.
    #[error(
        "the mask covers the whole image, so the object has no outline; use a mask that is black around the object, \
         and check that it is not inverted"
    )]
    MaskEverywhere,
    /// The covered part is too small for a ball.
    #[error(
        "the ball in the mask has a radius of only {radius:.1} pixels, but at least {MIN_BALL_RADIUS} are required; \
         use a larger image, or check the mask"
    )]
    TooSmall {
        /// Estimated radius, in pixels; without a fitted circle, that of a disc of the same area.
        radius: f64,
    },
    /// Too little of the outline lies within the picture.
    #[error(
        "only {degrees:.0} degrees of the ball's outline lie in the image, but at least {:.0} are required",
        MIN_SPAN.to_degrees()
    )]
    ShortOutline {
        /// Angle that the visible part of the outline spans, in degrees.
        degrees: f64,
    },
    /// The outline is an ellipse, not a circle.
    #[error("the outline is an ellipse, not a circle (axis ratio 1 to {aspect:.3})")]
    Elliptic {
        /// Shorter over longer axis, below one.
        aspect: f64,
        /// Whether a camera was given, under which a ball has a round outline.
        under_camera: bool,
    },
    /// The outline is not a circle.
    #[error(
        "the outline is not a circle: it deviates by {residual:.1} pixels from the best circle, with a radius of \
         {radius:.1} pixels, and {stray} of its {rim} points are outliers"
    )]
    NotACircle {
        /// Typical distance of the outline from the circle, in pixels.
        residual: f64,
        /// Radius of the best circle, in pixels.
        radius: f64,
        /// Points of the outline that lie far off the circle.
        stray: usize,
        /// Points of the outline.
        rim: usize,
    },
    /// The outline is not an ellipse, or not that of a ball in perspective.
    #[error("the outline of the object is not an ellipse: its {rim} points deviate by {residual:.1} pixels")]
    NotAnEllipse {
        /// Distance from the best ellipse within which 70 % of the points of the outline lie, in
        /// pixels; zero if no ellipse was fitted.
        residual: f64,
        /// Points of the outline.
        rim: usize,
    },
    /// The given circle cannot be the outline of a ball.
    #[error(
        "the circle with centre ({x}, {y}) and radius {radius} is invalid; use finite numbers and a radius of at \
         least {min} pixels"
    )]
    BadCircle {
        /// Column of the centre, in pixels.
        x: f64,
        /// Row of the centre, in pixels.
        y: f64,
        /// Radius, in pixels.
        radius: f64,
        /// Smallest accepted radius, in pixels.
        min: f64,
    },
    /// Two pictures that must be aligned differ in size.
    #[error(
        "the {what} is {width}x{height} pixels, but the image is {picture_width}x{picture_height}; use images of \
         the same size"
    )]
    Sizes {
        /// Name of the image of the wrong size, for example `"mask"` or `"normal map"`.
        what: &'static str,
        /// Number of its columns.
        width: usize,
        /// Number of its rows.
        height: usize,
        /// Number of columns of the picture.
        picture_width: usize,
        /// Number of rows of the picture.
        picture_height: usize,
    },
    /// No pixel has both coverage and a normal.
    #[error(
        "no covered pixel has a normal; check that mask and normal map match, and that the normal map is not empty"
    )]
    NoNormals,
    /// Too many normals are not of unit length.
    #[error(
        "{count} of {covered} normals are not unit vectors (worst length {worst:.3}); normalise the normal map, \
         decode values from 0..1 to -1..1, and mask out the background"
    )]
    NotUnit {
        /// Normals whose length is off by more than 0.05.
        count: usize,
        /// Covered pixels with a normal.
        covered: usize,
        /// The length farthest from one.
        worst: f64,
    },
    /// Too many normals face away from the camera.
    #[error(
        "{count} of {covered} visible normals face away from the camera; use normals in camera space (x right, y up, z \
         towards the camera), and check that no axis is flipped"
    )]
    FacingAway {
        /// Unit normals with `z <= 0`.
        count: usize,
        /// Covered pixels with a unit normal.
        covered: usize,
    },
    /// The normals are (nearly) all the same.
    #[error(
        "the shape is too flat to separate light and reflectance: it has only {directions} different normals (1.6 \
         degrees apart), but at least {MIN_POINTS} are required; use a rounder object"
    )]
    TooFlat {
        /// Number of cells of the grid of directions that contain a normal.
        directions: usize,
    },
    /// Too many pixels have values that are not radiances (negative, NaN or infinite).
    #[error(
        "too few of the object's {observed} pixels are valid: {negative} are negative and {not_finite} are NaN or \
         infinite; write the image from linear radiance, or check the mask or circle"
    )]
    BadPixels {
        /// Pixels of negative luminance.
        negative: usize,
        /// Pixels with a channel that is NaN or infinite.
        not_finite: usize,
        /// All pixels of the observed part.
        observed: usize,
    },
    /// Too few pixels have a usable normal: the others are steep, at an edge or without a normal.
    #[error(
        "only {used} of the {covered} pixels on the object have a usable normal, but at least {MIN_POINTS} are \
         required; check the normal map and the mask"
    )]
    TooFewNormals {
        /// Pixels with a usable normal.
        used: usize,
        /// Pixels on the object.
        covered: usize,
    },
    /// Too few points have a value.
    #[error(
        "only {used} points on the object are usable, but {MIN_POINTS} are required; {clipped} are clipped and {outside} \
         are uncovered or outside the image; use a shorter exposure, or check the mask and the circle"
    )]
    TooFewPoints {
        /// Points with a value.
        used: usize,
        /// Points without a value because of clipping.
        clipped: usize,
        /// Points that are not covered or not within the picture.
        outside: usize,
    },
    /// An observed point is not on the surface.
    #[error(
        "an observed point does not lie on the surface; specify the mesh or depth map from which the normals were \
         computed"
    )]
    NoSurface,
    /// No object was detected by an alpha channel, a uniform background or edges.
    #[error("no object found: the image has no alpha channel, no uniform background and no clear circle")]
    NoOutline,
    /// Several objects were detected.
    #[error("detected {} separate objects: {}", .objects.len(), listed(.objects))]
    Several {
        /// The objects, the largest first.
        objects: Vec<Extent>,
    },
    /// No circle was reliably detected on a non-uniform background.
    #[error(
        "the ball was not reliably detected: {} has edges along {:.0} % of its outline{}",
        best_of(.candidates.len()),
        100.0 * .candidates.first().map_or(0.0, |first| first.support),
        .doubt.reason()
    )]
    Unsure {
        /// Reason why the best candidate is unreliable.
        doubt: CircleDoubt,
        /// Circles that may be its outline, the most probable first.
        candidates: Vec<CircleCandidate>,
    },
    /// The surface is not aligned with the mask.
    #[error(
        "the shape is not aligned with the object: the intersection over union of their pixels is only {:.0} %",
        100.0 * .overlap
    )]
    Misaligned {
        /// Pixels of both over pixels of either.
        overlap: f64,
        /// Whether the camera is the default one because none was given.
        default_camera: bool,
    },
    /// The normals are inconsistent.
    #[error(transparent)]
    Contradiction(Contradiction),
    /// The positions do not form a surface.
    #[error(transparent)]
    PositionMap(#[from] MeshError),
    /// The camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Every observed value is zero.
    #[error("the object is entirely black; check the exposure, and that the mask or circle lies on the object")]
    Black,
}

impl SceneError {
    /// Returns the error for too few valid pixels.
    pub(super) fn bad_pixels(report: &ObservationReport) -> Self {
        let ObservationReport { negative, not_finite, observed_pixels: observed, .. } = *report;
        Self::BadPixels { negative, not_finite, observed }
    }

    /// Lists suggestions, the most probable first.
    pub fn suggestions(&self) -> Vec<Suggestion> {
        match self {
            Self::MaskEverywhere | Self::ShortOutline { .. } => vec![Suggestion::Outline],
            Self::Elliptic { under_camera: false, aspect } if *aspect < MIN_BALL_AXIS_RATIO => {
                vec![Suggestion::Mesh, Suggestion::Normals, Suggestion::Inflate, Suggestion::Ellipsoid]
            }
            Self::Elliptic { under_camera: false, .. } => {
                vec![Suggestion::Ellipsoid, Suggestion::Outline, Suggestion::Camera]
            }
            Self::Elliptic { under_camera: true, .. } => vec![Suggestion::Mesh, Suggestion::Mask],
            Self::NotACircle { .. } => {
                vec![Suggestion::Mesh, Suggestion::Normals, Suggestion::Inflate, Suggestion::Outline]
            }
            Self::Several { objects } => {
                let circles: Vec<Circle> = objects.iter().filter_map(|object| object.circle).collect();
                let one = (!circles.is_empty()).then_some(Suggestion::OneOf(circles));
                one.into_iter().chain([Suggestion::Mask]).collect()
            }
            Self::Unsure { candidates, .. } => {
                vec![Suggestion::OneOf(candidates.iter().map(|candidate| candidate.circle).collect()), Suggestion::Mask]
            }
            Self::NotAnEllipse { .. } => {
                vec![Suggestion::Mesh, Suggestion::Normals, Suggestion::Inflate, Suggestion::Mask]
            }
            Self::NoOutline => vec![Suggestion::Mask, Suggestion::Outline],
            Self::Misaligned { default_camera: true, .. } => {
                vec![Suggestion::Camera, Suggestion::Pose, Suggestion::Force]
            }
            Self::Misaligned { default_camera: false, .. } => vec![Suggestion::Pose, Suggestion::Force],
            Self::Contradiction(it) => vec![it.suggestion(), Suggestion::TrustNormals],
            _ => Vec::new(),
        }
    }

    /// Whether the error concerns the outline, and therefore the mask.
    pub fn is_of_outline(&self) -> bool {
        matches!(
            self,
            Self::EmptyMask
                | Self::MaskEverywhere
                | Self::TooSmall { .. }
                | Self::ShortOutline { .. }
                | Self::Elliptic { .. }
                | Self::NotACircle { .. }
                | Self::NotAnEllipse { .. }
        )
    }
}

/// Lists objects by number, with their positions.
fn listed(objects: &[Extent]) -> String {
    let one = |(at, Extent { from, to, circle }): (usize, &Extent)| {
        let what = if circle.is_some() { "a ball" } else { "another shape" };
        format!("({}) {what} in columns {} to {} and rows {} to {}", at + 1, from.0, to.0, from.1, to.1)
    };
    objects.iter().enumerate().map(one).collect::<Vec<_>>().join(", ")
}

fn best_of(circles: usize) -> String {
    if circles == 1 {
        "the only candidate circle".to_owned()
    } else {
        format!("the best of {circles} candidate circles")
    }
}
