//! Built-in test shapes.

use std::collections::HashMap;

use glam::DVec3;

use super::{Mesh, MeshError, MeshParts};
use crate::parallel;

/// A shape of about radius one about the origin, upright, with its front towards +z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuiltInShape {
    /// A lump with gentle hollows.
    Blob,
    /// An animal with long ears.
    Bunny,
    /// Half of a thick hollow ball, open towards the camera and a little upwards.
    Bowl,
}

impl BuiltInShape {
    /// Number of cells along a side of the lattice from which these shapes are meshed for display.
    pub const CELLS: usize = 96;

    /// Returns the shape with a lower-case name: `blob`, `bunny`, `bowl`.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "blob" => Self::Blob,
            "bunny" => Self::Bunny,
            "bowl" => Self::Bowl,
            _ => return None,
        })
    }

    /// Returns the implicit function, negative inside the shape.
    fn field(self) -> fn(DVec3) -> f64 {
        match self {
            Self::Blob => blob,
            Self::Bunny => bunny,
            Self::Bowl => bowl,
        }
    }

    /// Meshes the surface on a lattice of `cells` cells along each side.
    ///
    /// The mesh has about `8 cells^2` triangles, with normals from the gradient of the implicit
    /// function.
    ///
    /// # Errors
    /// If the lattice is too coarse for the shape.
    ///
    /// # Panics
    /// If `cells` is zero or more than 400.
    pub fn mesh(self, cells: usize) -> Result<Mesh, MeshError> {
        isosurface(self.field(), 1.3, cells)
    }
}

/// Returns the minimum with a rounded seam of width `k`.
fn blend(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * k * h * h
}

fn ball(p: DVec3, centre: DVec3, radius: f64) -> f64 {
    (p - centre).length() - radius
}

/// Returns the approximate distance to an ellipsoid.
fn egg(p: DVec3, centre: DVec3, axes: DVec3) -> f64 {
    let q = (p - centre) / axes;
    let (k, g) = (q.length(), (q / axes).length());
    if g < 1e-12 { -axes.min_element() } else { k * (k - 1.0) / g }
}

fn blob(p: DVec3) -> f64 {
    let parts = [
        ball(p, DVec3::new(0.0, -0.15, 0.0), 0.72),
        ball(p, DVec3::new(0.45, 0.4, 0.2), 0.42),
        ball(p, DVec3::new(-0.5, 0.3, 0.3), 0.38),
        ball(p, DVec3::new(0.2, -0.55, 0.45), 0.36),
    ];
    parts.into_iter().reduce(|a, b| blend(a, b, 0.5)).unwrap_or(1.0)
}

fn bunny(p: DVec3) -> f64 {
    // An ear is a tilted ellipsoid.
    let ear = |side: f64| {
        let q = p - DVec3::new(0.2 * side, 0.78, 0.18);
        let (s, c) = (0.22 * side).sin_cos();
        egg(DVec3::new(c * q.x - s * q.y, s * q.x + c * q.y, q.z), DVec3::ZERO, DVec3::new(0.11, 0.36, 0.09))
    };
    let parts = [
        (egg(p, DVec3::new(0.0, -0.4, -0.1), DVec3::new(0.55, 0.55, 0.6)), 0.1),
        (ball(p, DVec3::new(0.0, 0.28, 0.28), 0.36), 0.18),
        (ear(1.0), 0.08),
        (ear(-1.0), 0.08),
        (egg(p, DVec3::new(0.3, -0.8, 0.4), DVec3::new(0.16, 0.13, 0.26)), 0.1),
        (egg(p, DVec3::new(-0.3, -0.8, 0.4), DVec3::new(0.16, 0.13, 0.26)), 0.1),
        (ball(p, DVec3::new(0.0, 0.22, 0.62), 0.1), 0.1),
    ];
    parts.into_iter().reduce(|(a, _), (b, k)| (blend(a, b, k), k)).map_or(1.0, |(d, _)| d)
}

fn bowl(p: DVec3) -> f64 {
    let shell = (p.length() - 0.85).abs() - 0.1;
    let front = p.dot(DVec3::new(0.0, 0.25, 1.0).normalize()) - 0.1;
    -blend(-shell, -front, 0.08)
}

/// Tetrahedra of a cell, by the indices of its corners: bit 0 is x, bit 1 is y, bit 2 is z.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// Meshes the zero set of `field` in the cube from `-half` to `half`.
///
/// The method is marching tetrahedra (Doi & Koide 1991).
fn isosurface(field: fn(DVec3) -> f64, half: f64, cells: usize) -> Result<Mesh, MeshError> {
    assert!((1..=400).contains(&cells), "{cells} cells");
    let (n, step) = (cells + 1, 2.0 * half / cells as f64);
    let place =
        |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) * step - DVec3::splat(half);
    let values: Vec<f64> = parallel::map_range(n * n * n, |i| field(place(i)));
    let mut crossings: Vec<(usize, usize)> = Vec::new();
    let mut index: HashMap<(usize, usize), u32> = HashMap::new();
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for cell in (0..n * n * n).filter(|&i| [i % n, i / n % n, i / n / n].iter().all(|&c| c < cells)) {
        let corner = |k: usize| cell + (k & 1) + (k >> 1 & 1) * n + (k >> 2) * n * n;
        for tetrahedron in TETRAHEDRA {
            let corners = tetrahedron.map(corner);
            let (inside, outside): (Vec<usize>, Vec<usize>) = corners.iter().partition(|&&c| values[c] < 0.0);
            let mut between = |a: usize, b: usize| {
                *index.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    crossings.push((a, b));
                    (crossings.len() - 1) as u32
                })
            };
            match (&inside[..], &outside[..]) {
                ([a], [b, c, d]) | ([b, c, d], [a]) => {
                    triangles.push([between(*a, *b), between(*a, *c), between(*a, *d)])
                }
                ([a, b], [c, d]) => {
                    let (p, q, r, s) = (between(*a, *c), between(*a, *d), between(*b, *d), between(*b, *c));
                    triangles.extend([[p, q, r], [p, r, s]]);
                }
                _ => (),
            }
        }
    }
    let root = |&(a, b): &(usize, usize)| {
        let (mut low, mut high) = if values[a] < 0.0 { (place(a), place(b)) } else { (place(b), place(a)) };
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if field(middle) < 0.0 { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    };
    let positions: Vec<DVec3> = parallel::map(&crossings, root);
    let h = 1e-5;
    let gradient = |p: &DVec3| {
        let along = |e: DVec3| field(*p + h * e) - field(*p - h * e);
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)).normalize_or(DVec3::Y)
    };
    let normals: Vec<DVec3> = parallel::map(&positions, gradient);
    for triangle in &mut triangles {
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        if (b - a).cross(c - a).dot(normals[triangle[0] as usize]) < 0.0 {
            triangle.swap(1, 2);
        }
    }
    let normals = triangles.iter().map(|t| t.map(|i| normals[i as usize])).collect();
    Mesh::new(MeshParts { positions, triangles, normals: Some(normals) }).map(|(mesh, _)| mesh)
}
