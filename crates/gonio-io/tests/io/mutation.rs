//! Mutations of valid files.
//!
//! They are extreme numbers in headers, replaced words in binary headers, truncation and changed
//! bytes. The sequence of changes is fixed, so that failures are reproducible.

use std::path::Path;

use glam::Vec3;
use gonio::picture::Plane;
use gonio_io::{mesh, npy, picture};

use crate::corpus::{check_error, read_with_all};
use crate::damage::{cuts, with_changed_bytes};

/// Number of leading bytes that count as the header.
const HEADER: usize = 600;
/// Truncations and changed bytes tried for each file.
const CUTS: usize = 60;
const CHANGES: usize = 150;

/// Reads a valid file in `fuzz/seeds`.
fn seed(folder: &str, name: &str) -> Vec<u8> {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds");
    std::fs::read(seeds.join(folder).join(name)).unwrap()
}

/// A file of each format.
pub(crate) fn good() -> Vec<(&'static str, Vec<u8>)> {
    let rgb = Plane::from_fn(13, 11, |x, y| Vec3::new(x as f32 / 13.0, y as f32 / 11.0, 0.5));
    let image =
        image::DynamicImage::ImageRgb8(image::RgbImage::from_fn(13, 11, |x, y| image::Rgb([x as u8, y as u8, 9])));
    let through = |format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    vec![
        ("a.exr", picture::encode_exr(&rgb, None)),
        ("a.hdr", picture::encode_hdr(&rgb)),
        ("a.pfm", picture::encode_pfm(&rgb)),
        ("a.png", through(image::ImageFormat::Png)),
        ("a.tif", through(image::ImageFormat::Tiff)),
        ("a.jpg", through(image::ImageFormat::Jpeg)),
        ("a.npy", npy::encode(&npy::Array { shape: vec![11, 13, 3], values: vec![0.5; 429] })),
        ("a.obj", seed("mesh_obj", "a.obj")),
        ("a.ply", seed("mesh_ply", "a.ply")),
        ("text.ply", seed("mesh_ply", "text.ply")),
        ("a.glb", seed("mesh_gltf", "a.glb")),
        ("a.gltf", seed("mesh_gltf", "a.gltf")),
        ("camera.json", seed("camera", "camera.json")),
        ("pose.json", seed("pose", "pose.json")),
    ]
}

/// Replaces each decimal number in the header by extreme ones, one at a time.
fn with_numbers(good: &[u8]) -> Vec<Vec<u8>> {
    const LIES: [&str; 8] =
        ["0", "-1", "255", "65536", "4294967295", "2147483648", "18446744073709551615", "99999999999999999999999"];
    let header = &good[..good.len().min(HEADER)];
    let mut lies = Vec::new();
    let mut at = 0;
    while at < header.len() {
        let digits = header[at..].iter().take_while(|b| b.is_ascii_digit()).count();
        if digits > 0 {
            for lie in LIES {
                lies.push([&good[..at], lie.as_bytes(), &good[at + digits..]].concat());
            }
        }
        at += digits.max(1);
    }
    lies
}

/// Replaces words of 2, 4 and 8 bytes in the header, one at a time.
fn with_words(good: &[u8]) -> Vec<Vec<u8>> {
    let mut lies = Vec::new();
    for size in [2, 4, 8] {
        for at in (0..good.len().min(HEADER / 3).saturating_sub(size)).step_by(2) {
            for (first, rest) in [(0xff, 0xff), (0xff, 0x7f), (0, 0x10)] {
                let mut bad = good.to_vec();
                bad[at..at + size].fill(first);
                // The last byte, which is the highest in little-endian order.
                bad[at + size - 1] = rest;
                lies.push(bad);
            }
        }
    }
    lies
}

/// Returns truncated versions of the file and versions with one changed byte.
fn with_damage(good: &[u8]) -> Vec<Vec<u8>> {
    let cut = cuts(good, CUTS).map(|cut| good[..cut].to_vec());
    cut.chain(with_changed_bytes(good, CHANGES).into_iter().map(|(_, bad)| bad)).collect()
}

#[test]
fn readers_survive_mutated_files() {
    for (name, good) in good() {
        let path = Path::new(name);
        for bad in [with_numbers(&good), with_words(&good), with_damage(&good)].into_iter().flatten() {
            read_with_all(path, &bad).iter().for_each(|error| check_error(error, path));
        }
    }
}

#[test]
fn valid_files_are_read() {
    for (name, good) in good() {
        assert!(read_with_all(Path::new(name), &good).len() < 16, "{name}: no reader accepts it");
    }
}

#[test]
fn truncated_meshes_are_rejected() {
    let refused = |name: &str, good: &[u8], slack: usize| {
        for cut in 0..good.len() - slack {
            assert!(mesh::decode(Path::new(name), &good[..cut]).is_err(), "{name} cut to {cut}");
        }
        assert!(mesh::decode(Path::new(name), good).is_ok(), "{name}");
    };
    let files = good();
    let of = |name: &str| &files.iter().find(|f| f.0 == name).unwrap().1;
    refused("a.ply", of("a.ply"), 0);
    // The line break of the last line may be missing.
    refused("text.ply", of("text.ply"), 1);
    refused("a.glb", of("a.glb"), 0);
    refused("a.gltf", of("a.gltf"), 0);
}
