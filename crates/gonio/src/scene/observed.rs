//! The observed part of a picture: its clip level and the value of each point.

use glam::Vec3;

use super::SceneError;
use crate::picture::Plane;

/// Coverage below which a pixel mixes the object with its background.
pub(crate) const COVERED: f32 = 0.99;
/// Smallest number of pixels that share the largest value if a sensor or a file clips.
const CLIPPED_PIXELS: usize = 12;
/// Smallest share of the observed pixels that share it.
const CLIPPED_SHARE: f64 = 2e-4;

/// Value of a point in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ObservedColour {
    /// Radiance; single channels may be negative.
    Colour(Vec3),
    /// A value at or above the clip level.
    Clipped,
    /// No value: the point is not covered or outside the picture.
    Outside,
    /// No value: required pixels are negative, NaN, infinite or outliers.
    Faulty,
    /// A value of another colour than the object.
    OtherColour,
}

/// Checks that a mask, normal map or similar image has the size of the picture.
pub(crate) fn check_size(what: &'static str, size: (usize, usize), picture: (usize, usize)) -> Result<(), SceneError> {
    let ((width, height), (picture_width, picture_height)) = (size, picture);
    if size == picture {
        return Ok(());
    }
    Err(SceneError::Sizes { what, width, height, picture_width, picture_height })
}

/// Returns the value at or above which a channel counts as clipped.
///
/// This is the value `given`, or else the largest value of the region, if enough pixels have
/// exactly that value to exclude a coincidence.
pub(crate) fn clip_level(rgb: &Plane<Vec3>, region: &Plane<bool>, given: Option<f32>) -> Option<f32> {
    if given.is_some() {
        return given;
    }
    let (mut largest, mut count, mut pixels) = (0.0, 0_usize, 0_usize);
    for (colour, _) in rgb.as_slice().iter().zip(region.as_slice()).filter(|(_, region)| **region) {
        pixels += 1;
        let value = colour.max_element();
        if value > largest {
            (largest, count) = (value, 1);
        } else if value == largest {
            count += 1;
        }
    }
    let clips = largest > 0.0 && count >= CLIPPED_PIXELS && count as f64 >= CLIPPED_SHARE * pixels as f64;
    clips.then_some(largest)
}

/// Whether a colour has a clipped channel.
pub(crate) fn is_clipped(colour: Vec3, level: Option<f32>) -> bool {
    level.is_some_and(|level| colour.max_element() >= level)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 100 x 100 pixels of increasing values, of which the last `count` are 5.
    fn ramp(count: usize) -> Plane<Vec3> {
        let value = |i: usize| if i + count >= 10_000 { 5.0 } else { 1e-4 * i as f32 };
        Plane::from_fn(100, 100, |x, y| Vec3::new(0.1, value(100 * y + x), 0.2))
    }

    #[test]
    fn a_repeated_maximum_is_a_clip_level() {
        let everywhere = Plane::from_fn(100, 100, |_, _| true);
        for (count, want) in [(1, None), (11, None), (12, Some(5.0)), (900, Some(5.0))] {
            assert_eq!(clip_level(&ramp(count), &everywhere, None), want, "{count}");
        }
        assert_eq!(clip_level(&ramp(900), &everywhere, Some(0.5)), Some(0.5));
        let upper = Plane::from_fn(100, 100, |_, y| y < 50);
        assert_eq!(clip_level(&ramp(900), &upper, None), None);
        assert_eq!(clip_level(&ramp(0).map(|_| Vec3::ZERO), &everywhere, None), None);
    }

    #[test]
    fn a_coincidence_in_a_large_picture_is_not_a_clip_level() {
        let large = Plane::from_fn(400, 400, |x, y| {
            let i = 400 * y + x;
            Vec3::splat(if i < 20 { 9.0 } else { 1e-6 * i as f32 })
        });
        assert_eq!(clip_level(&large, &large.map(|_| true), None), None);
    }

    #[test]
    fn any_channel_clips_a_pixel() {
        let colour = Vec3::new(0.2, 0.3, 1.0);
        assert!(is_clipped(colour, Some(1.0)) && is_clipped(colour, Some(0.9)));
        assert!(!is_clipped(colour, Some(1.1)) && !is_clipped(colour, None));
    }
}
