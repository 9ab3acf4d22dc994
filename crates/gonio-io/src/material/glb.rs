use std::f64::consts::{PI, TAU};

use glam::DVec3;
use gonio::shading::MetallicRoughness;
use serde_json::{Value, json};

/// Rings of the sphere from pole to pole, and vertices around each.
const RINGS: u16 = 48;
const AROUND: u16 = 96;

/// Returns the glTF material of a model. `roughnessFactor` is the square root of GGX's width.
/// Viewers without the extensions assume an index of 1.5, no tint and no coat.
pub fn gltf_material(name: &str, model: &MetallicRoughness) -> Value {
    let four = |x: f64| (x * 1e4).round() / 1e4;
    let three = |colour: DVec3| colour.to_array().map(four);
    let [r, g, b] = three(model.base_color);
    let mut extensions = json!({ "KHR_materials_ior": { "ior": four(model.ior) } });
    if model.specular_color != DVec3::ONE {
        extensions["KHR_materials_specular"] = json!({ "specularColorFactor": three(model.specular_color) });
    }
    if model.clearcoat > 0.0 {
        extensions["KHR_materials_clearcoat"] = json!({
            "clearcoatFactor": four(model.clearcoat),
            "clearcoatRoughnessFactor": four(model.clearcoat_roughness),
        });
    }
    json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0],
            "metallicFactor": four(model.metallic),
            "roughnessFactor": four(model.roughness),
        },
        "extensions": extensions,
    })
}

/// Encodes a glTF 2.0 binary file: a sphere of radius one with the material of [`gltf_material`].
/// `note` is stored in the `extras` of the asset.
pub fn glb_sphere(name: &str, model: &MetallicRoughness, note: &str) -> Vec<u8> {
    let (mut points, mut triangles) = (Vec::<f32>::new(), Vec::<u16>::new());
    for i in 0..=RINGS {
        let (sin, cos) = (PI * f64::from(i) / f64::from(RINGS)).sin_cos();
        for k in 0..=AROUND {
            let (s, c) = (TAU * f64::from(k) / f64::from(AROUND)).sin_cos();
            points.extend([(sin * s) as f32, cos as f32, (sin * c) as f32]);
        }
    }
    for i in 0..RINGS {
        for k in 0..AROUND {
            let a = i * (AROUND + 1) + k;
            let b = a + AROUND + 1;
            // At a pole one side of the quad has no length.
            if i > 0 {
                triangles.extend([a, b, a + 1]);
            }
            if i + 1 < RINGS {
                triangles.extend([a + 1, b, b + 1]);
            }
        }
    }
    let count = points.len() / 3;
    let indices: Vec<u8> = triangles.iter().flat_map(|i| i.to_le_bytes()).collect();
    let places: Vec<u8> = points.iter().flat_map(|x| x.to_le_bytes()).collect();
    // Positions are also the normals: the sphere has radius one.
    let mut binary = places;
    let split = binary.len();
    binary.extend(indices);
    binary.resize(binary.len().next_multiple_of(4), 0);
    let material = gltf_material(name, model);
    let used: Vec<&String> = material["extensions"].as_object().into_iter().flat_map(|used| used.keys()).collect();
    let document = json!({
        "asset": {
            "version": "2.0", "generator": concat!("gonio ", env!("CARGO_PKG_VERSION")), "extras": { "note": note },
        },
        "extensionsUsed": used,
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": name }],
        "meshes": [{
            "name": "sphere",
            "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2, "material": 0 }],
        }],
        "materials": [material],
        "buffers": [{ "byteLength": binary.len() }],
        // Positions and normals share the first view, which therefore needs a stride.
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": split, "byteStride": 12, "target": 34962 },
            { "buffer": 0, "byteOffset": split, "byteLength": 2 * triangles.len(), "target": 34963 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": [-1.0, -1.0, -1.0], "max": [1.0, 1.0, 1.0] },
            { "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": triangles.len(), "type": "SCALAR" },
        ],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    container(&text, &binary)
}

/// Joins the JSON and the binary chunk, whose lengths should be multiples of four.
pub(crate) fn container(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut out = b"glTF".to_vec();
    out.extend(2_u32.to_le_bytes());
    out.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", binary)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_and_its_material_can_be_read() {
        let model = MetallicRoughness {
            base_color: DVec3::new(0.5, 0.25, 0.1),
            metallic: 0.2,
            roughness: 0.3,
            ior: 1.4,
            specular_color: DVec3::new(1.0, 0.5, 0.25),
            clearcoat: 0.75,
            clearcoat_roughness: 0.1,
        };
        let bytes = glb_sphere("a \"ball\"", &model, "for a test");
        let document = gltf_material("ball", &model);
        assert_eq!(document["extensions"]["KHR_materials_specular"]["specularColorFactor"][2], 0.25);
        assert_eq!(document["extensions"]["KHR_materials_clearcoat"]["clearcoatFactor"], 0.75);
        let json: Value = serde_json::from_slice(&gltf::Glb::from_slice(&bytes).unwrap().json).unwrap();
        assert_eq!(json["materials"][0]["name"], "a \"ball\"");
        let file = gltf::Gltf::from_slice(&bytes).unwrap();
        let pbr = file.materials().next().unwrap().pbr_metallic_roughness();
        assert_eq!(pbr.base_color_factor(), [0.5, 0.25, 0.1, 1.0]);
        assert_eq!((pbr.metallic_factor(), pbr.roughness_factor()), (0.2, 0.3));
        let path = std::path::Path::new("sphere.glb");
        let (mesh, defects) = crate::mesh::decode(path, &bytes).unwrap();
        assert_eq!(mesh.triangles().len(), usize::from(AROUND) * (2 * usize::from(RINGS) - 2));
        assert_eq!((defects.degenerate, defects.inside_out, defects.inconsistent_normals), (0, false, 0));
        let (centre, radius) = mesh.bounds();
        assert!(centre.length() < 1e-3 && (radius - 1.0).abs() < 1e-3);
    }
}
