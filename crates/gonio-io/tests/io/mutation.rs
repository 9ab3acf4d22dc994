//! Mutations of valid files.
//!
//! They are extreme numbers in headers, replaced words in binary headers, truncation and flipped
//! bits. The sequence of changes is fixed, so that failures are reproducible.

use std::path::Path;

use glam::{DVec3, Vec3};
use gonio::picture::Plane;
use gonio::shape::{Mesh, MeshParts};
use gonio_io::{mesh, npy, picture};

use crate::corpus::{check_error, read_with_all};

/// Number of leading bytes that count as the header.
const HEADER: usize = 600;
/// Flipped bits tried for each file.
const FLIPS: usize = 150;

/// A wavy strip of triangles.
fn strip() -> Mesh {
    let positions: Vec<DVec3> =
        (0..30).map(|i| DVec3::new(f64::from(i) / 2.0, f64::from(i % 2), f64::from(i % 5))).collect();
    let triangles = (0..28).map(|i| [i, i + 1, i + 2]).collect();
    Mesh::new(MeshParts { positions, triangles, normals: None }).unwrap().0
}

fn gltf(binary: bool) -> Vec<u8> {
    let bin: Vec<u8> = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let uri = if binary { "" } else { r#","uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA""# };
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1]}}],"nodes":[{{"mesh":0}},{{"mesh":0,"scale":[2,3,4]}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}],"bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":36}}],"buffers":[{{"byteLength":36{uri}}}]}}"#
    );
    if !binary {
        return json.into_bytes();
    }
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + json.len() as u32 + 36).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json.bytes());
    bytes.extend(36_u32.to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(bin);
    bytes
}

/// A file of each format.
pub(crate) fn good() -> Vec<(&'static str, Vec<u8>)> {
    let rgb = Plane::from_fn(13, 11, |x, y| Vec3::new(x as f32 / 13.0, y as f32 / 11.0, 0.5));
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    let camera = r#"{"projection": "perspective", "focal_mm": 85, "sensor_mm": [36, 27], "size": [640, 480],
        "principal_point": [320, 240], "pose": {"position": [0, 0.5, 3], "look_at": [0, 0, 0], "up": [0, 1, 0]}}"#;
    let pose = r#"{"translation": [1, 2, 3], "rotation_degrees": [10, 20, 30], "scale": [1, 2, 3]}"#;
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
        ("a.obj", mesh::encode_obj(&strip())),
        ("a.ply", mesh::encode_ply(&strip())),
        ("text.ply", text.into()),
        ("a.glb", gltf(true)),
        ("a.gltf", gltf(false)),
        ("camera.json", camera.into()),
        ("pose.json", pose.into()),
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

/// Returns truncated versions of the file and versions with one flipped bit.
fn with_damage(good: &[u8]) -> Vec<Vec<u8>> {
    let mut state = 7_u64;
    let mut below = |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % n
    };
    let cuts = (0..good.len()).step_by((good.len() / 60).max(1)).map(|cut| good[..cut].to_vec());
    let mut damaged: Vec<Vec<u8>> = cuts.collect();
    for i in 0..FLIPS {
        let mut bad = good.to_vec();
        let at = below(if i % 2 == 0 { good.len().min(HEADER) } else { good.len() });
        bad[at] ^= 1 << below(8);
        damaged.push(bad);
    }
    damaged
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
