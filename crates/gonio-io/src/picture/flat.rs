//! Corrections of the black level and of vignetting.

use std::path::Path;

use glam::Vec3;
use gonio::picture::{Picture, Plane};

use super::Decoded;
use crate::Error;

/// Subtracts the black level of a linear integer picture: `(v - black) / (1 - black)` with `black`
/// as a fraction of the full scale in 0..1. Values below it become 0. The full scale stays 1.
///
/// # Panics
/// If `black` is not within its range.
pub fn subtract_black(decoded: &mut Decoded, black: f32) {
    assert!((0.0..1.0).contains(&black), "the black level must be in 0..1");
    for colour in decoded.picture.rgb.as_mut_slice() {
        *colour = ((*colour - black) / (1.0 - black)).max(Vec3::ZERO);
    }
}

/// Divides a picture by a flat field.
///
/// A flat field is a picture of an evenly lit surface by the same camera. Its channels are first
/// divided by their largest values, so the centre of the picture keeps about its brightness and the
/// corners become brighter.
///
/// Pixels with a channel at or above `clip` are clipped: all their channels get the returned level,
/// which exceeds the values of all other pixels.
///
/// # Errors
/// If the flat field (from the file `path`) has another size, or pixels that are zero, negative or
/// not finite.
pub fn divide_by_flat(
    picture: &mut Picture,
    flat: &Plane<Vec3>,
    path: &Path,
    clip: Option<f32>,
) -> Result<Option<f32>, Error> {
    let ((w, h), (fw, fh)) = (picture.rgb.size(), flat.size());
    if (w, h) != (fw, fh) {
        let problem = format!("is a flat field of {fw}x{fh} pixels, but the photograph has {w}x{h}");
        return Err(Error::invalid(path, problem, "use a flat field of the same size"));
    }
    let bad = flat.as_slice().iter().filter(|v| !(v.is_finite() && v.min_element() > 0.0)).count();
    if bad > 0 {
        let problem = format!("is a flat field with {bad} pixels that are black or not finite");
        return Err(Error::invalid(path, problem, "use an image of an evenly lit surface"));
    }
    let largest = flat.as_slice().iter().fold(Vec3::ZERO, |a, v| a.max(*v));
    let smallest = flat.as_slice().iter().fold(Vec3::INFINITY, |a, v| a.min(*v / largest)).min_element();
    let level = clip.map(|clip| clip / smallest);
    for (colour, flat) in picture.rgb.as_mut_slice().iter_mut().zip(flat.as_slice()) {
        let clipped = clip.is_some_and(|clip| colour.max_element() >= clip);
        *colour = match level {
            Some(level) if clipped => Vec3::splat(level),
            _ => *colour * largest / *flat,
        };
    }
    Ok(level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    #[test]
    fn vignetting_is_removed_and_clipped_pixels_stay_clipped() {
        let flat = Plane::from_fn(20, 10, |x, y| Vec3::new(1.0, 0.5, 2.0) / (1.0 + 0.01 * (x * x + y * y) as f32));
        let rgb = flat.map(|v| 0.3 * *v);
        let mut picture = Picture { rgb, alpha: None };
        picture.rgb[(19, 9)] = Vec3::new(0.2, 1.0, 0.1);
        let level = divide_by_flat(&mut picture, &flat, Path::new("f"), Some(1.0)).unwrap().unwrap();
        assert!((picture.rgb[(17, 3)] - picture.rgb[(0, 0)]).length() < 1e-6);
        assert_eq!(picture.rgb[(19, 9)], Vec3::splat(level));
        assert!(level > 5.0);
    }

    #[test]
    fn invalid_flat_fields_are_rejected() {
        let mut picture = Picture { rgb: Plane::from_fn(4, 4, |_, _| Vec3::ONE), alpha: None };
        for flat in [Plane::from_fn(4, 3, |_, _| Vec3::ONE), Plane::from_fn(4, 4, |x, _| Vec3::splat(x as f32))] {
            let error = divide_by_flat(&mut picture, &flat, Path::new("f"), None).unwrap_err();
            assert_eq!(error.kind(), Kind::Invalid);
        }
    }
}
