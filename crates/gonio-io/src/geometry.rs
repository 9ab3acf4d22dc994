//! Depth and position maps.
//!
//! * OpenEXR: depths in a channel `Z`, `V`, `depth` or `distance`, plain or of a pass such as
//!   `Depth.V`, or in grey; positions in `X Y Z` or `R G B`, preferably of a pass named `position`.
//! * NPY: depths of shape (height, width), positions of shape (height, width, 3), row 0 at the top.
//! * 16-bit PNG and TIFF: depths coded as 0..1 between a near and a far depth. Float TIFF: plain
//!   depths or positions. PFM: both.
//!
//! A pixel without a surface is zero, infinite, NaN, or at least 1e9, as renderers write for the
//! background (Blender: 1e10). In an integer image, it has the smallest or the largest code, or is
//! transparent.

use std::path::Path;

use exr::meta::header::Header;
use glam::{DVec3, Vec3};
use gonio::picture::Plane;
use gonio::suggestion::Suggestion;

use crate::picture::{self, Decoded, Encoding, Format, Group, ReadOptions, Selection};
use crate::{Error, guard, npy};

/// Numbers of at least this magnitude mark pixels without a surface.
const NOTHING: f64 = 1e9;

/// Options for reading a depth map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthOptions {
    /// Depths of the codes 0 and 1 of an integer picture, in either order. No effect on float
    /// files.
    pub range: Option<(f64, f64)>,
    /// Limits on the input.
    pub read: ReadOptions,
}

/// Returns the depth of a stored number: `None` (no surface) if it is zero, not finite or huge.
pub fn depth_of(value: f64) -> Option<f64> {
    Some(value).filter(|d| d.is_finite() && *d != 0.0 && d.abs() < NOTHING)
}

/// Returns the position of three stored numbers. `None` (no surface) if they are zero, not finite
/// or huge.
pub fn position_of(value: DVec3) -> Option<DVec3> {
    Some(value).filter(|p| p.is_finite() && *p != DVec3::ZERO && p.abs().max_element() < NOTHING)
}

/// Reads a depth map in the unit of the file; `None` marks pixels without a surface.
///
/// The file does not state whether depths are measured along the axis of the camera or along each
/// ray.
///
/// # Errors
/// If the file cannot be read, is damaged, has no surface at all, or has too many pixels. Also if
/// its format cannot store depths, or if it stores integers of 8 bits or without a range.
pub fn read_depth(path: impl AsRef<Path>, options: &DepthOptions) -> Result<Plane<Option<f64>>, Error> {
    let path = path.as_ref();
    decode_depth(path, &guard::read_whole(path, options.read.max_bytes())?, options)
}

/// Decodes depths held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read_depth`].
pub fn decode_depth(path: &Path, bytes: &[u8], options: &DepthOptions) -> Result<Plane<Option<f64>>, Error> {
    let depth = |v: f32| depth_of(f64::from(v));
    let depths = if bytes.starts_with(npy::MAGIC) {
        let advice = "use an array of depths with the shape (height, width)";
        npy::decode_pixels(path, bytes, &options.read, advice, |&[v]| depth(v))?
    } else {
        match Format::of(path, bytes).map_err(|e| e.with_formats("use EXR, NPY, PFM, or 16-bit PNG or TIFF"))? {
            Format::Exr => {
                let select = |headers: &[Header]| select_depth(path, headers);
                let (width, height, planes) = picture::read_channels(path, bytes, &options.read, select)?;
                let [values] = planes.as_slice() else { return Err(Error::damaged(path, "has no depths")) };
                Plane::from_vec(width, height, values.iter().map(|v| depth(*v)).collect())
            }
            Format::Pfm | Format::Png | Format::Tiff => {
                let read = ReadOptions { linear: true, ..options.read.clone() };
                let decoded = picture::decode_unconverted(path, bytes, &read)?;
                if decoded.encoding == Encoding::LinearFloat {
                    grey(path, &decoded)?.map(|v| depth(*v))
                } else {
                    coded(path, &decoded, options.range)?
                }
            }
            // Radiance, JPEG and, with the feature `raw`, raw files.
            _ => {
                let advice = "use EXR, NPY or 16-bit PNG";
                return Err(Error::unsupported(path, "has a format with too few depth levels", advice));
            }
        }
    };
    if depths.as_slice().iter().all(Option::is_none) {
        return Err(Error::invalid(
            path,
            "contains no valid depths: all are zero, infinite or too large",
            "check the exported values",
        ));
    }
    Ok(depths)
}

