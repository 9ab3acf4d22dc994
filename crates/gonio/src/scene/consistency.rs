//! Refinement of inaccurate normals by shading, without knowledge of the light.
//!
//! Under distant light, pixels of one material with the same normal have the same brightness. Where
//! pixels contradict this, their normals are wrong. Each round averages the brightness over all
//! pixels of similar normals. It then moves the normal of each pixel along the gradient of this
//! average, towards the brightness of the pixel (a damped Gauss-Newton step). The displacements are
//! smooth over the picture, and zero at the outline, where an inflated normal is exact.
//!
//! A refinement also smooths sharp reflections, so it is only for normals that the misfit of an
//! estimate contradicts.

use glam::{Vec2, Vec3};

use super::view::has_normal;
use crate::picture::Plane;

/// Largest side of the picture in which displacements are computed, in pixels.
const MAX_SIDE: usize = 512;
/// Cells along a side of the disk of normals on which brightness is averaged.
const CELLS: usize = 64;
/// Standard deviation of the average over normals, in cells: 5 degrees.
const SIMILAR: f32 = 3.0;
/// Standard deviation of the smoothing of displacements, relative to the square root of the number
/// of pixels.
const SMOOTH: f32 = 0.015;
/// Standard deviation of the cube root of the brightness, relative to the mean, about the average
/// over similar correct normals: texture, interreflections, and the width of the average.
const DEVIATION: f32 = 0.1;
/// Component towards the camera at which a normal may be displaced entirely.
const FREE: f32 = 0.5;
/// Number of rounds.
const ROUNDS: usize = 15;

/// Returns normals that agree better with the brightness of their pixels.
///
/// `normals` are unit vectors in camera space, zero off the object. `brightness` is the luminance
/// of each pixel; `None` where it is unknown. `error` is the expected error of a normal in radians,
/// and about the largest angle by which a normal turns.
pub(super) fn refined(normals: &Plane<Vec3>, brightness: &Plane<Option<f32>>, error: f64) -> Plane<Vec3> {
    let (width, height) = normals.size();
    let step = width.max(height).div_ceil(MAX_SIDE).max(1);
    let small = Small::of(normals, brightness, step);
    let moved = small.displacements(error as f32);
    Plane::from_fn(width, height, |x, y| {
        let normal = normals[(x, y)];
        // Normals that face away from the camera are not observed.
        if !has_normal(normal) || normal.z <= 0.0 {
            return normal;
        }
        let by = small.interpolated(&moved, (x as f32 + 0.5) / step as f32 - 0.5, (y as f32 + 0.5) / step as f32 - 0.5);
        on_sphere(Vec2::new(normal.x, normal.y) + by)
    })
}

/// Returns the unit normal with these components to the right and upwards.
fn on_sphere(position: Vec2) -> Vec3 {
    // The limit keeps normals on the visible hemisphere.
    let position = position.clamp_length_max(0.999);
    position.extend((1.0 - position.length_squared()).sqrt())
}

/// A reduced picture.
struct Small {
    width: usize,
    height: usize,
    /// Components to the right and upwards of each normal.
    positions: Vec<Vec2>,
    /// Cube root of the brightness relative to the mean; `None` where it is unknown.
    brightness: Vec<Option<f32>>,
}

impl Small {
    fn of(normals: &Plane<Vec3>, brightness: &Plane<Option<f32>>, step: usize) -> Self {
        let (width, height) = (normals.width().div_ceil(step), normals.height().div_ceil(step));
        let mut positions = vec![Vec2::ZERO; width * height];
        let mut sums = vec![(0.0_f32, 0.0_f32); width * height];
        let mut counts = vec![0.0_f32; width * height];
        for y in 0..normals.height() {
            for x in 0..normals.width() {
                let (at, normal) = (y / step * width + x / step, normals[(x, y)]);
                if has_normal(normal) {
                    positions[at] += Vec2::new(normal.x, normal.y);
                    counts[at] += 1.0;
                    if let Some(value) = brightness[(x, y)] {
                        sums[at] = (sums[at].0 + value.max(0.0), sums[at].1 + 1.0);
                    }
                }
            }
        }
        positions.iter_mut().zip(&counts).for_each(|(position, count)| *position /= count.max(1.0));
        let (total, count) = sums
            .iter()
            .fold((0.0_f64, 0.0_f64), |(total, count), (sum, n)| (total + f64::from(*sum), count + f64::from(*n)));
        let mean = ((total / count.max(1.0)) as f32).max(f32::MIN_POSITIVE);
        let relative = |(sum, count): &(f32, f32)| (*count > 0.0).then(|| (sum / count / mean).cbrt());
        Self { width, height, brightness: sums.iter().map(relative).collect(), positions }
    }

