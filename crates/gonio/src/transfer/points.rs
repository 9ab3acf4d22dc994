//! The points that an operator is made for.

use super::SurfacePoint;
use crate::shape::Visibility;

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
