//! Code common to all formats: triangulates polygons and limits the number of triangles.

use std::path::Path;

use glam::{DVec2, DVec3};
use gonio::shape::{Mesh, MeshDefects, MeshParts};

use super::MAX_TRIANGLES;
use crate::Error;

/// Largest number of corners of a concave polygon; the time to triangulate it grows with the cube.
const MAX_CONCAVE: usize = 256;

/// Largest number of displaced vertices in all morph targets of a file.
const MAX_DISPLACEMENTS: u64 = 1 << 27;

/// Contents collected from a file.
pub(super) struct MeshBuilder<'a> {
    path: &'a Path,
    pub(super) positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<[DVec3; 3]>,
    any_normals: bool,
    /// Number of displaced vertices in the morph targets read so far.
    displacements: u64,
}

impl<'a> MeshBuilder<'a> {
    pub(super) fn new(path: &'a Path) -> Self {
        let (positions, triangles, normals) = (Vec::new(), Vec::new(), Vec::new());
        Self { path, positions, triangles, normals, any_normals: false, displacements: 0 }
    }

    /// Returns whether there are no triangles yet.
    pub(super) fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Checks that `more` triangles or vertices do not exceed the limit.
    pub(super) fn room_for(&self, more: u64) -> Result<(), Error> {
        let most = self.triangles.len().max(self.positions.len()) as u64;
        if most.saturating_add(more) > MAX_TRIANGLES as u64 {
            let problem = format!("has more than {MAX_TRIANGLES} triangles or vertices");
            return Err(Error::limits(self.path, problem, "simplify the mesh"));
        }
        Ok(())
    }

    /// Checks that `more` displaced vertices in morph targets do not exceed the limit. Targets may
    /// share their data, so a small file could have very many.
    pub(super) fn room_for_displacements(&mut self, more: u64) -> Result<(), Error> {
        self.displacements = self.displacements.saturating_add(more);
        if self.displacements > MAX_DISPLACEMENTS {
            let problem = format!("has more than {MAX_DISPLACEMENTS} displaced vertices in morph targets");
            return Err(Error::limits(self.path, problem, "apply the morph targets before exporting"));
        }
        Ok(())
    }

    /// Adds a polygon given by the indices and the normals of its corners. A missing normal is
    /// [`DVec3::ZERO`]. Polygons with fewer than three corners are ignored.
    ///
    /// # Panics
    /// If the numbers of corners and normals differ.
    pub(super) fn polygon(&mut self, corners: &[u32], normals: &[DVec3]) -> Result<(), Error> {
        assert_eq!(corners.len(), normals.len(), "one normal per corner");
        if corners.len() < 3 {
            return Ok(());
        }
        self.room_for(corners.len() as u64 - 2)?;
        self.any_normals |= normals.iter().any(|n| *n != DVec3::ZERO);
        let mut add = |t: [usize; 3]| {
            self.triangles.push(t.map(|i| corners[i]));
            self.normals.push(t.map(|i| normals[i]));
        };
        if corners.len() == 3 {
            add([0, 1, 2]);
            return Ok(());
        }
        let vertices = self.positions.len();
        let position = |&i: &u32| self.positions.get(i as usize).copied();
        let Some(polygon) = corners.iter().map(position).collect::<Option<Vec<DVec3>>>() else {
            let index = corners.iter().max().copied().unwrap_or_default();
            let problem = format!("has a face that refers to vertex {index}, but there are only {vertices}");
            return Err(Error::damaged(self.path, problem));
        };
        let Some(cut) = triangulate(&polygon) else {
            let problem = format!("has a face with {} corners that is not convex", corners.len());
            return Err(Error::unsupported(self.path, problem, "triangulate the mesh on export"));
        };
        cut.into_iter().for_each(add);
        Ok(())
    }

    /// Builds the mesh, or returns the error of [`Mesh::new`].
    pub(super) fn finish(self) -> Result<(Mesh, MeshDefects), Error> {
        let normals = self.any_normals.then_some(self.normals);
        Mesh::new(MeshParts { positions: self.positions, triangles: self.triangles, normals }).map_err(|e| {
            // The text of the error ends with the advice.
            let text = e.to_string();
            let (problem, advice) = text.rsplit_once("; ").unwrap_or((&text, "export the mesh again"));
            Error::invalid(self.path, problem, advice)
        })
    }
}

