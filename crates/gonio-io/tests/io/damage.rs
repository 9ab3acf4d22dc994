//! Damaged files: valid files of every format, truncated and with single bytes changed.
//!
//! Reading may succeed or fail, but it must not panic, and truncated files must be rejected.

use std::path::Path;

use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio_io::picture::{self, ReadOptions};
use gonio_io::{Error, Kind, merl, normals, npy};
use image::{DynamicImage, ImageFormat};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::{colour, seeds};

/// Small, so that a corrupted header cannot request much memory.
const OPTIONS: ReadOptions = ReadOptions { linear: false, max_pixels: 1 << 16, layer: None, colour_space: None };
/// Changed bytes tried for each file.
const CHANGES: usize = 400;

fn wavy(width: usize, height: usize) -> Plane<Vec3> {
    Plane::from_fn(width, height, |x, y| Vec3::new((x as f32).sin().abs(), y as f32 / 40.0, (x * y % 7) as f32 / 7.0))
}

fn through_image(format: ImageFormat, sixteen: bool) -> Vec<u8> {
    let rgb = wavy(29, 23);
    let bytes = rgb.as_slice().iter().flat_map(|v| v.to_array()).map(|v| (v * 255.0) as u8).collect();
    let image = DynamicImage::ImageRgb8(image::RgbImage::from_vec(29, 23, bytes).unwrap());
    let image = if sixteen { DynamicImage::ImageRgb16(image.to_rgb16()) } else { image };
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn tiled_exr(compression: exr::prelude::Compression) -> Vec<u8> {
    use exr::prelude::*;
    let encoding = Encoding { compression, blocks: Blocks::Tiles(Vec2(8, 8)), line_order: LineOrder::Increasing };
    let pixels = wavy(29, 23);
    let channels = SpecificChannels::rgb(|p: Vec2<usize>| {
        let v = pixels[(p.x(), p.y())];
        (f16::from_f32(v.x), f16::from_f32(v.y), f16::from_f32(v.z))
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_encoded_channels((29, 23), encoding, channels).write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// Returns lengths below that of a file: about `count` at equal distances, and the last eight.
pub(crate) fn cuts(good: &[u8], count: usize) -> impl Iterator<Item = usize> {
    let length = good.len();
    (0..length).step_by((length / count).max(1)).chain(length.saturating_sub(8)..length)
}

/// Returns `count` versions of a file with one changed byte, and the index of this byte. Half of
/// the changes are in the header, where they have the largest effect. The seed is fixed, so that
/// failures are reproducible.
pub(crate) fn with_changed_bytes(good: &[u8], count: usize) -> Vec<(usize, Vec<u8>)> {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut changed = |i: usize| {
        let mut bad = good.to_vec();
        let end = if i.is_multiple_of(2) { good.len().min(400) } else { good.len() };
        let at = rng.random_range(0..end);
        bad[at] = if i.is_multiple_of(3) { [0, 0xff, 0x7f, 0x80][rng.random_range(0..4)] } else { rng.random() };
        (at, bad)
    };
    (0..count).map(&mut changed).collect()
}

/// Feeds damaged versions of `good` to `read`. Reading a truncated file may succeed only if at most
/// `slack` bytes are missing, because some formats have bytes after their content.
#[track_caller]
pub(crate) fn check<T>(name: &str, good: &[u8], slack: usize, read: impl Fn(&Path, &[u8]) -> Result<T, Error>) {
    let path = Path::new(name);
    let sound = |error: &Error, what: &str| {
        let text = error.to_string();
        assert!(text.starts_with(&format!("{name}: ")) && !text.contains('\n'), "{what}: {text}");
    };
    if let Err(error) = read(path, good) {
        panic!("the valid file is rejected: {error}");
    }
    for cut in cuts(good, 500) {
        match read(path, &good[..cut]) {
            Ok(_) => assert!(
                good.len() - cut <= slack,
                "{name} is accepted when truncated from {} to {cut} bytes",
                good.len()
            ),
            Err(error) => sound(&error, &format!("cut to {cut}")),
        }
    }
    for (at, bad) in with_changed_bytes(good, CHANGES) {
        if let Err(error) = read(path, &bad) {
            sound(&error, &format!("byte {at} is {}", bad[at]));
        }
    }
}

fn check_picture(name: &str, good: &[u8], slack: usize) {
    check(name, good, slack, |path, bytes| picture::decode(path, bytes, &OPTIONS));
    check(name, good, slack, |path, bytes| normals::decode(path, bytes, &OPTIONS));
}

/// Returns pictures of every format and compression except Radiance. The number is that of the
/// bytes that may be missing at the end.
pub(crate) fn pictures() -> Vec<(&'static str, Vec<u8>, usize)> {
    use exr::prelude::Compression as C;
    vec![
        ("none.exr", tiled_exr(C::Uncompressed), 0),
        ("rle.exr", tiled_exr(C::RLE), 0),
        ("piz.exr", tiled_exr(C::PIZ), 0),
        ("pxr.exr", tiled_exr(C::PXR24), 0),
        ("b44.exr", tiled_exr(C::B44), 0),
        ("zip.exr", picture::encode_exr(&wavy(29, 23), None), 0),
        ("b.pfm", picture::encode_pfm(&wavy(9, 7)), 0),
        // The pixels end before the last chunks.
        ("8.png", picture::encode_png(&wavy(29, 23)), 16),
        ("16.png", through_image(ImageFormat::Png, true), 16),
        ("b.jpg", through_image(ImageFormat::Jpeg, false), 0),
        // Small fields of the directory at the end may have padding.
        ("8.tif", through_image(ImageFormat::Tiff, false), 4),
        ("16.tif", through_image(ImageFormat::Tiff, true), 4),
    ]
}

#[test]
fn damaged_pictures_never_panic() {
    for (name, good, slack) in pictures().into_iter().chain(colour::tagged()) {
        check_picture(name, &good, slack);
    }
    let good = picture::encode_hdr(&wavy(29, 23));
    check("a.hdr", &good, 0, |path, bytes| picture::decode(path, bytes, &OPTIONS));
}

fn png_with_exif(exif: Vec<u8>) -> Vec<u8> {
    use image::ImageEncoder;
    let samples: Vec<u8> =
        wavy(29, 23).as_slice().iter().flat_map(|v| v.to_array()).map(|v| (v * 255.0) as u8).collect();
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif).unwrap();
    encoder.write_image(&samples, 29, 23, image::ExtendedColorType::Rgb8).unwrap();
    bytes
}

#[test]
fn damaged_exposures_never_panic() {
    let options = picture::BracketOptions { read: OPTIONS, ..Default::default() };
    let good = png_with_exif(seeds::exif(false));
    let other = good.clone();
    // Two files, so that the exposure times of both are required.
    check("a.png", &good, 16, |path, bytes| {
        picture::decode_bracket(&[(path, bytes), (path, &other)], &options)
            .inspect(|b| assert_eq!(b.exposures.len(), 2))
    });
    let bracket = picture::decode_bracket(&[(Path::new("a.png"), good.as_slice()); 2], &options).unwrap();
    assert_eq!(bracket.exposure_settings[0].seconds, Some(1.0 / 30.0));
    assert_eq!(bracket.exposures[1].amount, 1.0 / 30.0 * 200.0 / (2.8 * 2.8));
}

#[test]
fn damaged_responses_never_panic() {
    let good = picture::encode_response(&gonio::bracket::Response::srgb(255));
    // A truncated curve is a valid curve of fewer codes, even if the last number lacks digits.
    check("a.csv", &good, good.len(), picture::decode_response);
}

#[test]
fn damaged_arrays_never_panic() {
    let array = npy::Array { shape: vec![7, 9, 3], values: vec![0.5; 189] };
    check("a.npy", &npy::encode(&array), 0, npy::decode);
    check("a.npy", &npy::encode(&array), 0, |path, bytes| normals::decode(path, bytes, &OPTIONS));
}

#[test]
fn damaged_merl_tables_never_panic() {
    let t = BivariateTable::from_fn(|h, d| h + d);
    let good = merl::encode(&MerlTable::from_bivariate([&t, &t, &t]));
    let read = |bytes: &[u8]| merl::decode(Path::new("a.binary"), bytes, bytes.len() as u64);
    for cut in (0..40).chain((40..good.len()).step_by(1_234_567)).chain([good.len() - 1]) {
        assert_eq!(read(&good[..cut]).unwrap_err().kind(), Kind::Damaged, "{cut}");
    }
    // A stream that is shorter than the given length.
    let error = merl::decode(Path::new("a"), &good[..1000], merl::FILE_BYTES).unwrap_err();
    assert_eq!(error.kind(), Kind::Damaged);
    let mut bad = good;
    let mut rng = Pcg64::seed_from_u64(2);
    for _ in 0..12 {
        let at = rng.random_range(0..bad.len());
        bad[at] = rng.random();
        let _ = read(&bad);
    }
}

#[test]
fn damaged_files_on_disk_are_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.png");
    let good = picture::encode_png(&wavy(29, 23));
    for cut in (0..good.len()).step_by(50) {
        std::fs::write(&path, &good[..cut]).unwrap();
        assert!(picture::read(&path, &OPTIONS).is_err());
        assert!(picture::read_mask(&path).is_err());
        assert!(normals::read_normals(&path).is_err());
        assert!(merl::read(&path).is_err());
    }
    std::fs::write(&path, &good).unwrap();
    assert_eq!(picture::read_mask(&path).unwrap().size(), (29, 23));
    assert_eq!(picture::read(dir.path(), &OPTIONS).unwrap_err().io_kind(), Some(std::io::ErrorKind::IsADirectory));
}
