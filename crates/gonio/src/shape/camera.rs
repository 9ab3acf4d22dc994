//! Cameras: rays of pixels and projection of positions.

use glam::{DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Projection of positions to pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Projection {
    /// Parallel rays along -z.
    Orthographic {
        /// Pixels per unit of length.
        pixels_per_unit: f64,
    },
    /// Rays from the camera's position.
    Perspective {
        /// Focal length in pixels: at depth `d`, a unit of length covers `focal / d` pixels.
        focal: f64,
    },
}

/// A camera without distortion and with square pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Projection.
    pub projection: Projection,
    /// Principal point in pixels from the top left corner, where the camera axis meets the picture.
    pub principal: (f64, f64),
    /// Columns and rows of the picture.
    pub size: (usize, usize),
    /// Transformation from camera to world coordinates: a rotation and a translation.
    pub to_world: DMat4,
}

/// A half line; `direction` is a unit vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin of the ray.
    pub origin: DVec3,
    /// Direction of the ray.
    pub direction: DVec3,
}

/// Error of invalid camera parameters.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CameraError {
    /// A number is not positive and finite.
    #[error("the {what} is {value}; use a positive, finite number")]
    NotPositive {
        /// Name of the number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// The picture has no pixels, or the principal point is not finite or too far away.
    #[error("the image size {0}x{1} or the principal point is invalid; use finite numbers and at least one pixel")]
    Frame(usize, usize),
    /// The pose is not a rotation and translation.
    #[error(
        "the pose of the camera is not a rotation and translation (axes of lengths {lengths:?}, determinant \
         {determinant:.3}); remove scaling, shearing and mirroring"
    )]
    NotRigid {
        /// Lengths of the three axes.
        lengths: [f64; 3],
        /// Determinant of the axes.
        determinant: f64,
    },
}

impl Camera {
    /// Builds a camera at the origin that looks along -z.
    ///
    /// # Errors
    /// If a number is not positive and finite, or the picture is empty.
    pub fn new(projection: Projection, principal: (f64, f64), size: (usize, usize)) -> Result<Self, CameraError> {
        let (what, value) = match projection {
            Projection::Orthographic { pixels_per_unit } => ("number of pixels per unit", pixels_per_unit),
            Projection::Perspective { focal } => ("focal length", focal),
        };
        if !(value.is_finite() && value > 0.0) {
            return Err(CameraError::NotPositive { what, value });
        }
        let sane = principal.0.abs() < 1e7 && principal.1.abs() < 1e7 && size.0.max(size.1) < 10_000_000;
        if size.0 == 0 || size.1 == 0 || !sane {
            return Err(CameraError::Frame(size.0, size.1));
        }
        Ok(Self { projection, principal, size, to_world: DMat4::IDENTITY })
    }

    /// Moves the camera to another pose, given as the transformation to world coordinates.
    ///
    /// Rotations that are exact to 1e-3 are orthonormalised.
    ///
    /// # Errors
    /// [`CameraError::NotRigid`].
    pub fn at(self, to_world: DMat4) -> Result<Self, CameraError> {
        let axes = [to_world.x_axis, to_world.y_axis, to_world.z_axis].map(|a| a.truncate());
        let lengths = axes.map(DVec3::length);
        let determinant = DMat3::from_cols(axes[0], axes[1], axes[2]).determinant();
        let affine = (to_world.row(3) - glam::DVec4::W).length() < 1e-6 && to_world.is_finite();
        let unit = lengths.iter().all(|l| (l - 1.0).abs() < 1e-3) && (determinant - 1.0).abs() < 5e-3;
        if !(affine && unit) {
            return Err(CameraError::NotRigid { lengths, determinant });
        }
        let z = axes[2].normalize();
        let x = axes[1].cross(z).normalize();
        let mut exact = DMat4::from_mat3(DMat3::from_cols(x, z.cross(x), z));
        exact.w_axis = to_world.w_axis;
        Ok(Self { to_world: exact, ..self })
    }

    /// Returns the ray through `(x, y)`, in camera coordinates.
    ///
    /// `(x, y)` is in pixels from the top left corner. Orthographic rays start in the plane
    /// `z = 0`.
    pub fn ray(&self, (x, y): (f64, f64)) -> Ray {
        let (right, up) = (x - self.principal.0, self.principal.1 - y);
        match self.projection {
            Projection::Orthographic { pixels_per_unit } => {
                Ray { origin: DVec3::new(right, up, 0.0) / pixels_per_unit, direction: DVec3::NEG_Z }
            }
            Projection::Perspective { focal } => {
                Ray { origin: DVec3::ZERO, direction: DVec3::new(right, up, -focal).normalize() }
            }
        }
    }

