//! Radiance HDR (`.hdr`, `.pic`): RGB with a shared exponent.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use glam::Vec3;
use gonio::picture::Plane;
use image::ImageDecoder;
use image::codecs::hdr::{HdrDecoder, HdrEncoder, HdrMetadata};

use super::integer::explain;
use super::space::{DeclaredSpace, SpaceSource};
use super::{Decoded, ReadOptions, float_picture};
use crate::colour_space::Primaries;
use crate::{Error, guard};

/// Largest number of pixels per byte. A run of 127 pixels takes 8 bytes, an old-style run of 255
/// takes 4.
const PIXELS_PER_BYTE: usize = 64;
/// Largest value of the format, a little below 2^127.
const MAX_VALUE: f32 = 1.6e38;
/// Colours with a largest channel below this value become black.
const SMALLEST: f32 = 1e-32;

pub(super) fn decode(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Decoded, Error> {
    let unix = with_unix_lines(bytes);
    let bytes = unix.as_ref();
    let is_xyz = header_lines(bytes).any(|line| line.starts_with(b"FORMAT=") && line.ends_with(b"xyze"));
    if is_xyz {
        return Err(Error::unsupported(path, "contains XYZ instead of RGB colours", "convert it with `ra_xyze -r`"));
    }
    let (axes, standard) = Axes::of(bytes);
    let bytes = standard.as_deref().unwrap_or(bytes);
    guard::catching(path, "Radiance HDR", || {
        // The strict reader accepts only `#?RADIANCE`, but `#?RGBE` is also common.
        let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|e| explain(path, e))?;
        let metadata = decoder.metadata();
        let factor = factor_of(&metadata).ok_or_else(|| {
            Error::damaged(path, "has an EXPOSURE or COLORCORR line that is not positive in its header")
        })?;
        let attributes = metadata.custom_attributes;
        let primaries: Vec<String> =
            attributes.into_iter().filter(|(key, _)| key == "PRIMARIES").map(|(_, value)| value).collect();
        let (width, height) = decoder.dimensions();
        let (width, height) = options.check_size(path, width.into(), height.into())?;
        if width * height > bytes.len().saturating_mul(PIXELS_PER_BYTE) {
            let problem = format!("has {} bytes, too few for {width}x{height} pixels", bytes.len());
            return Err(Error::damaged(path, problem));
        }
        let mut raw = vec![0; width * height * 12];
        decoder.read_image(&mut raw).map_err(|e| explain(path, e))?;
        let float = |b: &[u8]| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
        let rgb = raw.chunks_exact(12).map(|p| Vec3::new(float(p), float(&p[4..]), float(&p[8..])) / factor);
        let rgb = axes.upright(Plane::from_vec(width, height, rgb.collect()));
        let space = stated(&primaries).settle(options.colour_space);
        Ok(float_picture(rgb.size(), rgb.into_vec(), space))
    })
}

/// Returns the factor by which the values of each channel exceed radiance. It is the product of the
/// lines `EXPOSURE=` and `COLORCORR=`. `None` if it is not positive.
fn factor_of(metadata: &HdrMetadata) -> Option<Vec3> {
    let exposure = metadata.exposure.unwrap_or(1.0);
    let (r, g, b) = metadata.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let factor = exposure * Vec3::new(r, g, b);
    (factor.min_element() > 0.0 && factor.is_finite()).then_some(factor)
}

/// Longest header in bytes.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// Lists the lines of a header, up to the first empty one.
fn header_lines(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let header = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    header.split(|b| *b == b'\n').map(<[u8]>::trim_ascii_end).take_while(|line| !line.is_empty())
}

/// Replaces CR LF with LF in the header and at the end of the resolution line.
fn with_unix_lines(bytes: &[u8]) -> Cow<'_, [u8]> {
    let header = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let Some(blank) = header.windows(4).position(|w| w == b"\r\n\r\n") else { return Cow::Borrowed(bytes) };
    let rest = &bytes[blank + 4..];
    let resolution = rest.iter().position(|b| *b == b'\n').map_or(rest.len(), |at| at + 1);
    let mut out: Vec<u8> = bytes[..blank + 4 + resolution].to_vec();
    out.retain(|b| *b != b'\r');
    out.extend_from_slice(&rest[resolution..]);
    Cow::Owned(out)
}

/// Order in which a file stores its pixels, from the resolution line.
///
/// `-Y 20 +X 30` means 20 rows from top to bottom, each with 30 pixels from left to right; `+X 30
/// -Y 20` means 30 columns.
#[derive(Clone, Copy, Debug, Default)]
struct Axes {
    by_columns: bool,
    from_right: bool,
    from_bottom: bool,
}

impl Axes {
    /// Reads the resolution line. If the order is not that of `-Y N +X M`, also returns the file
    /// with this order in its resolution line, because the decoder reads no other.
    fn of(bytes: &[u8]) -> (Self, Option<Vec<u8>>) {
        Self::parse(bytes).map_or_else(Default::default, |(axes, standard)| (axes, Some(standard)))
    }

