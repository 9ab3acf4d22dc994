//! Photographs and lights for display, no larger than a screen needs.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::render::Exposure;

/// Reduces the picture to at most `side` pixels on its longer side and exposes it. Four fifths of
/// the pixels that are not black lie below one half. Returns linear display values.
pub fn preview(picture: &Picture, side: usize) -> Plane<Vec3> {
    let small = shrunk(&picture.rgb, side);
    let lit = |i: usize| small.as_slice()[i].max_element() > 0.0;
    let exposure = Exposure::by_quantile(&small, lit, 0.8, 0.5);
    small.map(|v| exposure.apply(*v))
}

/// Exposes a lat-long light for display. Three quarters of its texels lie below one half, so that
/// lamps are white.
pub fn light(radiance: &Plane<Vec3>) -> Plane<Vec3> {
    let exposure = Exposure::by_quantile(radiance, |_| true, 0.75, 0.5);
    radiance.map(|v| exposure.apply(*v))
}

/// Averages square blocks of pixels; values that are negative or not finite count as zero.
fn shrunk(rgb: &Plane<Vec3>, side: usize) -> Plane<Vec3> {
    let (width, height) = rgb.size();
    let step = width.max(height).div_ceil(side.max(1));
    let sound = |v: Vec3| if v.is_finite() { v.max(Vec3::ZERO) } else { Vec3::ZERO };
    Plane::from_fn(width.div_ceil(step), height.div_ceil(step), |x, y| {
        let columns = step * x..(step * (x + 1)).min(width);
        let rows = step * y..(step * (y + 1)).min(height);
        let count = columns.len() * rows.len();
        let sum: Vec3 = rows.flat_map(|y| columns.clone().map(move |x| (x, y))).map(|at| sound(rgb[at])).sum();
        sum / count as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_averaged_also_at_the_border() {
        let rgb = Plane::from_fn(5, 3, |x, _| if x == 0 { Vec3::NAN } else { Vec3::splat(x as f32) });
        let small = shrunk(&rgb, 3);
        assert_eq!(small.size(), (3, 2));
        assert_eq!([0, 1, 2].map(|x| small[(x, 1)].x), [0.5, 2.5, 4.0]);
        assert_eq!(shrunk(&rgb, 100).size(), (5, 3));
    }
}
