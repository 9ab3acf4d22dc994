//! Light at every scale: the prefiltered lookups of a fast renderer.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::sphere::OctahedralMap;

/// The chart: no trigonometry is needed to find the texel of a direction.
const CHART: OctahedralMap = OctahedralMap::PraunHoppe;

/// Samples along each side of a texel of the finest level.
const SAMPLES: usize = 2;

/// A texel is a lamp if it is so many times as bright as the mean over the sphere...
const BRIGHT: f64 = 12.0;

/// ...and among so many brightest.
const MOST_LAMPS: usize = 1500;

/// Luminance over all directions, averaged over texels of an octahedral square of 4 pi sr, and over ever larger squares of them.
#[derive(Clone, Debug)]
pub struct LightPyramid {
    /// All of the light, from the finest level on.
    all: Vec<Level>,
    /// The same without its lamps.
    even: Vec<Level>,
    /// Direction and irradiance of each bright texel, on a surface that faces it.
    lamps: Vec<(Vec3, f32)>,
}

/// What part of a light is looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    All,
    /// What is left without its [`LightPyramid::lamps`].
    Even,
}

/// One resolution, with a border of one texel that repeats what lies across the edge.
#[derive(Clone, Debug)]
struct Level {
    side: usize,
    /// `(side + 2)^2` values.
    texels: Vec<f32>,
}

impl LightPyramid {
    /// Texels along a side of the finest level: 0.8 degrees each, about what captured maps resolve.
    pub const SIDE: usize = 256;

    /// Of luminance by direction.
    pub fn new(luminance: impl Fn(DVec3) -> f64 + Sync) -> Self {
        let side = Self::SIDE;
        let step = 2.0 / (side * SAMPLES) as f64;
        let texel = |at: usize| {
            let (x, y) = (at % side, at / side);
            let (mut sum, mut weight) = (0.0, 0.0);
            for i in 0..SAMPLES * SAMPLES {
                let u = -1.0 + ((x * SAMPLES + i % SAMPLES) as f64 + 0.5) * step;
                let v = 1.0 - ((y * SAMPLES + i / SAMPLES) as f64 + 0.5) * step;
                let density = CHART.density(u, v);
                sum += density * luminance(CHART.direction(u, v));
                weight += density;
            }
            (sum / weight, weight)
        };
        let fine: Vec<(f64, f64)> = (0..side * side).into_par_iter().map(texel).collect();
        let total: f64 = fine.iter().map(|f| f.1).sum();
        let mean = fine.iter().map(|f| f.0 * f.1).sum::<f64>() / total;
        let mut bright: Vec<usize> = (0..fine.len()).filter(|&t| fine[t].0 > BRIGHT * mean).collect();
        bright.sort_by(|&a, &b| (fine[b].0 * fine[b].1).total_cmp(&(fine[a].0 * fine[a].1)).then(a.cmp(&b)));
        bright.truncate(MOST_LAMPS);
        let mut even = fine.clone();
        bright.iter().for_each(|&t| even[t].0 = 0.0);
        let lamp = |&t: &usize| {
            let (u, v) = (((t % side) as f64 + 0.5) / side as f64, ((t / side) as f64 + 0.5) / side as f64);
            let direction = CHART.direction(2.0 * u - 1.0, 1.0 - 2.0 * v);
            let solid_angle = fine[t].1 / total * 4.0 * std::f64::consts::PI;
            (direction.as_vec3(), (fine[t].0 * solid_angle) as f32)
        };
        Self { lamps: bright.iter().map(lamp).collect(), all: Level::all(fine), even: Level::all(even) }
    }

    /// Direction and irradiance, on a surface that faces it, of each texel that is much brighter than the rest.
    pub fn lamps(&self) -> &[(Vec3, f32)] {
        &self.lamps
    }

    /// The level whose texels are about as wide as a patch of light of this solid angle (sr).
    pub fn level(solid_angle: f64) -> usize {
        let texel = 4.0 * std::f64::consts::PI / (Self::SIDE * Self::SIDE) as f64;
        // Half of the logarithm to the base of two, rounded up rather than down; the coarsest level has two texels a side.
        let level = 0.5 * (solid_angle / texel).max(1e-9).log2() + 0.8;
        (level.max(0.0) as usize).min(Self::SIDE.ilog2() as usize - 1)
    }