    fn parse(bytes: &[u8]) -> Option<(Self, Vec<u8>)> {
        let header = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
        let start = header.windows(2).position(|w| w == b"\n\n")? + 2;
        let end = start + header[start..].iter().position(|b| *b == b'\n')?;
        let words: Vec<&str> = std::str::from_utf8(&header[start..end]).ok()?.split_whitespace().collect();
        let &[first, count, second, length] = words.as_slice() else { return None };
        let by_columns = match (first, second) {
            ("-Y", "+X") => return None,
            ("-Y" | "+Y", "-X" | "+X") => false,
            ("-X" | "+X", "-Y" | "+Y") => true,
            _ => return None,
        };
        let has = |axis| first == axis || second == axis;
        let line = format!("-Y {count} +X {length}");
        let axes = Self { by_columns, from_right: has("-X"), from_bottom: has("+Y") };
        Some((axes, [&bytes[..start], line.as_bytes(), &bytes[end..]].concat()))
    }

    /// Rotates and mirrors a picture, whose rows are the stored rows or columns.
    fn upright(self, stored: Plane<Vec3>) -> Plane<Vec3> {
        let Self { by_columns, from_right, from_bottom } = self;
        if !(by_columns || from_right || from_bottom) {
            return stored;
        }
        let (length, count) = stored.size();
        let (width, height) = if by_columns { (count, length) } else { (length, count) };
        Plane::from_fn(width, height, |x, y| {
            let x = if from_right { width - 1 - x } else { x };
            let y = if from_bottom { height - 1 - y } else { y };
            stored[if by_columns { (y, x) } else { (x, y) }]
        })
    }
}

/// Returns the colour space of the last `PRIMARIES=` line: x and y of red, green, blue and white.
fn stated(lines: &[String]) -> DeclaredSpace {
    let Some(line) = lines.last() else { return DeclaredSpace::default() };
    let numbers: Option<Vec<f64>> = line.split_whitespace().map(|word| word.parse().ok()).collect();
    match numbers.and_then(|numbers| numbers.try_into().ok()) {
        Some(xy) => DeclaredSpace::primaries(&Primaries::from_array(xy), SpaceSource::Primaries, "PRIMARIES"),
        None => DeclaredSpace { space: None, unusable: Some("PRIMARIES (not eight numbers)".to_owned()) },
    }
}

pub(super) fn encode(rgb: &Plane<Vec3>) -> Vec<u8> {
    let pixels: Vec<_> = rgb.as_slice().iter().map(|&v| image::Rgb(rounded(v))).collect();
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes).encode(&pixels, rgb.width(), rgb.height()).expect("writing to memory cannot fail");
    bytes
}

