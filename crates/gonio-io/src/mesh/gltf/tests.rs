use std::path::Path;

use base64::Engine;
use glam::DVec3;
use gonio::shape::{Mesh, MeshDefects};
use serde_json::{Value, json};

use crate::material::glb::container;
use crate::mesh::{decode, read_mesh};
use crate::{Error, Kind};

fn read(bytes: &[u8]) -> Result<(Mesh, MeshDefects), Error> {
    decode(Path::new("a.glb"), bytes)
}

/// Encodes a `.glb` file.
fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    container(&text, &bin)
}

/// Returns JSON and bytes of a unit square. The bytes are four corners, four normals along z, and
/// the indices of two triangles in 8, 16 and 32 bits.
fn square() -> (Value, Vec<u8>) {
    let floats = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0_f32]];
    let mut bin: Vec<u8> = floats.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    bin.extend([0.0, 0.0, 1.0_f32].repeat(4).iter().flat_map(|v| v.to_le_bytes()));
    let indices = [0_u8, 1, 2, 0, 2, 3];
    bin.extend(indices);
    bin.extend([0, 0]);
    bin.extend(indices.iter().flat_map(|i| u16::from(*i).to_le_bytes()));
    bin.extend(indices.iter().flat_map(|i| u32::from(*i).to_le_bytes()));
    let json = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "../../none.png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5121, "count": 6, "type": "SCALAR"},
            {"bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 4, "componentType": 5125, "count": 6, "type": "SCALAR"}
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 48},
            {"buffer": 0, "byteOffset": 96, "byteLength": 6},
            {"buffer": 0, "byteOffset": 104, "byteLength": 12},
            {"buffer": 0, "byteOffset": 116, "byteLength": 24}
        ],
        "buffers": [{"byteLength": bin.len()}]
    });
    (json, bin)
}

/// Encodes the square with changes, given as JSON pointers and values.
fn changed(changes: &[(&str, Value)]) -> Vec<u8> {
    let (mut json, bin) = square();
    for (pointer, value) in changes {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match json.pointer_mut(parent).unwrap() {
            Value::Object(map) => drop(map.insert(key.to_owned(), value.clone())),
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value.clone(),
            _ => panic!("{pointer}"),
        }
    }
    glb(&json, &bin)
}

/// Returns twice the area of all triangles, as a vector.
fn area(mesh: &Mesh) -> DVec3 {
    let place = |i: u32| mesh.positions()[i as usize];
    mesh.triangles().iter().map(|&[a, b, c]| (place(b) - place(a)).cross(place(c) - place(a))).sum()
}

const PRIMITIVE: &str = "/meshes/0/primitives/0";

#[test]
fn reads_indices_of_all_widths_and_meshes_without_indices() {
    for (indices, mode) in [(json!(2), 4), (json!(3), 4), (json!(4), 4), (Value::Null, 6)] {
        let bytes = changed(&[(&format!("{PRIMITIVE}/indices"), indices), (&format!("{PRIMITIVE}/mode"), json!(mode))]);
        let (mesh, defects) = read(&bytes).unwrap();
        assert_eq!((defects.triangles, defects.normals_computed), (2, false));
        assert_eq!(area(&mesh), 2.0 * DVec3::Z);
    }
    // A strip of the four corners in order folds over: its triangles are 012 and 132.
    let bytes = changed(&[(&format!("{PRIMITIVE}/indices"), Value::Null), (&format!("{PRIMITIVE}/mode"), json!(5))]);
    let (mesh, _) = read(&bytes).unwrap();
    assert_eq!(mesh.triangles(), [[0, 1, 2], [1, 3, 2]]);
    let points = changed(&[(&format!("{PRIMITIVE}/mode"), json!(0))]);
    assert!(read(&points).unwrap_err().to_string().contains("the mesh is empty"));
}

