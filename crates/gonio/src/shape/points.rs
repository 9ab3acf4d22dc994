//! Surface points at which a photograph is sampled and operators are computed.

use glam::{DQuat, DVec3};

use super::Visibility;

/// A visible point of a surface; both vectors have unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Surface normal.
    pub normal: DVec3,
    /// Direction towards the camera.
    pub view: DVec3,
}

/// Cosine between normal and view of a point that barely faces the camera.
const MIN_COSINE: f64 = 1e-3;

impl SurfacePoint {
    /// Returns the normal in the view frame, whose z axis points towards the camera.
    ///
    /// The rotation to this frame is along the shortest arc.
    pub fn in_view(&self) -> DVec3 {
        DQuat::from_rotation_arc(self.view, DVec3::Z) * self.normal
    }

    /// Returns the point with its normal bent towards the camera if it points away.
    ///
    /// Interpolated normals may point away at the rim.
    #[must_use]
    pub fn facing(self) -> Self {
        let short = MIN_COSINE - self.normal.dot(self.view);
        if short <= 0.0 { self } else { Self { normal: (self.normal + short * self.view).normalize(), ..self } }
    }
}

/// Points of a surface and the visibility of the light from them.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    pub(crate) points: &'a [SurfacePoint],
    pub(crate) visibility: Option<&'a Visibility>,
}

impl<'a> Points<'a> {
    /// Combines points with their visibility; `None` if all light above the horizon arrives.
    ///
    /// # Panics
    /// If the numbers of points and visibilities differ.
    pub fn new(points: &'a [SurfacePoint], visibility: Option<&'a Visibility>) -> Self {
        assert!(visibility.is_none_or(|v| v.len() == points.len()), "points and visibility differ in number");
        Self { points, visibility }
    }

    /// Returns the points.
    pub fn points(self) -> &'a [SurfacePoint] {
        self.points
    }

    /// Returns the visibility of the points.
    pub fn visibility(self) -> Option<&'a Visibility> {
        self.visibility
    }

    /// Returns the number of points.
    pub fn len(self) -> usize {
        self.points.len()
    }

    /// Returns whether there are no points.
    pub fn is_empty(self) -> bool {
        self.points.is_empty()
    }
}

impl<'a> From<&'a [SurfacePoint]> for Points<'a> {
    fn from(points: &'a [SurfacePoint]) -> Self {
        Self::new(points, None)
    }
}

impl<'a> From<&'a Vec<SurfacePoint>> for Points<'a> {
    fn from(points: &'a Vec<SurfacePoint>) -> Self {
        Self::new(points, None)
    }
}