    /// Mean luminance around a unit direction at a level, bilinear.
    pub fn at(&self, part: Part, direction: Vec3, level: usize) -> f32 {
        let Level { side, texels } = match part {
            Part::All => &self.all[level],
            Part::Even => &self.even[level],
        };
        let sum = direction.x.abs() + direction.y.abs() + direction.z.abs();
        let (a, b) = (direction.x.abs() / sum, direction.y.abs() / sum);
        let (a, b) = if direction.z >= 0.0 { (a, b) } else { (1.0 - b, 1.0 - a) };
        let half = 0.5 * *side as f32;
        // With the border a texel centre is at a whole number plus one half.
        let x = half * (1.0 + a.copysign(direction.x)) + 0.5;
        let y = half * (1.0 - b.copysign(direction.y)) + 0.5;
        let (column, row) = ((x as usize).min(*side), (y as usize).min(*side));
        let (s, t) = (x - column as f32, y - row as f32);
        let first = row * (side + 2) + column;
        let (upper, lower) = (&texels[first..first + 2], &texels[first + side + 2..first + side + 4]);
        let top = upper[0] + s * (upper[1] - upper[0]);
        let bottom = lower[0] + s * (lower[1] - lower[0]);
        top + t * (bottom - top)
    }
}

impl Level {
    /// From values with their solid angles, all levels.
    fn all(mut fine: Vec<(f64, f64)>) -> Vec<Self> {
        let (mut levels, mut side) = (Vec::new(), LightPyramid::SIDE);
        loop {
            levels.push(Self::of(side, &fine));
            if side == 2 {
                return levels;
            }
            side /= 2;
            let merged = |at: usize| {
                let (x, y) = (2 * (at % side), 2 * (at / side));
                let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| fine[y * 2 * side + x]);
                let weight: f64 = four.iter().map(|f| f.1).sum();
                (four.iter().map(|f| f.0 * f.1).sum::<f64>() / weight, weight)
            };
            fine = (0..side * side).map(merged).collect();
        }
    }

    fn of(side: usize, values: &[(f64, f64)]) -> Self {
        let wide = side + 2;
        let mirrored = |i: usize| side - 1 - i;
        let texel = |at: usize| {
            let (x, y) = ((at % wide) as isize - 1, (at / wide) as isize - 1);
            let inside = |i: isize| (0..side as isize).contains(&i);
            let clamp = |i: isize| i.clamp(0, side as isize - 1) as usize;
            // Across an edge lies the mirror image of the same edge; corners meet at one point.
            let (x, y) = match (inside(x), inside(y)) {
                (true, false) => (mirrored(x as usize), clamp(y)),
                (false, true) => (clamp(x), mirrored(y as usize)),
                _ => (clamp(x), clamp(y)),
            };
            values[y * side + x].0 as f32
        };
        Self { side, texels: (0..wide * wide).map(texel).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::fibonacci_hemisphere;

    fn everywhere() -> impl Iterator<Item = DVec3> {
        fibonacci_hemisphere(500).flat_map(|n| [n, -n])
    }

    #[test]
    fn smooth_light_is_the_same_at_every_level() {
        let light = |d: DVec3| 2.0 + d.y + 0.5 * d.x * d.z;
        let pyramid = LightPyramid::new(light);
        for (level, bound) in [(0, 3e-3), (2, 8e-3), (4, 0.06)] {
            for d in everywhere() {
                let got = f64::from(pyramid.at(Part::All, d.as_vec3(), level));
                assert!((got - light(d)).abs() < bound, "{level} {d}: {got} {}", light(d));
            }
        }
    }

    #[test]
    fn a_lamp_keeps_its_power_at_every_level() {
        let lamp = DVec3::new(0.3, 0.5, -0.4).normalize();
        let pyramid = LightPyramid::new(|d| if d.angle_between(lamp) < 0.06 { 1000.0 } else { 0.0 });
        let power = |level: usize| {
            let directions: Vec<DVec3> = fibonacci_hemisphere(400_000).flat_map(|n| [n, -n]).collect();
            let sum: f64 = directions.iter().map(|d| f64::from(pyramid.at(Part::All, d.as_vec3(), level))).sum();
            sum / directions.len() as f64
        };
        let want = 1000.0 * 0.5 * (1.0 - 0.06_f64.cos());
        for level in [0, 2, 4, 5] {
            assert!((power(level) / want - 1.0).abs() < 0.12, "{level}: {} {want}", power(level));
        }
    }
}