#[test]
fn nodes_transform_and_mirror_their_meshes() {
    let nodes = json!([
        {"children": [1, 2], "translation": [0, 0, 5]},
        {"mesh": 0, "scale": [-2, 1, 1]},
        {"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 0, 0, 1]},
        {"mesh": 0}
    ]);
    let (mesh, defects) = read(&changed(&[("/nodes", nodes)])).unwrap();
    assert_eq!((defects.triangles, defects.inconsistent_normals, defects.normals_computed), (4, 0, false));
    assert!((area(&mesh) - 6.0 * DVec3::Z).length() < 1e-12, "{}", area(&mesh));
    let (low, high) =
        mesh.positions().iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    assert_eq!((low, high), (DVec3::new(-2.0, 0.0, 5.0), DVec3::new(7.0, 1.0, 5.0)));
}

#[test]
fn sparse_accessors_replace_values() {
    let sparse = json!({"count": 2, "indices": {"bufferView": 3, "byteOffset": 2, "componentType": 5123},
        "values": {"bufferView": 0, "byteOffset": 12}});
    // The 16-bit indices are 1 and 2; the values are corners 1 and 2, inserted into zeros.
    let bytes = changed(&[
        (
            "/accessors/0",
            json!({"componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0], "sparse": sparse}),
        ),
        (&format!("{PRIMITIVE}/indices"), json!(3)),
    ]);
    let (mesh, defects) = read(&bytes).unwrap();
    // The fourth corner is also zero, so the second triangle is degenerate, and its corner is
    // removed.
    assert_eq!((defects.triangles, defects.degenerate), (1, 1));
    assert_eq!(mesh.positions(), [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)]);
}

#[test]
fn buffers_may_be_embedded_or_separate_files() {
    let (mut json, bin) = square();
    let text = base64::engine::general_purpose::STANDARD.encode(&bin);
    json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{text}"));
    assert_eq!(read(json.to_string().as_bytes()).unwrap().1.triangles, 2);

    json["buffers"][0]["uri"] = json!("the%20data.bin");
    let error = read(json.to_string().as_bytes()).unwrap_err();
    assert!(error.to_string().contains("stores its geometry in another file"), "{error}");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gltf");
    std::fs::write(&path, json.to_string()).unwrap();
    assert_eq!(read_mesh(&path).unwrap_err().io_kind(), Some(std::io::ErrorKind::NotFound));
    std::fs::write(dir.path().join("the data.bin"), &bin[..100]).unwrap();
    assert!(read_mesh(&path).unwrap_err().to_string().contains("has 100 bytes in buffer 0"));
    std::fs::write(dir.path().join("the data.bin"), &bin).unwrap();
    assert_eq!(read_mesh(&path).unwrap().1.triangles, 2);
}

#[test]
fn unreadable_files_are_rejected_with_the_reason() {
    let required = |name: &str| ("/extensionsRequired", json!([name]));
    type Changes = Vec<(&'static str, Value)>;
    let cases: Vec<(Changes, Kind, &str)> = vec![
        (
            vec![required("KHR_draco_mesh_compression")],
            Kind::Unsupported,
            "is compressed with KHR_draco_mesh_compression; decompress the mesh: gltf-transform copy in.glb out.glb",
        ),
        (vec![required("EXT_meshopt_compression")], Kind::Unsupported, "is compressed with EXT_meshopt_compression"),
        (vec![required("EXT_something")], Kind::Unsupported, "without this extension"),
        (vec![("/accessors/0/count", json!(5))], Kind::Damaged, "beyond the end"),
        (vec![("/accessors/0/count", json!(u64::MAX))], Kind::Limits, "more than"),
        (vec![("/accessors/2/count", json!(u64::MAX / 2))], Kind::Damaged, "beyond the end"),
        (vec![("/accessors/0/byteOffset", json!(u64::MAX))], Kind::Damaged, "beyond the end"),
        (vec![("/accessors/2/byteOffset", json!(1))], Kind::Damaged, "beyond the end"),
        (vec![("/bufferViews/0/byteOffset", json!(u64::MAX))], Kind::Damaged, "beyond the end"),
        (vec![("/bufferViews/0/byteStride", json!(4))], Kind::Damaged, "beyond the end"),
        (vec![("/accessors/1/count", json!(3))], Kind::Damaged, "has 3 normals for 4 vertices"),
        (vec![("/accessors/0/componentType", json!(5125))], Kind::Unsupported, "positions of type Vec3 of U32"),
        (vec![("/accessors/1/type", json!("VEC2"))], Kind::Unsupported, "normals of type Vec2 of F32"),
        (vec![("/accessors/2/componentType", json!(5126))], Kind::Damaged, "invalid indices"),
        (vec![("/accessors/0/bufferView", Value::Null)], Kind::Damaged, "accessors[0].bufferView: Missing data"),
        (
            vec![("/accessors/0/bufferView", Value::Null), ("/extensionsUsed", json!(["EXT_meshopt_compression"]))],
            Kind::Unsupported,
            "is compressed with EXT_meshopt_compression",
        ),
        (
            vec![
                ("/buffers", json!([{"byteLength": 140}, {"byteLength": 9}])),
                ("/extensionsUsed", json!(["EXT_meshopt_compression"])),
            ],
            Kind::Unsupported,
            "is compressed with EXT_meshopt_compression",
        ),
        (vec![("/bufferViews/2/byteOffset", json!(54))], Kind::Damaged, "refers to vertex 128"),
        (vec![("/buffers/0/byteLength", json!(9999))], Kind::Damaged, "declares 9999"),
        (vec![("/buffers/0/byteLength", json!(u64::MAX))], Kind::Limits, "bytes"),
        (vec![("/meshes/0/primitives/0/attributes/POSITION", json!(9))], Kind::Damaged, "is an inconsistent glTF"),
        (vec![("/nodes", json!([{"children": [0], "mesh": 0}]))], Kind::Damaged, "two parents"),
        (vec![("/nodes", json!([{"children": [1], "mesh": 0}, {"children": [0]}]))], Kind::Damaged, "two parents"),
        (vec![("/nodes/0/scale", json!([1, 0, 1]))], Kind::Invalid, "zero scale"),
        (vec![("/nodes/0/skin", json!(0)), ("/skins", json!([{"joints": [0]}]))], Kind::Unsupported, "armature"),
        (vec![("/scenes", json!([])), ("/scene", Value::Null)], Kind::Invalid, "no scene"),
    ];
    for (changes, kind, message) in cases {
        let error = read(&changed(&changes)).unwrap_err();
        assert!(error.kind() == kind && error.to_string().contains(message), "{changes:?}: {error}");
    }
    assert!(read(&changed(&[required("KHR_materials_unlit")])).is_ok());
}

#[test]
fn the_container_is_checked() {
    let good = changed(&[]);
    for cut in 4..good.len() {
        assert!(read(&good[..cut]).is_err(), "{cut}");
    }
    let mut old = good.clone();
    old[4] = 1;
    assert!(read(&old).unwrap_err().to_string().contains("version 1"));
    let bomb = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}{{}}]}}", "{},".repeat(300_000));
    assert_eq!(read(bomb.as_bytes()).unwrap_err().kind(), Kind::Limits);
    let deep = format!("{{\"asset\":{}", "[".repeat(100_000));
    assert_eq!(read(deep.as_bytes()).unwrap_err().kind(), Kind::Damaged);
}