    /// Computes the displacement of each normal on the disk, given their expected error.
    fn displacements(&self, error: f32) -> Vec<Vec2> {
        let known: Vec<f32> = self.brightness.iter().map(|value| f32::from(u8::from(value.is_some()))).collect();
        let area: f32 = known.iter().sum();
        let width = (SMOOTH * area.sqrt()).max(1.0);
        let weights = blurred(&known, (self.width, self.height), width);
        // Below this slope, the brightness determines a normal less well than the expected error.
        let damping = DEVIATION / error;
        let mut moved = vec![Vec2::ZERO; self.positions.len()];
        for _ in 0..ROUNDS {
            let now: Vec<Vec2> = self.positions.iter().zip(&moved).map(|(position, by)| *position + *by).collect();
            let average = Average::of(&now, &self.brightness);
            let wanted = |at: usize| -> Vec2 {
                let Some(own) = self.brightness[at] else { return Vec2::ZERO };
                let (value, slope) = average.at(now[at]);
                moved[at] + (own - value) / (slope.length_squared() + damping * damping) * slope
            };
            let steps: Vec<Vec2> = (0..moved.len()).map(wanted).collect();
            let part = |component: usize| {
                let values: Vec<f32> = steps.iter().map(|step| step[component]).collect();
                blurred(&values, (self.width, self.height), width)
            };
            let (right, up) = (part(0), part(1));
            for (at, by) in moved.iter_mut().enumerate() {
                let z = (1.0 - self.positions[at].length_squared()).max(0.0).sqrt();
                let smooth = Vec2::new(right[at], up[at]) / weights[at].max(1e-3);
                // An angle is the length on the disk over z.
                *by = (z / FREE).min(1.0) * smooth.clamp_length_max(error * z);
            }
        }
        moved
    }

    /// Interpolates bilinearly between pixel centres.
    fn interpolated(&self, values: &[Vec2], x: f32, y: f32) -> Vec2 {
        let (x, y) = (x.clamp(0.0, (self.width - 1) as f32), y.clamp(0.0, (self.height - 1) as f32));
        let (column, row) = (x as usize, y as usize);
        let (next, below) = ((column + 1).min(self.width - 1), (row + 1).min(self.height - 1));
        let at = |column: usize, row: usize| values[row * self.width + column];
        let across = |row: usize| at(column, row).lerp(at(next, row), x.fract());
        across(row).lerp(across(below), y.fract())
    }
}

/// Average brightness over the disk of normals.
struct Average {
    values: Vec<f32>,
}

impl Average {
    fn of(positions: &[Vec2], brightness: &[Option<f32>]) -> Self {
        let (mut sums, mut counts) = (vec![0.0_f32; CELLS * CELLS], vec![0.0_f32; CELLS * CELLS]);
        for (position, value) in positions.iter().zip(brightness) {
            if let Some(value) = value {
                let cell = |v: f32| (((v + 1.0) * 0.5 * CELLS as f32) as usize).min(CELLS - 1);
                let at = cell(position.y) * CELLS + cell(position.x);
                sums[at] += value;
                counts[at] += 1.0;
            }
        }
        let (sums, counts) = (blurred(&sums, (CELLS, CELLS), SIMILAR), blurred(&counts, (CELLS, CELLS), SIMILAR));
        Self { values: sums.iter().zip(&counts).map(|(sum, count)| sum / count.max(1e-6)).collect() }
    }

    /// Returns the average at a position on the disk, and its gradient.
    fn at(&self, position: Vec2) -> (f32, Vec2) {
        let scale = 0.5 * CELLS as f32;
        let coordinate = |v: f32| ((v + 1.0) * scale - 0.5).clamp(1.0, (CELLS - 3) as f32);
        let (x, y) = (coordinate(position.x), coordinate(position.y));
        let (column, row, s, t) = (x as usize, y as usize, x.fract(), y.fract());
        let value = |dx: usize, dy: usize| self.values[(row + dy) * CELLS + column + dx];
        let (top, bottom) = (value(0, 0) * (1.0 - s) + value(1, 0) * s, value(0, 1) * (1.0 - s) + value(1, 1) * s);
        let across = (value(1, 0) - value(0, 0)) * (1.0 - t) + (value(1, 1) - value(0, 1)) * t;
        (top * (1.0 - t) + bottom * t, scale * Vec2::new(across, bottom - top))
    }
}

