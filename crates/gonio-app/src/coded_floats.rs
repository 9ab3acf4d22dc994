//! Detects 8-bit images that were stored as floats, for example by `imread(...) / 255`.

use std::collections::HashSet;

use glam::Vec3;
use gonio::picture::Plane;

/// Largest number of values of an 8-bit channel.
const CODES: usize = 256;
/// Smallest number of values in one channel; a drawing with few colours has fewer.
const MIN_VALUES: usize = 32;
/// Smallest number of pixels: fewer may have few values by chance.
const MIN_PIXELS: usize = 64 * 64;
/// Largest number of pixels whose values are counted. Flat images would take seconds otherwise.
const MAX_PIXELS: usize = 1 << 17;
/// Largest distance of a code from an integer, in codes.
const SLACK: f32 = 1e-3;

/// Returns a warning if the channels have as few values as those of an 8-bit image.
pub(crate) fn warning(name: &str, rgb: &Plane<Vec3>) -> Option<String> {
    let pixels = rgb.as_slice();
    if pixels.len() < MIN_PIXELS {
        return None;
    }
    let channels = [0, 1, 2].map(|channel| few_values(pixels, channel));
    let [Some(red), Some(green), Some(blue)] = channels else { return None };
    let values = || red.iter().chain(&green).chain(&blue).map(|bits| f32::from_bits(*bits));
    if red.len().max(green.len()).max(blue.len()) < MIN_VALUES {
        return None;
    }
    let largest = values().fold(0.0, f32::max);
    let scale = if largest > 1.0 { 1.0 } else { 255.0 };
    let are_codes = values().all(|value| {
        let code = scale * value;
        (0.0..=255.0 + SLACK).contains(&code) && (code - code.round()).abs() < SLACK
    });
    let what = if are_codes {
        "contains the codes of an 8-bit image as floats, so its values are not linear; pass the 8-bit image itself, or \
         better an HDR image"
    } else {
        "has at most 256 different values in each channel, like an 8-bit image, so its highlights are probably clipped; \
         use an HDR image for reliable results"
    };
    Some(format!("{name}: {what}"))
}

/// Returns the bits of the finite values of a channel, in evenly spaced pixels; `None` if there are
/// too many.
fn few_values(pixels: &[Vec3], channel: usize) -> Option<HashSet<u32>> {
    let mut values = HashSet::new();
    let step = pixels.len().div_ceil(MAX_PIXELS);
    for value in pixels.iter().step_by(step).map(|pixel| pixel[channel]).filter(|value| value.is_finite()) {
        values.insert(value.to_bits());
        if values.len() > CODES {
            return None;
        }
    }
    Some(values)
}

#[cfg(test)]
mod tests {
    use gonio::picture::srgb_decode;

    use super::*;

    fn image(value: impl Fn(usize) -> f32) -> Plane<Vec3> {
        Plane::from_fn(80, 80, |x, y| Vec3::new(value(x + y), value(2 * x), value(y)))
    }

    #[test]
    fn recognises_eight_bit_images_in_floats() {
        let codes = |scale: f32| warning("a.exr", &image(|at| scale * (at % 256) as f32)).unwrap();
        assert!([codes(1.0), codes(1.0 / 255.0)].iter().all(|text| text.contains("the codes of an 8-bit image")));
        let linear = warning("a.exr", &image(|at| srgb_decode((at % 256) as f32 / 255.0))).unwrap();
        assert!(linear.starts_with("a.exr: has at most 256 different values"), "{linear}");
    }

    #[test]
    fn accepts_other_images() {
        let hdr = Plane::from_fn(80, 80, |x, y| Vec3::splat((x as f32).hypot(y as f32)));
        assert_eq!(warning("a.exr", &hdr), None);
        assert_eq!(warning("a.exr", &image(|at| (at % 9) as f32)), None, "few colours");
        let small = Plane::from_fn(20, 20, |x, y| Vec3::splat((x + 20 * y) as f32 / 255.0));
        assert_eq!(warning("a.exr", &small), None, "few pixels");
    }
}
