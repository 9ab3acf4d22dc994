//! Suggestions for errors and warnings.

use crate::scene::{Circle, Correction};

/// Suggested input or setting that resolves an error or a warning.
///
/// Each front end words suggestions in its own terms: options of a program or arguments of a
/// function.
#[derive(Clone, Debug, PartialEq)]
pub enum Suggestion {
    /// Specify the outline of the ball.
    Outline,
    /// Check the outline of the mirror ball.
    MirrorBall,
    /// Inflate the outline, if the object is smooth.
    Inflate,
    /// Specify one of these circles as the outline of the ball, the most probable first.
    OneOf(Vec<Circle>),
    /// Specify that the object is an ellipsoid.
    Ellipsoid,
    /// Specify the semi-axis of the ellipsoid towards the camera.
    DepthAxis,
    /// Specify the camera.
    Camera,
    /// Specify another pose of the mesh.
    Pose,
    /// Specify a mask of the object.
    Mask,
    /// Specify the shape as a mesh.
    Mesh,
    /// Specify the shape as a normal map.
    Normals,
    /// Apply one of these corrections to the channels of the normal map.
    NormalAxes(Vec<Correction>),
    /// Skip the consistency checks of the normals.
    TrustNormals,
    /// Treat the object as one material: use regions of another colour or paint as well.
    OneMaterial,
    /// Search for the rotation of the environment map.
    AlignLight,
    /// Estimate although shape or light contradict the photograph.
    Force,
    /// Specify that the values of an integer image are linear radiance.
    Linear,
    /// Select another layer of the file.
    Layer,
    /// Specify the depths of the smallest and the largest code.
    DepthRange,
    /// Specify the exposure times.
    Times,
    /// Use the exposure times without checks, and ignore inconsistent pixels.
    TrustTimes,
    /// Specify the response curve of the camera.
    Response,
    /// Specify the angle between the cameras around the ball.
    SecondAzimuth,
    /// Specify the outline of the ball in the second photograph.
    SecondOutline,
    /// Specify a mask of the ball in the second photograph.
    SecondMask,
    /// Specify the centres of the corner patches of the colour chart.
    ChartCorners,
    /// Specify the radiance at which the camera clips.
    ClipLevel,
    /// Use the colour of the reference, but not its brightness.
    ReferenceColourOnly,
    /// Pass one photograph at a time.
    Separately,
    /// Write to another folder.
    OtherFolder,
    /// Train a posterior of materials and add it to the model.
    LearnPosterior,
}
