//! Encoding and writing of pictures.
//!
//! Every file is encoded in memory first and then written [atomically](crate::atomic).

use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::sync::LazyLock;

use ::exr::meta::attribute::{AttributeValue, Chromaticities, Text};
use ::exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, LineOrder, Vec2, WritableImage,
};
use glam::Vec3;
use gonio::picture::{Plane, srgb_encode};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::{exr, pfm, radiance};
use crate::colour_space::{ColourSpace, Primaries};

/// Contents of an OpenEXR file in addition to its colours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExrOptions<'a> {
    /// Coverage, of the size of the picture; colour must already be multiplied by it.
    pub alpha: Option<&'a Plane<f32>>,
    /// Clip level, positive and finite, stored in the attribute `clipLevel`.
    /// [`read`](super::read) returns it as [`Decoded::full_scale`](super::Decoded::full_scale).
    pub clip_level: Option<f32>,
    /// Space of the colours: the attribute `chromaticities`. Readers assume Rec. 709 for files
    /// without it.
    pub space: Option<ColourSpace>,
}

/// Encodes OpenEXR with 32-bit float channels `R G B` and, with alpha, `A`. Compression is
/// lossless. All float values are preserved, including NaN. Colour must already be multiplied by
/// alpha.
///
/// # Panics
/// If the picture has no pixels, or alpha has another size.
pub fn encode_exr(rgb: &Plane<Vec3>, alpha: Option<&Plane<f32>>) -> Vec<u8> {
    encode_exr_with(rgb, &ExrOptions { alpha, ..ExrOptions::default() })
}

/// Encodes linear Rec. 709 colours as an OpenEXR file in another colour space, which its attribute
/// `chromaticities` states. Colours outside the gamut of the space get negative channels.
///
/// # Panics
/// Like [`encode_exr`].
pub fn encode_exr_in(rgb: &Plane<Vec3>, alpha: Option<&Plane<f32>>, space: ColourSpace) -> Vec<u8> {
    let options = ExrOptions { alpha, clip_level: None, space: Some(space) };
    match space {
        ColourSpace::Rec709 => encode_exr_with(rgb, &options),
        _ => {
            let matrix = space.from_rec709().as_mat3();
            encode_exr_with(&rgb.map(|v| matrix * *v), &options)
        }
    }
}

/// Encodes like [`encode_exr`], with the attributes of the options. The colours are not converted.
///
/// # Panics
/// If the picture has no pixels, alpha has another size, or the clip level is not positive and
/// finite.
pub fn encode_exr_with(rgb: &Plane<Vec3>, options: &ExrOptions<'_>) -> Vec<u8> {
    write_exr(rgb, options, &[])
}

/// Encodes OpenEXR with further pictures as layers: the channels `NAME.R`, `NAME.G` and `NAME.B`.
///
/// `rgb` and the layers are in linear Rec. 709. Readers that do not know layers read `rgb`.
///
/// # Panics
/// If the picture has no pixels, or alpha or a layer has another size.
pub fn encode_exr_layers(rgb: &Plane<Vec3>, alpha: Option<&Plane<f32>>, layers: &[(&str, &Plane<Vec3>)]) -> Vec<u8> {
    let options = ExrOptions { alpha, clip_level: None, space: Some(ColourSpace::Rec709) };
    write_exr(rgb, &options, layers)
}

fn write_exr(rgb: &Plane<Vec3>, options: &ExrOptions<'_>, layers: &[(&str, &Plane<Vec3>)]) -> Vec<u8> {
    let ExrOptions { alpha, clip_level, space } = *options;
    assert!(
        clip_level.is_none_or(|level| level > 0.0 && level.is_finite()),
        "the clip level must be positive and finite"
    );
    let (width, height) = rgb.size();
    assert!(width > 0 && height > 0, "the picture must have pixels");
    let mut channels = Vec::new();
    for (prefix, plane) in [("".to_owned(), rgb)].into_iter().chain(layers.iter().map(|(n, p)| (format!("{n}."), *p))) {
        assert_eq!(plane.size(), rgb.size(), "layers must have the size of the picture");
        for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
            let values = plane.as_slice().iter().map(|v| v[c]).collect();
            channels.push(AnyChannel::new(format!("{prefix}{name}").as_str(), FlatSamples::F32(values)));
        }
    }
    if let Some(alpha) = alpha {
        assert_eq!(alpha.size(), rgb.size(), "alpha must have the size of the picture");
        channels.push(AnyChannel::new("A", FlatSamples::F32(alpha.as_slice().to_vec())));
    }
    let mut of_image = ImageAttributes::new(IntegerBounds::from_dimensions((width, height)));
    of_image.chromaticities = space.map(chromaticities);
    let mut of_layer = LayerAttributes::default();
    of_layer.other.extend(clip_level.map(|level| (Text::from(exr::CLIP_LEVEL), AttributeValue::F32(level))));
    let layer = Layer::new((width, height), of_layer, ENCODING, AnyChannels::sort(channels.into_iter().collect()));
    let mut bytes = Cursor::new(Vec::new());
    Image::new(of_image, layer).write().to_buffered(&mut bytes).expect("writing to memory cannot fail");
    bytes.into_inner()
}

