//! Triangle meshes.

use glam::{DMat4, DVec3};
use thiserror::Error;

use super::smooth::smooth_normals;
use super::topology::{Topology, face};
use crate::picture::Plane;
use crate::statistics::median;

/// Contents of a mesh file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshParts {
    /// Positions of the vertices.
    pub positions: Vec<DVec3>,
    /// Three indices of vertices for each triangle, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Normals at the three corners of each triangle, if the file contains any.
    ///
    /// They need not have unit length. A missing normal is `ZERO`.
    pub normals: Option<Vec<[DVec3; 3]>>,
}

/// Triangles with a normal at each corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<[DVec3; 3]>,
}

/// Defects of a mesh, none of which makes it unusable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshDefects {
    /// Number of triangles that are kept.
    pub triangles: usize,
    /// Number of triangles with zero area, which are removed.
    pub degenerate: usize,
    /// Number of edges with only one triangle; zero for a closed surface.
    pub open_edges: usize,
    /// Number of edges with three triangles or more.
    pub non_manifold_edges: usize,
    /// Number of edges whose two triangles are oriented inconsistently.
    pub inconsistent_edges: usize,
    /// Whether the surface is closed and its triangles face inwards.
    pub inside_out: bool,
    /// Number of triangles whose normals in the file contradict the order of their corners.
    pub inconsistent_normals: usize,
    /// Whether the normals were computed, because those of the file are missing or unusable.
    pub normals_computed: bool,
}

/// Error of invalid mesh parts; each message suggests a correction.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MeshError {
    /// There are no triangles, or no vertices.
    #[error("the mesh is empty ({vertices} vertices, {triangles} triangles); export the surface with its faces")]
    Empty {
        /// Number of vertices.
        vertices: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// An index exceeds the number of vertices.
    #[error("triangle {triangle} refers to vertex {index}, but there are only {vertices}; export the mesh again")]
    Index {
        /// Index of the triangle, from 0.
        triangle: usize,
        /// Index of the vertex, from 0.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A position is not finite.
    #[error("vertex {0} has coordinates that are not finite; export the mesh again")]
    NotFinite(usize),
    /// The number of normals is not three for each triangle.
    #[error("{normals} of {triangles} triangles have normals; export the mesh again")]
    Normals {
        /// Number of triples of normals.
        normals: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// No triangle has a positive area.
    #[error("all {0} triangles have zero area; check that the mesh is not flattened to a line or a point")]
    AllDegenerate(usize),
    /// The transformation flattens the mesh.
    #[error("the pose flattens the object or is not finite; use a rotation, a translation and a nonzero scale")]
    Pose,
}

/// Smallest area of a triangle relative to a square as large as the object.
///
/// Triangles with a smaller area are degenerate.
const MIN_AREA: f64 = 1e-16;

impl Mesh {
    /// Builds a mesh from its parts.
    ///
    /// Triangles with zero area are removed, and vertices that no other triangle uses. If any
    /// normal is missing or unusable, all normals are computed as means over neighbouring
    /// triangles, except across edges sharper than 45 degrees.
    ///
    /// # Errors
    /// If the parts are empty, an index is out of range, or a position is not finite.
    pub fn new(parts: MeshParts) -> Result<(Self, MeshDefects), MeshError> {
        let MeshParts { positions, mut triangles, normals } = parts;
        if positions.is_empty() || triangles.is_empty() {
            return Err(MeshError::Empty { vertices: positions.len(), triangles: triangles.len() });
        }
        let vertices = positions.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&i| i as usize >= vertices) {
                return Err(MeshError::Index { triangle, index, vertices });
            }
        }
        if let Some(i) = positions.iter().position(|p| !p.is_finite() || p.abs().max_element() > 1e30) {
            return Err(MeshError::NotFinite(i));
        }
        if let Some(normals) = &normals
            && normals.len() != triangles.len()
        {
            return Err(MeshError::Normals { normals: normals.len(), triangles: triangles.len() });
        }
        let corners: Vec<DVec3> = triangles.iter().flatten().map(|&i| positions[i as usize]).collect();
        let extent = extent(&corners);
        let least = MIN_AREA * extent * extent;
        let sound: Vec<bool> = triangles.iter().map(|t| face(&positions, *t).length() > 2.0 * least).collect();
        let all = triangles.len();
        triangles = kept(triangles, &sound);
        if triangles.is_empty() {
            return Err(MeshError::AllDegenerate(all));
        }
        // Loose vertices would enlarge the bounds of the mesh.
        let positions = referenced(positions, &mut triangles);
        let topology = Topology::of(&positions, &triangles);
        let given = normals.map(|n| kept(n, &sound)).filter(|n| n.iter().flatten().all(usable));
        let normals_computed = given.is_none();
        let normals = given.unwrap_or_else(|| smooth_normals(&topology, &positions, &triangles));
        let normals: Vec<[DVec3; 3]> = normals.into_iter().map(|n| n.map(DVec3::normalize)).collect();
        let against =
            triangles.iter().zip(&normals).filter(|(t, n)| face(&positions, **t).dot(n[0] + n[1] + n[2]) < 0.0);
        let defects = MeshDefects {
            triangles: triangles.len(),
            degenerate: all - triangles.len(),
            open_edges: topology.open_edges,
            non_manifold_edges: topology.non_manifold_edges,
            inconsistent_edges: topology.inconsistent_edges,
            inside_out: topology.is_closed() && volume(&positions, &triangles) < 0.0,
            inconsistent_normals: against.count(),
            normals_computed,
        };
        Ok((Self { positions, triangles, normals }, defects))
    }

    /// Builds the surface of a position map, in any frame.
    ///
    /// Each square of four neighbouring pixels with positions gives two triangles, except across
    /// steps. A step is an edge more than `jump` times as long as the median one (8 is a good
    /// value).
    ///
    /// # Errors
    /// [`MeshError::Empty`] if no pixels are neighbours.
    pub(crate) fn of_positions(map: &Plane<Option<DVec3>>, jump: f64) -> Result<(Self, MeshDefects), MeshError> {
        let (width, height) = map.size();
        let mut index = vec![u32::MAX; width * height];
        let mut positions = Vec::new();
        for (slot, position) in index.iter_mut().zip(map.as_slice()) {
            if let Some(position) = position.filter(|p| p.is_finite()) {
                *slot = positions.len() as u32;
                positions.push(position);
            }
        }
        let at = |x: usize, y: usize| index[y * width + x];
        let mut triangles = Vec::new();
        for y in 0..height.saturating_sub(1) {
            for x in 0..width.saturating_sub(1) {
                // Rows run down, so this order is counterclockwise for a camera that looks along
                // -z.
                let [a, b, c, d] = [at(x, y), at(x, y + 1), at(x + 1, y + 1), at(x + 1, y)];
                triangles.extend([[a, b, c], [a, c, d]].into_iter().filter(|t| !t.contains(&u32::MAX)));
            }
        }
        if triangles.is_empty() {
            return Err(MeshError::Empty { vertices: positions.len(), triangles: 0 });
        }
        let longest = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            (b - a).length().max((c - b).length()).max((a - c).length())
        };
        let median = median(triangles.iter().map(longest)).unwrap_or(0.0);
        triangles.retain(|t| longest(t) <= jump * median);
        Self::new(MeshParts { positions, triangles, normals: None })
    }

    /// Translates, rotates, scales or mirrors the mesh.
    ///
    /// # Errors
    /// [`MeshError::Pose`].
    pub fn transformed(&self, by: &DMat4) -> Result<Self, MeshError> {
        let normal_matrix = glam::DMat3::from_mat4(*by).inverse().transpose();
        let mirrored = glam::DMat3::from_mat4(*by).determinant();
        let affine = (by.row(3) - glam::DVec4::W).length() < 1e-6;
        if !(affine && by.is_finite() && normal_matrix.is_finite() && mirrored != 0.0) {
            return Err(MeshError::Pose);
        }
        let positions = self.positions.iter().map(|p| by.transform_point3(*p)).collect();
        let normals = self.normals.iter().map(|n| n.map(|n| (normal_matrix * n).normalize())).collect();
        let turn = |&[a, b, c]: &[u32; 3]| if mirrored < 0.0 { [a, c, b] } else { [a, b, c] };
        let corners: Vec<[DVec3; 3]> = normals;
        let normals = if mirrored < 0.0 { corners.into_iter().map(|[a, b, c]| [a, c, b]).collect() } else { corners };
        Ok(Self { positions, triangles: self.triangles.iter().map(turn).collect(), normals })
    }

    /// Returns the positions of the vertices.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Returns the indices of the corners of each triangle.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Returns the unit normals at the corners of each triangle.
    pub fn normals(&self) -> &[[DVec3; 3]] {
        &self.normals
    }

    /// Returns the centre of the bounding box and the distance of the farthest vertex from it.
    pub fn bounds(&self) -> (DVec3, f64) {
        let (low, high) = corners_of(&self.positions);
        let centre = 0.5 * (low + high);
        (centre, self.positions.iter().map(|p| (*p - centre).length()).fold(0.0, f64::max))
    }
}