    /// Builds an orthographic camera along -z of the world that frames a sphere.
    ///
    /// `margin` is the margin around the sphere as a fraction of the picture's smaller side. The
    /// distance of the camera from the centre is twice the radius.
    ///
    /// # Errors
    /// See [`Self::new`].
    pub fn framing(centre: DVec3, radius: f64, size: (usize, usize), margin: f64) -> Result<Self, CameraError> {
        let side = size.0.min(size.1) as f64;
        let pixels_per_unit = side * (1.0 - 2.0 * margin) / (2.0 * radius);
        let principal = (0.5 * size.0 as f64, 0.5 * size.1 as f64);
        let camera = Self::new(Projection::Orthographic { pixels_per_unit }, principal, size)?;
        camera.at(DMat4::from_translation(centre + DVec3::new(0.0, 0.0, 2.0 * radius)))
    }

    /// Projects a position in camera coordinates to pixels; `None` behind a perspective camera.
    pub fn project(&self, place: DVec3) -> Option<(f64, f64)> {
        let scale = match self.projection {
            Projection::Orthographic { pixels_per_unit } => pixels_per_unit,
            Projection::Perspective { .. } if place.z >= 0.0 => return None,
            Projection::Perspective { focal } => focal / -place.z,
        };
        Some((self.principal.0 + scale * place.x, self.principal.1 - scale * place.y))
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    const SIZE: (usize, usize) = (640, 480);

    fn both() -> [Camera; 2] {
        [Projection::Orthographic { pixels_per_unit: 90.0 }, Projection::Perspective { focal: 700.0 }]
            .map(|p| Camera::new(p, (320.0, 236.5), SIZE).unwrap())
    }

    #[test]
    fn project_inverts_ray() {
        for camera in both() {
            for at in [(0.5, 0.5), (320.0, 236.5), (611.2, 17.0)] {
                let ray = camera.ray(at);
                assert!((ray.direction.length() - 1.0).abs() < 1e-12);
                let back = camera.project(ray.origin + 3.7 * ray.direction).unwrap();
                assert!((back.0 - at.0).abs() < 1e-9 && (back.1 - at.1).abs() < 1e-9, "{at:?} {back:?}");
            }
        }
        assert_eq!(both()[1].project(DVec3::Z), None);
    }

    #[test]
    fn up_in_the_picture_is_y() {
        for camera in both() {
            let (above, right) = (camera.ray((320.0, 100.0)), camera.ray((500.0, 236.5)));
            assert!((above.origin + above.direction).y > 0.1 && (right.origin + right.direction).x > 0.1);
        }
    }

    #[test]
    fn framed_sphere_fills_the_picture() {
        let (centre, radius) = (DVec3::new(3.0, -2.0, 50.0), 4.0);
        let camera = Camera::framing(centre, radius, SIZE, 0.05).unwrap();
        let seen = |p: DVec3| camera.project(camera.to_world.inverse().transform_point3(p)).unwrap();
        let (x, y) = seen(centre);
        assert!((x - 320.0).abs() < 1e-9 && (y - 240.0).abs() < 1e-9);
        let (_, top) = seen(centre + radius * DVec3::Y);
        assert!((top - 24.0).abs() < 1e-9, "{top}");
    }

    #[test]
    fn poses_are_rigid() {
        let [camera, _] = both();
        let turn = DMat4::from_rotation_translation(DQuat::from_rotation_y(0.3), DVec3::new(1.0, 2.0, 3.0));
        let rounded = DMat4::from_cols_array(&turn.to_cols_array().map(|v| (v * 1e4).round() / 1e4));
        let posed = camera.at(rounded).unwrap();
        let axes = posed.to_world.to_scale_rotation_translation();
        assert!((axes.0 - DVec3::ONE).length() < 1e-12 && (axes.2 - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        for bad in [
            turn * DMat4::from_scale(DVec3::splat(2.0)),
            turn * DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0)),
            DMat4::ZERO,
            DMat4::NAN,
        ] {
            assert!(matches!(camera.at(bad), Err(CameraError::NotRigid { .. })));
        }
        let focal = Projection::Perspective { focal: 0.0 };
        assert!(matches!(Camera::new(focal, (0.0, 0.0), SIZE), Err(CameraError::NotPositive { .. })));
        let parallel = Projection::Orthographic { pixels_per_unit: 1.0 };
        assert!(matches!(Camera::new(parallel, (f64::NAN, 0.0), SIZE), Err(CameraError::Frame(..))));
    }
}