/// Encoding of all OpenEXR files.
const ENCODING: Encoding =
    Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

/// Returns the attribute `chromaticities` of a space.
fn chromaticities(space: ColourSpace) -> Chromaticities {
    let Primaries { red, green, blue, white } = space.primaries();
    let [red, green, blue, white] = [red, green, blue, white].map(|c| Vec2(c.x as f32, c.y as f32));
    Chromaticities { red, green, blue, white }
}

/// Encodes a portable float map, 32-bit little-endian RGB. All float values are preserved.
pub fn encode_pfm(rgb: &Plane<Vec3>) -> Vec<u8> {
    pfm::encode(rgb)
}

/// Encodes Radiance HDR, precise to 1 part in 256 of the largest channel. Negative values and NaN
/// become 0; values beyond the range of the format become its largest value.
pub fn encode_hdr(rgb: &Plane<Vec3>) -> Vec<u8> {
    radiance::encode(rgb)
}

/// Encodes linear values as an 8-bit sRGB PNG; values outside 0..=1 are clamped, NaN becomes 0.
///
/// # Panics
/// If the picture has no pixels.
pub fn encode_png(rgb: &Plane<Vec3>) -> Vec<u8> {
    let samples: Vec<u8> = rgb.as_slice().iter().flat_map(|v| v.to_array().map(srgb8)).collect();
    encode_png_srgb8(rgb.width(), rgb.height(), &samples)
}

/// Returns the rounded sRGB code of a linear value.
///
/// A table indexed by the leading 16 bits of the value holds the code and the value at which the
/// next code begins.
fn srgb8(value: f32) -> u8 {
    const FIRST: u32 = 114 << 7;
    const LAST: u32 = 127 << 7;
    static STEPS: LazyLock<Vec<(u8, f32)>> = LazyLock::new(|| {
        let exact = |v: f32| (srgb_encode(v) * 255.0).round() as u8;
        let step = |bits: u32| {
            let (low, high) = (bits << 16, (bits + 1) << 16);
            let code = exact(f32::from_bits(low));
            // The smallest value of the next code, if that code begins in this interval.
            let (mut below, mut above) = (low, high);
            while above - below > 1 {
                let middle = below + (above - below) / 2;
                if exact(f32::from_bits(middle)) > code { above = middle } else { below = middle }
            }
            (code, f32::from_bits(above))
        };
        (FIRST..LAST).map(step).collect()
    });
    let bits = value.max(0.0).to_bits() >> 16;
    match bits {
        0..FIRST => 0,
        FIRST..LAST => {
            let (code, next) = STEPS[(bits - FIRST) as usize];
            code + u8::from(value >= next)
        }
        _ => 255,
    }
}

/// Encodes like [`encode_png`] and stores the name of the program in the file, for [`is_signed`].
///
/// # Panics
/// Like [`encode_png`], and if `program` is longer than a PNG chunk allows.
pub fn encode_png_signed(rgb: &Plane<Vec3>, program: &str) -> Vec<u8> {
    let mut bytes = encode_png(rgb);
    // The last chunk, `IEND`, is empty.
    let end = bytes.len() - 12;
    bytes.splice(end..end, signature(program));
    bytes
}

/// Returns whether a file is a PNG that [`encode_png_signed`] wrote for this program.
pub fn is_signed(path: impl AsRef<Path>, program: &str) -> bool {
    let signature = signature(program);
    fs::read(path).is_ok_and(|bytes| {
        bytes.starts_with(b"\x89PNG") && bytes.windows(signature.len()).any(|part| part == signature)
    })
}

/// Returns a text chunk of a PNG file with the name of the program.
fn signature(program: &str) -> Vec<u8> {
    let mut chunk = b"tEXtSoftware\0".to_vec();
    chunk.extend(program.as_bytes());
    let length = u32::try_from(chunk.len() - 4).expect("the name of a program is short");
    let mut check = flate2::Crc::new();
    check.update(&chunk);
    [&length.to_be_bytes()[..], &chunk, &check.sum().to_be_bytes()].concat()
}

