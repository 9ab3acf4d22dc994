//! Raw files: a generated DNG, damaged versions of it, and a bracket.

use std::path::Path;

use glam::Vec3;
use gonio::bracket::{MergeSettings, Response, merge};
use gonio_io::Kind;
use gonio_io::picture::{BracketOptions, Encoding, ReadOptions, decode, decode_bracket};

use crate::damage::check;

const WIDTH: usize = 32;
const HEIGHT: usize = 24;
const BLACK: u16 = 512;
const WHITE: u16 = 16383;

/// A field of a directory: tag, type, count, and the bytes. Types: 1 byte, 2 text, 3 short, 4 long,
/// 5 rational, 7 bytes.
type Field = (u16, u16, u32, Vec<u8>);

fn shorts(tag: u16, values: &[u16]) -> Field {
    (tag, 3, values.len() as u32, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

fn long(tag: u16, value: u32) -> Field {
    (tag, 4, 1, value.to_le_bytes().to_vec())
}

fn text(tag: u16, value: &str) -> Field {
    (tag, 2, value.len() as u32 + 1, [value.as_bytes(), b"\0"].concat())
}

/// Encodes a little-endian DNG with one directory and the exposure time. The mosaic is RGGB with
/// uncompressed 16-bit samples.
fn dng(sample: impl Fn(usize, usize) -> u16, fraction: u32, radial: Option<f64>, orientation: u16) -> Vec<u8> {
    let mosaic: Vec<u8> = (0..WIDTH * HEIGHT).flat_map(|i| sample(i % WIDTH, i / WIDTH).to_le_bytes()).collect();
    let mut fields: Vec<Field> = vec![
        long(254, 0),
        long(256, WIDTH as u32),
        long(257, HEIGHT as u32),
        shorts(258, &[16]),
        shorts(259, &[1]),
        shorts(262, &[32803]),
        text(271, "gonio"),
        text(272, "test"),
        // The mosaic directly follows the header.
        long(273, 8),
        shorts(274, &[orientation]),
        shorts(277, &[1]),
        long(278, HEIGHT as u32),
        long(279, mosaic.len() as u32),
        shorts(33421, &[2, 2]),
        (33422, 1, 4, vec![0, 1, 1, 2]),
        (33434, 5, 1, [1_u32.to_le_bytes(), fraction.to_le_bytes()].concat()),
        (50706, 1, 4, vec![1, 4, 0, 0]),
        shorts(50713, &[1, 1]),
        shorts(50714, &[BLACK]),
        shorts(50717, &[WHITE]),
    ];
    if let Some(k) = radial {
        let mut list = [1_u32, 3, 0x0103_0000, 0, 56].iter().flat_map(|w| w.to_be_bytes()).collect::<Vec<u8>>();
        list.extend([k, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5].iter().flat_map(|v| v.to_be_bytes()));
        fields.push((51022, 7, list.len() as u32, list));
    }
    let directory = 8 + mosaic.len();
    let mut extra_at = directory + 2 + 12 * fields.len() + 4;
    let mut bytes = b"II\x2a\0".to_vec();
    bytes.extend((directory as u32).to_le_bytes());
    bytes.extend(mosaic);
    bytes.extend((fields.len() as u16).to_le_bytes());
    let mut extra = Vec::new();
    for (tag, kind, count, value) in fields {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        if value.len() <= 4 {
            bytes.extend(value.iter().copied().chain([0; 4]).take(4));
        } else {
            bytes.extend((extra_at as u32).to_le_bytes());
            extra_at += value.len() + value.len() % 2;
            extra.extend(value.iter().copied().chain(std::iter::repeat_n(0, value.len() % 2)));
        }
    }
    bytes.extend(0_u32.to_le_bytes());
    bytes.extend(extra);
    bytes
}

/// Expected colours of the binned pixels.
fn colour(x: usize, y: usize) -> Vec3 {
    Vec3::new(0.02 + 0.02 * x as f32, 0.5 - 0.01 * y as f32, 0.1 + 0.005 * (x + y) as f32)
}

fn sample(x: usize, y: usize, seconds: f32) -> u16 {
    let channel = [[0, 1], [1, 2]][y % 2][x % 2];
    let v = colour(x / 2, y / 2)[channel] * seconds;
    (f32::from(BLACK) + f32::from(WHITE - BLACK) * v).round().min(f32::from(WHITE)) as u16
}

fn read(bytes: &[u8]) -> gonio_io::picture::Decoded {
    decode(Path::new("t.dng"), bytes, &ReadOptions::default()).unwrap()
}

#[test]
fn a_dng_becomes_linear_colour() {
    let got = read(&dng(|x, y| sample(x, y, 1.0), 8, None, 1));
    assert_eq!((got.encoding, got.full_scale), (Encoding::LinearFloat, Some(1.0)));
    let rgb = &got.picture.rgb;
    assert_eq!(rgb.size(), (WIDTH / 2, HEIGHT / 2));
    for (x, y) in [(0, 0), (15, 0), (7, 11), (15, 11)] {
        assert!((rgb[(x, y)] - colour(x, y)).length() < 1e-3, "{x} {y}: {} {}", rgb[(x, y)], colour(x, y));
    }
    // A rotation by 90 degrees moves the bottom left pixel to the top left.
    let turned = read(&dng(|x, y| sample(x, y, 1.0), 8, None, 6)).picture.rgb;
    assert_eq!((turned.size(), turned[(0, 0)]), ((HEIGHT / 2, WIDTH / 2), rgb[(0, HEIGHT / 2 - 1)]));
}

#[test]
fn clipped_samples_stay_clipped_after_the_vignetting_correction() {
    let clip = |x: usize, y: usize| if (x, y) == (9, 9) { WHITE } else { sample(x, y, 1.0) };
    let got = read(&dng(clip, 8, Some(0.5), 1));
    let level = got.full_scale.unwrap();
    assert!((1.4..1.5).contains(&level), "{level}");
    let rgb = &got.picture.rgb;
    assert_eq!(rgb[(4, 4)].z, level);
    assert_eq!(rgb.as_slice().iter().filter(|v| v.max_element() >= level).count(), 1);
    assert!((rgb[(8, 6)].y / colour(8, 6).y - 1.0).abs() < 0.01);
    assert!((rgb[(0, 0)].y / colour(0, 0).y - level).abs() < 1e-3);
}

#[test]
fn raw_files_form_a_bracket() {
    let files: Vec<Vec<u8>> =
        [1, 4, 16].iter().map(|f| dng(|x, y| sample(x, y, 16.0 / *f as f32), *f, None, 1)).collect();
    let files: Vec<(&Path, &[u8])> = files.iter().map(|f| (Path::new("t.dng"), f.as_slice())).collect();
    let bracket = decode_bracket(&files, &BracketOptions::default()).unwrap();
    assert!(bracket.linear);
    assert_eq!(bracket.exposure_settings[1].seconds, Some(0.25));
    let merged = merge(&bracket.exposures, Some(&Response::linear(u16::MAX, 0.0)), &MergeSettings::default()).unwrap();
    let scale = merged.picture.rgb[(7, 7)].y / colour(7, 7).y;
    for (x, y) in [(0, 0), (15, 3), (3, 11)] {
        let error = merged.picture.rgb[(x, y)] / scale / colour(x, y) - 1.0;
        assert!(error.abs().max_element() < 5e-3, "{error}");
    }
}

#[test]
fn damaged_raw_files_are_rejected() {
    let good = dng(|x, y| sample(x, y, 1.0), 8, Some(0.5), 1);
    let options = ReadOptions { max_pixels: 1 << 16, ..ReadOptions::default() };
    // The values after the directory may be missing: make, model and correction.
    check("t.dng", &good, 150, |path, bytes| decode(path, bytes, &options));
    let error = decode(Path::new("t.dng"), &good, &ReadOptions { max_pixels: 99, ..options }).unwrap_err();
    assert_eq!(error.kind(), Kind::Limits);
    let error = decode(Path::new("t.cr3"), b"no raw file at all", &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().starts_with("t.cr3: cannot be decoded as a raw file"), "{error}");
}