fn usable(normal: &DVec3) -> bool {
    normal.is_finite() && normal.length() > 1e-3
}

fn corners_of(positions: &[DVec3]) -> (DVec3, DVec3) {
    positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}

/// Returns the longest side of the bounding box.
fn extent(positions: &[DVec3]) -> f64 {
    let (low, high) = corners_of(positions);
    (high - low).max_element()
}

/// Returns six times the volume within a closed surface, negative if its triangles face inwards.
fn volume(positions: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let centre = positions.iter().sum::<DVec3>() / positions.len() as f64;
    let each = triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| positions[i as usize] - centre);
        a.dot(b.cross(c))
    });
    each.sum()
}

/// Returns the vertices that triangles use, and adapts the indices of the triangles.
fn referenced(positions: Vec<DVec3>, triangles: &mut [[u32; 3]]) -> Vec<DVec3> {
    let mut is_used = vec![false; positions.len()];
    triangles.iter().flatten().for_each(|&i| is_used[i as usize] = true);
    let mut count = 0;
    let index = |used: &bool| {
        count += u32::from(*used);
        count.saturating_sub(1)
    };
    let indices: Vec<u32> = is_used.iter().map(index).collect();
    triangles.iter_mut().flatten().for_each(|i| *i = indices[*i as usize]);
    kept(positions, &is_used)
}

fn kept<T>(all: Vec<T>, keep: &[bool]) -> Vec<T> {
    all.into_iter().zip(keep).filter(|(_, keep)| **keep).map(|(item, _)| item).collect()
}

#[cfg(test)]
mod tests;
