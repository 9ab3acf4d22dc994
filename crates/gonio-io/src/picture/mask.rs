//! Masks: the fraction of each pixel that belongs to the object.

use std::path::Path;

use gonio::picture::{Picture, Plane};

use super::{Encoding, Format, ReadOptions, decode_unconverted, groups, read_channels};
use crate::{Error, guard};

/// Largest distance of a float value outside 0..=1 that counts as rounding.
const ROUNDING: f32 = 1e-3;

/// Reads a mask from a picture of any supported format: 1 inside the object, 0 outside.
///
/// The mask is the grey value, or the largest channel of coloured pixels, without sRGB decoding. If
/// the file has an alpha channel that is not 1 everywhere, the content determines its use. A
/// picture of constant or coloured content is a cut-out, and its alpha is the mask. A grey picture
/// is multiplied by its alpha. In an OpenEXR file without colour, the mask is the channel `A`, or
/// else the only channel. Masks of two values, such as 0 and 1 or 0 and 128 in 8 bits, are scaled
/// to 0 and 1.
///
/// # Errors
/// Errors of [`read`](super::read), and if values are not numbers or lie outside 0..=1.
pub fn read_mask(path: impl AsRef<Path>) -> Result<Plane<f32>, Error> {
    let path = path.as_ref();
    let options = ReadOptions { linear: true, ..Default::default() };
    let bytes = guard::read_whole(path, options.max_bytes())?;
    decode_mask(path, &bytes, &options)
}

