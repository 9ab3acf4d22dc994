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
    /// Triangles with zero area are removed. If any normal is missing or unusable, all normals are
    /// computed as means over neighbouring triangles, except across edges sharper than 45 degrees.
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
        let extent = extent(&positions);
        let least = MIN_AREA * extent * extent;
        let sound: Vec<bool> = triangles.iter().map(|t| face(&positions, *t).length() > 2.0 * least).collect();
        let all = triangles.len();
        triangles = kept(triangles, &sound);
        if triangles.is_empty() {
            return Err(MeshError::AllDegenerate(all));
        }
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
    pub(crate) fn of_positions(places: &Plane<Option<DVec3>>, jump: f64) -> Result<(Self, MeshDefects), MeshError> {
        let (width, height) = places.size();
        let mut index = vec![u32::MAX; width * height];
        let mut positions = Vec::new();
        for (slot, place) in index.iter_mut().zip(places.as_slice()) {
            if let Some(place) = place.filter(|p| p.is_finite()) {
                *slot = positions.len() as u32;
                positions.push(place);
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

fn kept<T>(all: Vec<T>, keep: &[bool]) -> Vec<T> {
    all.into_iter().zip(keep).filter(|(_, keep)| **keep).map(|(item, _)| item).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a cube of side two about the origin, with split vertices as in a file of flat faces.
    fn cube() -> MeshParts {
        let mut parts = MeshParts::default();
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            for sign in [1.0, -1.0] {
                let (n, u) = (sign * axis, DVec3::new(axis.y, axis.z, axis.x));
                let v = n.cross(u);
                let first = parts.positions.len() as u32;
                parts.positions.extend([n - u - v, n + u - v, n + u + v, n - u + v]);
                parts.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            }
        }
        parts
    }

    #[test]
    fn cube_is_closed_and_keeps_its_edges() {
        let (mesh, defects) = Mesh::new(cube()).unwrap();
        let want = MeshDefects { triangles: 12, normals_computed: true, ..MeshDefects::default() };
        assert_eq!(defects, want);
        for (t, normals) in mesh.triangles().iter().zip(mesh.normals()) {
            let flat = face(mesh.positions(), *t).normalize();
            assert!(normals.iter().all(|n| (*n - flat).length() < 1e-12), "{normals:?}");
        }
        assert_eq!(mesh.bounds(), (DVec3::ZERO, 3.0_f64.sqrt()));
    }

    #[test]
    fn reports_defects_of_meshes() {
        let mut parts = cube();
        parts.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        assert!(Mesh::new(parts).unwrap().1.inside_out);
        let mut parts = cube();
        parts.triangles[0].swap(0, 1);
        assert_eq!(Mesh::new(parts).unwrap().1.inconsistent_edges, 3);
        let mut parts = cube();
        let repeated = parts.triangles[5];
        parts.triangles.extend([[1, 1, 2], repeated]);
        let defects = Mesh::new(parts).unwrap().1;
        assert_eq!((defects.degenerate, defects.non_manifold_edges, defects.triangles), (1, 3, 13));
        let mut parts = cube();
        parts.triangles.pop();
        assert_eq!(Mesh::new(parts).unwrap().1.open_edges, 3);
        let mut parts = cube();
        parts.normals = Some(parts.triangles.iter().map(|t| [-2.0 * face(&parts.positions, *t); 3]).collect());
        let (mesh, defects) = Mesh::new(parts).unwrap();
        assert_eq!((defects.inconsistent_normals, defects.normals_computed), (12, false));
        assert!(mesh.normals().iter().flatten().all(|n| (n.length() - 1.0).abs() < 1e-12));
        let mut parts = cube();
        parts.normals = Some(vec![[DVec3::ZERO; 3]; 12]);
        assert!(Mesh::new(parts).unwrap().1.normals_computed);
    }

    #[test]
    fn rejects_invalid_meshes() {
        let refused = |change: &dyn Fn(&mut MeshParts)| {
            let mut parts = cube();
            change(&mut parts);
            Mesh::new(parts).unwrap_err()
        };
        assert_eq!(refused(&|p| p.triangles.clear()), MeshError::Empty { vertices: 24, triangles: 0 });
        assert_eq!(refused(&|p| p.triangles[3][1] = 24), MeshError::Index { triangle: 3, index: 24, vertices: 24 });
        assert_eq!(refused(&|p| p.positions[7].y = f64::NAN), MeshError::NotFinite(7));
        assert_eq!(refused(&|p| p.normals = Some(Vec::new())), MeshError::Normals { normals: 0, triangles: 12 });
        let line = |p: &mut MeshParts| p.positions.iter_mut().for_each(|v| *v = DVec3::splat(v.x));
        assert_eq!(refused(&line), MeshError::AllDegenerate(12));
    }

    #[test]
    fn smooth_surfaces_have_smooth_normals() {
        // A cylinder of 24 sides without lids; every other side faces inwards.
        let sides = 24_u32;
        let ring = |z: f64| {
            (0..sides)
                .map(move |i| DVec3::from((glam::DVec2::from_angle(f64::from(i) * std::f64::consts::TAU / 24.0), z)))
        };
        let positions: Vec<DVec3> = ring(0.0).chain(ring(1.0)).collect();
        let mut triangles = Vec::new();
        for i in 0..sides {
            let (j, up) = ((i + 1) % sides, sides);
            let turn = |t: [u32; 3]| if i % 2 == 0 { t } else { [t[0], t[2], t[1]] };
            triangles.extend([turn([i, j, j + up]), turn([i, j + up, i + up])]);
        }
        let (mesh, defects) = Mesh::new(MeshParts { positions, triangles, normals: None }).unwrap();
        assert_eq!((defects.open_edges, defects.inconsistent_edges), (48, 24));
        for (triangle, normals) in mesh.triangles().iter().zip(mesh.normals()) {
            for (vertex, normal) in triangle.iter().zip(normals) {
                let place = mesh.positions()[*vertex as usize];
                let out = DVec3::new(place.x, place.y, 0.0);
                assert!(normal.dot(out).abs() > 0.999, "{normal} at {out}");
            }
        }
    }

    #[test]
    fn position_maps_are_cut_at_steps() {
        // Two planes one above the other, and a pixel without a position.
        let places = Plane::from_fn(10, 6, |x, y| {
            let z = if x < 5 { 0.0 } else { 40.0 };
            ((x, y) != (1, 1)).then(|| DVec3::new(x as f64, -(y as f64), z))
        });
        let (mesh, defects) = Mesh::of_positions(&places, 8.0).unwrap();
        // Eight columns of five quads remain without the step; six triangles touch the missing
        // pixel.
        assert_eq!(defects.triangles, 2 * 8 * 5 - 6);
        assert!(mesh.normals().iter().flatten().all(|n| (*n - DVec3::Z).length() < 1e-12));
        let none = Plane::from_fn(4, 4, |_, _| None);
        assert_eq!(Mesh::of_positions(&none, 8.0).unwrap_err(), MeshError::Empty { vertices: 0, triangles: 0 });
    }

    #[test]
    fn transformed_normals_stay_perpendicular() {
        let (mesh, _) = Mesh::new(cube()).unwrap();
        let squeeze = DMat4::from_scale(DVec3::new(-1.0, 3.0, 0.5)) * DMat4::from_rotation_z(0.4);
        let moved = mesh.transformed(&squeeze).unwrap();
        for (t, normals) in moved.triangles().iter().zip(moved.normals()) {
            let flat = face(moved.positions(), *t).normalize();
            assert!(normals.iter().all(|n| n.dot(flat) > 1.0 - 1e-9));
        }
        assert_eq!(mesh.transformed(&DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0))), Err(MeshError::Pose));
        assert_eq!(mesh.transformed(&DMat4::NAN), Err(MeshError::Pose));
    }
}
