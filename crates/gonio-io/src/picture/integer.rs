//! PNG, JPEG and TIFF: integers, sRGB-coded or linear, and the float variants of TIFF.

use std::io::Cursor;
use std::path::Path;

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use image::error::ImageError;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::curve::Curve;
use super::embedded::Embedded;
use super::space::Conversion;
use super::{Decoded, Encoding, ReadOptions, jpeg, tiff};
use crate::{Error, guard};

pub(super) fn decode(path: &Path, bytes: &[u8], format: ImageFormat, options: &ReadOptions) -> Result<Decoded, Error> {
    let Loaded { mut image, samples, orientation, embedded } = load(path, bytes, format, options)?;
    image.apply_orientation(orientation);
    unpack(path, &image, samples, embedded, options)
}

/// A picture as stored in the file.
pub(super) struct Loaded {
    /// Codes, or floats. For [`Samples`] of 32 bits and more, floats hold codes divided by the
    /// largest one.
    pub(super) image: DynamicImage,
    pub(super) samples: Samples,
    pub(super) orientation: Orientation,
    pub(super) embedded: Embedded,
}

/// Samples of a file; the picture in memory can have others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Samples {
    /// Bits of an integer; 32 for floats.
    pub(super) bits: u8,
    pub(super) is_float: bool,
    /// Whether the file has one channel, or one and alpha.
    pub(super) is_grey: bool,
}

impl Samples {
    fn of(image: &DynamicImage) -> Self {
        let bits = match image.color().bytes_per_pixel() / image.color().channel_count() {
            1 => 8,
            2 => 16,
            _ => 32,
        };
        Self { bits, is_float: bits == 32, is_grey: !image.color().has_color() }
    }
}

/// Loads the picture as stored in the file, its orientation and its colour information.
pub(super) fn load(path: &Path, bytes: &[u8], format: ImageFormat, options: &ReadOptions) -> Result<Loaded, Error> {
    let name = format!("{format:?}").to_uppercase();
    if format == ImageFormat::Jpeg {
        jpeg::check_complete(path, bytes)?;
    }
    guard::catching(path, &name, || {
        let failed = |e| explain(path, e);
        let wide = if format == ImageFormat::Tiff { tiff::load(path, bytes, options)? } else { None };
        if let Some((image, samples, orientation)) = wide {
            let embedded = Embedded::of_tiff(path, bytes)?;
            return Ok(Loaded { image, samples, orientation, embedded });
        }
        let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
        let mut limits = Limits::no_limits();
        // The picture (at most 16 bytes per pixel), the same amount for the decoder, and its
        // tables.
        limits.max_alloc = Some(options.max_pixels.saturating_mul(32).saturating_add(1 << 24));
        reader.limits(limits);
        let mut decoder = reader.into_decoder().map_err(failed)?;
        let (width, height) = decoder.dimensions();
        options.check_size(path, width.into(), height.into())?;
        // Unreadable metadata must not prevent reading the picture.
        let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
        let embedded = Embedded::of(path, bytes, format, &mut decoder)?;
        let image = DynamicImage::from_decoder(decoder).map_err(failed)?;
        Ok(Loaded { samples: Samples::of(&image), image, orientation, embedded })
    })
}

