//! Surfaces that intersect rays.

use glam::{DMat3, DVec3};
use thiserror::Error;

use super::Ray;

/// Intersection of a ray with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the origin of the ray.
    pub distance: f64,
    /// Position of the hit.
    pub position: DVec3,
    /// Unit shading normal on the side from which the ray comes.
    pub normal: DVec3,
    /// Origin of rays towards the light: the position, or slightly above it.
    ///
    /// The offset clears the facets that approximate a smooth surface.
    pub ray_origin: DVec3,
    /// Whether the ray hit the inner side; for triangles, by the order of their corners.
    pub back_facing: bool,
}

/// A surface in camera coordinates.
pub trait Surface: Sync {
    /// Returns the first intersection with a ray.
    fn hit(&self, ray: &Ray) -> Option<Hit>;

    /// Returns for each direction whether the surface blocks the ray from a [`Hit::ray_origin`].
    ///
    /// Fastest if similar directions are consecutive.
    fn blocked(&self, origin: DVec3, directions: &[DVec3]) -> Vec<bool>;

    /// Returns whether the surface cannot shadow itself.
    fn is_convex(&self) -> bool {
        false
    }
}

/// An ellipsoid; a sphere if its axes are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    centre: DVec3,
    /// Transformation to the sphere of radius one.
    to_unit: DMat3,
}

/// Error of invalid centre or semi-axes of an ellipsoid.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("an ellipsoid needs a finite centre and three perpendicular semi-axes of finite, positive length")]
pub struct EllipsoidError;

impl Ellipsoid {
    /// Builds an ellipsoid from its centre and three mutually perpendicular semi-axes.
    ///
    /// # Errors
    /// If the axes are not perpendicular, or a number is not finite.
    pub fn new(centre: DVec3, axes: DMat3) -> Result<Self, EllipsoidError> {
        let columns = [axes.x_axis, axes.y_axis, axes.z_axis];
        let [a, b, c] = columns.map(|v| v.normalize_or_zero());
        let slant = a.dot(b).abs().max(b.dot(c).abs()).max(c.dot(a).abs());
        let long = columns.iter().all(|v| v.is_finite() && v.length() > 1e-30 && v.length() < 1e30);
        if !(centre.is_finite() && long && slant < 1e-6) {
            return Err(EllipsoidError);
        }
        Ok(Self { centre, to_unit: axes.inverse() })
    }

    /// Builds a sphere.
    ///
    /// # Errors
    /// If the radius is not positive, or a number is not finite.
    pub fn sphere(centre: DVec3, radius: f64) -> Result<Self, EllipsoidError> {
        Self::new(centre, DMat3::from_diagonal(DVec3::splat(radius)))
    }
}

impl Ellipsoid {
    /// Returns the centre.
    pub fn centre(&self) -> DVec3 {
        self.centre
    }

    /// Returns the length of the first semi-axis, which is the radius of a sphere.
    pub(crate) fn first_axis(&self) -> f64 {
        self.to_unit.inverse().x_axis.length()
    }
}

impl Surface for Ellipsoid {
    fn hit(&self, ray: &Ray) -> Option<Hit> {
        let (o, d) = (self.to_unit * (ray.origin - self.centre), self.to_unit * ray.direction);
        // Solves |o + t d| = 1 from the point of the ray nearest to the centre, which is accurate
        // for distant origins.
        let nearest = -o.dot(d) / d.length_squared();
        let square = 1.0 - (o + nearest * d).length_squared();
        if square < 0.0 {
            return None;
        }
        let half = (square / d.length_squared()).sqrt();
        let (inside, distance) = if nearest - half > 0.0 { (false, nearest - half) } else { (true, nearest + half) };
        let unit = o + distance * d;
        let outwards = (self.to_unit.transpose() * unit).normalize();
        let normal = if inside { -outwards } else { outwards };
        let position = ray.origin + distance * ray.direction;
        (distance > 0.0).then_some(Hit { distance, position, normal, ray_origin: position, back_facing: inside })
    }

    fn blocked(&self, _: DVec3, directions: &[DVec3]) -> Vec<bool> {
        vec![false; directions.len()]
    }

    fn is_convex(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn rays_hit_a_sphere_at_its_radius() {
        let sphere = Ellipsoid::sphere(DVec3::new(1.0, 2.0, -30.0), 3.0).unwrap();
        let towards = DVec3::new(1.2, 1.5, -28.0).normalize();
        let hit = sphere.hit(&Ray { origin: DVec3::ZERO, direction: towards }).unwrap();
        assert!(((hit.position - DVec3::new(1.0, 2.0, -30.0)).length() - 3.0).abs() < 1e-12);
        assert!((hit.normal - (hit.position - DVec3::new(1.0, 2.0, -30.0)) / 3.0).length() < 1e-12);
        assert!(
            hit.normal.dot(towards) < 0.0
                && !hit.back_facing
                && (hit.position - hit.distance * towards).length() < 1e-12
        );
        assert_eq!(sphere.hit(&Ray { origin: DVec3::ZERO, direction: DVec3::X }), None);
        assert_eq!(sphere.hit(&Ray { origin: DVec3::ZERO, direction: DVec3::Z }), None);
    }

    #[test]
    fn ellipsoid_normals_are_perpendicular_to_the_surface() {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1));
        let shape = Ellipsoid::new(DVec3::ZERO, turn * DMat3::from_diagonal(DVec3::new(1.0, 2.0, 0.5))).unwrap();
        let at = |x: f64, y: f64| shape.hit(&Ray { origin: DVec3::new(x, y, 9.0), direction: DVec3::NEG_Z }).unwrap();
        let (hit, step) = (at(0.2, -0.3), 1e-5);
        for (dx, dy) in [(step, 0.0), (0.0, step)] {
            let along = at(0.2 + dx, -0.3 + dy).position - at(0.2 - dx, -0.3 - dy).position;
            assert!(hit.normal.dot(along.normalize()).abs() < 1e-8);
        }
    }

    #[test]
    fn rejects_invalid_ellipsoids() {
        assert_eq!(Ellipsoid::sphere(DVec3::ZERO, 0.0), Err(EllipsoidError));
        assert_eq!(Ellipsoid::sphere(DVec3::NAN, 1.0), Err(EllipsoidError));
        let slanted = DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::Z);
        assert_eq!(Ellipsoid::new(DVec3::ZERO, slanted), Err(EllipsoidError));
    }
}
