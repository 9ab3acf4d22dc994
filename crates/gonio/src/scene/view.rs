//! Surface given pixel by pixel.

use glam::{DVec3, Vec3};

use super::components::neighbours;
use crate::picture::Plane;
use crate::shape::{Camera, Projection, view_at};

/// Length below which a vector marks a pixel without normal.
const NO_NORMAL: f32 = 0.1;
/// Largest angle between the normals of neighbouring pixels, in degrees; above it there is an edge
/// between them.
const MAX_FOLD: f64 = 25.0;
/// Largest change of depth from a pixel to its neighbour, in widths of a pixel; above it the
/// surface steps back: tan 80 degrees on the diagonal.
const STEEPEST: f64 = 8.0;

/// Surface behind each pixel of a picture.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceView<'a> {
    /// Normals in coordinates of the camera, unit vectors; shorter than 0.1 or not finite where
    /// there is no normal.
    pub normals: &'a Plane<Vec3>,
    /// The camera; `None` for an orthographic one.
    pub camera: Option<&'a Camera>,
    /// Distance along the ray of each pixel, if known; detects where the surface steps back.
    pub distances: Option<&'a Plane<f32>>,
}

impl SurfaceView<'_> {
    /// Returns the unit vector to the camera from the point that a pixel (row-major index) shows.
    pub(super) fn view(&self, pixel: usize) -> DVec3 {
        let width = self.normals.width();
        self.camera.map_or(DVec3::Z, |camera| view_at(camera, pixel % width, pixel / width))
    }

    /// Whether the surface ends, steps back or folds between a pixel and one of its neighbours.
    /// Without distances, the mask determines where the surface ends.
    pub(super) fn is_edge(&self, x: usize, y: usize) -> bool {
        let normal = self.normals[(x, y)];
        let least = MAX_FOLD.to_radians().cos() as f32;
        neighbours((x, y), self.normals.size(), true).any(|next| {
            let other = self.normals[next];
            if !has_normal(other) {
                return self.distances.is_some();
            }
            let folds = other.dot(normal) < least * other.length() * normal.length();
            folds || self.distances.is_some_and(|d| self.steps((d[(x, y)], d[next])))
        })
    }

    /// Whether the surface steps back between two pixels.
    ///
    /// The threshold is the step of a surface seen at 80 degrees, along the diagonal.
    fn steps(&self, (near, far): (f32, f32)) -> bool {
        let footprint = match self.camera.map(|c| c.projection) {
            Some(Projection::Orthographic { pixels_per_unit }) => 1.0 / pixels_per_unit,
            Some(Projection::Perspective { focal }) => f64::from(near.min(far)) / focal,
            None => return false,
        };
        f64::from((near - far).abs()) > STEEPEST * footprint
    }
}

/// Whether a pixel of a normal map contains a normal.
pub(super) fn has_normal(normal: Vec3) -> bool {
    normal.is_finite() && normal.length() >= NO_NORMAL
}