/// Triangulates a polygon, as indices of its corners; `None` if it is not convex and has too many
/// corners. A polygon that intersects itself gives the same number of triangles, some of which
/// overlap.
fn triangulate(polygon: &[DVec3]) -> Option<Vec<[usize; 3]>> {
    let flat = flatten(polygon);
    let count = flat.len();
    let turn = |a: usize, b: usize, c: usize| (flat[b] - flat[a]).perp_dot(flat[c] - flat[b]);
    let convex = (0..count).all(|i| turn(i, (i + 1) % count, (i + 2) % count) >= 0.0);
    if convex {
        return Some((1..count - 1).map(|i| [0, i, i + 1]).collect());
    }
    if count > MAX_CONCAVE {
        return None;
    }
    // Clips one ear at a time.
    let mut left: Vec<usize> = (0..count).collect();
    let mut triangles = Vec::with_capacity(count - 2);
    while left.len() > 3 {
        let n = left.len();
        let corner = |i: usize| (left[(i + n - 1) % n], left[i], left[(i + 1) % n]);
        let ear = (0..n).find(|&i| {
            let (a, b, c) = corner(i);
            let inside = |&p: &usize| {
                let other = p != a && p != b && p != c;
                other && turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
            };
            turn(a, b, c) > 0.0 && !left.iter().any(inside)
        });
        let ear = ear.unwrap_or(0);
        let (a, b, c) = corner(ear);
        triangles.push([a, b, c]);
        left.remove(ear);
    }
    triangles.push([left[0], left[1], left[2]]);
    Some(triangles)
}

/// Projects the polygon to its mean plane, counterclockwise.
fn flatten(polygon: &[DVec3]) -> Vec<DVec2> {
    let origin = polygon[0];
    let next = polygon.iter().cycle().skip(1);
    let area: DVec3 = polygon.iter().zip(next).map(|(p, q)| (*p - origin).cross(*q - origin)).sum();
    let normal = area.try_normalize().unwrap_or(DVec3::Z);
    let u = normal.any_orthonormal_vector();
    let v = normal.cross(u);
    polygon.iter().map(|p| DVec2::new((*p - origin).dot(u), (*p - origin).dot(v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(polygon: &[DVec3], triangles: &[[usize; 3]]) -> f64 {
        let twice = |t: &[usize; 3]| (polygon[t[1]] - polygon[t[0]]).cross(polygon[t[2]] - polygon[t[0]]).z;
        assert!(triangles.iter().all(|t| twice(t) >= 0.0), "a triangle is turned over: {triangles:?}");
        triangles.iter().map(twice).sum::<f64>() / 2.0
    }

    fn polygon(flat: &[(f64, f64)]) -> Vec<DVec3> {
        flat.iter().map(|&(x, y)| DVec3::new(x, y, 3.0)).collect()
    }

    #[test]
    fn polygons_are_covered_once() {
        let arrow = polygon(&[(0.0, 0.0), (2.0, -1.0), (0.5, 0.0), (2.0, 1.0)]);
        let comb: Vec<(f64, f64)> = (0..20)
            .map(|i| (f64::from(19 - i), if i % 2 == 0 { 5.0 } else { 1.0 }))
            .chain([(0.0, 0.0), (19.0, 0.0)])
            .collect();
        let comb = polygon(&comb);
        for (polygon, want) in [(&arrow, 0.5), (&comb, 19.0 * 3.0)] {
            // The area does not depend on the first corner.
            for shift in 0..polygon.len() {
                let mut turned = polygon.clone();
                turned.rotate_left(shift);
                let cut = triangulate(&turned).unwrap();
                assert_eq!(cut.len(), polygon.len() - 2);
                assert!((area(&turned, &cut) - want).abs() < 1e-12, "{shift}");
            }
        }
    }

    #[test]
    fn triangulation_of_degenerate_polygons_terminates() {
        let crossed = polygon(&[(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.5, 3.0)]);
        assert_eq!(triangulate(&crossed).unwrap().len(), 3);
        assert_eq!(triangulate(&[DVec3::ONE; 9]).unwrap().len(), 7);
        assert_eq!(triangulate(&[DVec3::NAN; 5]).unwrap().len(), 3);
        let star: Vec<DVec3> = (0..1000)
            .map(|i| {
                (1.0 + f64::from(i % 2))
                    * DVec3::new((0.00628 * f64::from(i)).cos(), (0.00628 * f64::from(i)).sin(), 0.0)
            })
            .collect();
        assert_eq!(triangulate(&star), None);
    }
}
