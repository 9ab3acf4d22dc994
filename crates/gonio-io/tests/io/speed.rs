//! Measures the time to load cache entries and meshes: `cargo test -p gonio-io --release --
//! --ignored --nocapture speed`.

use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use gonio::shape::{Mesh, MeshParts};
use gonio_io::{cache::Cache, mesh};

#[test]
#[ignore = "a measurement"]
fn loading_a_large_entry() {
    let dir = tempfile::tempdir().unwrap();
    let cache = Cache::at(dir.path());
    for megabytes in [65, 130] {
        let content: Vec<u8> = (0..megabytes << 20).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let start = Instant::now();
        cache.store("k", &content).unwrap();
        let stored = start.elapsed();
        let times: Vec<_> = (0..5)
            .map(|_| {
                let start = Instant::now();
                let loaded = cache.load("k").unwrap();
                let elapsed = start.elapsed();
                assert_eq!(loaded.len(), content.len());
                elapsed
            })
            .collect();
        eprintln!("{megabytes} MB: stored in {stored:?}, loaded in {times:?}");
    }
}

/// A wavy surface of 150,152 triangles.
fn surface() -> Mesh {
    const SIDE: u32 = 275;
    let place = |i: u32| {
        let (x, y) = (f64::from(i % SIDE) / 50.0, f64::from(i / SIDE) / 50.0);
        DVec3::new(x, y, (x * 3.0).sin() * y.cos())
    };
    let corners = (0..SIDE * SIDE).filter(|i| i % SIDE + 1 < SIDE && i / SIDE + 1 < SIDE);
    let triangles = corners.flat_map(|i| [[i, i + 1, i + SIDE + 1], [i, i + SIDE + 1, i + SIDE]]).collect();
    let parts = MeshParts { positions: (0..SIDE * SIDE).map(place).collect(), triangles, normals: None };
    Mesh::new(parts).unwrap().0
}

/// Encodes a mesh as `.glb` with one normal per vertex.
fn glb(mesh: &Mesh) -> Vec<u8> {
    let (vertices, triangles) = (mesh.positions().len(), mesh.triangles().len());
    let mut normals = vec![DVec3::ZERO; vertices];
    for (t, n) in mesh.triangles().iter().zip(mesh.normals()) {
        t.iter().zip(n).for_each(|(i, n)| normals[*i as usize] = *n);
    }
    let floats = mesh.positions().iter().chain(&normals).flat_map(|v| v.as_vec3().to_array());
    let mut bin: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
    bin.extend(mesh.triangles().iter().flatten().flat_map(|i| i.to_le_bytes()));
    let (half, indices) = (12 * vertices, 12 * triangles);
    let json = serde_json::json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3", "min": [0, 0, -1], "max": [9, 9, 1]},
            {"bufferView": 1, "componentType": 5126, "count": vertices, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5125, "count": 3 * triangles, "type": "SCALAR"}
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": half},
            {"buffer": 0, "byteOffset": half, "byteLength": half},
            {"buffer": 0, "byteOffset": 2 * half, "byteLength": indices}
        ],
        "buffers": [{"byteLength": bin.len()}]
    });
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, data) in [(b"JSON", &json), (b"BIN\0", &bin)] {
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(data);
    }
    bytes
}

#[test]
#[ignore = "a measurement"]
fn reading_large_meshes() {
    let surface = surface();
    for (name, bytes) in
        [("a.obj", mesh::encode_obj(&surface)), ("a.ply", mesh::encode_ply(&surface)), ("a.glb", glb(&surface))]
    {
        let times: Vec<_> = (0..5)
            .map(|_| {
                let start = Instant::now();
                let (read, soundness) = mesh::decode(Path::new(name), &bytes).unwrap();
                let elapsed = start.elapsed();
                assert_eq!((read.triangles().len(), soundness.normals_computed), (150_152, false));
                elapsed
            })
            .collect();
        eprintln!("{name}: {:.1} MB in {times:?}", bytes.len() as f64 / 1e6);
    }
    let parts = MeshParts {
        positions: surface.positions().to_vec(),
        triangles: surface.triangles().to_vec(),
        normals: Some(surface.normals().to_vec()),
    };
    let start = Instant::now();
    Mesh::new(parts).unwrap();
    eprintln!("of which Mesh::new on the vertices of OBJ and GLB takes {:?}", start.elapsed());
}
