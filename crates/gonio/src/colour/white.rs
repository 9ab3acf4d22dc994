//! Colours of lights, and detection of photographs without colour.

use glam::{DQuat, DVec3, Vec3};

use super::chroma::Chroma;
use crate::lighting::LightGrid;
use crate::sphere::fibonacci_hemisphere;

/// Whether all colours are grey, up to rounding.
pub fn is_grey<'a>(colours: impl IntoIterator<Item = &'a Vec3>) -> bool {
    colours.into_iter().all(|c| c.max_element() - c.min_element() <= 1e-5 * c.max_element().abs())
}

/// Returns the chroma of a white matte ball in a light, averaged over its visible surface.
///
/// The direction to the camera is `camera` times `+z`.
pub fn white_chroma(light: &LightGrid, camera: DQuat) -> Chroma {
    Chroma::of(mean_irradiance(light, camera))
}

/// Returns the irradiance of a ball in linear RGB, averaged over its visible surface.
///
/// The direction to the camera is `camera` times `+z`.
pub(crate) fn mean_irradiance(light: &LightGrid, camera: DQuat) -> DVec3 {
    let normals: Vec<DVec3> = fibonacci_hemisphere(500).map(|n| camera * n).collect();
    let mut sum = DVec3::ZERO;
    for (texel, radiance) in light.texels().iter().enumerate() {
        let (u, v) = LightGrid::centre_of(light.side(), texel);
        let direction = light.map().direction(u, v);
        let irradiance_weight: f64 = normals.iter().map(|n| n.dot(direction).max(0.0)).sum();
        sum += light.map().density(u, v) * irradiance_weight * radiance.as_dvec3();
    }
    sum * 4.0 / (light.texels().len() * normals.len()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::OctahedralMap;

    #[test]
    fn only_equal_channels_are_grey() {
        assert!(is_grey(&[Vec3::splat(0.3), Vec3::ZERO]));
        assert!(!is_grey(&[Vec3::splat(0.3), Vec3::new(0.3, 0.3, 0.31)]));
    }

    #[test]
    fn a_ball_shows_the_light_in_front_of_it() {
        let side = 16;
        let map = OctahedralMap::EqualArea;
        let texel = |i: usize| {
            let (u, v) =
                ((2 * (i % side) + 1) as f64 / side as f64 - 1.0, 1.0 - (2 * (i / side) + 1) as f64 / side as f64);
            if map.direction(u, v).z > 0.0 { Vec3::new(2.0, 1.0, 1.0) } else { Vec3::new(1.0, 1.0, 2.0) }
        };
        let light = LightGrid::from_texels(map, side, (0..side * side).map(texel).collect());
        let (front, back) =
            (white_chroma(&light, DQuat::IDENTITY), white_chroma(&light, DQuat::from_rotation_y(std::f64::consts::PI)));
        assert!(front.0[0] > 0.4 && front.0[1] < 0.3, "{front:?}");
        // Texels on the equator belong to only one half.
        assert!((front.0[0] - back.0[1]).abs() < 0.1, "{front:?} {back:?}");
    }
}
