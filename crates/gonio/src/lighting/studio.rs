//! Synthetic studio light for displaying an estimated material; the program ships no captured map.

use glam::{DVec3, Vec3};

use super::EnvironmentMap;
use super::scenes::{rectangle, smooth};
use crate::picture::Plane;
use crate::sphere::direction_of_lat_long;

/// Light of a photographer's studio, `2 height` by `height`, in relative units of mean about one.
///
/// A large soft box is above left of the camera, a strip light at the right, and a small hot lamp
/// behind the left shoulder. A window is low at the back, and a dim panel low in front. The room
/// around them is graded.
pub fn studio_light(height: usize) -> EnvironmentMap {
    let unit = |x: f64, y: f64, z: f64| DVec3::new(x, y, z).normalize();
    // Centre, half width and height (lengths in the tangent plane), colour, softness of the edge.
    let panels = [
        (unit(-0.75, 0.75, 0.7), 0.42, 0.30, Vec3::new(9.0, 8.6, 8.0), 0.05),
        (unit(1.0, 0.15, 0.35), 0.09, 0.75, Vec3::new(6.0, 6.6, 7.6), 0.02),
        (unit(0.25, 0.35, -1.0), 0.35, 0.25, Vec3::new(5.0, 5.4, 6.2), 0.03),
        (unit(-0.15, -0.55, 0.9), 0.5, 0.12, Vec3::new(0.9, 0.7, 0.5), 0.1),
    ];
    let lamp = unit(-0.55, 0.25, 0.95);
    let radiance = Plane::from_fn(2 * height, height, |x, y| {
        let d = direction_of_lat_long((x as f64 + 0.5) / (2 * height) as f64, (y as f64 + 0.5) / height as f64);
        let up = 0.5 * (d.y as f32 + 1.0);
        let mut sum = Vec3::new(0.20, 0.17, 0.15).lerp(Vec3::new(0.50, 0.55, 0.62), up * up);
        for (centre, half_width, half_height, colour, soft) in panels {
            sum += colour * rectangle(d, centre, (half_width, half_height), soft) as f32;
        }
        let away = d.angle_between(lamp);
        sum + Vec3::new(150.0, 135.0, 110.0) * smooth((0.045 - away) / 0.01) as f32
    });
    EnvironmentMap::new(radiance).expect("the light is a valid map")
}
