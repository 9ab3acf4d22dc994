//! Light prefiltered at every scale, for the lookups of a fast renderer.

use std::iter::Sum;
use std::ops::{Add, Div, Mul, Sub};

use glam::{DVec3, Vec3, Vec3A};

use crate::picture::luminance;
use crate::sphere::OctahedralMap;

/// Map of the sphere to a square; computing the texel of a direction needs no trigonometry.
pub(crate) const CHART: OctahedralMap = OctahedralMap::PraunHoppe;

/// Radiance as one number or as RGB.
pub(crate) trait Radiance: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f32, Output = Self> {
    /// Type in which means are computed.
    type Wide: Copy + Mul<f64, Output = Self::Wide> + Div<f64, Output = Self::Wide> + Sum + Default;

    /// Rounds a mean to the type of the texels.
    fn narrow(wide: Self::Wide) -> Self;

    /// Returns the luminance, by which lamps are detected.
    fn brightness(wide: Self::Wide) -> f64;
}

impl Radiance for f32 {
    type Wide = f64;

    fn narrow(wide: f64) -> Self {
        wide as f32
    }

    fn brightness(wide: f64) -> f64 {
        wide
    }
}

impl Radiance for Vec3A {
    type Wide = DVec3;

    fn narrow(wide: DVec3) -> Self {
        wide.as_vec3a()
    }

    fn brightness(wide: DVec3) -> f64 {
        f64::from(luminance(wide.as_vec3()))
    }
}

/// Rule that classifies texels as lamps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LampRule {
    /// Ratio to the mean over the sphere above which a texel may be a lamp.
    pub(crate) bright: f64,
    /// Largest number of lamps; the texels with the most flux are selected.
    pub(crate) most: usize,
}

/// Light over all directions, averaged over texels and over ever larger squares of texels.
///
/// The texels divide an octahedral square, which represents 4 pi sr.
#[derive(Clone, Debug)]
pub(crate) struct Pyramid<T> {
    /// Full light, finest level first.
    all: Vec<Level<T>>,
    /// Light without its lamps, finest level first.
    without_lamps: Vec<Level<T>>,
    /// Direction and irradiance (on a surface that faces it) of each lamp.
    lamps: Vec<(Vec3, T)>,
}

/// Part of a light to look up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// The full light.
    All,
    /// The light without its [`Pyramid::lamps`].
    WithoutLamps,
}

/// One resolution, with a border of one texel that repeats the texels across the edge.
#[derive(Clone, Debug)]
struct Level<T> {
    side: usize,
    /// `(side + 2)^2` values.
    texels: Vec<T>,
}

/// Returns direction and density of solid angle at `(u, v)` in 0..1 of the square (`v` down).
pub(crate) fn on_square(u: f64, v: f64) -> (DVec3, f64) {
    let (u, v) = (2.0 * u - 1.0, 1.0 - 2.0 * v);
    (CHART.direction(u, v), CHART.density(u, v))
}

impl<T: Radiance> Pyramid<T> {
    /// Builds the pyramid from the texels of the finest level.
    ///
    /// `fine` contains, row by row, the mean radiance of each texel and a number proportional to
    /// its solid angle.
    pub(crate) fn of_texels(side: usize, fine: Vec<(T::Wide, f64)>, lamps: LampRule) -> Self {
        let total: f64 = fine.iter().map(|f| f.1).sum();
        let strength: Vec<f64> = fine.iter().map(|f| T::brightness(f.0)).collect();
        let mean = strength.iter().zip(&fine).map(|(s, f)| s * f.1).sum::<f64>() / total;
        let mut bright: Vec<usize> = (0..fine.len()).filter(|&t| strength[t] > lamps.bright * mean).collect();
        bright.sort_by(|&a, &b| (strength[b] * fine[b].1).total_cmp(&(strength[a] * fine[a].1)).then(a.cmp(&b)));
        bright.truncate(lamps.most);
        let mut even = fine.clone();
        bright.iter().for_each(|&t| even[t].0 = T::Wide::default());
        let lamp = |&t: &usize| {
            let (u, v) = (((t % side) as f64 + 0.5) / side as f64, ((t / side) as f64 + 0.5) / side as f64);
            let solid_angle = fine[t].1 / total * 4.0 * std::f64::consts::PI;
            (on_square(u, v).0.as_vec3(), T::narrow(fine[t].0 * solid_angle))
        };
        Self {
            lamps: bright.iter().map(lamp).collect(),
            all: Level::all(side, fine),
            without_lamps: Level::all(side, even),
        }
    }

    /// Returns direction and irradiance (on a surface that faces it) of each lamp.
    pub(crate) fn lamps(&self) -> &[(Vec3, T)] {
        &self.lamps
    }

    /// Returns the number of texels along a side of the finest level.
    pub(crate) fn side(&self) -> usize {
        self.all[0].side
    }