/// Reads a position map in the frame and unit of the file. `None` marks pixels without a surface:
/// positions that are not finite, huge, or exactly at the origin.
///
/// # Errors
/// If the file cannot be read, is damaged, has a format that cannot store positions, has no surface
/// at all, or has too many pixels.
pub fn read_positions(path: impl AsRef<Path>) -> Result<Plane<Option<DVec3>>, Error> {
    let path = path.as_ref();
    let options = ReadOptions::default();
    decode_positions(path, &guard::read_whole(path, options.max_bytes())?, &options)
}

/// Decodes positions held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read_positions`].
pub fn decode_positions(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Plane<Option<DVec3>>, Error> {
    let position = |v: Vec3| position_of(v.as_dvec3());
    let positions = if bytes.starts_with(npy::MAGIC) {
        let advice = "use an array of positions with the shape (height, width, 3)";
        npy::decode_pixels(path, bytes, options, advice, |p| position(Vec3::from_array(*p)))?
    } else {
        let unsupported = || {
            let problem = "has a format that cannot store positions";
            Error::unsupported(path, problem, "use EXR or NPY")
        };
        match Format::of(path, bytes).map_err(|e| e.with_formats("use EXR, NPY, PFM, or TIFF of floats"))? {
            Format::Exr => {
                let select = |headers: &[Header]| select_positions(path, headers);
                let (width, height, planes) = picture::read_channels(path, bytes, options, select)?;
                let [x, y, z] = planes.as_slice() else { return Err(Error::damaged(path, "has no positions")) };
                let positions = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| position(Vec3::new(x, y, z)));
                Plane::from_vec(width, height, positions.collect())
            }
            Format::Pfm | Format::Tiff => {
                let read = ReadOptions { linear: true, ..options.clone() };
                let decoded = picture::decode_unconverted(path, bytes, &read)?;
                if decoded.encoding != Encoding::LinearFloat {
                    return Err(unsupported());
                }
                decoded.picture.rgb.map(|v| position(*v))
            }
            _ => return Err(unsupported()),
        }
    };
    if positions.as_slice().iter().all(Option::is_none) {
        return Err(Error::invalid(
            path,
            "contains no valid positions: all are zero, infinite or too large",
            "check the exported values",
        ));
    }
    Ok(positions)
}

/// Selects a channel with a depth name, preferably of a depth pass.
fn select_depth(path: &Path, headers: &[Header]) -> Result<Selection, Error> {
    let pass = |group: &Group, name: &str| {
        let pass = match group.pass() {
            "depth" | "z" | "mist" | "distance" => 0,
            "" => 1,
            // The Z of a pass of normals or positions is not a depth.
            _ => return None,
        };
        // Colour channels store depths only in a depth pass or in a grey file.
        let is_vector = name == "z" && group.select(&["x"]).is_some() || name == "r" && pass != 0;
        (!is_vector).then_some(pass)
    };
    let names = [(["depth"], 0), (["z"], 2), (["v"], 2), (["distance"], 0), (["d"], 2), (["y"], 4), (["r"], 6)];
    let missing = || {
        let problem = "has no depth channel (Z, V or depth)";
        Error::unsupported(path, problem, "rename the depth channel to Z")
    };
    picture::select_best(headers, &names, pass).ok_or_else(missing)
}

/// Selects the channels most likely to be positions.
fn select_positions(path: &Path, headers: &[Header]) -> Result<Selection, Error> {
    let pass = |group: &Group, _: &str| match group.pass() {
        "p" | "pos" | "position" | "positions" | "point" | "points" | "world" | "pworld" => Some(0),
        "" => Some(2),
        "n" | "normal" | "normals" | "nrm" | "uv" | "vector" => None,
        _ => Some(4),
    };
    let names = [(["x", "y", "z"], 0), (["px", "py", "pz"], 0), (["r", "g", "b"], 1)];
    let advice = "rename the position channels";
    let missing = || Error::unsupported(path, "has no position channels (X, Y, Z or R, G, B)", advice);
    picture::select_best(headers, &names, pass).ok_or_else(missing)
}

