//! Normal maps: one direction for each pixel of the photograph, zero where there is no surface.
//!
//! Axes are those of the camera: x right, y up, z towards the camera; this module does not flip or
//! rotate normals. Formats:
//! * OpenEXR with float channels `X Y Z` or `R G B`, plain or of a pass such as `Normal.X`; PFM;
//! * NPY of shape (height, width, 3), row 0 at the top;
//! * PNG, TIFF and JPEG with the usual encoding, `n = 2 v - 1` for `v` in 0..=1; float TIFF with
//!   plain components.
//!
//! Float files and arrays may have plain components, or the encoding of integers in 0..=1, 0..=255
//! or 0..=65535, also with the sRGB curve removed by mistake. gonio selects the encoding that gives
//! the most unit vectors. Normals of lengths from 0.5 to 1.3 become unit vectors. The caller
//! decides how to treat the others and normals that face away from the camera.

use std::path::Path;

use glam::Vec3;
use gonio::picture::{Plane, srgb_encode};

use crate::picture::{self, Decoded, Encoding, Format, Group, ReadOptions, Selection};
use crate::{Error, guard, npy};

/// Lengths of normals that become unit vectors. Averages of a finer map are shorter than one, and
/// JPEG compression changes lengths.
const RENORMALISED: std::ops::RangeInclusive<f32> = 0.5..=1.3;
/// Largest deviation from 1 of the length of a correctly decoded normal.
const UNIT_SLACK: f32 = 0.02;
/// Length below which a decoded normal counts as zero, which no integer represents exactly.
const CODED_ZERO: f32 = 0.05;

/// Reads a normal map. Pixels without a surface (zero or NaN; in integer files black, mid-grey or
/// transparent) are [`Vec3::ZERO`].
///
/// # Errors
/// If the file cannot be read, is damaged, has a format that cannot store normals, or has too many
/// pixels (2^27).
pub fn read_normals(path: impl AsRef<Path>) -> Result<Plane<Vec3>, Error> {
    let path = path.as_ref();
    let options = ReadOptions { linear: true, ..Default::default() };
    decode(path, &guard::read_whole(path, options.max_bytes())?, &options)
}

/// Decodes a normal map held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read_normals`].
pub fn decode(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Plane<Vec3>, Error> {
    if bytes.starts_with(npy::MAGIC) {
        let advice = "use an array with the shape (height, width, 3)";
        return npy::decode_pixels(path, bytes, options, advice, |n| Vec3::from_array(*n)).map(floats);
    }
    match Format::of(path, bytes).map_err(|e| e.with_formats("use EXR, NPY, PFM, PNG, TIFF or JPEG"))? {
        Format::Exr => {
            let (width, height, planes) = picture::read_channels(path, bytes, options, |h| select(path, h))?;
            let [x, y, z] = planes.as_slice() else { return Err(Error::damaged(path, "has no normals")) };
            let normals = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| Vec3::new(x, y, z)).collect();
            Ok(floats(Plane::from_vec(width, height, normals)))
        }
        Format::Radiance => {
            Err(Error::unsupported(path, "is a Radiance file, which cannot store negative values", "use EXR or NPY"))
        }
        _ => {
            let options = ReadOptions { linear: true, ..options.clone() };
            Ok(from_picture(picture::decode_unconverted(path, bytes, &options)?))
        }
    }
}

/// Selects the channels most likely to be normals: `X Y Z` before `R G B`, and a pass with a name
/// for normals before all others.
fn select(path: &Path, headers: &[exr::meta::header::Header]) -> Result<Selection, Error> {
    let pass = |group: &Group, _: &str| match group.pass() {
        "n" | "normal" | "normals" | "nrm" => Some(0),
        "" => Some(2),
        _ => Some(4),
    };
    let names = [(["x", "y", "z"], 0), (["nx", "ny", "nz"], 0), (["r", "g", "b"], 1)];
    let missing = || Error::unsupported(path, "has no channels X, Y, Z or R, G, B", "rename the normal channels");
    picture::select_best(headers, &names, pass).ok_or_else(missing)
}

