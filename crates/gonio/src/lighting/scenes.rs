//! Synthetic lights for displaying an estimated material; the program ships no captured map.

use glam::{DVec3, Vec3};

use super::EnvironmentMap;
use crate::picture::Plane;
use crate::sphere::direction_of_lat_long;

/// Returns the synthetic light `studio`, `sky` or `lamp`, `2 height` by `height`.
pub fn named_light(name: &str, height: usize) -> Option<EnvironmentMap> {
    match name {
        "studio" => Some(studio_light(height)),
        "sky" => Some(sky_light(height)),
        "lamp" => Some(lamp_light(height)),
        _ => None,
    }
}

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
    map(height, |d| {
        let up = 0.5 * (d.y as f32 + 1.0);
        let mut sum = Vec3::new(0.20, 0.17, 0.15).lerp(Vec3::new(0.50, 0.55, 0.62), up * up);
        for (centre, half_width, half_height, colour, soft) in panels {
            sum += colour * rectangle(d, centre, (half_width, half_height), soft) as f32;
        }
        let away = d.angle_between(lamp);
        sum + Vec3::new(150.0, 135.0, 110.0) * smooth((0.045 - away) / 0.01) as f32
    })
}

/// Light of a clear day, `2 height` by `height`: a sky that pales towards the horizon, a low sun
/// behind the left shoulder, and dull ground. Relative units, mean about one; the sun gives half of
/// the light.
pub fn sky_light(height: usize) -> EnvironmentMap {
    let sun = DVec3::new(-0.6, 0.55, 0.65).normalize();
    map(height, |d| {
        let up = d.y.max(0.0) as f32;
        let sky = Vec3::new(0.90, 0.92, 0.95).lerp(Vec3::new(0.18, 0.36, 0.80), up.sqrt());
        let ground = Vec3::new(0.16, 0.14, 0.11);
        let away = d.angle_between(sun);
        // Light that the air scatters around the sun.
        let glow = Vec3::new(1.0, 0.85, 0.6) * (2.5 * (-away / 0.25).exp()) as f32;
        let mixed = ground.lerp(sky + glow, smooth((d.y + 0.01) / 0.03) as f32);
        mixed + Vec3::new(560.0, 500.0, 410.0) * smooth((0.05 - away) / 0.02) as f32
    })
}

/// Light of a dark room with lamps, `2 height` by `height`: a row of warm bulbs over the object, a
/// screen at the left, a doorway behind. Relative units, mean about one.
pub fn lamp_light(height: usize) -> EnvironmentMap {
    let bulbs: Vec<DVec3> = (-2..=2).map(|i| DVec3::new(0.55 * f64::from(i), 1.0, 0.55).normalize()).collect();
    let (screen, door) = (DVec3::new(-1.0, 0.05, 0.3).normalize(), DVec3::new(0.5, 0.1, -1.0).normalize());
    map(height, |d| {
        let room = Vec3::new(0.05, 0.045, 0.04) * (1.5 + d.y as f32);
        let bulb = |b: &DVec3| smooth((0.075 - d.angle_between(*b)) / 0.02) as f32;
        let warm = Vec3::new(130.0, 84.0, 42.0) * bulbs.iter().map(bulb).sum::<f32>();
        let cold = Vec3::new(2.2, 3.4, 5.2) * rectangle(d, screen, (0.45, 0.30), 0.04) as f32;
        room + warm + cold + Vec3::new(2.6, 2.1, 1.5) * rectangle(d, door, (0.16, 0.42), 0.04) as f32
    })
}

/// Creates a map from radiance as a function of direction.
fn map(height: usize, radiance: impl Fn(DVec3) -> Vec3) -> EnvironmentMap {
    let pixel = |x: usize, y: usize| {
        radiance(direction_of_lat_long((x as f64 + 0.5) / (2 * height) as f64, (y as f64 + 0.5) / height as f64))
    };
    EnvironmentMap::new(Plane::from_fn(2 * height, height, pixel)).expect("the light is a valid map")
}

/// Returns the smoothed indicator of an upright rectangle around `centre`.
///
/// The half sides and the width of the soft edges are lengths in the tangent plane.
fn rectangle(d: DVec3, centre: DVec3, (half_width, half_height): (f64, f64), soft: f64) -> f64 {
    let right = DVec3::Y.cross(centre).normalize();
    let (top, depth) = (centre.cross(right), d.dot(centre));
    if depth <= 0.0 {
        return 0.0;
    }
    let edge = |x: f64, half: f64| smooth((half - x.abs()) / soft);
    edge(d.dot(right) / depth, half_width) * edge(d.dot(top) / depth, half_height)
}

/// Smooth step from 0 at 0 to 1 at 1.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::luminance;
    use crate::sphere::OctahedralMap;

    #[test]
    fn synthetic_lights_have_a_mean_of_about_one() {
        for light in [studio_light(128), sky_light(128), lamp_light(128)] {
            let mean = light.to_grid(OctahedralMap::EqualArea, 32).integral() / (4.0 * std::f64::consts::PI);
            let mean = luminance(mean.as_vec3());
            assert!((0.4..2.5).contains(&mean), "{mean}");
        }
    }
}
