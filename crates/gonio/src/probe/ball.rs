//! Geometry of a mirror ball: the direction that each point of its image reflects to the camera.

use glam::DVec3;

use super::ProbeError;
use crate::picture::{Picture, Plane};
use crate::scene::{Circle, ObjectShape, SceneError, find_ball, outline_of_ball, outlined};
use crate::shape::{Camera, Ellipsoid, Projection, Surface};

/// Smallest radius of a ball, in pixels: a smaller one does not show enough of its surroundings.
const MIN_RADIUS: f64 = 8.0;
/// Largest number of steps of Newton's method, which converges quadratically and ends earlier.
const NEWTON_STEPS: usize = 40;

/// A ball in front of a camera, both in coordinates of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorBall {
    camera: Camera,
    radius: f64,
    surface: Ellipsoid,
}

/// Reflection at a point of the image; unit vectors in camera space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflection {
    /// Direction that the light comes from.
    pub direction: DVec3,
    /// Surface normal.
    pub normal: DVec3,
    /// Cosine between normal and view direction, 0 at the outline and 1 in the middle.
    pub cosine: f64,
}

/// Position at which the light from a direction is visible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// Column and row in pixels, from the top left corner.
    pub(super) at: (f64, f64),
    /// Cosine between normal and view direction.
    pub(super) cosine: f64,
}

impl MirrorBall {
    /// Builds a ball in front of a camera.
    ///
    /// # Errors
    /// [`SceneError::NotAnEllipse`] if the camera is inside the ball or faces away from it.
    pub fn new(camera: Camera, centre: DVec3, radius: f64) -> Result<Self, ProbeError> {
        let ahead = match camera.projection {
            Projection::Orthographic { .. } => true,
            Projection::Perspective { .. } => centre.z < 0.0 && centre.length() > radius,
        };
        match Ellipsoid::sphere(centre, radius) {
            Ok(surface) if ahead => Ok(Self { camera, radius, surface }),
            _ => Err(SceneError::NotAnEllipse { residual: 0.0, rim: 0 }.into()),
        }
    }

    /// Builds a distant ball from its outline in a picture of `size`.
    ///
    /// # Errors
    /// [`SceneError::BadCircle`] for a radius below 8 pixels or numbers that are not finite.
    pub fn of_circle(circle: Circle, size: (usize, usize)) -> Result<Self, ProbeError> {
        let Circle { x, y, radius } = circle;
        if !(x.is_finite() && y.is_finite() && radius.is_finite() && radius >= MIN_RADIUS) {
            return Err(SceneError::BadCircle { x, y, radius, min: MIN_RADIUS }.into());
        }
        let camera = Camera::new(Projection::Orthographic { pixels_per_unit: 1.0 }, (0.0, 0.0), size)
            .map_err(SceneError::from)?;
        Self::new(camera, DVec3::new(x, -y, -2.0 * radius), radius)
    }

    /// Detects the ball in a picture, unless its circle is given.
    ///
    /// As in [`Detection::of`](crate::scene::Detection::of), the outline comes from the mask, the
    /// alpha channel, a plain background, or edges.
    ///
    /// # Errors
    /// Errors of the outline; [`ProbeError::NotABall`] for another object.
    pub(super) fn find(picture: &Picture, mask: Option<&Plane<f32>>, object: &ObjectShape) -> Result<Self, ProbeError> {
        match object {
            ObjectShape::Sphere(Some(circle)) => Self::of_circle(*circle, picture.rgb.size()),
            ObjectShape::Sphere(None) => Self::of_circle(outline_of_ball(picture, mask)?.0, picture.rgb.size()),
            ObjectShape::Ball(camera) => {
                let ball = find_ball(&outlined(picture, mask)?, camera)?;
                Self::new(*camera, ball.centre(), ball.first_axis())
            }
            _ => Err(ProbeError::NotABall),
        }
    }

    /// Returns the direction to the camera, and the ball's radius over its distance (zero if
    /// distant).
    fn towards_camera(&self) -> (DVec3, f64) {
        match self.camera.projection {
            Projection::Orthographic { .. } => (DVec3::Z, 0.0),
            Projection::Perspective { .. } => {
                let distance = self.surface.centre().length();
                (-self.surface.centre() / distance, self.radius / distance)
            }
        }
    }

    /// Returns the unit vector from the ball to the camera.
    pub(super) fn axis(&self) -> DVec3 {
        self.towards_camera().0
    }

    /// Returns the radius of the outline in pixels.
    ///
    /// In perspective, this is the radius that it would have in the middle of the picture.
    pub fn pixels(&self) -> f64 {
        match self.camera.projection {
            Projection::Orthographic { pixels_per_unit } => self.radius * pixels_per_unit,
            Projection::Perspective { focal } => {
                let ratio = self.radius / self.surface.centre().length();
                focal * ratio / (1.0 - ratio * ratio).sqrt()
            }
        }
    }

    /// Returns the outline of a distant ball as a circle.
    pub fn circle(&self) -> Option<Circle> {
        match self.camera.projection {
            Projection::Orthographic { .. } => {
                let (x, y) = self.camera.project(self.surface.centre())?;
                Some(Circle { x, y, radius: self.pixels() })
            }
            Projection::Perspective { .. } => None,
        }
    }

    /// Returns the centre in coordinates of the camera, and the radius.
    pub fn sphere(&self) -> (DVec3, f64) {
        (self.surface.centre(), self.radius)
    }