/// Blurs an image by a Gaussian of a standard deviation in pixels; values beyond the border are
/// zero.
fn blurred(values: &[f32], (width, height): (usize, usize), deviation: f32) -> Vec<f32> {
    let reach = (2.5 * deviation).ceil() as usize;
    let kernel: Vec<f32> = (0..=reach).map(|i| (-0.5 * (i as f32 / deviation).powi(2)).exp()).collect();
    let total = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
    let mut rows = vec![0.0_f32; values.len()];
    for (from, to) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (i, weight) in kernel.iter().enumerate().take_while(|(i, _)| *i < width) {
            let weight = weight / total;
            to[i..].iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
            if i > 0 {
                to.iter_mut().zip(&from[i..]).for_each(|(to, from)| *to += weight * from);
            }
        }
    }
    let mut out = vec![0.0_f32; values.len()];
    for (i, weight) in kernel.iter().enumerate().take_while(|(i, _)| *i < height) {
        let (weight, shift) = (weight / total, i * width);
        out[shift..].iter_mut().zip(&rows).for_each(|(to, from)| *to += weight * from);
        if i > 0 {
            out.iter_mut().zip(&rows[shift..]).for_each(|(to, from)| *to += weight * from);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blur_keeps_the_sum_and_is_symmetric() {
        let mut values = vec![0.0; 31 * 21];
        values[10 * 31 + 15] = 1.0;
        let out = blurred(&values, (31, 21), 2.0);
        assert!((out.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        for (dx, dy) in [(3, 1), (1, 3), (0, 4)] {
            let at = |x: usize, y: usize| out[y * 31 + x];
            let four = [at(15 + dx, 10 + dy), at(15 - dx, 10 + dy), at(15 + dx, 10 - dy), at(15 - dx, 10 - dy)];
            assert!(four.iter().all(|v| (v - four[0]).abs() < 1e-7) && four[0] > 0.0, "{four:?}");
        }
        // A Gaussian: its variance is that of the kernel, which is cut at 2.5 deviations.
        let variance: f32 = out.iter().enumerate().map(|(i, v)| v * ((i % 31) as f32 - 15.0).powi(2)).sum();
        assert!((variance - 4.0).abs() < 0.5, "{variance}");
    }

    /// Two spheres side by side in one light, which depends on the normal by `shade`.
    fn spheres(shade: impl Fn(Vec3) -> f32) -> (Plane<Vec3>, Plane<Option<f32>>) {
        let normal = |x: usize, y: usize| {
            let (u, v) = ((x % 100) as f32 / 50.0 - 0.99, 0.99 - y as f32 / 50.0);
            if u.hypot(v) < 0.98 { on_sphere(Vec2::new(u, v)) } else { Vec3::ZERO }
        };
        let normals = Plane::from_fn(200, 100, normal);
        let brightness = normals.map(|n| (*n != Vec3::ZERO).then(|| shade(*n)));
        (normals, brightness)
    }

    /// Turns the normals of the right sphere by up to `by` radians, less towards its outline.
    fn bent(normals: &Plane<Vec3>, by: f32) -> Plane<Vec3> {
        Plane::from_fn(200, 100, |x, y| {
            let n = normals[(x, y)];
            if n == Vec3::ZERO || x < 100 { n } else { on_sphere(Vec2::new(n.x + by * n.z, n.y)) }
        })
    }

    fn error(normals: &Plane<Vec3>, truth: &Plane<Vec3>) -> f32 {
        let pairs = normals.as_slice().iter().zip(truth.as_slice()).filter(|(_, truth)| **truth != Vec3::ZERO);
        let angles: Vec<f32> = pairs.map(|(a, b)| a.angle_between(*b)).collect();
        angles.iter().sum::<f32>() / angles.len() as f32
    }

    /// Root mean square difference between the brightness of the pixels and the average over
    /// similar normals.
    fn contradiction(normals: &Plane<Vec3>, brightness: &Plane<Option<f32>>) -> f32 {
        let small = Small::of(normals, brightness, 1);
        let average = Average::of(&small.positions, &small.brightness);
        let known = small.positions.iter().zip(&small.brightness);
        let squares: Vec<f32> =
            known.filter_map(|(position, value)| Some((value.as_ref()? - average.at(*position).0).powi(2))).collect();
        (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
    }

    #[test]
    fn contradicting_normals_become_consistent() {
        let (truth, brightness) = spheres(|n| 1.0 + 0.8 * n.x + 0.3 * n.y);
        let wrong = bent(&truth, 0.25);
        let better = refined(&wrong, &brightness, 0.35);
        let (before, after) = (contradiction(&wrong, &brightness), contradiction(&better, &brightness));
        assert!(after < 0.5 * before, "{before} {after}");
        assert!(better.as_slice().iter().all(|n| *n == Vec3::ZERO || (n.length() - 1.0).abs() < 1e-5));
        // Normals at the outline hardly move.
        let rim = |(n, m): (&Vec3, &Vec3)| *n == Vec3::ZERO || n.z > 0.1 || n.angle_between(*m) < 0.1;
        assert!(wrong.as_slice().iter().zip(better.as_slice()).all(rim));
    }

    #[test]
    fn consistent_normals_hardly_move() {
        let (truth, brightness) = spheres(|n| 1.0 + 0.8 * n.x + 0.3 * n.y);
        let moved = error(&refined(&truth, &brightness, 0.35), &truth);
        // The average over 5 degrees is wrong where the brightness curves.
        assert!(moved < 0.04, "{moved}");
        // Uniform brightness does not determine normals.
        let even = brightness.map(|value| value.map(|_| 2.0));
        assert!(error(&refined(&truth, &even, 0.35), &truth) < 1e-3);
    }
}
