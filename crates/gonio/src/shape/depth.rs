//! Positions from depth maps.

use glam::DVec3;
use thiserror::Error;

use super::{Camera, Projection};
use crate::picture::Plane;

/// Definition of depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthKind {
    /// Distance from the camera plane, along the camera axis, as in most renderers and sensors.
    #[default]
    AlongAxis,
    /// Distance from the camera, along the ray of the pixel.
    AlongRay,
}

/// Error of a depth map whose size differs from that of the camera's pictures.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error(
    "the depth map is {}x{} pixels, but the camera's image is {}x{}; use images of the same size",
    depths.0, depths.1, camera.0, camera.1
)]
pub struct DepthSize {
    /// Columns and rows of the depths.
    pub depths: (usize, usize),
    /// Columns and rows of the camera's pictures.
    pub camera: (usize, usize),
}

/// Computes the position visible in each pixel, in camera coordinates.
///
/// Axes are x right, y up, and `z` minus the depth along the axis. Depths are at the centres of
/// pixels, in the camera's unit of length. Depths that are not finite count as missing; with a
/// perspective camera, so do depths that are not positive.
///
/// # Errors
/// [`DepthSize`].
pub fn positions_of_depth(
    depth: &Plane<Option<f64>>,
    camera: &Camera,
    kind: DepthKind,
) -> Result<Plane<Option<DVec3>>, DepthSize> {
    if depth.size() != camera.size {
        return Err(DepthSize { depths: depth.size(), camera: camera.size });
    }
    let perspective = matches!(camera.projection, Projection::Perspective { .. });
    Ok(Plane::from_fn(depth.width(), depth.height(), |x, y| {
        let depth = depth[(x, y)].filter(|d| d.is_finite() && (*d > 0.0 || !perspective))?;
        let ray = camera.ray((x as f64 + 0.5, y as f64 + 0.5));
        let along = match kind {
            DepthKind::AlongRay => depth,
            DepthKind::AlongAxis => depth / -ray.direction.z,
        };
        Some(ray.origin + along * ray.direction).filter(|p| p.is_finite())
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the distances along the rays at which they hit a sphere.
    fn sphere(camera: &Camera, centre: DVec3, radius: f64) -> Plane<Option<f64>> {
        Plane::from_fn(camera.size.0, camera.size.1, |x, y| {
            let ray = camera.ray((x as f64 + 0.5, y as f64 + 0.5));
            let to = centre - ray.origin;
            let middle = to.dot(ray.direction);
            let squared = radius * radius - (to.length_squared() - middle * middle);
            (squared >= 0.0).then(|| middle - squared.sqrt())
        })
    }

    #[test]
    fn positions_from_depths_of_a_sphere_lie_on_it() {
        let size = (90, 70);
        let (centre, radius) = (DVec3::new(0.3, -0.2, -6.0), 1.5);
        for projection in [Projection::Orthographic { pixels_per_unit: 20.0 }, Projection::Perspective { focal: 100.0 }]
        {
            let camera = Camera::new(projection, (46.5, 33.0), size).unwrap();
            let along_ray = sphere(&camera, centre, radius);
            let along_axis = Plane::from_fn(size.0, size.1, |x, y| {
                let ray = camera.ray((x as f64 + 0.5, y as f64 + 0.5));
                along_ray[(x, y)].map(|d| -(ray.origin + d * ray.direction).z)
            });
            for (depths, kind) in [(&along_ray, DepthKind::AlongRay), (&along_axis, DepthKind::AlongAxis)] {
                let positions = positions_of_depth(depths, &camera, kind).unwrap();
                let observed = positions.as_slice().iter().flatten().count();
                assert!(observed > 1500 && observed == depths.as_slice().iter().flatten().count(), "{observed}");
                for (i, position) in positions.as_slice().iter().enumerate() {
                    let Some(position) = position else { continue };
                    assert!(((*position - centre).length() - radius).abs() < 1e-12, "{position}");
                    let (x, y) = camera.project(*position).unwrap();
                    assert!((x - (i % 90) as f64 - 0.5).abs() + (y - (i / 90) as f64 - 0.5).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn invalid_depths_give_no_position() {
        let camera = Camera::new(Projection::Perspective { focal: 10.0 }, (1.0, 0.5), (4, 1)).unwrap();
        let depths = Plane::from_vec(4, 1, vec![None, Some(f64::NAN), Some(-1.0), Some(2.0)]);
        let positions = positions_of_depth(&depths, &camera, DepthKind::AlongAxis).unwrap();
        assert_eq!(positions.as_slice(), [None, None, None, Some(DVec3::new(0.5, 0.0, -2.0))]);
        let error = positions_of_depth(&Plane::from_fn(2, 3, |_, _| None), &camera, DepthKind::AlongRay).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the depth map is 2x3 pixels, but the camera's image is 4x1; use images of the same size"
        );
    }
}
