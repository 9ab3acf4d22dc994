//! Surfaces in front of a camera.

use std::sync::Arc;

use super::{Camera, CameraError, Mesh, MeshDefects, MeshError, Surface, Tracer, hit_at};
use thiserror::Error;

/// Margin around a mesh without a camera, as a fraction of the smaller side of the picture.
const MARGIN: f64 = 0.05;

/// A surface in camera coordinates, with its camera.
#[derive(Clone)]
pub struct PosedSurface {
    /// The surface.
    pub surface: Arc<dyn Surface + Send>,
    /// The camera.
    pub camera: Camera,
    /// Whether the camera is the default one because none was given.
    pub default_camera: bool,
}

/// Error in placing a mesh in front of a camera.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PoseError {
    /// The camera is invalid, for example because the mesh has no extent to frame.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The mesh cannot be transformed to the camera.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// No ray hits the mesh.
    #[error("the mesh is not visible to the camera; check the pose and the camera (it looks along -z, y is up)")]
    Unseen,
}

impl PosedSurface {
    /// Places a mesh, given in world coordinates, in front of its camera.
    ///
    /// Without a camera, an orthographic one along -z frames the mesh, for pictures of `size`.
    ///
    /// # Errors
    /// If the mesh is not visible to the camera, or either of them is invalid.
    pub fn of_mesh(mesh: &Mesh, camera: Option<Camera>, size: (usize, usize)) -> Result<Self, PoseError> {
        let default_camera = camera.is_none();
        let camera = match camera {
            Some(camera) => camera,
            None => {
                let (centre, radius) = mesh.bounds();
                Camera::framing(centre, radius, size, MARGIN)?
            }
        };
        let surface = Arc::new(Tracer::new(mesh.transformed(&camera.to_world.inverse())?));
        let placed = Self { surface, camera, default_camera };
        if placed.is_seen() { Ok(placed) } else { Err(PoseError::Unseen) }
    }

    /// Returns whether the surface is visible in any pixel.
    ///
    /// Tests a coarse grid of a few hundred pixels first, then all pixels.
    fn is_seen(&self) -> bool {
        let (width, height) = self.camera.size;
        let step = (width.max(height) / 24).max(1);
        let met = |x: usize, y: usize| hit_at(self.surface.as_ref(), &self.camera, x, y).is_some();
        let coarse = (0..height).step_by(step).any(|y| (0..width).step_by(step).any(|x| met(x, y)));
        coarse || (0..height).any(|y| (0..width).any(|x| met(x, y)))
    }
}

impl MeshDefects {
    /// Describes the defects of the mesh; `None` for a mesh without defects.
    pub fn describe(&self) -> Option<String> {
        let Self {
            triangles,
            degenerate,
            non_manifold_edges,
            inconsistent_edges,
            inside_out,
            inconsistent_normals: normals_against,
            ..
        } = *self;
        let count = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}"));
        let defects: Vec<String> = [
            count(degenerate, "triangles with zero area (ignored)"),
            count(non_manifold_edges, "edges shared by more than two triangles"),
            count(inconsistent_edges, "edges between triangles of opposite orientation"),
            count(
                if 20 * normals_against > triangles { normals_against } else { 0 },
                "triangles whose normals point to the back (gonio uses the visible side)",
            ),
            inside_out.then(|| "all triangles facing inwards (gonio uses the visible side)".to_owned()),
        ]
        .into_iter()
        .flatten()
        .collect();
        (!defects.is_empty()).then(|| format!("the mesh of {triangles} triangles has {}", defects.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::{BuiltInShape, Projection};

    #[test]
    fn frames_meshes_and_rejects_invisible_ones() {
        let mesh = BuiltInShape::Blob.mesh(24).unwrap();
        let framed = PosedSurface::of_mesh(&mesh, None, (40, 30)).unwrap();
        assert_eq!(framed.camera.size, (40, 30));
        // The mesh is outside the picture.
        let aside = Camera::new(Projection::Orthographic { pixels_per_unit: 1.0 }, (-500.0, 0.0), (40, 30)).unwrap();
        assert_eq!(PosedSurface::of_mesh(&mesh, Some(aside), (40, 30)).err(), Some(PoseError::Unseen));
    }

    #[test]
    fn complains_only_about_meshes_with_defects() {
        assert_eq!(MeshDefects { triangles: 10, ..Default::default() }.describe(), None);
        let defects = MeshDefects { triangles: 10, degenerate: 2, inside_out: true, ..Default::default() };
        let complaint = defects.describe().unwrap();
        assert!(complaint.starts_with("the mesh of 10 triangles has 2 triangles with zero area"), "{complaint}");
        assert!(complaint.contains("inwards"), "{complaint}");
    }
}
