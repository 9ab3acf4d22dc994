//! Lights for display: a built-in light with dark parts, and interpolated estimated lights.

use std::f32::consts::FRAC_PI_2;
use std::f64::consts::PI;

use glam::{DVec3, Vec3, Vec3A};
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::picture::Plane;
use gonio::sphere::direction_of_lat_long;
use rayon::prelude::*;

/// Rows of an estimated light for display, for each texel along a side.
const ROWS_PER_TEXEL: usize = 2;
const MIN_ROWS: usize = 96;
const MAX_ROWS: usize = 256;
/// Standard deviation of its blur in texels: the smallest value that hides the texels.
const SPREAD: f32 = 0.6;
/// Exponent of the Gaussian weight beyond which texels are ignored.
const CUT_OFF: f32 = 6.0;

/// Returns a photographer's studio with dark parts between the lamps, `2 height` x `height` pixels.
/// It has a large softbox on the left, a narrow one on the right, two behind, and a floor that
/// darkens towards the horizon. A mirror shows strong contrasts in this light, and a matte surface
/// a clear gradient.
pub fn dark_studio(height: usize) -> EnvironmentMap {
    let boxes = [
        // Direction; half width, half height and edge softness in its plane; colour.
        (DVec3::new(-0.75, 0.80, 0.75), (0.46, 0.40, 0.04), Vec3::new(12.5, 12.2, 11.8)),
        (DVec3::new(1.0, 0.12, 0.32), (0.10, 0.85, 0.03), Vec3::new(6.6, 7.0, 7.6)),
        (DVec3::new(-0.9, 0.25, -0.75), (0.14, 0.60, 0.04), Vec3::new(6.4, 6.3, 6.1)),
        (DVec3::new(0.35, 0.8, -0.75), (0.40, 0.16, 0.04), Vec3::new(4.6, 4.7, 4.9)),
    ]
    .map(|(d, size, colour)| (d.normalize(), size, colour));
    let pixel = |x: usize, y: usize| {
        let d = direction_of_lat_long((x as f64 + 0.5) / (2 * height) as f64, (y as f64 + 0.5) / height as f64);
        let wall = Vec3::new(0.32, 0.33, 0.35) * (0.10 + 0.90 * (1.0 - d.y.max(0.0)).powi(3)) as f32;
        let floor = Vec3::new(0.46, 0.42, 0.38) * (0.14 + 0.86 * (-d.y).clamp(0.0, 1.0)) as f32;
        let mut sum = wall.lerp(floor, smooth(0.5 - d.y / 0.14));
        for (centre, (half_width, half_height, soft), colour) in boxes {
            let right = DVec3::Y.cross(centre).normalize();
            let (top, depth) = (centre.cross(right), d.dot(centre));
            if depth > 0.0 {
                let (a, b) = (d.dot(right) / depth / half_width, d.dot(top) / depth / half_height);
                let edge = |x: f64, half: f64| smooth((1.0 - x.abs()) * half / soft);
                // A softbox is brightest in the middle.
                let bright = 1.1 - 0.3 * (a * a + b * b).min(2.0) as f32 * 0.5;
                sum = sum.lerp(colour * bright, edge(a, half_width) * edge(b, half_height));
            }
        }
        sum
    };
    EnvironmentMap::new(Plane::from_fn(2 * height, height, pixel)).expect("the map is lit and twice as wide as high")
}

/// Returns a smooth step from 0 at 0 to 1 at 1.
fn smooth(x: f64) -> f32 {
    let x = x.clamp(0.0, 1.0);
    (x * x * (3.0 - 2.0 * x)) as f32
}

/// Returns the resolution of an estimated light: the width of a texel in degrees.
pub fn resolution(light: &LightGrid) -> f64 {
    (4.0 * PI).sqrt().to_degrees() / light.side() as f64
}