    /// Returns the reflection at the point `(x, y)`, in pixels from the top left corner.
    ///
    /// Returns `None` outside the ball.
    pub fn reflection_at(&self, at: (f64, f64)) -> Option<Reflection> {
        let ray = self.camera.ray(at);
        let normal = self.surface.hit(&ray)?.normal;
        let cosine = -normal.dot(ray.direction);
        Some(Reflection { direction: ray.direction + 2.0 * cosine * normal, normal, cosine })
    }

    /// Returns the position at which the light from a direction, a unit vector, is visible.
    ///
    /// Returns `None` for directions behind the ball.
    ///
    /// In the plane of the direction and the camera, the normal at the angle `t` from the axis to
    /// the camera reflects the direction at `2 t + b`. Here `b = atan2(s sin t, 1 - s cos t)` is
    /// the angle between the axis and the direction from the point to the camera, with the ratio
    /// `s` of radius and distance. The sum is concave in `t`, so Newton's method increases
    /// monotonically from zero to its solution.
    pub(super) fn place_of(&self, direction: DVec3) -> Option<Place> {
        let (axis, ratio) = self.towards_camera();
        let place = |normal: DVec3, cosine: f64| {
            let at = self.camera.project(self.surface.centre() + self.radius * normal)?;
            Some(Place { at, cosine })
        };
        if ratio == 0.0 {
            // The normal bisects the angle between the direction and the camera.
            let normal = (direction + axis).try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
            return place(normal, normal.dot(axis));
        }
        let along = direction.dot(axis);
        let across = direction - along * axis;
        let angle = across.length().atan2(along);
        let aside = |t: f64| (ratio * t.sin()).atan2(1.0 - ratio * t.cos());
        let most = ratio.acos();
        if angle > 2.0 * most + aside(most) {
            return None;
        }
        let mut tilt = 0.0;
        for _ in 0..NEWTON_STEPS {
            let cos = f64::cos(tilt);
            let slope = 2.0 + ratio * (cos - ratio) / (1.0 - 2.0 * ratio * cos + ratio * ratio);
            let step = (angle - 2.0 * tilt - aside(tilt)) / slope;
            tilt = (tilt + step).min(most);
            if step.abs() < 1e-12 {
                break;
            }
        }
        let sideways = across.try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
        let normal = tilt.cos() * axis + tilt.sin() * sideways;
        place(normal, (tilt + aside(tilt)).cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::direction_of_lat_long;

    fn balls() -> [MirrorBall; 3] {
        let size = (400, 300);
        let perspective = |centre, radius| {
            let camera = Camera::new(Projection::Perspective { focal: 500.0 }, (200.0, 150.0), size).unwrap();
            MirrorBall::new(camera, centre, radius).unwrap()
        };
        [
            MirrorBall::of_circle(Circle { x: 180.3, y: 140.1, radius: 120.0 }, size).unwrap(),
            perspective(DVec3::new(0.2, -0.1, -3.0), 0.6),
            perspective(DVec3::new(0.05, 0.1, -1.3), 1.0),
        ]
    }

    #[test]
    fn positions_and_directions_are_inverse() {
        for ball in balls() {
            let mut seen = 0;
            for i in 0..2000 {
                let direction =
                    direction_of_lat_long(f64::from(i % 50) / 50.0 + 0.003, (f64::from(i / 50) + 0.5) / 40.0);
                let Some(place) = ball.place_of(direction) else { continue };
                seen += 1;
                let back = ball.reflection_at(place.at).unwrap_or_else(|| panic!("{ball:?} {place:?}"));
                assert!(place.cosine >= -1e-9 && (back.cosine - place.cosine).abs() < 1e-5, "{place:?} {back:?}");
                // Near the outline, a position determines the direction less accurately.
                assert!((back.direction - direction).length() * place.cosine < 1e-6, "{direction} {back:?}");
            }
            assert!(seen > 1300, "{seen}");
        }
    }

    #[test]
    fn the_middle_reflects_the_camera_and_the_rim_the_background() {
        let [far, near, _] = balls();
        let middle = far.reflection_at((180.3, 140.1)).unwrap();
        assert!((middle.direction - DVec3::Z).length() < 1e-9 && (middle.cosine - 1.0).abs() < 1e-9);
        // A point slightly left of the right rim.
        let rim = far.reflection_at((180.3 + 119.99, 140.1)).unwrap();
        assert!(rim.direction.z < -0.99 && rim.direction.x > 0.0, "{rim:?}");
        // The normal is at 45 degrees, so the light comes from the right.
        let right = far.reflection_at((180.3 + 120.0 * 0.5_f64.sqrt(), 140.1)).unwrap();
        assert!((right.direction - DVec3::X).length() < 1e-9, "{right:?}");
        let up = far.reflection_at((180.3, 140.1 - 120.0 * 0.5_f64.sqrt())).unwrap();
        assert!((up.direction - DVec3::Y).length() < 1e-9, "{up:?}");
        // A near ball occludes a wider cone.
        assert!(near.place_of(near.axis() * -1.0).is_none());
        assert!(far.place_of(DVec3::new(1e-3, 0.0, -1.0).normalize()).is_some());
    }

    #[test]
    fn rejects_invalid_balls() {
        let circle = Circle { x: 5.0, y: 5.0, radius: 3.0 };
        let refused = MirrorBall::of_circle(circle, (10, 10)).unwrap_err();
        assert!(matches!(refused, ProbeError::Scene(SceneError::BadCircle { .. })), "{refused}");
        let camera = Camera::new(Projection::Perspective { focal: 500.0 }, (200.0, 150.0), (400, 300)).unwrap();
        for centre in [DVec3::new(0.0, 0.0, -0.5), DVec3::new(0.0, 0.0, 3.0)] {
            assert!(MirrorBall::new(camera, centre, 1.0).is_err());
        }
    }
}