fn decode_mask(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Plane<f32>, Error> {
    let picture = match decode_unconverted(path, bytes, options) {
        Ok(decoded) => {
            // OpenEXR stores colour multiplied by alpha; dividing restores the colour of a cut-out.
            let associated = decoded.encoding == Encoding::LinearFloat;
            return unit_range(path, mask_of(decoded.picture, associated));
        }
        Err(error) if Format::of(path, bytes)? == Format::Exr => single_channel(path, bytes, options, error)?,
        Err(error) => return Err(error),
    };
    unit_range(path, picture)
}

/// Reads the alpha channel or the only channel of an OpenEXR file without colour. Returns `error`
/// if the file has neither.
fn single_channel(path: &Path, bytes: &[u8], options: &ReadOptions, error: Error) -> Result<Plane<f32>, Error> {
    let (width, height, mut planes) = read_channels(path, bytes, options, |headers| {
        let only = |layer: usize| super::Selection { layer, channels: vec![0] };
        let groups = groups(headers);
        let alpha = groups.iter().find_map(|g| g.select(&["a"]));
        let single = (headers.len() == 1 && headers[0].channels.list.len() == 1).then(|| only(0));
        alpha.or(single).ok_or(error)
    })?;
    let plane = planes.pop().ok_or_else(|| Error::damaged(path, "has no channels"))?;
    Ok(Plane::from_vec(width, height, plane))
}

fn mask_of(picture: Picture, associated: bool) -> Plane<f32> {
    let Picture { rgb, alpha } = picture;
    let grey = rgb.map(|v| v.max_element());
    let Some(alpha) = alpha.filter(|a| a.as_slice().iter().any(|&a| a != 1.0)) else { return grey };
    // Only visible pixels show whether the content is constant.
    let visible = || rgb.as_slice().iter().zip(alpha.as_slice()).filter(|(_, a)| **a > 0.0);
    let colour = |(v, a): (&glam::Vec3, &f32)| if associated { *v / *a } else { *v };
    let first = visible().next().map(colour);
    let constant = visible().map(colour).all(|v| first.is_some_and(|f| (v - f).abs().max_element() < 1e-3));
    let coloured = rgb.as_slice().iter().any(|v| v.max_element() - v.min_element() > 1e-3);
    if constant || coloured {
        return alpha;
    }
    if associated {
        return grey;
    }
    let product = grey.as_slice().iter().zip(alpha.as_slice()).map(|(g, a)| g * a).collect();
    Plane::from_vec(grey.width(), grey.height(), product)
}

/// Clamps values outside 0..=1 within rounding and rejects others.
fn unit_range(path: &Path, mask: Plane<f32>) -> Result<Plane<f32>, Error> {
    let odd = |v: f32| !(-ROUNDING..=1.0 + ROUNDING).contains(&v);
    if let Some(&v) = mask.as_slice().iter().find(|&&v| odd(v)) {
        let problem = format!("contains the value {v}, which is invalid in a mask");
        return Err(Error::invalid(path, problem, "use values from 0 (outside) to 1 (object)"));
    }
    // Masks of two values are labels, for example 0 and 1, or 0 and 128, in 8 bits.
    let largest = mask.as_slice().iter().copied().fold(0.0, f32::max);
    let (outside, inside) = (|v: f32| v <= 0.0, |v: f32| v == largest);
    let has_two = mask.as_slice().iter().any(|&v| outside(v)) && largest > 0.0;
    let are_labels = has_two && mask.as_slice().iter().all(|&v| outside(v) || inside(v));
    let scale = if are_labels { 1.0 / largest } else { 1.0 };
    Ok(mask.map(|v| (scale * v).clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn check(rgb: [Vec3; 2], alpha: Option<[f32; 2]>, associated: bool, expected: [f32; 2]) {
        let alpha = alpha.map(|a| Plane::from_vec(2, 1, a.to_vec()));
        let got = mask_of(Picture { rgb: Plane::from_vec(2, 1, rgb.to_vec()), alpha }, associated);
        assert_eq!(got.as_slice(), expected);
    }

    #[test]
    fn two_values_are_labels() {
        let scaled = |values: [f32; 3]| {
            unit_range(Path::new("m.png"), Plane::from_vec(3, 1, values.to_vec())).unwrap().as_slice().to_vec()
        };
        assert_eq!(scaled([0.0, 1.0 / 255.0, 0.0]), [0.0, 1.0, 0.0]);
        assert_eq!(scaled([128.0 / 255.0, 0.0, 128.0 / 255.0]), [1.0, 0.0, 1.0]);
        // Soft edges are kept.
        assert_eq!(scaled([0.0, 0.25, 0.5]), [0.0, 0.25, 0.5]);
        assert_eq!(scaled([0.0; 3]), [0.0; 3]);
    }

    #[test]
    fn masks_are_grey_values_or_alpha() {
        let (black, white, red) = (Vec3::ZERO, Vec3::ONE, Vec3::X);
        check([black, white], None, false, [0.0, 1.0]);
        check([black, red], None, false, [0.0, 1.0]);
        check([black, white], Some([1.0, 1.0]), false, [0.0, 1.0]);
        check([black, black], Some([0.25, 1.0]), false, [0.25, 1.0]);
        check([black, white], Some([0.0, 1.0]), false, [0.0, 1.0]);
        check([white, black], Some([0.0, 1.0]), false, [0.0, 1.0]);
        check([white * 0.5, white], Some([0.5, 0.9]), false, [0.25, 0.9]);
        check([white * 0.5, white], Some([0.5, 1.0]), true, [0.5, 1.0]);
        check([red, white], Some([0.0, 0.5]), false, [0.0, 0.5]);
    }

    #[test]
    fn values_are_linear_codes() {
        let image = image::GrayImage::from_vec(3, 1, vec![0, 51, 255]).unwrap();
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        std::fs::write(&path, bytes.into_inner()).unwrap();
        assert_eq!(read_mask(&path).unwrap().as_slice(), [0.0, 0.2, 1.0]);
    }

    #[test]
    fn a_single_channel_is_a_mask_and_invalid_values_are_rejected() {
        use exr::prelude::*;
        let encode = |name: &str, value: f32| {
            let list = [AnyChannel::new(name, FlatSamples::F32(vec![value; 4]))];
            let mut bytes = std::io::Cursor::new(Vec::new());
            let image = Image::from_channels((2, 2), AnyChannels::sort(list.into_iter().collect()));
            image.write().to_buffered(&mut bytes).unwrap();
            decode_mask(Path::new("m.exr"), &bytes.into_inner(), &ReadOptions::default())
        };
        for name in ["A", "mask", "Y"] {
            assert_eq!(encode(name, 0.5).unwrap().as_slice(), [0.5; 4]);
        }
        assert_eq!(encode("mask", 255.0).unwrap_err().kind(), crate::Kind::Invalid);
        assert_eq!(encode("mask", f32::NAN).unwrap_err().kind(), crate::Kind::Invalid);
    }
}
