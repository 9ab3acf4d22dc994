//! Synthetic charts for tests.

use glam::{DMat3, DVec3, Vec3};

use super::patch_colours;
use crate::picture::Plane;

/// Returns noise of standard deviation one, from a hash of the pixel.
pub(super) fn noise(x: usize, y: usize) -> f32 {
    let uniform = |seed: u64| {
        let mut z =
            (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F) ^ seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 40) as f32 / (1_u64 << 24) as f32
    };
    // The sum of three uniform numbers has variance 1/4.
    2.0 * (uniform(1) + uniform(2) + uniform(3) - 1.5)
}

/// Returns a picture of a chart before a background, with relative noise.
///
/// The patch in column `u`, row `v` is centred at `pose * (u, v)`.
pub(super) fn chart_picture(
    (width, height): (usize, usize),
    pose: DMat3,
    light: DVec3,
    relative_noise: f32,
    background: impl Fn(f64, f64) -> Vec3,
) -> Plane<Vec3> {
    let (colours, inverse) = (patch_colours(), pose.inverse());
    let radiance = |x: f64, y: f64| {
        let p = inverse * DVec3::new(x, y, 1.0);
        let (u, v) = (p.x / p.z, p.y / p.z);
        if !((-0.8..5.8).contains(&u) && (-0.8..3.8).contains(&v)) {
            return background(x, y);
        }
        let (column, row) = (u.round(), v.round());
        let inside = (u - column).abs().max((v - row).abs()) < 0.43;
        if inside && (0.0..6.0).contains(&column) && (0.0..4.0).contains(&row) {
            (colours[row as usize * 6 + column as usize] * light).as_vec3()
        } else {
            (0.035 * light).as_vec3()
        }
    };
    Plane::from_fn(width, height, |x, y| {
        let mean = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]
            .into_iter()
            .map(|(a, b)| radiance(x as f64 + a, y as f64 + b))
            .sum::<Vec3>()
            / 4.0;
        let grain = Vec3::new(noise(x, y), noise(x + 7919, y), noise(x, y + 104_729));
        mean * (Vec3::ONE + relative_noise * grain)
    })
}

/// Returns a pose in perspective.
///
/// The chart is rotated by `angle` radians. The first patch is at `(x, y)`, where patches are
/// `pitch` pixels apart.
pub(super) fn pose(x: f64, y: f64, pitch: f64, angle: f64, perspective: (f64, f64)) -> DMat3 {
    let (sin, cos) = angle.sin_cos();
    let affine = DMat3::from_cols(
        DVec3::new(pitch * cos, pitch * sin, 0.0),
        DVec3::new(-pitch * sin, pitch * cos, 0.0),
        DVec3::new(x, y, 1.0),
    );
    let warp = DMat3::from_cols(
        DVec3::new(1.0, 0.0, perspective.0),
        DVec3::new(0.0, 1.0, perspective.1),
        DVec3::new(0.0, 0.0, 1.0),
    );
    affine * warp
}
