//! What a user can do about an error or a warning.

use crate::scene::{Circle, Correction};

/// An input or setting that settles an error or a warning.
///
/// The library knows neither options of a program nor arguments of a function: each front end words
/// a remedy in its own terms.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Remedy {
    /// Give the outline of the ball.
    Outline,
    /// Give one of these circles as the outline of the ball, the most probable first.
    OneOf(Vec<Circle>),
    /// Say that the object is an ellipsoid.
    Ellipsoid,
    /// Give the semi-axis of the ellipsoid towards the camera.
    DepthAxis,
    /// Give the camera.
    Camera,
    /// Give another pose of the mesh.
    Pose,
    /// Give a mask of the object.
    Mask,
    /// Give the shape as a mesh.
    Mesh,
    /// Give the shape as a picture of normals.
    Normals,
    /// Bring the channels of the normals into order by one of these corrections.
    NormalAxes(Vec<Correction>),
    /// Take the normals as they are.
    TrustNormals,
    /// Observe regions of another colour, too.
    KeepColours,
    /// Say that the values of an integer picture are linear radiance.
    Linear,
    /// Choose another layer of the file.
    Layer,
    /// Give the depths that the least and the largest code stand for.
    DepthRange,
    /// Give the exposure times.
    Times,
    /// Give the angle by which the second camera went around the ball.
    Turn,
    /// Give the outline of the ball in the second photograph.
    SecondOutline,
    /// Give a mask of the ball in the second photograph.
    SecondMask,
    /// Give the centres of the corner patches of the colour chart.
    ChartCorners,
    /// Give the radiance at which the camera clips.
    ClipLevel,
    /// Take the colour of the light from the reference, and not the scale.
    ReferenceColourOnly,
    /// Give each of several photographs by itself.
    Separately,
    /// Learn a posterior of materials and join it to the model.
    LearnPosterior,
}