/// Appends numbers to the buffer of the square and an accessor of three of them per vertex.
fn with_accessor(json: &mut Value, bin: &mut Vec<u8>, kind: u32, normalized: bool, data: &[u8]) -> usize {
    bin.resize(bin.len().next_multiple_of(4), 0);
    let views = json["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": data.len(), "byteStride": data.len() / 4}));
    let view = views.len() - 1;
    bin.extend(data);
    json["buffers"][0]["byteLength"] = json!(bin.len());
    let accessors = json["accessors"].as_array_mut().unwrap();
    accessors
        .push(json!({"bufferView": view, "componentType": kind, "normalized": normalized, "count": 4, "type": "VEC3"}));
    accessors.len() - 1
}

#[test]
fn quantised_vectors_become_floats() {
    // Vectors of three and a byte or number of padding; the largest code and its negative.
    let bytes = |codes: [i32; 2], width: usize| -> Vec<u8> {
        let [one, low] = codes;
        let corners = [[low, low, 0, 0], [one, low, 0, 0], [one, one, 0, 0], [low, one, 0, 0]];
        corners.iter().flatten().flat_map(|code| code.to_le_bytes()[..width].to_vec()).collect()
    };
    for (kind, normalized, data, want) in [
        (5120, true, bytes([127, -128], 1), [1.0, -1.0]),
        (5121, true, bytes([255, 51], 1), [1.0, 0.2]),
        (5122, true, bytes([32_767, -32_768], 2), [1.0, -1.0]),
        (5123, true, bytes([65_535, 13_107], 2), [1.0, 0.2]),
        (5120, false, bytes([100, -28], 1), [100.0, -28.0]),
        (5121, false, bytes([200, 3], 1), [200.0, 3.0]),
        (5122, false, bytes([1000, -4000], 2), [1000.0, -4000.0]),
        (5123, false, bytes([60_000, 7], 2), [60_000.0, 7.0]),
    ] {
        let (mut json, mut bin) = square();
        let places = with_accessor(&mut json, &mut bin, kind, normalized, &data);
        let up = [0, 0, 127, 0].repeat(4);
        let normals = with_accessor(&mut json, &mut bin, 5120, true, &up);
        json["meshes"][0]["primitives"][0]["attributes"] =
            json!({"POSITION": places, "NORMAL": normals, "_CUSTOM": 0, "TEXCOORD_0": 99});
        json["nodes"][0] = json!({"mesh": 0, "scale": [2, 2, 2], "translation": [10, 0, 0]});
        json["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_texture_transform"]);
        let (mesh, defects) = read(&glb(&json, &bin)).unwrap();
        assert_eq!((defects.triangles, defects.normals_computed, defects.inconsistent_normals), (2, false, 0));
        let [one, low] = want.map(|v: f32| 2.0 * f64::from(v));
        let corners = [[low, low], [one, low], [one, one], [low, one]].map(|[x, y]| DVec3::new(10.0 + x, y, 0.0));
        assert_eq!(mesh.positions(), corners, "{kind}, {normalized}");
    }
}

