//! Points of a surface: what an image is sampled at, and an operator is made for.

use glam::{DQuat, DVec3};

use super::Visibility;

/// A point of the surface as the camera sees it; unit vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Surface normal.
    pub normal: DVec3,
    /// Direction towards the camera.
    pub view: DVec3,
}

/// Cosine between normal and view of a point that is just seen.
const LEAST_COSINE: f64 = 1e-3;

impl SurfacePoint {
    /// The normal in the frame of the view: z towards the camera, turned there by the shortest way.
    pub fn in_view(&self) -> DVec3 {
        DQuat::from_rotation_arc(self.view, DVec3::Z) * self.normal
    }

    /// The same point with its normal bent to where the camera just sees it, if it points away:
    /// normals that are interpolated do at the rim.
    #[must_use]
    pub fn facing(self) -> Self {
        let short = LEAST_COSINE - self.normal.dot(self.view);
        if short <= 0.0 { self } else { Self { normal: (self.normal + short * self.view).normalize(), ..self } }
    }
}

/// Points of a surface, and what keeps light from them.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    pub(crate) points: &'a [SurfacePoint],
    pub(crate) visibility: Option<&'a Visibility>,
}

impl<'a> Points<'a> {
    /// Points with the visibility of each; `None` where all light above the horizon arrives.
    ///
    /// # Panics
    /// If there is visibility for another number of points.
    pub fn new(points: &'a [SurfacePoint], visibility: Option<&'a Visibility>) -> Self {
        assert!(visibility.is_none_or(|v| v.len() == points.len()), "visibility of other points");
        Self { points, visibility }
    }

    /// The points.
    pub fn points(self) -> &'a [SurfacePoint] {
        self.points
    }

    /// Their visibility.
    pub fn visibility(self) -> Option<&'a Visibility> {
        self.visibility
    }

    /// Number of points.
    pub fn len(self) -> usize {
        self.points.len()
    }

    /// Whether there are none.
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
