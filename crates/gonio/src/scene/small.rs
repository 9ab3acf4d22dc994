//! Reduced photograph with values compressed to 0..1, so that lamps do not dominate.

use glam::Vec3;

use crate::parallel;
use crate::picture::{Plane, luminance};
use crate::statistics::quantile;

/// Side of the grid of pixels from which the median brightness is taken.
const PROBES: usize = 64;
/// Largest value that is kept, so that sums over blocks are finite.
const MAX_RADIANCE: f32 = 1e30;

/// Smallest scale of the compression, as a share of the brightness of bright pixels, so that noise
/// in a dark background does not count as contrast.
const DARK: f32 = 0.1;

/// Curve that compresses radiance: `v / (v + s)` for each channel.
///
/// The scale `s` is the median luminance of the photograph, but at least a tenth of its 95 %
/// quantile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Compression(f32);

impl Compression {
    fn of(rgb: &Plane<Vec3>) -> Self {
        let (width, height) = rgb.size();
        let every = |length: usize| (0..length).step_by(length.div_ceil(PROBES).max(1));
        let bright = every(height).flat_map(|y| every(width).map(move |x| luminance(sound(rgb[(x, y)]))));
        let mut bright: Vec<f32> = bright.filter(|v| *v > 0.0).collect();
        let mut brightness = |share| quantile(&mut bright, share).unwrap_or(1.0);
        let middle = brightness(0.5).max(DARK * brightness(0.95));
        Self(middle.clamp(1.0 / MAX_RADIANCE, MAX_RADIANCE))
    }

    /// Compresses a colour; negative channels and colours that are not finite count as zero.
    pub(super) fn apply(self, colour: Vec3) -> Vec3 {
        let colour = sound(colour);
        colour / (colour + self.0)
    }
}

fn sound(colour: Vec3) -> Vec3 {
    if colour.is_finite() { colour.clamp(Vec3::ZERO, Vec3::splat(MAX_RADIANCE)) } else { Vec3::ZERO }
}

/// A reduced photograph: means of square blocks of compressed values.
#[derive(Clone, Debug)]
pub(super) struct Small {
    /// The means, each channel in 0..=1.
    pub(super) values: Plane<Vec3>,
    /// Pixels of the photograph along a side of a block.
    pub(super) step: usize,
    /// Curve that compressed the values.
    pub(super) compression: Compression,
}

impl Small {
    /// Reduces a photograph to at most `side` pixels along its longer side.
    pub(super) fn of(rgb: &Plane<Vec3>, side: usize) -> Self {
        let compression = Compression::of(rgb);
        let step = rgb.width().max(rgb.height()).div_ceil(side).max(1);
        Self { values: blocks(rgb, step, |colour| compression.apply(colour)), step, compression }
    }

    /// Reduces the photograph further, to at most `side` pixels along its longer side.
    pub(super) fn reduced(&self, side: usize) -> Self {
        let by = self.values.width().max(self.values.height()).div_ceil(side).max(1);
        Self { values: blocks(&self.values, by, |value| value), step: self.step * by, ..*self }
    }
}

/// Returns the means over square blocks of `step` pixels per side.
///
/// Blocks at the right and lower border may be smaller.
fn blocks(of: &Plane<Vec3>, step: usize, value: impl Fn(Vec3) -> Vec3 + Sync) -> Plane<Vec3> {
    let (width, height) = of.size();
    let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
    let row = |y: usize| {
        let mut sums = vec![Vec3::ZERO; columns];
        let span = step * y..(step * (y + 1)).min(height);
        for line in span.clone() {
            let pixels = &of.as_slice()[line * width..(line + 1) * width];
            for (sum, block) in sums.iter_mut().zip(pixels.chunks(step)) {
                *sum += block.iter().map(|v| value(*v)).sum::<Vec3>() / block.len() as f32;
            }
        }
        sums.iter_mut().for_each(|sum| *sum /= span.len() as f32);
        sums
    };
    Plane::from_vec(columns, rows, parallel::flat_map_range(rows, row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_blocks_including_those_at_the_border() {
        let rgb = Plane::from_fn(5, 3, |x, _| if x == 0 { Vec3::NAN } else { Vec3::splat(2.0) });
        let small = Small::of(&rgb, 3);
        assert_eq!((small.values.size(), small.step), ((3, 2), 2));
        let off = [0.25, 0.5, 0.5].iter().enumerate().map(|(x, want)| (small.values[(x, 1)].x - want).abs());
        assert!(off.fold(0.0, f32::max) < 1e-6);
        assert_eq!(Small::of(&rgb, 100).values.size(), (5, 3));
        assert_eq!(small.reduced(1).values.size(), (1, 1));
        assert!(Small::of(&Plane::from_vec(0, 0, vec![]), 9).values.as_slice().is_empty());
    }

    #[test]
    fn compressed_values_are_at_most_one() {
        let rgb = Plane::from_fn(9, 9, |x, y| Vec3::new(f32::MAX, f32::INFINITY, -1.0) * (x * y) as f32);
        let small = Small::of(&rgb, 4);
        assert!(
            small.values.as_slice().iter().all(|v| v.is_finite() && v.min_element() >= 0.0 && v.max_element() <= 1.0)
        );
    }
}
