//! Segmentation of the object from a constant background, for pictures without a mask.

use std::collections::BTreeMap;

use glam::Vec3;

use super::components::{border, flood, neighbours};
use crate::picture::{Picture, Plane};

/// Coverage (0..1) of what a picture shows: by a mask, else by its alpha channel, else by a
/// constant background; `None` if nothing tells.
pub(crate) fn coverage_of(picture: &Picture, mask: Option<&Plane<f32>>) -> Option<Plane<f32>> {
    mask.or(picture.alpha.as_ref()).cloned().or_else(|| background_coverage(&picture.rgb))
}

/// Estimates the coverage (0..1) of the object in a picture whose background has exactly one value,
/// such as the black of a renderer; `None` when there is no such background.
///
/// The background is the most frequent value on the border of the picture, of which it must make up
/// a quarter at least, with every pixel of that value connected to those. A pixel next to the
/// background may be part background: its coverage is its contrast to the background over that of
/// the object's pixels nearby, at most 1.
fn background_coverage(rgb: &Plane<Vec3>) -> Option<Plane<f32>> {
    // Adding zero turns -0 into 0, which are equal but differ in their bits.
    let key = |at: (usize, usize)| (rgb[at] + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut counts = BTreeMap::new();
    for at in border(rgb.size()) {
        *counts.entry(key(at)).or_insert(0_usize) += 1;
    }
    let (&value, &count) = counts.iter().max_by_key(|&(_, count)| count)?;
    if 4 * count < border(rgb.size()).count() {
        return None;
    }
    let mut background = rgb.map(|_| false);
    let reached = flood(&mut background, border(rgb.size()), false, |at| key(at) == value);
    if reached == rgb.as_slice().len() {
        return None;
    }
    let base = Vec3::from_array(value.map(f32::from_bits));
    let near_background = Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
        neighbours((x, y), rgb.size(), true).any(|next| background[next])
    });
    Some(Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
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
        // NaN where no pixel nearby is inside, or those inside equal the background.
        if share.is_nan() { 1.0 } else { share.clamp(0.0, 1.0) }
    }))
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
    fn a_constant_background_is_told_from_the_ball() {
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
