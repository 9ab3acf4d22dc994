//! Connectivity of the triangles of a mesh.

use glam::DVec3;

/// Vertices welded by position, and counts of the edges between them.
pub(super) struct Topology {
    /// First vertex at the position of each vertex.
    pub(super) welded: Vec<u32>,
    /// Number of edges with one triangle.
    pub(super) open_edges: usize,
    /// Number of edges with more than two triangles.
    pub(super) non_manifold_edges: usize,
    /// Number of edges that both triangles traverse in the same direction.
    pub(super) inconsistent_edges: usize,
}

impl Topology {
    /// Welds the vertices, which files split at seams, by exact comparison of positions.
    pub(super) fn of(positions: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let key = |i: u32| (positions[i as usize] + DVec3::ZERO).to_array().map(f64::to_bits);
        let mut order: Vec<u32> = (0..positions.len() as u32).collect();
        order.sort_unstable_by_key(|&i| (key(i), i));
        let mut welded = vec![0; positions.len()];
        let mut first = 0;
        for (n, &i) in order.iter().enumerate() {
            if n == 0 || key(i) != key(first) {
                first = i;
            }
            welded[i as usize] = first;
        }
        // Each edge as (lower vertex, higher vertex, whether it runs upwards).
        let mut edges: Vec<(u32, u32, bool)> = Vec::with_capacity(3 * triangles.len());
        for triangle in triangles {
            let [a, b, c] = triangle.map(|i| welded[i as usize]);
            edges.extend([(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q), p < q)));
        }
        edges.sort_unstable();
        let mut topology = Self { welded, open_edges: 0, non_manifold_edges: 0, inconsistent_edges: 0 };
        for edge in edges.chunk_by(|p, q| (p.0, p.1) == (q.0, q.1)) {
            match edge {
                [_] => topology.open_edges += 1,
                [p, q] => topology.inconsistent_edges += usize::from(p.2 == q.2),
                _ => topology.non_manifold_edges += 1,
            }
        }
        topology
    }

    /// Returns whether the triangles bound a solid.
    pub(super) fn is_closed(&self) -> bool {
        self.open_edges + self.non_manifold_edges + self.inconsistent_edges == 0
    }
}

/// Returns twice the area of a triangle along its normal.
pub(super) fn face(positions: &[DVec3], triangle: [u32; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(|i| positions[i as usize]);
    (b - a).cross(c - a)
}
