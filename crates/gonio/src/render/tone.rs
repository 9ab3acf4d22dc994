//! Tone mapping of radiance for display.

use glam::Vec3;

use crate::picture::{Plane, luminance};

/// Factor that brings radiance to display range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure(pub f32);

impl Exposure {
    /// Exposure that puts the `quantile` (0..=1) of the luminance of the pixels that `keep` selects
    /// at `level`; one for a black picture.
    pub fn by_quantile(rgb: &Plane<Vec3>, keep: impl Fn(usize) -> bool, quantile: f32, level: f32) -> Self {
        let mut values: Vec<f32> =
            rgb.as_slice().iter().enumerate().filter(|(i, _)| keep(*i)).map(|(_, p)| luminance(*p)).collect();
        if values.is_empty() {
            return Self(1.0);
        }
        let at = (((values.len() - 1) as f32) * quantile.clamp(0.0, 1.0)) as usize;
        let (_, value, _) = values.select_nth_unstable_by(at, f32::total_cmp);
        Self(if *value > 0.0 { level / *value } else { 1.0 })
    }

    /// Linear display value of a radiance, in 0..1: linear up to a half, then a shoulder that
    /// preserves differences between highlights and their hue.
    pub fn apply(self, radiance: Vec3) -> Vec3 {
        let x = (radiance * self.0).max(Vec3::ZERO);
        let peak = x.max_element();
        if peak <= 0.5 {
            return x;
        }
        // 1 - 0.5 exp(-2 (peak - 0.5)): value and slope join at 0.5.
        let mapped = 1.0 - 0.5 * (-2.0 * (peak - 0.5)).exp();
        x * (mapped / peak)
    }
}

/// Median of each channel over the pixels that `keep` selects, scaled to luminance one: the colour
/// in which the paper shows a monochrome BRDF. White if there are none.
pub fn median_colour(rgb: &Plane<Vec3>, keep: impl Fn(usize) -> bool) -> Vec3 {
    let kept: Vec<Vec3> = rgb.as_slice().iter().enumerate().filter(|(i, _)| keep(*i)).map(|(_, p)| *p).collect();
    if kept.is_empty() {
        return Vec3::ONE;
    }
    let median = [0, 1, 2].map(|c| {
        let mut values: Vec<f32> = kept.iter().map(|p| p[c]).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    });
    let colour = Vec3::from_array(median);
    if luminance(colour) > 0.0 { colour / luminance(colour) } else { Vec3::ONE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_rises_and_stays_in_range() {
        let mut last = -1.0;
        for i in 0..1000 {
            let x = Exposure(1.0).apply(Vec3::splat(i as f32 * 0.01)).x;
            assert!(x >= last - 1e-6 && x <= 1.0);
            last = x;
        }
        assert!((Exposure(1.0).apply(Vec3::splat(0.5001)).x - 0.5001).abs() < 1e-4);
    }

    #[test]
    fn exposure_and_colour_are_those_of_the_median() {
        let plane = Plane::from_fn(10, 10, |x, y| Vec3::splat((10 * y + x) as f32));
        let exposure = Exposure::by_quantile(&plane, |_| true, 0.5, 0.5);
        assert!((exposure.0 - 0.5 / 49.0).abs() < 1e-6);
        assert_eq!(median_colour(&plane, |_| true), Vec3::ONE);
        assert_eq!(median_colour(&plane, |_| false), Vec3::ONE);
    }
}
