//! Encoding of meshes.

use std::fmt::Write;

use gonio::shape::Mesh;

/// Encodes binary little-endian PLY: positions in double, normals in float precision. PLY has one
/// normal per vertex, so every corner of a triangle becomes a separate vertex; reading merges
/// vertices of the same position.
pub fn encode_ply(mesh: &Mesh) -> Vec<u8> {
    let triangles = mesh.triangles();
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property float nx\nproperty float ny\nproperty float nz\nelement face {}\n\
         property list uchar uint vertex_indices\nend_header\n",
        3 * triangles.len(),
        triangles.len()
    )
    .into_bytes();
    bytes.reserve(triangles.len() * (3 * 36 + 13));
    for (corners, normals) in triangles.iter().zip(mesh.normals()) {
        for (vertex, normal) in corners.iter().zip(normals) {
            bytes.extend(mesh.positions()[*vertex as usize].to_array().iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend(normal.to_array().iter().flat_map(|v| (*v as f32).to_le_bytes()));
        }
    }
    for triangle in 0..triangles.len() as u32 {
        bytes.push(3);
        bytes.extend((0..3).flat_map(|i| (3 * triangle + i).to_le_bytes()));
    }
    bytes
}

/// Encodes OBJ with a normal for each corner of each triangle. Reading restores the numbers
/// exactly.
pub fn encode_obj(mesh: &Mesh) -> Vec<u8> {
    let mut text = String::new();
    let written = "writing to a String cannot fail";
    for p in mesh.positions() {
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).expect(written);
    }
    for n in mesh.normals().iter().flatten() {
        writeln!(text, "vn {} {} {}", n.x, n.y, n.z).expect(written);
    }
    for (i, [a, b, c]) in mesh.triangles().iter().enumerate() {
        let n = 3 * i + 1;
        writeln!(text, "f {}//{n} {}//{} {}//{}", a + 1, b + 1, n + 1, c + 1, n + 2).expect(written);
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::mesh::decode;
    use glam::DVec3;
    use gonio::shape::MeshParts;

    #[test]
    fn meshes_round_trip() {
        let positions = (0..40).map(|i| f64::from(i) / 7.0).map(|t| DVec3::new(t.cos(), t.sin(), 0.1 * t));
        let positions: Vec<DVec3> = positions.collect();
        let triangles: Vec<[u32; 3]> = (0..38).map(|i| [i, i + 1, i + 2]).collect();
        let (mesh, _) = Mesh::new(MeshParts { positions, triangles, normals: None }).unwrap();
        let (from_obj, defects) = decode(Path::new("a"), &encode_obj(&mesh)).unwrap();
        assert!(!defects.normals_computed);
        assert_eq!((from_obj.positions(), from_obj.triangles()), (mesh.positions(), mesh.triangles()));
        let (from_ply, defects) = decode(Path::new("a"), &encode_ply(&mesh)).unwrap();
        assert_eq!((defects.triangles, defects.normals_computed), (38, false));
        for (got, tolerance) in [(&from_obj, 1e-15), (&from_ply, 1e-7)] {
            for (a, b) in got.normals().iter().flatten().zip(mesh.normals().iter().flatten()) {
                assert!((*a - *b).length() < tolerance);
            }
        }
        let place = |mesh: &Mesh, t: usize, c: usize| mesh.positions()[mesh.triangles()[t][c] as usize];
        assert!((0..38).all(|t| (0..3).all(|c| place(&from_ply, t, c) == place(&mesh, t, c))));
    }
}
