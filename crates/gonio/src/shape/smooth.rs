//! Smooth normals for meshes without normals.

use glam::DVec3;

use super::topology::{Topology, face};

/// Largest angle in degrees between triangles with a smooth common edge.
const CREASE: f64 = 45.0;

/// Computes the mean normal of the triangles around each corner.
///
/// Triangles are weighted by their angle at the corner (Thürmer & Wüthrich 1998). Only those within
/// [`CREASE`] of the corner's own triangle count. Neighbours of opposite orientation count with
/// their normal flipped.
pub(super) fn smooth_normals(topology: &Topology, positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<[DVec3; 3]> {
    let faces: Vec<DVec3> = triangles.iter().map(|t| face(positions, *t).normalize_or_zero()).collect();
    let mut around: Vec<Vec<(u32, f64)>> = vec![Vec::new(); positions.len()];
    for (f, triangle) in triangles.iter().enumerate() {
        for corner in 0..3 {
            let [at, next, last] = [0, 1, 2].map(|k| positions[triangle[(corner + k) % 3] as usize]);
            let angle = (next - at).angle_between(last - at);
            around[topology.welded[triangle[corner] as usize] as usize].push((f as u32, angle));
        }
    }
    let least = CREASE.to_radians().cos();
    let normal = |own: DVec3, vertex: u32| {
        let near = around[topology.welded[vertex as usize] as usize].iter().filter_map(|&(f, angle)| {
            let other = faces[f as usize];
            let cosine = own.dot(other);
            (cosine.abs() >= least).then(|| angle * cosine.signum() * other)
        });
        near.sum::<DVec3>().try_normalize().unwrap_or(own)
    };
    triangles.iter().zip(&faces).map(|(t, own)| t.map(|vertex| normal(*own, vertex))).collect()
}
