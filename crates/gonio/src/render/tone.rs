//! Tone mapping of radiance for display.

use glam::Vec3;

use crate::picture::{Plane, luminance};
use crate::statistics::median;

/// Display value up to which radiance is shown unchanged.
const STRAIGHT: f32 = 0.76;
/// Rate at which colours above `STRAIGHT` fade to white.
const FADE: f32 = 0.15;

/// Brightness at which an object is shown that is too dark or too bright at exposure one.
const OWN_LEVEL: f32 = 0.6;
/// Range of brightness in which an object is shown at exposure one.
const OWN_RANGE: (f32, f32) = (0.03, 1.5);

/// Factor that maps radiance to the display range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure(pub f32);

impl Exposure {
    /// Returns the exposure that maps a quantile of the brightness to `level`.
    ///
    /// The `quantile` (0..=1) is over the pixels that `keep` selects. The brightness of a pixel is
    /// its luminance; saturated colours have a larger one, so that their largest channel does not
    /// fade. Returns one for a black picture.
    pub fn by_quantile(rgb: &Plane<Vec3>, keep: impl Fn(usize) -> bool, quantile: f32, level: f32) -> Self {
        let kept = rgb.as_slice().iter().enumerate().filter(|(i, _)| keep(*i));
        let mut values: Vec<f32> = kept.map(|(_, p)| brightness(*p, level)).collect();
        if values.is_empty() {
            return Self(1.0);
        }
        let at = (((values.len() - 1) as f32) * quantile.clamp(0.0, 1.0)) as usize;
        let (_, value, _) = values.select_nth_unstable_by(at, f32::total_cmp);
        Self(if *value > 0.0 { level / *value } else { 1.0 })
    }

    /// Returns one if the object is neither black nor white at this exposure, else maps it to 0.6.
    ///
    /// The exposure is one if the 90 % quantile of the brightness of the pixels that `keep` selects
    /// is between 0.03 and 1.5. Otherwise it maps that quantile to 0.6.
    pub fn own(rgb: &Plane<Vec3>, keep: impl Fn(usize) -> bool) -> Self {
        let fitted = Self::by_quantile(rgb, keep, 0.9, OWN_LEVEL);
        let quantile = OWN_LEVEL / fitted.0;
        if (OWN_RANGE.0..=OWN_RANGE.1).contains(&quantile) { Self(1.0) } else { fitted }
    }

    /// Returns the exposure that maps the mean brightness to `level`.
    ///
    /// The mean is over the pixels that `keep` selects. Their brightness is limited to its 90 %
    /// quantile, so that small, bright highlights do not darken the rest. Returns one for a black
    /// picture.
    pub fn by_mean(rgb: &Plane<Vec3>, keep: impl Fn(usize) -> bool, level: f32) -> Self {
        let top = level / Self::by_quantile(rgb, &keep, 0.9, level).0;
        let kept = rgb.as_slice().iter().enumerate().filter(|(i, _)| keep(*i));
        let add = |(sum, n), (_, p): (usize, &Vec3)| (sum + f64::from(brightness(*p, level).min(top)), n + 1.0);
        let (sum, count) = kept.fold((0.0, 0.0), add);
        Self(if sum > 0.0 { level * (count / sum) as f32 } else { 1.0 })
    }

    /// Returns the linear display value of a radiance, in 0..1.
    ///
    /// Values up to 0.76 are unchanged, so that colours are those of the material. Larger ones
    /// approach white slowly, keep their order, and fade only if they are several times too bright
    /// (the curve of the Khronos PBR Neutral tone mapper, without its toe).
    pub fn apply(self, radiance: Vec3) -> Vec3 {
        let x = (radiance * self.0).max(Vec3::ZERO);
        let peak = x.max_element();
        if peak <= STRAIGHT {
            return x;
        }
        let rest = 1.0 - STRAIGHT;
        let mapped = 1.0 - rest * rest / (peak + rest - STRAIGHT);
        let fade = 1.0 - 1.0 / (FADE * (peak - mapped) + 1.0);
        (x * (mapped / peak)).lerp(Vec3::splat(mapped), fade)
    }
}

