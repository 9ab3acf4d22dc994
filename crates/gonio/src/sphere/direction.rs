//! Directions: the half/difference parametrisation, lat-long coordinates, uniform sets of normals.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// Light and view direction in the frame of half and difference vectors (Rusinkiewicz 1998).
///
/// All angles are in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfDifference {
    /// Angle between normal and half vector, 0..=pi/2.
    pub theta_h: f64,
    /// Angle between half vector and light (and view), 0..=pi/2.
    pub theta_d: f64,
    /// Azimuth of the light around the half vector, in 0..2 pi.
    ///
    /// It is measured from the plane of normal and half vector.
    pub phi_d: f64,
}

/// Returns the half and difference angles of unit vectors `light` and `view`.
///
/// `normal` is the unit normal of the surface. Angles are computed from chords,
/// `2 asin(|a - b| / 2)`, because `acos` of a dot product is inaccurate for small angles: the first
/// `theta_h` samples of MERL are a hundredth of a degree apart.
pub fn half_difference(normal: DVec3, light: DVec3, view: DVec3) -> HalfDifference {
    let half = (light + view).try_normalize().unwrap_or(normal);
    let theta_h = 2.0 * (0.5 * (half - normal).length()).min(1.0).asin();
    let theta_d = (0.5 * (light - view).length()).min(1.0).asin();
    // In the frame of the half vector, x points away from the normal, as if `half` were rotated to
    // the pole of the surface.
    let axis = normal.cross(half);
    let phi_d = match axis.try_normalize() {
        Some(y) => light.dot(y).atan2(light.dot(y.cross(half))).rem_euclid(TAU),
        None => 0.0,
    };
    HalfDifference { theta_h, theta_d, phi_d }
}

/// Returns the solid angle (sr) of a pixel in `row` of a lat-long map with `rows` rows.
pub(crate) fn lat_long_solid_angle(row: usize, rows: usize) -> f64 {
    let edge = |row: usize| (PI * row as f64 / rows as f64).cos();
    (edge(row) - edge(row + 1)) * PI / rows as f64
}

/// Returns the direction of the point `(u, v)` of a lat-long map, both in 0..1.
///
/// The centre of the map is the direction -z; row 0 is up.
pub fn direction_of_lat_long(u: f64, v: f64) -> DVec3 {
    let (azimuth, polar) = (TAU * (u - 0.5), PI * v);
    DVec3::new(azimuth.sin() * polar.sin(), polar.cos(), -azimuth.cos() * polar.sin())
}

/// Returns the point `(u, v)` of a lat-long map, both in 0..=1, for a direction.
///
/// The direction may have any length but zero.
pub(crate) fn lat_long_of_direction(direction: DVec3) -> (f64, f64) {
    let d = direction.normalize();
    let polar = d.x.hypot(d.z).atan2(d.y);
    (d.x.atan2(-d.z) / TAU + 0.5, polar / PI)
}

/// Returns `count` normals of a Fibonacci lattice on the hemisphere z > 0, each of equal area.
pub fn fibonacci_hemisphere(count: usize) -> impl Iterator<Item = DVec3> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (i as f64 + 0.5) / count as f64;
        let r = (1.0 - z * z).sqrt();
        let (sin, cos) = (golden * i as f64).sin_cos();
        DVec3::new(r * cos, r * sin, z)
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    /// Inverts [`half_difference`] for the normal +z and a half vector at azimuth `phi_h`.
    fn pair(theta_h: f64, phi_h: f64, theta_d: f64, phi_d: f64) -> (DVec3, DVec3) {
        let diff = DVec3::new(theta_d.sin() * phi_d.cos(), theta_d.sin() * phi_d.sin(), theta_d.cos());
        let light = glam::DQuat::from_rotation_z(phi_h) * (glam::DQuat::from_rotation_y(theta_h) * diff);
        let half = glam::DQuat::from_rotation_z(phi_h) * (glam::DQuat::from_rotation_y(theta_h) * DVec3::Z);
        (light, 2.0 * half.dot(light) * half - light)
    }

    #[test]
    fn half_difference_inverts_the_construction() {
        for theta_h in [1e-5, 1e-3, 0.4, 1.3] {
            for theta_d in [1e-4, 0.5, 1.4] {
                for phi_d in [0.1, 1.9, 3.3, 6.0] {
                    let (light, view) = pair(theta_h, 0.7, theta_d, phi_d);
                    let got = half_difference(DVec3::Z, light, view);
                    assert!((got.theta_h - theta_h).abs() < 1e-9, "{got:?}");
                    assert!((got.theta_d - theta_d).abs() < 1e-9, "{got:?}");
                    assert!((got.phi_d - phi_d).abs() < 1e-6, "{got:?} {phi_d}");
                }
            }
        }
    }

    #[test]
    fn opposite_light_and_view_give_finite_angles() {
        let got = half_difference(DVec3::Z, DVec3::X, -DVec3::X);
        assert_eq!((got.theta_h, got.theta_d), (0.0, FRAC_PI_2));
    }

    #[test]
    fn centre_of_a_lat_long_map_is_behind_the_object() {
        for (u, v, d) in [
            (0.5, 0.5, -DVec3::Z),
            (0.75, 0.5, DVec3::X),
            (0.25, 0.5, -DVec3::X),
            (0.3, 0.0, DVec3::Y),
            (0.3, 1.0, -DVec3::Y),
        ] {
            assert!((direction_of_lat_long(u, v) - d).length() < 1e-12, "{u} {v}");
        }
        let d = DVec3::new(0.3, -0.5, 0.8).normalize();
        let (u, v) = lat_long_of_direction(d);
        assert!((direction_of_lat_long(u, v) - d).length() < 1e-12);
    }

    #[test]
    fn fibonacci_normals_are_uniform() {
        let normals: Vec<DVec3> = fibonacci_hemisphere(12_000).collect();
        let mean = normals.iter().sum::<DVec3>() / 12_000.0;
        assert!((mean - DVec3::new(0.0, 0.0, 0.5)).length() < 1e-4, "{mean}");
        let kept = normals.iter().filter(|n| n.z > 80.0_f64.to_radians().cos()).count();
        assert_eq!(kept, 9916);
    }
}
