//! Segmentation of the object from a plain background, for pictures without a mask.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use super::components::{border, connected_to_border, neighbours};
use super::small::Small;
use crate::picture::{Picture, Plane};
use crate::statistics::{median, quantile};

/// Returns the coverage (0..1) of the object, or `None` if no source is available.
///
/// The source is the mask, else the alpha channel, else a constant background.
pub(crate) fn coverage_of(picture: &Picture, mask: Option<&Plane<f32>>) -> Option<Plane<f32>> {
    mask.or(picture.varying_alpha()).cloned().or_else(|| background_coverage(&picture.rgb))
}

/// Estimates the coverage (0..1) of the object on a background of exactly one value.
///
/// Renderers write such a background, usually black. Its value is the most frequent one on the
/// border of the picture, where it must make up at least a quarter of the pixels. The background
/// consists of all pixels of that value that are connected to the border. Returns `None` if there
/// is no such background.
fn background_coverage(rgb: &Plane<Vec3>) -> Option<Plane<f32>> {
    // Adding zero turns -0 into 0: the two are equal but differ in their bits.
    let key = |at: (usize, usize)| (rgb[at] + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut counts = BTreeMap::new();
    for at in border(rgb.size()) {
        *counts.entry(key(at)).or_insert(0_usize) += 1;
    }
    let (&value, &count) = counts.iter().max_by_key(|&(_, count)| count)?;
    if 4 * count < border(rgb.size()).count() {
        return None;
    }
    let (background, reached) = connected_to_border(rgb.size(), false, |at| key(at) == value);
    if reached == rgb.as_slice().len() {
        return None;
    }
    let base = Vec3::from_array(value.map(f32::from_bits));
    Some(soft_coverage(rgb, base, &background))
}

/// Multiple of the spread of the border's values within which a pixel is background.
const SPREADS: f32 = 4.0;
/// Quantile of the distances of the border's values from their median that defines this spread;
/// also the smallest share of the border that must be background.
const BORDER_SHARE: f64 = 0.7;
/// Smallest distance of compressed values that counts as contrast; coding explains smaller ones.
const CODING: f32 = 0.04;
/// Share of the object's contrast below which a pixel is background: most artefacts of lossy
/// compression around the object are weaker.
const LOSSES: f32 = 0.12;
/// Largest noise of a plain background, as a share of the object's contrast.
const MAX_NOISE: f32 = 0.4;

/// Estimates the coverage (0..1) of the object on a plain background with noise.
///
/// The noise may also be compression losses. The background consists of the pixels of the reduced
/// photograph that are connected to its border through values near the median of the border. The
/// threshold depends on the spread of the border and on the contrast of the object. The compression
/// losses limit the accuracy of the outline, sometimes to several pixels. Returns `None` if the
/// background is not plain.
pub(super) fn plain_coverage(small: &Small, size: (usize, usize)) -> Option<Plane<f32>> {
    let values = &small.values;
    let outer: Vec<Vec3> = border(values.size()).map(|at| values[at]).collect();
    let channel = |c: usize| median(outer.iter().map(|v| v[c]));
    let base = Vec3::new(channel(0)?, channel(1)?, channel(2)?);
    let from_base = |v: &Vec3| (*v - base).length();
    let noise = SPREADS * quantile(&mut outer.iter().map(from_base).collect::<Vec<_>>(), BORDER_SHARE)?;
    let contrast = contrast(values.as_slice().iter().map(from_base));
    if contrast < CODING || noise > MAX_NOISE * contrast {
        return None;
    }
    let near = noise.max(LOSSES * contrast);
    let (background, reached) = connected_to_border(values.size(), false, |at| from_base(&values[at]) <= near);
    let on_border = border(values.size()).filter(|at| background[*at]).count();
    if reached == values.as_slice().len() || (on_border as f64) < BORDER_SHARE * outer.len() as f64 {
        return None;
    }
    let coverage = soft_coverage(values, base, &background);
    Some(if small.step == 1 { coverage } else { enlarged(&coverage, small.step, size) })
}

/// Returns the mean of the larger distances after a split by Otsu's method; zero without a split.
///
/// The split maximises the variance between the two parts.
fn contrast(distances: impl Iterator<Item = f32>) -> f32 {
    const BINS: usize = 256;
    // Colours with channels in 0..=1 differ by at most the square root of three.
    let mut counts = [0_u32; BINS];
    distances.for_each(|d| counts[((d / 1.74 * BINS as f32) as usize).min(BINS - 1)] += 1);
    let middle = |bin: usize| (bin as f64 + 0.5) / BINS as f64 * 1.74;
    let sums = |range: std::ops::Range<usize>| {
        range.fold((0.0, 0.0), |(n, sum), bin| (n + f64::from(counts[bin]), sum + f64::from(counts[bin]) * middle(bin)))
    };
    let mut best = (0.0, 0.0);
    for split in 1..BINS {
        let ((n, sum), (m, rest)) = (sums(0..split), sums(split..BINS));
        let between = n * m * (rest / m - sum / n).powi(2);
        if n > 0.0 && m > 0.0 && between > best.0 {
            best = (between, rest / m);
        }
    }
    best.1 as f32
}

/// Interpolates a plane of blocks of `step` pixels per side to single pixels.
fn enlarged(blocks: &Plane<f32>, step: usize, (width, height): (usize, usize)) -> Plane<f32> {
    // Blocks on either side of a pixel, and the weight of the second.
    let sides = |at: usize, most: usize| {
        let place = ((at as f32 + 0.5) / step as f32 - 0.5).clamp(0.0, most as f32 - 1.0);
        let low = place as usize;
        (low, (low + 1).min(most - 1), place.fract())
    };
    let columns: Vec<_> = (0..width).map(|x| sides(x, blocks.width())).collect();
    let row = |y: usize| {
        let (top, below, down) = sides(y, blocks.height());
        let columns = columns.clone();
        columns.into_iter().map(move |(left, right, along)| {
            let mix = |row: usize| {
                let (a, b) = (blocks[(left, row)], blocks[(right, row)]);
                a + along * (b - a)
            };
            mix(top) + down * (mix(below) - mix(top))
        })
    };
    Plane::from_vec(width, height, (0..height).into_par_iter().flat_map_iter(row).collect())
}

/// Returns the coverage of each pixel, given the `background` pixels and their value `base`.
///
/// A pixel next to the background may be partly background: its coverage is its contrast to the
/// background relative to the mean contrast of the object's pixels nearby, clamped to 0..=1.
fn soft_coverage(rgb: &Plane<Vec3>, base: Vec3, background: &Plane<bool>) -> Plane<f32> {
    let near_background = Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
        neighbours((x, y), rgb.size(), true).any(|next| background[next])
    });
    Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
        if background[(x, y)] {
            return 0.0;
        }
        if !near_background[(x, y)] {
            return 1.0;
        }
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for v in y.saturating_sub(2)..(y + 3).min(rgb.height()) {
            for u in x.saturating_sub(2)..(x + 3).min(rgb.width()) {
                if !near_background[(u, v)] && !background[(u, v)] && rgb[(u, v)].is_finite() {
                    sum += rgb[(u, v)] - base;
                    count += 1.0;
                }
            }
        }
        let inside = sum / count;
        let share = (rgb[(x, y)] - base).dot(inside) / inside.length_squared();
        // The share is NaN if no pixel nearby is inside, or if those inside equal the background.
        if share.is_nan() { 1.0 } else { share.clamp(0.0, 1.0) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::find_sphere;

    /// A ball of radius 40 about (64.3, 60.8), shaded from below, over `base`; antialiased or not.
    fn ball(base: Vec3, samples: usize) -> Plane<Vec3> {
        Plane::from_fn(128, 128, |x, y| {
            let mut sum = Vec3::ZERO;
            for i in 0..samples * samples {
                let at = |whole: usize, part: usize| whole as f32 + (part as f32 + 0.5) / samples as f32;
                let (dx, dy) = (at(x, i % samples) - 64.3, at(y, i / samples) - 60.8);
                let shade = Vec3::new(1.2, 1.0, 0.8) * (2.0 + dy / 40.0);
                sum += if dx.hypot(dy) <= 40.0 { shade } else { base };
            }
            sum / (samples * samples) as f32
        })
    }

    #[test]
    fn segments_a_ball_from_a_constant_background() {
        for (base, samples) in [(Vec3::ZERO, 8), (Vec3::ZERO, 1), (Vec3::splat(0.25), 8)] {
            let found = find_sphere(&background_coverage(&ball(base, samples)).unwrap()).unwrap().circle;
            let error = (found.x - 64.3).abs().max((found.y - 60.8).abs()).max((found.radius - 40.0).abs());
            assert!(error < if samples == 1 { 0.25 } else { 0.1 }, "{base} {samples} {found:?}");
        }
    }

    #[test]
    fn black_spots_within_the_ball_belong_to_it() {
        let mut picture = ball(Vec3::ZERO, 1);
        picture[(64, 60)] = Vec3::ZERO;
        assert_eq!(background_coverage(&picture).unwrap()[(64, 60)], 1.0);
    }

    #[test]
    fn other_backgrounds_have_no_coverage() {
        let uneven = Plane::from_fn(40, 40, |x, y| Vec3::splat((x * 41 + y) as f32));
        assert!(background_coverage(&uneven).is_none());
        assert!(background_coverage(&Plane::from_fn(40, 40, |_, _| Vec3::ONE)).is_none());
        assert!(background_coverage(&Plane::from_vec(0, 0, vec![])).is_none());
    }
}