fn from_picture(decoded: Decoded) -> Plane<Vec3> {
    let Decoded { picture, encoding, .. } = decoded;
    if encoding == Encoding::LinearFloat {
        return floats(picture.rgb);
    }
    let mut normals = picture.rgb.map(|&v| coded(v));
    if let Some(alpha) = picture.alpha {
        for (n, _) in normals.as_mut_slice().iter_mut().zip(alpha.as_slice()).filter(|(_, a)| **a == 0.0) {
            *n = Vec3::ZERO;
        }
    }
    normals
}

/// Conversions of encoded components to codes in 0..=1.
const CODES: [fn(Vec3) -> Vec3; 4] =
    [|v| v, |v| v / 255.0, |v| v / 65535.0, |v| Vec3::from(v.to_array().map(srgb_encode))];

/// Converts float components, either plain or in the encoding of integers.
fn floats(normals: Plane<Vec3>) -> Plane<Vec3> {
    let is_unit = |n: Vec3| (n.length() - 1.0).abs() < UNIT_SLACK;
    let in_range = |code: Vec3| code.min_element() >= 0.0 && code.max_element() <= 1.0;
    let surface: Vec<Vec3> = normals.as_slice().iter().copied().filter(|n| n.is_finite() && *n != Vec3::ZERO).collect();
    let plain = surface.iter().filter(|n| is_unit(**n)).count();
    let units =
        CODES.map(|code| surface.iter().map(|n| code(*n)).filter(|c| in_range(*c) && is_unit(2.0 * c - 1.0)).count());
    // The first one is taken if several are equal.
    let (code, &coded_units) = CODES.iter().zip(&units).rev().max_by_key(|(_, units)| **units).expect("there are four");
    // Background pixels may have any value, but most normals of the surface have length one.
    let decode = coded_units > 2 * plain && 4 * coded_units > surface.len();
    normals.map(|&n| match n.is_finite() {
        true if decode => coded(code(n)),
        true => renormalised(n),
        false => Vec3::ZERO,
    })
}

fn renormalised(n: Vec3) -> Vec3 {
    let length = n.length();
    if RENORMALISED.contains(&length) { n / length } else { n }
}