    /// Returns a pyramid, without lamps, in which each texel combines `WAYS` texels of this one.
    ///
    /// `texel` receives a number below `WAYS`, the index of the last column and row, and the column
    /// and row of the texel; it returns the column and row to read. All indices include the border.
    pub(crate) fn at_images<const WAYS: usize, U: From<[T; WAYS]>>(
        &self,
        texel: impl Fn(usize, usize, (usize, usize)) -> (usize, usize),
    ) -> Pyramid<U> {
        let level = |level: &Level<T>| {
            let wide = level.side + 2;
            let value = |at: usize| {
                let image = |way: usize| {
                    let (column, row) = texel(way, wide - 1, (at % wide, at / wide));
                    level.texels[row * wide + column]
                };
                U::from(std::array::from_fn(image))
            };
            Level { side: level.side, texels: (0..wide * wide).map(value).collect() }
        };
        let [all, even] = [&self.all, &self.without_lamps].map(|levels| levels.iter().map(level).collect());
        Pyramid { all, without_lamps: even, lamps: Vec::new() }
    }
}

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>> Pyramid<T> {
    /// Interpolates the mean radiance bilinearly at a place of [`Place::of`] on a level.
    #[inline(always)]
    pub(crate) fn at(&self, part: Part, level: usize, place: &Place) -> T {
        let Level { side, texels } = match part {
            Part::All => &self.all[level],
            Part::WithoutLamps => &self.without_lamps[level],
        };
        let first = place.row as usize * (side + 2) + place.column as usize;
        let (upper, lower) = (&texels[first..first + 2], &texels[first + side + 2..first + side + 4]);
        let top = upper[0] + (upper[1] - upper[0]) * place.right;
        let bottom = lower[0] + (lower[1] - lower[0]) * place.right;
        top + (bottom - top) * place.down
    }
}

/// Returns the level whose texels are about as wide as a patch of light of this solid angle (sr).
///
/// `side` is the number of texels along a side of the finest level.
pub(crate) fn level(side: usize, solid_angle: f64) -> usize {
    let texel = 4.0 * std::f64::consts::PI / (side * side) as f64;
    // Half of the binary logarithm of the ratio, rounded up rather than down. The coarsest level
    // has two texels per side.
    let level = 0.5 * (solid_angle / texel).max(1e-9).log2() + 0.8;
    (level.max(0.0) as usize).min(side.ilog2() as usize - 1)
}

/// Returns half the number of texels along a side of a level.
pub(crate) fn half_side(side: usize, level: usize) -> f32 {
    (side >> (level + 1)) as f32
}

/// Position of a direction on a level, for bilinear interpolation.
///
/// It consists of column and row of the upper left of four texels, and the fractions of the way to
/// the right and down from there.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Place {
    column: u32,
    row: u32,
    right: f32,
    down: f32,
}

impl Place {
    /// Computes the place of a unit direction on a level of this [`half_side`].
    ///
    /// Branch-free, for processing many directions at once.
    #[inline(always)]
    pub(crate) fn of(direction: impl Into<[f32; 3]>, half_side: f32) -> Self {
        let [x, y, z] = direction.into();
        let scale = 1.0 / (x.abs() + y.abs() + z.abs());
        let (a, b) = (x.abs() * scale, y.abs() * scale);
        let (a, b) = if z >= 0.0 { (a, b) } else { (1.0 - b, 1.0 - a) };
        // The offset of 0.5 is one texel for the border minus half a texel for the texel centre.
        let (column, right) = whole(half_side * (1.0 + a.copysign(x)) + 0.5);
        let (row, down) = whole(half_side * (1.0 - b.copysign(y)) + 0.5);
        Self { column, row, right, down }
    }
}

/// Splits a number in 0..2^21 into its whole part and the rest.
///
/// At some whole numbers, the rest is 1 and the whole part is one less.
#[inline(always)]
pub(crate) fn whole(x: f32) -> (u32, f32) {
    // Adding 1.5 times 2^23 rounds to an integer, which is then in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let rounded = (x - 0.5) + ROUND;
    (rounded.to_bits() & 0x3f_ffff, x - (rounded - ROUND))
}

impl<T: Radiance> Level<T> {
    /// Builds all levels from values with their solid angles.
    fn all(mut side: usize, mut fine: Vec<(T::Wide, f64)>) -> Vec<Self> {
        let mut levels = Vec::new();
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
                (four.iter().map(|f| f.0 * f.1).sum::<T::Wide>() / weight, weight)
            };
            fine = (0..side * side).map(merged).collect();
        }
    }

    fn of(side: usize, values: &[(T::Wide, f64)]) -> Self {
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
            T::narrow(values[y * side + x].0)
        };
        Self { side, texels: (0..wide * wide).map(texel).collect() }
    }
}
