//! G-buffer of a surface: normals and distances pixel by pixel.

use glam::{DVec3, Vec3};

use super::{Camera, Hit, Surface};
use crate::parallel;
use crate::picture::Plane;

/// Normals and distances at the centres of the pixels, in camera coordinates (a G-buffer).
#[derive(Clone, Debug, PartialEq)]
pub struct GeometryBuffer {
    /// Unit normals; `ZERO` where no surface is visible.
    pub normals: Plane<Vec3>,
    /// Distance along the ray; infinite where no surface is visible.
    pub distances: Plane<f32>,
    /// Number of pixels in which the surface is visible.
    pub visible: usize,
    /// Number of these pixels that show a back face, by the order of the corners of its triangles.
    pub back_facing: usize,
}

impl GeometryBuffer {
    /// Sends a ray through the centre of each pixel.
    pub fn of(surface: &dyn Surface, camera: &Camera) -> Self {
        let (width, height) = camera.size;
        let pixels: Vec<(Vec3, f32, bool)> =
            parallel::map_range(width * height, |i| match hit_at(surface, camera, i % width, i / width) {
                Some(hit) => (hit.normal.as_vec3(), hit.distance as f32, hit.back_facing),
                None => (Vec3::ZERO, f32::INFINITY, false),
            });
        Self {
            visible: pixels.iter().filter(|p| p.1.is_finite()).count(),
            back_facing: pixels.iter().filter(|p| p.2).count(),
            normals: Plane::from_vec(width, height, pixels.iter().map(|p| p.0).collect()),
            distances: Plane::from_vec(width, height, pixels.iter().map(|p| p.1).collect()),
        }
    }
}

/// Returns the intersection of the ray through the centre of a pixel.
pub fn hit_at(surface: &dyn Surface, camera: &Camera, column: usize, row: usize) -> Option<Hit> {
    surface.hit(&camera.ray((column as f64 + 0.5, row as f64 + 0.5)))
}

/// Returns the unit vector towards the camera along the ray of a pixel.
pub fn view_at(camera: &Camera, column: usize, row: usize) -> DVec3 {
    -camera.ray((column as f64 + 0.5, row as f64 + 0.5)).direction
}
