//! Prefiltered light at every scale, for the lookups of a fast renderer.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::sphere::OctahedralMap;

/// Map of the sphere to a square: the texel of a direction is found without trigonometry.
const CHART: OctahedralMap = OctahedralMap::PraunHoppe;

/// Samples along each side of a texel of the finest level.
const SAMPLES: usize = 2;

/// Factor above the mean over the sphere from which on a texel is a lamp...
const BRIGHT: f64 = 12.0;

/// ...if it is among this number of those with most flux.
const MOST_LAMPS: usize = 1500;

/// Luminance over all directions, averaged over texels of an octahedral square of 4 pi sr, and over
/// ever larger squares of texels.
#[derive(Clone, Debug)]
pub struct LightPyramid {
    /// Full light, from the finest level on.
    all: Vec<Level>,
    /// Light without its lamps.
    even: Vec<Level>,
    /// Direction and irradiance of each bright texel, on a surface that faces it.
    lamps: Vec<(Vec3, f32)>,
}

/// Part of a light that is looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// The full light.
    All,
    /// The light without its [`LightPyramid::lamps`].
    Even,
}

/// One resolution, with a border of one texel that repeats the texels across the edge.
#[derive(Clone, Debug)]
struct Level {
    side: usize,
    /// `(side + 2)^2` values.
    texels: Vec<f32>,
}

impl LightPyramid {
    /// Texels along a side of the finest level: 0.8 degrees each, about what captured maps resolve.
    pub const SIDE: usize = 256;

    /// Builds the pyramid from the luminance by direction.
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

    /// Returns direction and irradiance, on a surface that faces it, of each texel that is much
    /// brighter than the rest.
    pub fn lamps(&self) -> &[(Vec3, f32)] {
        &self.lamps
    }

    /// Returns the level whose texels are about as wide as a patch of light of this solid angle
    /// (sr).
    pub fn level(solid_angle: f64) -> usize {
        let texel = 4.0 * std::f64::consts::PI / (Self::SIDE * Self::SIDE) as f64;
        // Half of the logarithm to the base of two, rounded up rather than down; the coarsest level
        // has two texels a side.
        let level = 0.5 * (solid_angle / texel).max(1e-9).log2() + 0.8;
        (level.max(0.0) as usize).min(Self::SIDE.ilog2() as usize - 1)
    }

    /// Returns half of the number of texels along a side of a level.
    pub(super) fn half_side(level: usize) -> f32 {
        (Self::SIDE >> (level + 1)) as f32
    }

    /// Returns the mean luminance at a place of [`Place::of`] on a level, bilinear.
    #[inline(always)]
    pub(super) fn at(&self, part: Part, level: usize, place: &Place) -> f32 {
        let Level { side, texels } = match part {
            Part::All => &self.all[level],
            Part::Even => &self.even[level],
        };
        let first = place.row as usize * (side + 2) + place.column as usize;
        let (upper, lower) = (&texels[first..first + 2], &texels[first + side + 2..first + side + 4]);
        let top = upper[0] + place.right * (upper[1] - upper[0]);
        let bottom = lower[0] + place.right * (lower[1] - lower[0]);
        top + place.down * (bottom - top)
    }
}

#[cfg(test)]
impl LightPyramid {
    /// Returns the mean luminance of the full light around a direction.
    pub(super) fn towards(&self, direction: DVec3, level: usize) -> f32 {
        let d = direction.as_vec3();
        self.at(Part::All, level, &Place::of(d.x, d.y, d.z, Self::half_side(level)))
    }
}

/// Position of a direction on a level: the upper left of four texels, and the fractions of the way
/// to the right and down from there.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    column: u32,
    row: u32,
    right: f32,
    down: f32,
}

impl Place {
    /// Finds the place of a unit direction on a level of this [`LightPyramid::half_side`].
    /// Branch-free, for processing many at once.
    #[inline(always)]
    pub(super) fn of(x: f32, y: f32, z: f32, half_side: f32) -> Self {
        let scale = 1.0 / (x.abs() + y.abs() + z.abs());
        let (a, b) = (x.abs() * scale, y.abs() * scale);
        let (a, b) = if z >= 0.0 { (a, b) } else { (1.0 - b, 1.0 - a) };
        // With the border a texel centre is at a whole number plus one half.
        let (column, right) = whole(half_side * (1.0 + a.copysign(x)) + 0.5);
        let (row, down) = whole(half_side * (1.0 - b.copysign(y)) + 0.5);
        Self { column, row, right, down }
    }
}

/// Returns the whole part of a number in 0..2^21 and the rest, which is 1 at some whole numbers.
#[inline(always)]
pub(super) fn whole(x: f32) -> (u32, f32) {
    // One and a half times 2^23: adding it rounds to an integer, which is then in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let rounded = (x - 0.5) + ROUND;
    (rounded.to_bits() & 0x3f_ffff, x - (rounded - ROUND))
}

impl Level {
    /// Builds all levels from values with their solid angles.
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
            // The texels across an edge are the mirror image of those along the same edge; corners
            // meet at one point.
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

    #[test]
    fn a_number_is_its_whole_part_and_its_rest() {
        for i in 0..6000 {
            let x = i as f32 * 0.037;
            let (whole, rest) = whole(x);
            assert!((0.0..=1.0).contains(&rest) && (whole as f32 + rest - x).abs() < 1e-5, "{x} {whole} {rest}");
        }
    }

    fn everywhere() -> impl Iterator<Item = DVec3> {
        fibonacci_hemisphere(500).flat_map(|n| [n, -n])
    }

    #[test]
    fn smooth_light_is_the_same_at_every_level() {
        let light = |d: DVec3| 2.0 + d.y + 0.5 * d.x * d.z;
        let pyramid = LightPyramid::new(light);
        for (level, bound) in [(0, 3e-3), (2, 8e-3), (4, 0.06)] {
            for d in everywhere() {
                let got = f64::from(pyramid.towards(d, level));
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
            let sum: f64 = directions.iter().map(|&d| f64::from(pyramid.towards(d, level))).sum();
            sum / directions.len() as f64
        };
        let want = 1000.0 * 0.5 * (1.0 - 0.06_f64.cos());
        for level in [0, 2, 4, 5] {
            assert!((power(level) / want - 1.0).abs() < 0.12, "{level}: {} {want}", power(level));
        }
    }
}
