//! Detects 8-bit images that were stored as floats, for example by `imread(...) / 255`.

use std::collections::HashSet;

use glam::Vec3;
use gonio::picture::Plane;

/// Largest number of values of an 8-bit channel.
const CODES: usize = 256;
/// Smallest number of values in one channel; a drawing with few colours has fewer.
const MIN_VALUES: usize = 32;
/// Smallest number of pixels that differ from the pixel before. With fewer, few values may be
/// chance.
const MIN_CHANGES: usize = 64 * 64;
/// Largest distance of a code from an integer, in codes.
const SLACK: f32 = 1e-3;

/// Returns a warning if the channels have as few values as those of an 8-bit image.
pub(crate) fn warning(name: &str, rgb: &Plane<Vec3>) -> Option<String> {
    let channels = [0, 1, 2].map(|channel| few_values(rgb.as_slice(), channel));
    let [Some(red), Some(green), Some(blue)] = channels else { return None };
    let all = [&red, &green, &blue];
    let most = |count: fn(&FewValues) -> usize| all.iter().map(|channel| count(channel)).max().unwrap_or(0);
    if most(|channel| channel.bits.len()) < MIN_VALUES || most(|channel| channel.changes) < MIN_CHANGES {
        return None;
    }
    let values = || all.iter().flat_map(|channel| &channel.bits).map(|bits| f32::from_bits(*bits));
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

/// The values of a channel with at most [`CODES`] values.
struct FewValues {
    bits: HashSet<u32>,
    /// Number of pixels whose value differs from that of the pixel before.
    changes: usize,
}

/// Returns the finite values of a channel; `None` if there are too many.
fn few_values(pixels: &[Vec3], channel: usize) -> Option<FewValues> {
    let mut found = FewValues { bits: HashSet::new(), changes: 0 };
    let mut before = None;
    for value in pixels.iter().map(|pixel| pixel[channel]).filter(|value| value.is_finite()) {
        // Flat images would take seconds otherwise.
        if before.replace(value.to_bits()) == Some(value.to_bits()) {
            continue;
        }
        found.changes += 1;
        found.bits.insert(value.to_bits());
        if found.bits.len() > CODES {
            return None;
        }
    }
    Some(found)
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
        let object = |x: usize, y: usize| if x.max(y) < 14 { (x + 14 * y) as f32 / 255.0 } else { 0.5 };
        let flat = Plane::from_fn(900, 900, |x, y| Vec3::splat(object(x, y)));
        assert_eq!(warning("a.exr", &flat), None, "a small object before a flat background");
    }
}