fn coded(v: Vec3) -> Vec3 {
    let n = 2.0 * v - 1.0;
    if v == Vec3::ZERO || n.length() < CODED_ZERO { Vec3::ZERO } else { renormalised(n) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;
    use exr::prelude::*;

    fn read(bytes: &[u8]) -> std::result::Result<Plane<Vec3>, crate::Error> {
        super::decode(Path::new("n"), bytes, &ReadOptions::default())
    }

    fn exr(channels: &[(&str, f32)]) -> Vec<u8> {
        let list = channels.iter().map(|&(n, v)| AnyChannel::new(n, FlatSamples::F32(vec![v; 4]))).collect();
        let mut bytes = std::io::Cursor::new(Vec::new());
        Image::from_channels((2, 2), AnyChannels::sort(list)).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn selects_the_normal_channels_of_exr_files() {
        let n = [(0.6, "R"), (0.0, "G"), (0.8, "B")];
        assert_eq!(read(&exr(&n.map(|(v, c)| (c, v)))).unwrap()[(1, 1)], Vec3::new(0.6, 0.0, 0.8));
        let mixed = [("B", 9.0), ("G", 9.0), ("R", 9.0), ("Normal.X", 0.0), ("Normal.Y", 1.0), ("Normal.Z", 0.0)];
        assert_eq!(read(&exr(&mixed)).unwrap()[(0, 1)], Vec3::Y);
        let nan = [("X", f32::NAN), ("Y", 0.0), ("Z", 1.0)];
        assert_eq!(read(&exr(&nan)).unwrap()[(0, 0)], Vec3::ZERO);
        assert_eq!(read(&exr(&[("Z", 1.0)])).unwrap_err().kind(), Kind::Unsupported);
    }

    #[test]
    fn npy_rows_start_at_the_top() {
        let array = npy::Array { shape: vec![2, 1, 3], values: vec![0., 0., 1., 1., f32::NAN, 0.] };
        let got = read(&npy::encode(&array)).unwrap();
        assert_eq!((got.size(), got.as_slice()), ((1, 2), &[Vec3::Z, Vec3::ZERO][..]));
        let flat = npy::Array { shape: vec![2, 3], values: vec![0.0; 6] };
        assert_eq!(read(&npy::encode(&flat)).unwrap_err().kind(), Kind::Invalid);
    }

    #[test]
    fn encoded_floats_and_averaged_normals_become_unit_vectors() {
        let sphere = |n: fn(Vec3) -> Vec3| -> Vec<Vec3> {
            let pixel = |i: i32| {
                let (x, y) = ((i % 9 - 4) as f32 / 5.0, (i / 9 - 4) as f32 / 5.0);
                let square = 1.0 - x * x - y * y;
                if square > 0.0 { n(Vec3::new(x, y, square.sqrt())) } else { n(Vec3::ZERO) }
            };
            let normals = (0..81).map(pixel).collect();
            floats(Plane::from_vec(9, 9, normals)).as_slice().to_vec()
        };
        let plain = sphere(|n| n);
        let same = |other: Vec<Vec3>| plain.iter().zip(&other).all(|(a, b)| (*a - *b).length() < 1e-5);
        assert!(same(sphere(|n| 0.5 * n + 0.5)));
        assert!(same(sphere(|n| 127.5 * n + 127.5)));
        assert!(same(sphere(|n| 32767.5 * n + 32767.5)));
        let decoded = sphere(|n| Vec3::from((0.5 * n + 0.5).to_array().map(gonio::picture::srgb_decode)));
        assert!(plain.iter().zip(&decoded).all(|(a, b)| (*a - *b).length() < 1e-3), "{decoded:?}");
        assert!(same(sphere(|n| 0.8 * n)));
        assert!(!same(sphere(|n| 0.3 * n)), "lengths far from one are not changed");
    }

    #[test]
    fn coded_normals_become_unit_vectors_or_zero() {
        let png = |pixel: [u8; 4]| {
            let image = image::RgbaImage::from_pixel(1, 1, image::Rgba(pixel));
            let mut bytes = std::io::Cursor::new(Vec::new());
            image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
            read(&bytes.into_inner()).unwrap()[(0, 0)]
        };
        let n = png([218, 128, 218, 255]);
        assert!((n.length() - 1.0).abs() < 1e-6 && (n.x - 0.5_f32.sqrt()).abs() < 0.01, "{n}");
        for nothing in [[0, 0, 0, 255], [128, 128, 128, 255], [127, 128, 127, 255], [218, 128, 218, 0]] {
            assert_eq!(png(nothing), Vec3::ZERO, "{nothing:?}");
        }
        assert!(png([255, 255, 255, 255]).length() > 1.7, "a length far from one is not changed");
    }

    #[test]
    fn integer_maps_use_all_sixteen_bits() {
        for n in [Vec3::new(0.6, -0.64, 0.48), Vec3::new(1e-3, 0.0, 1.0), Vec3::new(-0.8, 0.6, 1e-3)] {
            let code = n.normalize().to_array().map(|v| ((0.5 * v + 0.5) * 65535.0).round() as u16);
            let image = image::ImageBuffer::from_pixel(1, 1, image::Rgb(code));
            for format in [image::ImageFormat::Png, image::ImageFormat::Tiff] {
                let mut bytes = std::io::Cursor::new(Vec::new());
                image.write_to(&mut bytes, format).unwrap();
                let got = read(&bytes.into_inner()).unwrap()[(0, 0)];
                assert!((got - n.normalize()).length() < 4e-5, "{got}");
            }
        }
    }

    #[test]
    fn errors_list_the_formats_of_normal_maps() {
        for name in ["n.mat", "n.npz", "n.bin"] {
            let error = super::decode(Path::new(name), b"PK\x03\x04 or other", &ReadOptions::default()).unwrap_err();
            let extension = &name[1..];
            let want = format!(
                "{name}: is a {extension} file, which is not a supported image format; use EXR, NPY, PFM, PNG, TIFF or \
                 JPEG"
            );
            assert_eq!(error.to_string(), want);
        }
    }

    #[test]
    fn radiance_files_are_rejected() {
        assert_eq!(read(b"#?RADIANCE\n").unwrap_err().kind(), Kind::Unsupported);
    }
}
