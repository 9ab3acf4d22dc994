//! A light over half vectors, prefiltered at several resolutions.
//!
//! For a distant camera, a lobe about a normal reflects the light at half vectors near the normal.
//! The light direction of a half vector does not depend on the normal. The light is therefore
//! stored once over half vectors, on the stereographic disk, which is conformal, at successively
//! halved resolutions. A lobe of any width is then a weighted sum of a few look-ups. Interpolation
//! by cubic splines on each level avoids visible texels.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, Vec3A};
use gonio::lighting::EnvironmentMap;
use gonio::picture::Plane;
use rayon::prelude::*;

/// Texels along a side of the finest level: 0.3 degrees at the centre.
const FINEST_SIDE: usize = 768;
/// Number of levels, each with half the resolution of the one before; the last blurs by 7 degrees.
pub(super) const LEVELS: usize = 6;

/// Radiance times the cube of the cosine of the half vector, over half vectors in front of the
/// camera.
pub(super) struct HalfVectorLight {
    levels: Vec<Level>,
}

struct Level {
    side: usize,
    texels: Vec<Vec3A>,
}

impl HalfVectorLight {
    pub(super) fn of(light: &EnvironmentMap) -> Self {
        let row = |y: usize| (0..FINEST_SIDE).map(move |x| (at_centre(x, FINEST_SIDE), -at_centre(y, FINEST_SIDE)));
        let texel = |(x, y): (f32, f32)| {
            let square = x * x + y * y;
            if square >= 1.0 {
                return Vec3A::ZERO;
            }
            let half = Vec3::new(2.0 * x, 2.0 * y, 1.0 - square) / (1.0 + square);
            let towards = 2.0 * half.z * half - Vec3::Z;
            Vec3A::from(between(light.radiance(), towards)) * half.z.powi(3)
        };
        let finest = (0..FINEST_SIDE).into_par_iter().flat_map_iter(|y| row(y).map(texel)).collect();
        let mut levels = vec![Level { side: FINEST_SIDE, texels: finest }];
        while levels.len() < LEVELS {
            levels.extend(levels.last().map(Level::halved));
        }
        Self { levels }
    }

    /// Computes several weighted sums over the levels of the light at a half vector. `weights`
    /// returns the weights of the levels for each element of `out`.
    pub(super) fn gather<'a>(&self, half: Vec3, weights: impl Fn(usize) -> &'a [Vec3A; LEVELS], out: &mut [Vec3A]) {
        let (x, y) = (half.x / (1.0 + half.z), half.y / (1.0 + half.z));
        out.fill(Vec3A::ZERO);
        for (n, level) in self.levels.iter().enumerate() {
            if (0..out.len()).any(|result| weights(result)[n] != Vec3A::ZERO) {
                let light = level.at(x, y);
                out.iter_mut().enumerate().for_each(|(result, sum)| *sum += weights(result)[n] * light);
            }
        }
        let scale = half.z.max(1e-3).powi(3).recip();
        out.iter_mut().for_each(|sum| *sum *= scale);
    }
}

/// Returns the variance of the blur of each level (square radians, along one axis) at a half vector
/// with this cosine to the view direction.
pub(super) fn variances(cos: f32) -> [f32; LEVELS] {
    // In square texels: the variance of the previous halvings, plus 1/3 for the cubic spline.
    let mut halvings = 0.0;
    std::array::from_fn(|level| {
        let texel = 2.0 * (1.0 + cos) / (FINEST_SIDE >> level) as f32;
        let variance = (halvings + 1.0 / 3.0) * texel * texel;
        halvings = 0.25 * halvings + 0.1875;
        variance
    })
}

/// Returns the centre of a texel, in -1..1.
fn at_centre(i: usize, side: usize) -> f32 {
    (2 * i + 1) as f32 / side as f32 - 1.0
}

/// Looks up a direction in a lat-long map with bilinear interpolation.
pub(super) fn between(map: &Plane<Vec3>, d: Vec3) -> Vec3 {
    let (width, height) = map.size();
    let u = (d.x.atan2(-d.z) / TAU + 0.5) * width as f32 - 0.5;
    let v = (d.y.clamp(-1.0, 1.0).acos() / PI * height as f32 - 0.5).clamp(0.0, (height - 1) as f32);
    let (left, top) = (u.floor(), (v as usize).min(height.saturating_sub(2)));
    let (s, t) = (u - left, v - top as f32);
    let column = (left as isize).rem_euclid(width as isize) as usize;
    let next = if column + 1 == width { 0 } else { column + 1 };
    let below = (top + 1).min(height - 1);
    map[(column, top)].lerp(map[(next, top)], s).lerp(map[(column, below)].lerp(map[(next, below)], s), t)
}

/// Returns the cubic B-spline weights of four texels; `t` in 0..=1 is the position between the
/// middle two.
pub(super) fn spline(t: f32) -> [f32; 4] {
    let u = 1.0 - t;
    let near = |t: f32| 2.0 / 3.0 - t * t * (1.0 - 0.5 * t);
    [u * u * u / 6.0, near(t), near(u), t * t * t / 6.0]
}

impl Level {
    /// Returns the level at half the resolution, by a binomial filter.
    fn halved(&self) -> Self {
        const BINOMIAL: [f32; 4] = [0.125, 0.375, 0.375, 0.125];
        let side = self.side / 2;
        let near = |i: usize, k: usize| (2 * i + k).checked_sub(1).filter(|i| *i < self.side);
        let texel = |x: usize, y: usize| {
            let mut sum = Vec3A::ZERO;
            for (j, v) in BINOMIAL.iter().enumerate().filter_map(|(k, v)| Some((near(y, k)?, v))) {
                for (i, u) in BINOMIAL.iter().enumerate().filter_map(|(k, u)| Some((near(x, k)?, u))) {
                    sum += self.texels[j * self.side + i] * (u * v);
                }
            }
            sum
        };
        let texels = (0..side).into_par_iter().flat_map_iter(|y| (0..side).map(move |x| texel(x, y))).collect();
        Self { side, texels }
    }

    /// Interpolates the level at a point of the disk by cubic splines.
    fn at(&self, x: f32, y: f32) -> Vec3A {
        let place = |x: f32| {
            let at = ((0.5 + 0.5 * x) * self.side as f32 - 0.5).clamp(1.0, (self.side - 3) as f32);
            (at as usize - 1, spline(at.fract()))
        };
        let ((column, across), (row, down)) = (place(x), place(-y));
        let mut sum = Vec3A::ZERO;
        for (j, v) in down.iter().enumerate() {
            let first = (row + j) * self.side + column;
            let four = &self.texels[first..first + 4];
            sum += (four[0] * across[0] + four[1] * across[1] + four[2] * across[2] + four[3] * across[3]) * *v;
        }
        sum
    }
}