/// Returns the brightness of a pixel to be shown at `level`.
///
/// The brightness is the luminance or, if the largest channel would exceed the straight part of the
/// curve, that channel scaled to the end of that part.
fn brightness(rgb: Vec3, level: f32) -> f32 {
    luminance(rgb).max(rgb.max_element() * level / STRAIGHT)
}

/// Returns the median of each channel over selected pixels, scaled to luminance one.
///
/// The paper displays a monochrome BRDF in this colour. Returns white if `keep` selects no pixels
/// or the median is black.
pub fn median_colour(rgb: &Plane<Vec3>, keep: impl Fn(usize) -> bool) -> Vec3 {
    let kept: Vec<Vec3> = rgb.as_slice().iter().enumerate().filter(|(i, _)| keep(*i)).map(|(_, p)| *p).collect();
    if kept.is_empty() {
        return Vec3::ONE;
    }
    let colour = Vec3::from_array([0, 1, 2].map(|c| median(kept.iter().map(|p| p[c])).unwrap_or(1.0)));
    if luminance(colour) > 0.0 { colour / luminance(colour) } else { Vec3::ONE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_rises_and_stays_in_range() {
        let mut last = -1.0;
        for i in 0..1000 {
            let x = Exposure(1.0).apply(Vec3::splat(i as f32 * 0.01)).x;
            assert!(x >= last - 1e-6 && x <= 1.0);
            last = x;
        }
        assert!((Exposure(1.0).apply(Vec3::splat(0.5001)).x - 0.5001).abs() < 1e-4);
    }

    #[test]
    fn colours_fade_only_if_much_too_bright() {
        let orange = Vec3::new(1.0, 0.4, 0.1);
        assert_eq!(Exposure(0.7).apply(orange), 0.7 * orange);
        let [once, often] = [1.5, 40.0].map(|exposure| Exposure(exposure).apply(orange));
        assert!(once.y / once.x < 0.5 && often.y / often.x > 0.7, "{once} {often}");
    }

    #[test]
    fn saturated_colours_do_not_fade() {
        let red = Plane::from_fn(4, 4, |_, _| Vec3::new(3.0, 0.1, 0.1));
        for exposure in [Exposure::by_quantile(&red, |_| true, 0.9, 0.6), Exposure::by_mean(&red, |_| true, 0.3)] {
            let shown = exposure.apply(red[(0, 0)]);
            assert!((shown.y / shown.x - 0.1 / 3.0).abs() < 1e-3 && shown.x > 0.7, "{shown}");
        }
    }

    #[test]
    fn own_exposure_changes_only_black_or_white_objects() {
        let ball = |value: f32| Plane::from_fn(4, 4, |_, _| Vec3::splat(value));
        for value in [0.05, 0.6, 1.4] {
            assert_eq!(Exposure::own(&ball(value), |_| true), Exposure(1.0));
        }
        for value in [1e-3, 40.0] {
            assert!((Exposure::own(&ball(value), |_| true).0 * value - 0.6).abs() < 1e-4);
        }
    }

    #[test]
    fn exposures_and_median_colour_match_known_values() {
        let plane = Plane::from_fn(10, 10, |x, y| Vec3::splat((10 * y + x) as f32));
        let exposure = Exposure::by_quantile(&plane, |_| true, 0.5, 0.5);
        assert!((exposure.0 - 0.5 / 49.0).abs() < 1e-6);
        let lamp = Plane::from_fn(10, 10, |x, y| Vec3::splat(if (x, y) == (3, 3) { 1e6 } else { 2.0 }));
        assert!((Exposure::by_mean(&lamp, |_| true, 0.5).0 - 0.25).abs() < 1e-6);
        assert_eq!(median_colour(&plane, |_| true), Vec3::ONE);
        assert_eq!(median_colour(&plane, |_| false), Vec3::ONE);
    }
}