/// Encodes a PNG of 8-bit RGB samples that are already sRGB-coded, row-major from the top.
///
/// # Panics
/// If the number of samples is not `3 * width * height`, or zero, or a side is longer than 2^31 -
/// 1.
pub fn encode_png_srgb8(width: usize, height: usize, rgb: &[u8]) -> Vec<u8> {
    assert!(!rgb.is_empty() && rgb.len() == 3 * width * height, "the samples must be those of {width}x{height} pixels");
    let side = |n: usize| u32::try_from(n).ok().filter(|&n| n < 1 << 31).expect("the side must be below 2^31");
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(rgb, side(width), side(height), ExtendedColorType::Rgb8)
        .expect("writing to memory cannot fail");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{ReadOptions, SpaceSource, decode};

    fn wavy() -> Plane<Vec3> {
        Plane::from_fn(37, 21, |x, y| Vec3::new((x as f32).sin(), 1e4 * y as f32, (x * y) as f32 / 777.0))
    }

    #[test]
    fn exr_preserves_every_bit() {
        let (rgb, alpha) = (wavy(), Plane::from_fn(37, 21, |x, _| x as f32 / 36.0));
        let read = |bytes: &[u8]| decode(Path::new("t"), bytes, &ReadOptions::default()).unwrap().picture;
        let got = read(&encode_exr(&rgb, Some(&alpha)));
        assert_eq!((got.rgb, got.alpha), (rgb.clone(), Some(alpha)));
        assert_eq!(read(&encode_exr(&rgb, None)).alpha, None);
        assert_eq!(read(&encode_pfm(&rgb)).rgb, rgb);
    }

    #[test]
    fn exr_preserves_values_that_are_not_finite() {
        let rgb = Plane::from_vec(1, 1, vec![Vec3::new(f32::NAN, f32::INFINITY, -1.0)]);
        let got = decode(Path::new("t"), &encode_exr(&rgb, None), &ReadOptions::default()).unwrap().picture.rgb;
        assert!(got[(0, 0)].x.is_nan() && got[(0, 0)].y == f32::INFINITY && got[(0, 0)].z == -1.0);
    }

    #[test]
    fn exr_preserves_the_clip_level() {
        let bytes = encode_exr_with(&wavy(), &ExrOptions { clip_level: Some(12.5), ..ExrOptions::default() });
        let got = decode(Path::new("t"), &bytes, &ReadOptions::default()).unwrap();
        assert_eq!((got.full_scale, got.picture.rgb), (Some(12.5), wavy()));
        let at = bytes.windows(4).position(|w| w == 12.5_f32.to_le_bytes()).unwrap();
        for bad in [0.0_f32, -1.0, f32::NAN] {
            let mut bytes = bytes.clone();
            bytes[at..at + 4].copy_from_slice(&bad.to_le_bytes());
            assert!(decode(Path::new("t"), &bytes, &ReadOptions::default()).is_err(), "{bad}");
        }
    }

    #[test]
    fn exr_round_trips_in_all_colour_spaces() {
        let rgb = wavy().map(|v| v.abs());
        for space in ColourSpace::ALL {
            let got = decode(Path::new("t"), &encode_exr_in(&rgb, None, space), &ReadOptions::default()).unwrap();
            assert_eq!((got.input.name.as_str(), got.input.source), (space.name(), SpaceSource::Chromaticities));
            let off = |(a, b): (&Vec3, &Vec3)| (*a - *b).abs().max_element() / (1.0 + a.max_element());
            let worst = rgb.as_slice().iter().zip(got.picture.rgb.as_slice()).map(off).fold(0.0, f32::max);
            assert!(worst < 1e-5, "{}: {worst}", space.name());
        }
    }

    #[test]
    fn encoding_is_deterministic() {
        assert_eq!(encode_exr(&wavy(), None), encode_exr(&wavy(), None));
    }

    #[test]
    fn png_encodes_linear_values() {
        let rgb = Plane::from_vec(2, 1, vec![Vec3::new(0.0, 0.2158605, 2.0), Vec3::new(f32::NAN, -1.0, 1.0)]);
        let options = ReadOptions { linear: true, ..Default::default() };
        let got = decode(Path::new("t"), &encode_png(&rgb), &options).unwrap().picture.rgb;
        assert_eq!(got.map(|v| (*v * 255.0).round()).as_slice(), [Vec3::new(0., 128., 255.), Vec3::new(0., 0., 255.)]);
    }

    #[test]
    fn tabulated_codes_match_the_srgb_curve() {
        for i in 0..200_000 {
            let value = i as f32 * 6e-6;
            assert_eq!(srgb8(value), (srgb_encode(value) * 255.0).round() as u8, "{value}");
        }
        assert_eq!([-1.0, f32::NAN, f32::INFINITY, 1.0].map(srgb8), [0, 0, 255, 255]);
    }

    #[test]
    fn layers_are_read_by_their_names() {
        let plane = |v: f32| Plane::from_fn(3, 2, |x, y| Vec3::new(v, v + x as f32, v + y as f32));
        let (rgb, low, alpha) = (plane(1.0), plane(2.0), Plane::from_fn(3, 2, |x, _| x as f32 / 2.0));
        let bytes = encode_exr_layers(&rgb, Some(&alpha), &[("low", &low)]);
        let read = |layer: Option<&str>| {
            let options = ReadOptions { layer: layer.map(str::to_owned), ..ReadOptions::default() };
            decode(Path::new("t"), &bytes, &options).unwrap().picture
        };
        assert_eq!((read(None).rgb, read(None).alpha), (rgb, Some(alpha)));
        assert_eq!((read(Some("low")).rgb, read(Some("low")).alpha), (low, None));
    }
}