/// Returns the nearest colour that the format can represent. The encoder truncates, which would
/// darken pictures by 0.4 %.
fn rounded(v: Vec3) -> [f32; 3] {
    let v = v.to_array().map(|v| if v > 0.0 { v.min(MAX_VALUE) } else { 0.0 });
    let largest = v.iter().fold(0.0_f32, |a, &b| a.max(b));
    if largest < SMALLEST {
        return [0.0; 3];
    }
    // The largest power of two up to the largest channel, divided by 128, is the unit of the
    // mantissas.
    let unit = f32::from_bits(largest.to_bits() & 0xff80_0000) / 128.0;
    v.map(|v| (v / unit).round() * unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trips_to_one_part_in_256() {
        let rgb = Plane::from_fn(40, 3, |x, y| Vec3::new(1.0 + x as f32, 20.0 / (1.0 + y as f32), 30.0));
        let mut bytes = encode(&rgb);
        let back = decode(Path::new("t.hdr"), &bytes, &ReadOptions::default()).unwrap();
        for (a, b) in rgb.as_slice().iter().zip(back.picture.rgb.as_slice()) {
            assert!((*a - *b).abs().max_element() <= a.max_element() / 256.0, "{a} {b}");
        }
        assert_eq!(back.full_scale, None);
        bytes.splice(..10, *b"#?RGBE");
        assert!(decode(Path::new("t.hdr"), &bytes, &ReadOptions::default()).is_ok());
    }

    #[test]
    fn values_are_divided_by_the_exposure() {
        let rgb = Plane::from_fn(4, 2, |_, _| Vec3::new(2.0, 4.0, 8.0));
        let bytes = String::from_utf8_lossy(&encode(&rgb)).find('\n').unwrap();
        let (first, rest) = (encode(&rgb)[..=bytes].to_vec(), encode(&rgb)[bytes + 1..].to_vec());
        let with = |lines: &[u8]| decode(Path::new("t.hdr"), &[&first, lines, &rest].concat(), &ReadOptions::default());
        let found = with(b"EXPOSURE=2\nEXPOSURE=2\nCOLORCORR=1 0.5 2\n").unwrap();
        assert_eq!(found.picture.rgb[(1, 1)], Vec3::new(0.5, 2.0, 1.0));
        assert!(with(b"EXPOSURE=0\n").is_err() && with(b"EXPOSURE=-1\n").is_err());
    }

    #[test]
    fn headers_may_have_cr_lf_and_mention_xyze() {
        let rgb = Plane::from_fn(40, 3, |x, _| Vec3::splat(1.0 + x as f32));
        let bytes = encode(&rgb);
        let blank = bytes.windows(2).position(|w| w == b"\n\n").unwrap();
        let line = blank + 2 + bytes[blank + 2..].iter().position(|b| *b == b'\n').unwrap();
        let mut header = String::from_utf8(bytes[..line + 1].to_vec()).unwrap();
        header = header.replacen("\n", "\nra_xyze -r old.hdr\n", 1).replace('\n', "\r\n");
        let odd = [header.as_bytes(), &bytes[line + 1..]].concat();
        let read = |bytes: &[u8]| decode(Path::new("t.hdr"), bytes, &ReadOptions::default());
        assert_eq!(read(&odd).unwrap().picture.rgb, read(&bytes).unwrap().picture.rgb);
        let xyz = String::from_utf8_lossy(&bytes[..blank]).replace("rgbe", "xyze");
        let error = read(&[xyz.as_bytes(), &bytes[blank..]].concat()).unwrap_err();
        assert!(error.to_string().contains("XYZ"), "{error}");
    }

    #[test]
    fn pictures_of_all_axis_orders_are_upright() {
        let (width, height) = (12, 9);
        let value = |x: usize, y: usize| Vec3::new(1.0 + x as f32, 1.0 + y as f32, 4.0);
        for from_right in [false, true] {
            for from_bottom in [false, true] {
                for by_columns in [false, true] {
                    let (count, length) = if by_columns { (width, height) } else { (height, width) };
                    let stored = Plane::from_fn(length, count, |along, across| {
                        let (x, y) = if by_columns { (across, along) } else { (along, across) };
                        let x = if from_right { width - 1 - x } else { x };
                        value(x, if from_bottom { height - 1 - y } else { y })
                    });
                    let y_axis = format!("{}Y {height}", if from_bottom { '+' } else { '-' });
                    let x_axis = format!("{}X {width}", if from_right { '-' } else { '+' });
                    let line = if by_columns { [x_axis, y_axis] } else { [y_axis, x_axis] }.join(" ");
                    let bytes = encode(&stored);
                    let start = bytes.windows(2).position(|w| w == b"\n\n").unwrap() + 2;
                    let end = start + bytes[start..].iter().position(|b| *b == b'\n').unwrap();
                    let bytes = [&bytes[..start], line.as_bytes(), &bytes[end..]].concat();
                    let got = decode(Path::new("t.hdr"), &bytes, &ReadOptions::default()).unwrap().picture.rgb;
                    assert_eq!(got, Plane::from_fn(width, height, value), "{line}");
                }
            }
        }
        for line in ["-Y 3 +Y 4", "-Z 3 +X 4", "-Y 3 +X", "-Y 3 -X 99999999999"] {
            let bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{line}\n{}", "abcd".repeat(99));
            assert!(decode(Path::new("t.hdr"), bytes.as_bytes(), &ReadOptions::default()).is_err(), "{line}");
        }
    }

    #[test]
    fn runs_of_the_old_encoding_are_read() {
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 300\n".to_vec();
        // A pixel and runs of 43 and 256 times 1; 300 single pixels.
        bytes.extend([128, 64, 0, 129, 1, 1, 1, 43, 1, 1, 1, 1]);
        bytes.extend([0, 128, 255, 128].repeat(300));
        let got = decode(Path::new("t.hdr"), &bytes, &ReadOptions::default()).unwrap().picture.rgb;
        for x in [0, 1, 43, 44, 299] {
            let want = (Vec3::new(1.0, 0.5, 0.0), Vec3::new(0.0, 0.5, 255.0 / 256.0));
            assert_eq!((got[(x, 0)], got[(x, 1)]), want, "{x}");
        }
    }

    #[test]
    fn invalid_values_are_replaced() {
        let rgb = Plane::from_vec(2, 1, vec![Vec3::new(f32::NAN, -1.0, 1.0), Vec3::splat(f32::INFINITY)]);
        let back = decode(Path::new("t.hdr"), &encode(&rgb), &ReadOptions::default()).unwrap().picture.rgb;
        assert_eq!(back[(0, 0)], Vec3::new(0.0, 0.0, 1.0));
        assert!(back[(1, 0)].is_finite() && back[(1, 0)].x > 1e38);
    }

    #[test]
    fn rejects_headers_with_more_pixels_than_the_file_can_hold() {
        let bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 10000 +X 10000\nabcd";
        let error = decode(Path::new("t.hdr"), bytes, &ReadOptions::default()).unwrap_err();
        assert!(error.to_string().contains("too few"), "{error}");
    }
}
