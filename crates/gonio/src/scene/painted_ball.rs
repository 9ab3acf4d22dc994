//! Pictures of a ball for tests of paint.

use glam::Vec3;

use crate::picture::Plane;

/// Width and height of the pictures.
pub(super) const SIZE: usize = 300;

/// Unit normal of a pixel.
pub(super) fn normal((x, y): (usize, usize)) -> Vec3 {
    let at = |i: usize| (i as f32 + 0.5 - 150.0) / 140.0;
    let (nx, ny) = (at(x), -at(y));
    Vec3::new(nx, ny, (1.0 - nx * nx - ny * ny).max(0.0).sqrt())
}

/// Whether a pixel is on the ball and not too steep.
pub(super) fn usable(at: (usize, usize)) -> bool {
    normal(at).z > 0.17
}

/// A ball whose radiance is `f` of the normal and the mirrored view, without noise.
pub(super) fn clean_ball(f: impl Fn(Vec3, Vec3) -> Vec3) -> Plane<Vec3> {
    Plane::from_fn(SIZE, SIZE, |x, y| {
        let n = normal((x, y));
        f(n, 2.0 * n.z * n - Vec3::Z)
    })
}

/// The same ball with noise of up to 2 %.
pub(super) fn ball(f: impl Fn(Vec3, Vec3) -> Vec3) -> Plane<Vec3> {
    let mut noise = 1_u32;
    clean_ball(f).map(|radiance| {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let grain = 1.0 + 0.02 * ((noise >> 8) as f32 / (1 << 23) as f32 - 1.0);
        grain * *radiance
    })
}

/// Direction and colour of lamps.
pub(super) const LAMPS: [([f32; 3], [f32; 3]); 4] = [
    ([0.3, 0.8, 0.5], [1.0, 0.9, 0.7]),
    ([-0.8, 0.2, 0.6], [0.2, 0.3, 1.0]),
    ([0.7, -0.5, 0.5], [1.0, 0.25, 0.15]),
    ([-0.1, -0.9, 0.3], [0.2, 0.8, 0.3]),
];

/// Irradiance under four lamps of saturation `colour`, plus ambient light.
pub(super) fn irradiance(n: Vec3, colour: f32) -> Vec3 {
    LAMPS.iter().fold(Vec3::splat(0.15), |sum, (from, rgb)| {
        sum + n.dot(Vec3::from_array(*from).normalize()).max(0.0) * Vec3::ONE.lerp(Vec3::from_array(*rgb), colour)
    })
}

/// Reflections of the lamps, whose width is given by `power`.
pub(super) fn highlights(r: Vec3, power: f32) -> Vec3 {
    LAMPS.iter().fold(Vec3::ZERO, |sum, (from, rgb)| {
        sum + r.dot(Vec3::from_array(*from).normalize()).max(0.0).powf(power) * Vec3::from_array(*rgb)
    })
}