/// Interpolates an estimated light without visible texels and seams: each direction is the mean of
/// the texels around it, with Gaussian weights (standard deviation 0.6 texels). Returns `None` if
/// the result is not a valid light, such as a black one.
pub fn display(light: &LightGrid) -> Option<EnvironmentMap> {
    let spread = SPREAD * resolution(light).to_radians() as f32;
    let side = light.side();
    let at = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
    let mut texels: Vec<(Vec3A, Vec3A)> = (light.texels().iter().enumerate())
        .map(|(t, radiance)| {
            let centre = light.map().direction(at(t % side), -at(t / side));
            (centre.as_vec3a(), Vec3A::from(radiance.max(Vec3::ZERO)))
        })
        .collect();
    texels.sort_by(|(a, _), (b, _)| a.y.total_cmp(&b.y));
    let rows = (ROWS_PER_TEXEL * side).clamp(MIN_ROWS, MAX_ROWS);
    let row = |y: usize| {
        let direction = |x: usize| {
            let (u, v) = ((x as f64 + 0.5) / (2 * rows) as f64, (y as f64 + 0.5) / rows as f64);
            direction_of_lat_long(u, v).as_vec3a()
        };
        // Texels whose elevation is close enough for a weight.
        let reach = (1.0 - CUT_OFF * spread * spread).max(-1.0).acos();
        let elevation = direction(0).y.clamp(-1.0, 1.0).asin();
        let height = |angle: f32| angle.clamp(-FRAC_PI_2, FRAC_PI_2).sin();
        let first = texels.partition_point(|(centre, _)| centre.y < height(elevation - reach));
        let last = texels.partition_point(|(centre, _)| centre.y <= height(elevation + reach));
        let pixel = |x: usize| {
            let middle = direction(x);
            let (mut sum, mut total) = (Vec3A::ZERO, 0.0);
            for (centre, radiance) in &texels[first..last] {
                let away = (1.0 - middle.dot(*centre)) / (spread * spread);
                if away < CUT_OFF {
                    let weight = (-away).exp();
                    (sum, total) = (sum + *radiance * weight, total + weight);
                }
            }
            Vec3::from(sum / total.max(1e-30))
        };
        (0..2 * rows).map(pixel).collect::<Vec<Vec3>>()
    };
    let pixels: Vec<Vec<Vec3>> = (0..rows).into_par_iter().map(row).collect();
    EnvironmentMap::new(Plane::from_vec(2 * rows, rows, pixels.concat())).ok()
}

#[cfg(test)]
mod tests {
    use gonio::picture::luminance;
    use gonio::sphere::OctahedralMap;

    use super::*;

    #[test]
    fn the_studio_has_lamps_and_dark_parts() {
        let light = dark_studio(64);
        let grid = light.to_grid(OctahedralMap::EqualArea, 32);
        let mean = luminance((grid.integral() / (4.0 * PI)).as_vec3());
        assert!((0.4..2.5).contains(&mean), "{mean}");
        let dark = grid.texels().iter().filter(|t| luminance(**t) < 0.2 * mean).count();
        assert!(dark > 300, "{dark} of 1024 texels are dark");
        assert!(grid.texels().iter().any(|t| luminance(*t) > 8.0 * mean));
    }

    #[test]
    fn fine_lights_have_finer_pictures() {
        let light = |side: usize| {
            let texels = (0..side * side).map(|t| Vec3::splat(if t % side < side / 2 { 1.0 } else { 3.0 })).collect();
            LightGrid::from_texels(OctahedralMap::EqualArea, side, texels)
        };
        let [coarse, fine] = [16, 128].map(|side| display(&light(side)).unwrap());
        assert_eq!((coarse.radiance().height(), fine.radiance().height()), (96, 256));
        // Both are the same light away from the edge between its halves.
        let (coarse, fine) = (coarse.to_grid(OctahedralMap::EqualArea, 32), fine.to_grid(OctahedralMap::EqualArea, 32));
        let inner = (0..32 * 32).filter(|t| (4..12).contains(&(t % 32)) || (20..28).contains(&(t % 32)));
        let inner = inner.filter(|t| (4..28).contains(&(t / 32)));
        let mut count = 0;
        for t in inner {
            assert!((coarse.texels()[t].x / fine.texels()[t].x - 1.0).abs() < 0.02, "texel {t}");
            count += 1;
        }
        assert_eq!(count, 16 * 24);
    }

    #[test]
    fn display_is_smooth_and_preserves_the_integral() {
        let texels = (0..256).map(|t| Vec3::splat(if t == 100 { 256.0 } else { 0.0 })).collect();
        let shown = display(&LightGrid::from_texels(OctahedralMap::EqualArea, 16, texels)).unwrap();
        let grid = shown.to_grid(OctahedralMap::EqualArea, 64);
        assert!((grid.integral().x / (4.0 * PI) - 1.0).abs() < 0.05, "{}", grid.integral().x);
        // Adjacent pixels differ by a small part of the radiance of the texel.
        let rows = shown.radiance().height();
        let step = |x: usize, y: usize| (shown.radiance()[(x, y)].x - shown.radiance()[(x + 1, y)].x).abs();
        let steepest =
            (0..2 * rows - 1).flat_map(|x| (rows / 8..7 * rows / 8).map(move |y| step(x, y))).fold(0.0, f32::max);
        assert!(steepest < 60.0, "{steepest}");
        let black = LightGrid::from_texels(OctahedralMap::EqualArea, 4, vec![Vec3::ZERO; 16]);
        assert!(display(&black).is_none());
    }
}