fn unpack(
    path: &Path,
    image: &DynamicImage,
    Samples { bits, is_float, is_grey }: Samples,
    embedded: Embedded,
    options: &ReadOptions,
) -> Result<Decoded, Error> {
    let channels = usize::from(image.color().channel_count());
    let size = (image.width() as usize, image.height() as usize);
    let Embedded { curve, stated, narrow } = embedded;
    let of_space = || options.colour_space.map_or(Curve::Srgb, Curve::of_space);
    let curve = match curve {
        _ if options.linear => Curve::Linear,
        Some(curve) => curve,
        // Float samples are linear unless the file states another curve.
        None if is_float => Curve::Linear,
        None => of_space(),
    };
    // ITU-T H.273, equation 20: in the narrow range of 8 bits 16 is black and 235 is white.
    let steps = if bits == 8 { 255.0 } else { 65535.0 / 256.0 };
    let value = |channel: usize, code: f32| {
        let code = if narrow && !is_float { ((steps * code - 16.0) / 219.0).max(0.0) } else { code };
        curve.decode(channel, code)
    };
    let eight = |samples: &[u8]| {
        let table = tables(u8::MAX.into(), &value);
        picture(size, samples, channels, |c, v| table[c][usize::from(v)], |v| f32::from(v) / 255.0)
    };
    let sixteen = |samples: &[u16]| {
        let table = tables(u16::MAX.into(), &value);
        picture(size, samples, channels, |c, v| table[c][usize::from(v)], |v| f32::from(v) / 65535.0)
    };
    let float = |samples: &[f32]| picture(size, samples, channels, value, |v| v);
    let picture = match image {
        DynamicImage::ImageLuma8(i) => eight(i),
        DynamicImage::ImageLumaA8(i) => eight(i),
        DynamicImage::ImageRgb8(i) => eight(i),
        DynamicImage::ImageRgba8(i) => eight(i),
        DynamicImage::ImageLuma16(i) => sixteen(i),
        DynamicImage::ImageLumaA16(i) => sixteen(i),
        DynamicImage::ImageRgb16(i) => sixteen(i),
        DynamicImage::ImageRgba16(i) => sixteen(i),
        DynamicImage::ImageRgb32F(i) => float(i),
        DynamicImage::ImageRgba32F(i) => float(i),
        other => {
            let problem = format!("has samples of type {:?}", other.color());
            return Err(Error::unsupported(path, problem, "write 8-bit, 16-bit or 32-bit float samples"));
        }
    };
    let is_table = matches!(stated.space, Some((Conversion::Table(_), ..)));
    let encoding = match (bits, &curve) {
        (_, Curve::Linear) if is_table && !options.linear => Encoding::Coded { bits },
        (_, Curve::Linear) if is_float => Encoding::LinearFloat,
        (bits, Curve::Linear) => Encoding::Linear { bits },
        (bits, Curve::Srgb) => Encoding::Srgb { bits },
        (bits, Curve::Other(_)) => Encoding::Coded { bits },
    };
    // The curves of a profile may end just below 1.
    let white = (0..3).map(|channel| value(channel, 1.0)).fold(f32::INFINITY, f32::min);
    let linear = options.linear.then_some("linear values");
    let (conversion, input) = stated.settle_values(is_grey, linear, options.colour_space);
    let full_scale = (!is_float).then_some(white);
    Ok(Decoded { picture, encoding, full_scale, layer: None, input, conversion })
}

/// Returns the linear value of each code in each channel.
fn tables(max: u32, value: &dyn Fn(usize, f32) -> f32) -> [Vec<f32>; 3] {
    [0, 1, 2].map(|channel| (0..=max).map(|v| value(channel, v as f32 / max as f32)).collect())
}

/// Converts samples with one or three colour channels. If the number of channels is even, the last
/// one is alpha.
fn picture<T: Copy>(
    (width, height): (usize, usize),
    samples: &[T],
    channels: usize,
    colour: impl Fn(usize, T) -> f32,
    coverage: impl Fn(T) -> f32,
) -> Picture {
    let pixels = samples.chunks_exact(channels);
    let rgb = match channels {
        1 | 2 => pixels.clone().map(|p| Vec3::splat(colour(0, p[0]))).collect(),
        _ => pixels.clone().map(|p| Vec3::new(colour(0, p[0]), colour(1, p[1]), colour(2, p[2]))).collect(),
    };
    let alpha = channels.is_multiple_of(2).then(|| pixels.map(|p| coverage(p[channels - 1])).collect());
    Picture {
        rgb: Plane::from_vec(width, height, rgb),
        alpha: alpha.map(|alpha| Plane::from_vec(width, height, alpha)),
    }
}