/// Returns one value per pixel of a grey picture.
fn grey(path: &Path, decoded: &Decoded) -> Result<Plane<f32>, Error> {
    let rgb = &decoded.picture.rgb;
    let same = |a: f32, b: f32| a == b || (a.is_nan() && b.is_nan());
    if rgb.as_slice().iter().any(|v| !(same(v.x, v.y) && same(v.y, v.z))) {
        return Err(Error::invalid(path, "has colours, but a depth map must be grey", "use a grey image"));
    }
    Ok(rgb.map(|v| v.x))
}

fn coded(path: &Path, decoded: &Decoded, range: Option<(f64, f64)>) -> Result<Plane<Option<f64>>, Error> {
    if matches!(decoded.encoding, Encoding::Linear { bits: 8 } | Encoding::Srgb { bits: 8 }) {
        let problem = "has only 8 bits, which is 256 depth levels";
        return Err(Error::invalid(path, problem, "use 16-bit PNG, EXR or NPY"));
    }
    let codes = grey(path, decoded)?;
    let Some((near, far)) = range else {
        let problem = "stores depths as 0..1 without their range";
        let advice = "specify the depth range, or use EXR or NPY";
        return Err(Error::invalid(path, problem, advice).with_suggestion(Suggestion::DepthRange));
    };
    if !(near.is_finite() && far.is_finite() && near != far) {
        let problem = format!("stores depths as 0..1, and the range {near},{far} is invalid");
        return Err(Error::invalid(path, problem, "use two different, finite depths"));
    }
    let covered = |i: usize| decoded.picture.alpha.as_ref().is_none_or(|a| a.as_slice()[i] > 0.0);
    let depth = |(i, code): (usize, &f32)| {
        let code = f64::from(*code);
        (code > 0.0 && code < 1.0 && covered(i)).then_some(near + code * (far - near))
    };
    let depths = codes.as_slice().iter().enumerate().map(depth).collect();
    Ok(Plane::from_vec(codes.width(), codes.height(), depths))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;
    use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};

    const DEPTHS: [f32; 6] = [1.5, 0.0, f32::NAN, f32::INFINITY, 1e10, 2.5];
    const WANT: [Option<f64>; 6] = [Some(1.5), None, None, None, None, Some(2.5)];

    fn exr(channels: &[(&str, &[f32])]) -> Vec<u8> {
        let list = channels.iter().map(|&(n, v)| AnyChannel::new(n, FlatSamples::F32(v.to_vec()))).collect();
        let mut bytes = std::io::Cursor::new(Vec::new());
        Image::from_channels((3, 2), AnyChannels::sort(list)).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn depth(bytes: &[u8], range: Option<(f64, f64)>) -> Result<Plane<Option<f64>>, Error> {
        decode_depth(Path::new("d"), bytes, &DepthOptions { range, ..Default::default() })
    }

    fn positions(bytes: &[u8]) -> Result<Plane<Option<DVec3>>, Error> {
        decode_positions(Path::new("p"), bytes, &ReadOptions::default())
    }

    #[test]
    fn reads_depths_of_float_files() {
        let other = [9.0; 6];
        for channels in [
            &[("Z", &DEPTHS[..])][..],
            &[("R", &other[..]), ("G", &other), ("B", &other), ("Z", &DEPTHS)],
            &[
                ("ViewLayer.Depth.Z", &DEPTHS),
                ("ViewLayer.Combined.R", &other),
                ("ViewLayer.Normal.Z", &other),
                ("ViewLayer.Normal.X", &other),
            ],
            &[("Depth.V", &DEPTHS), ("X", &other), ("Y", &other), ("Z", &other)],
            &[("depth", &DEPTHS), ("Y", &other)],
            &[("Y", &DEPTHS)],
            &[("Depth.R", &DEPTHS), ("Depth.G", &DEPTHS), ("Depth.B", &DEPTHS)],
        ] {
            let got = depth(&exr(channels), None).unwrap();
            assert_eq!((got.size(), got.as_slice()), ((3, 2), &WANT[..]), "{channels:?}");
        }
        let array = npy::Array { shape: vec![2, 3], values: DEPTHS.to_vec() };
        assert_eq!(depth(&npy::encode(&array), None).unwrap().as_slice(), WANT);
        let grey = Plane::from_vec(3, 2, DEPTHS.iter().map(|v| Vec3::splat(*v)).collect());
        assert_eq!(depth(&picture::encode_pfm(&grey), None).unwrap().as_slice(), WANT);
    }

    #[test]
    fn reads_depths_of_integer_files() {
        let codes = [0_u16, 1, 16384, 32768, 65534, 65535];
        let image = image::ImageBuffer::<image::Luma<u16>, _>::from_vec(3, 2, codes.to_vec()).unwrap();
        for format in [image::ImageFormat::Png, image::ImageFormat::Tiff] {
            let mut bytes = std::io::Cursor::new(Vec::new());
            image.write_to(&mut bytes, format).unwrap();
            let bytes = bytes.into_inner();
            let got = depth(&bytes, Some((2.0, 4.0))).unwrap();
            let want = |code: u16| 2.0 + 2.0 * f64::from(code) / 65535.0;
            assert_eq!((got[(0, 0)], got[(2, 1)]), (None, None));
            for (got, code) in got.as_slice()[1..5].iter().zip(&codes[1..5]) {
                assert!((got.unwrap() - want(*code)).abs() < 1e-6);
            }
            // Near and far swapped.
            assert!((depth(&bytes, Some((4.0, 2.0))).unwrap()[(1, 0)].unwrap() - 4.0).abs() < 1e-4);
            assert!(depth(&bytes, None).unwrap_err().suggestion() == Some(&Suggestion::DepthRange));
            for range in [(1.0, 1.0), (0.0, f64::NAN)] {
                assert_eq!(depth(&bytes, Some(range)).unwrap_err().kind(), Kind::Invalid);
            }
        }
        let eight = picture::encode_png(&Plane::from_fn(2, 2, |_, _| Vec3::ONE));
        assert!(depth(&eight, Some((0.0, 1.0))).unwrap_err().to_string().contains("8 bits"));
    }

    #[test]
    fn reads_positions_of_float_files() {
        let (x, y, z) = ([1.0, 0.0, f32::NAN, 0.0, 1e10, 2.0], [0.0; 6], [0.0, 0.0, 1.0, -1.0, 0.0, 3.0]);
        let want = [Some(DVec3::X), None, None, Some(DVec3::NEG_Z), None, Some(DVec3::new(2.0, 0.0, 3.0))];
        let other = [9.0; 6];
        for channels in [
            &[("X", &x[..]), ("Y", &y), ("Z", &z)][..],
            &[
                ("L.Position.X", &x),
                ("L.Position.Y", &y),
                ("L.Position.Z", &z),
                ("R", &other),
                ("G", &other),
                ("B", &other),
            ],
            &[("P.R", &x), ("P.G", &y), ("P.B", &z), ("N.X", &other), ("N.Y", &other), ("N.Z", &other)],
            &[("R", &x), ("G", &y), ("B", &z)],
        ] {
            assert_eq!(positions(&exr(channels)).unwrap().as_slice(), want, "{channels:?}");
        }
        let values = (0..6).flat_map(|i| [x[i], y[i], z[i]]).collect();
        let array = npy::Array { shape: vec![2, 3, 3], values };
        assert_eq!(positions(&npy::encode(&array)).unwrap().as_slice(), want);
    }

    #[test]
    fn rejects_files_without_geometry() {
        let other = [9.0; 6];
        for (bytes, kind) in [
            (exr(&[("R", &other), ("G", &other), ("B", &other)]), Kind::Unsupported),
            (exr(&[("Normal.X", &other), ("Normal.Y", &other), ("Normal.Z", &other)]), Kind::Unsupported),
            (exr(&[("Z", &[0.0; 6])]), Kind::Invalid),
            (npy::encode(&npy::Array { shape: vec![6], values: other.to_vec() }), Kind::Invalid),
            (b"#?RADIANCE\n".to_vec(), Kind::Unsupported),
            (picture::encode_pfm(&Plane::from_fn(2, 2, |x, _| Vec3::new(1.0, x as f32, 0.0))), Kind::Invalid),
        ] {
            let error = depth(&bytes, None).unwrap_err();
            assert_eq!(error.kind(), kind, "{error}");
        }
        for (bytes, kind) in [
            (exr(&[("Z", &other)]), Kind::Unsupported),
            (exr(&[("Normal.X", &other), ("Normal.Y", &other), ("Normal.Z", &other)]), Kind::Unsupported),
            (picture::encode_png(&Plane::from_fn(2, 2, |_, _| Vec3::ONE)), Kind::Unsupported),
            (exr(&[("X", &[0.0; 6]), ("Y", &[0.0; 6]), ("Z", &[0.0; 6])]), Kind::Invalid),
        ] {
            let error = positions(&bytes).unwrap_err();
            assert_eq!(error.kind(), kind, "{error}");
        }
    }
}