#[test]
fn morph_targets_have_the_weights_of_the_node_or_its_mesh() {
    let floats = |v: [f32; 3]| v.repeat(4).iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let (mut json, mut bin) = square();
    let up = with_accessor(&mut json, &mut bin, 5126, false, &floats([0.0, 0.0, 8.0]));
    let right = with_accessor(&mut json, &mut bin, 5122, false, &[2, 0, 0, 0, 0, 0, 0, 0].repeat(4));
    let tilt = with_accessor(&mut json, &mut bin, 5126, false, &floats([0.0, 1.0, 0.0]));
    json["meshes"][0]["primitives"][0]["targets"] =
        json!([{"POSITION": up, "NORMAL": tilt}, {"POSITION": right, "NORMAL": tilt}, {"POSITION": up}]);
    let with = |of_mesh: Value, of_node: Value| {
        let mut json = json.clone();
        (json["meshes"][0]["weights"], json["nodes"][0]["weights"]) = (of_mesh, of_node);
        read(&glb(&json, &bin))
    };
    for (of_mesh, of_node, corner) in [
        (Value::Null, Value::Null, [0.0, 0.0, 0.0]),
        (json!([0.25, 0.5]), Value::Null, [1.0, 0.0, 2.0]),
        (json!([0.25, 0.5]), json!([0.5, 0, 0]), [0.0, 0.0, 4.0]),
    ] {
        let (mesh, defects) = with(of_mesh, of_node).unwrap();
        assert_eq!((mesh.positions()[0], defects.normals_computed), (corner.into(), false));
    }
    // The normals do not fit a target without normals.
    let (mesh, defects) = with(json!([0, 0, 1]), Value::Null).unwrap();
    assert_eq!((mesh.positions()[2], defects.normals_computed), (DVec3::new(1.0, 1.0, 8.0), true));

    json["accessors"][up]["count"] = json!(3);
    let error = read(&{
        json["meshes"][0]["weights"] = json!([1]);
        glb(&json, &bin)
    });
    assert!(error.unwrap_err().to_string().contains("has 3 positions in a morph target for 4"));
}

#[test]
fn bounds_and_padding_may_be_missing() {
    let bounds = json!({"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"});
    assert_eq!(area(&read(&changed(&[("/accessors/0", bounds)])).unwrap().0), 2.0 * DVec3::Z);
    for name in ["", "a", "ab", "abc"] {
        let (mut json, bin) = square();
        json["asset"]["generator"] = json!(name);
        let bytes = container(json.to_string().as_bytes(), &bin);
        assert_eq!(area(&read(&bytes).unwrap().0), 2.0 * DVec3::Z, "{name}");
    }
}