/// Sorts the errors of the `image` crate by cause. Its readers read from memory only, so even an
/// I/O error means that the file is truncated.
pub(super) fn explain(path: &Path, error: ImageError) -> Error {
    match error {
        ImageError::Unsupported(e) => Error::unsupported(path, e.to_string(), "write 8- or 16-bit RGB, or EXR"),
        ImageError::Limits(e) => Error::limits(path, e.to_string(), "scale the image down"),
        e => Error::damaged(path, format!("is truncated or damaged ({e})")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayAlphaImage, ImageBuffer, Rgb, RgbImage};

    fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.into().write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    fn read(bytes: &[u8], linear: bool) -> Decoded {
        super::super::decode(Path::new("t"), bytes, &ReadOptions { linear, ..Default::default() }).unwrap()
    }

    #[test]
    fn eight_bits_are_srgb_unless_linear_is_set() {
        let bytes = encoded(RgbImage::from_pixel(3, 2, Rgb([255, 128, 0])), ImageFormat::Png);
        let srgb = read(&bytes, false);
        assert_eq!(srgb.encoding, Encoding::Srgb { bits: 8 });
        assert_eq!(srgb.full_scale, Some(1.0));
        assert!((srgb.picture.rgb[(1, 1)] - Vec3::new(1.0, 0.2158605, 0.0)).length() < 1e-6);
        let linear = read(&bytes, true);
        assert_eq!(linear.encoding, Encoding::Linear { bits: 8 });
        assert_eq!(linear.picture.rgb[(1, 1)], Vec3::new(1.0, 128.0 / 255.0, 0.0));
    }

    #[test]
    fn reads_sixteen_bits_and_grey_with_alpha() {
        let image = ImageBuffer::from_pixel(2, 2, Rgb([65535_u16, 1, 0]));
        for format in [ImageFormat::Png, ImageFormat::Tiff] {
            let got = read(&encoded(image.clone(), format), true);
            assert_eq!(got.encoding, Encoding::Linear { bits: 16 });
            assert_eq!(got.picture.rgb[(0, 0)], Vec3::new(1.0, 1.0 / 65535.0, 0.0));
        }
        let image = GrayAlphaImage::from_pixel(2, 2, image::LumaA([255, 51]));
        let got = read(&encoded(image, ImageFormat::Png), false).picture;
        assert_eq!((got.rgb[(0, 0)], got.alpha.unwrap()[(1, 1)]), (Vec3::ONE, 0.2));
    }

    #[test]
    fn float_tiff_is_linear() {
        let image = ImageBuffer::from_pixel(2, 2, Rgb([1e6_f32, -1.0, 0.5]));
        let got = read(&encoded(image, ImageFormat::Tiff), false);
        assert_eq!((got.encoding, got.full_scale), (Encoding::LinearFloat, None));
        assert_eq!(got.picture.rgb[(0, 0)], Vec3::new(1e6, -1.0, 0.5));
    }

    #[test]
    fn truncated_jpeg_files_are_rejected() {
        let bytes = encoded(RgbImage::from_pixel(33, 20, Rgb([200, 200, 200])), ImageFormat::Jpeg);
        let got = read(&bytes, true).picture.rgb;
        assert!((got[(20, 10)] - Vec3::splat(200.0 / 255.0)).length() < 0.02);
        for cut in (3..bytes.len()).step_by(7) {
            let got = super::super::decode(Path::new("t"), &bytes[..cut], &ReadOptions::default());
            assert_eq!(got.unwrap_err().kind(), crate::Kind::Damaged, "{cut}");
        }
    }

    #[test]
    fn the_pixel_limit_is_enforced() {
        let bytes = encoded(RgbImage::new(100, 100), ImageFormat::Png);
        let options = ReadOptions { max_pixels: 9999, ..Default::default() };
        let error = super::super::decode(Path::new("t"), &bytes, &options).unwrap_err();
        assert_eq!(error.kind(), crate::Kind::Limits);
    }
}
