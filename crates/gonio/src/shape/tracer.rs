//! Ray tracing of a mesh.

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, leaf_collapser::collapse, reinsertion::ReinsertionOptimizer};
use obvhs::ploc::PlocBuilder;
use obvhs::ray::RayHit;
use obvhs::triangle::Triangle;

use super::Ray;
use super::mesh::Mesh;
use super::packet::Shadows;
use super::surface::{Hit, Surface};
use super::topology::face;

/// Height above the surface at which rays towards the light start, relative to the object's size.
///
/// Single precision allows no smaller value.
const LIFT: f64 = 2e-5;

/// Smallest cosine between the mean of a triangle's normals and its plane's normal.
///
/// Below it, the triangle is a sliver or a fold.
const SLIVER: f64 = 0.3;

/// Padding of the boxes around triangles, relative to the object's size.
const PAD: f32 = 1e-6;

/// Largest number of triangles in a leaf.
const LEAF: u32 = 8;
/// Cost of a box relative to that of a triangle, for rays that are traced together.
const COST: f32 = 2.0;

/// A mesh with an acceleration structure for ray intersection.
pub struct Tracer {
    mesh: Mesh,
    /// Bounding volumes of `triangles`, scaled so that the bounding sphere has radius one.
    tree: Bvh2,
    triangles: Vec<Triangle>,
    centre: DVec3,
    radius: f64,
}

impl Tracer {
    /// Builds the acceleration structure of a mesh in camera coordinates.
    pub fn new(mesh: Mesh) -> Self {
        let (centre, radius) = mesh.bounds();
        // Coordinates are in units of the object's size, because files are in millimetres or in
        // kilometres, and rays are traced in single precision.
        let place = |i: u32| Vec3A::from(((mesh.positions()[i as usize] - centre) / radius).as_vec3());
        let unsorted: Vec<Triangle> =
            mesh.triangles().iter().map(|t| Triangle { v0: place(t[0]), v1: place(t[1]), v2: place(t[2]) }).collect();
        // Boxes are padded: one with an axis-parallel side can end a rounding error short of it,
        // and a ray along that side would miss both neighbours.
        let boxes: Vec<Aabb> = unsorted
            .iter()
            .map(|t| {
                let tight = t.aabb();
                Aabb::new(tight.min - Vec3A::splat(PAD), tight.max + Vec3A::splat(PAD))
            })
            .collect();
        let build = BvhBuildParams::medium_build();
        let mut tree = PlocBuilder::with_capacity(unsorted.len()).build(
            build.ploc_search_distance,
            &boxes,
            (0..unsorted.len() as u32).collect(),
            build.sort_precision,
            build.search_depth_threshold,
        );
        ReinsertionOptimizer::default().run(&mut tree, build.reinsertion_batch_ratio, None);
        collapse(&mut tree, LEAF, COST);
        let triangles = tree.primitive_indices.iter().map(|&i| unsorted[i as usize]).collect();
        Self { mesh, tree, triangles, centre, radius }
    }

    /// Returns the mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Returns the centre of the bounding box and the radius of the sphere about it.
    ///
    /// The sphere contains the mesh.
    pub fn bounds(&self) -> (DVec3, f64) {
        (self.centre, self.radius)
    }

    /// Transforms a ray to the frame of the tree and clips it to the bounding sphere.
    ///
    /// Returns `None` if the ray misses the sphere.
    fn local(&self, ray: &Ray) -> Option<obvhs::ray::Ray> {
        let o = (ray.origin - self.centre) / self.radius;
        let nearest = -o.dot(ray.direction);
        let square = 1.0 + 1e-6 - (o + nearest * ray.direction).length_squared();
        if square <= 0.0 {
            return None;
        }
        let (enter, leave) = ((nearest - square.sqrt()).max(0.0), nearest + square.sqrt());
        if leave <= enter {
            return None;
        }
        let origin = Vec3A::from((o + enter * ray.direction).as_vec3());
        // Adding zero removes the sign of negative zeros: the tree determines the octant and the
        // slope by different tests of the sign.
        let direction = Vec3A::from(ray.direction.as_vec3()) + Vec3A::ZERO;
        Some(obvhs::ray::Ray::new(origin, direction, 0.0, (leave - enter) as f32))
    }
}

/// A ray sheared to run along an axis, for a watertight triangle test (Woop, Benthin & Wald 2013).
struct Sheared {
    axes: [usize; 3],
    shear: [f32; 3],
    origin: Vec3A,
    reach: f32,
}

impl Sheared {
    fn new(ray: &obvhs::ray::Ray) -> Self {
        let d = ray.direction;
        let z = d.abs().max_position();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if d[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        Self { axes: [x, y, z], shear: [d[x] / d[z], d[y] / d[z], 1.0 / d[z]], origin: ray.origin, reach: ray.tmax }
    }

    /// Returns the distance at which the ray hits a triangle before `most`, or infinity.
    fn meet(&self, triangle: &Triangle, most: f32) -> f32 {
        let [x, y, z] = self.axes;
        let [sx, sy, sz] = self.shear;
        let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2].map(|v| v - self.origin);
        let flat = |p: Vec3A| (p[x] - sx * p[z], p[y] - sy * p[z]);
        let (pa, pb, pc) = (flat(a), flat(b), flat(c));
        let edge = |p: (f32, f32), q: (f32, f32)| {
            let area = p.0 * q.1 - p.1 * q.0;
            if area != 0.0 {
                f64::from(area)
            } else {
                f64::from(p.0) * f64::from(q.1) - f64::from(p.1) * f64::from(q.0)
            }
        };
        let (u, v, w) = (edge(pc, pb), edge(pa, pc), edge(pb, pa));
        let (some, all) = (u.min(v).min(w) < 0.0, u.max(v).max(w) > 0.0);
        let det = u + v + w;
        if (some && all) || det == 0.0 {
            return f32::INFINITY;
        }
        let distance = ((u * f64::from(sz * a[z]) + v * f64::from(sz * b[z]) + w * f64::from(sz * c[z])) / det) as f32;
        if distance >= 0.0 && distance <= most.min(self.reach) { distance } else { f32::INFINITY }
    }
}

impl Surface for Tracer {
    fn hit(&self, ray: &Ray) -> Option<Hit> {
        let local = self.local(ray)?;
        let (mut found, sheared) = (RayHit::none(), Sheared::new(&local));
        if !self.tree.ray_traverse(local, &mut found, |ray, i| sheared.meet(&self.triangles[i], ray.tmax)) {
            return None;
        }
        let index = self.tree.primitive_indices[found.primitive_id as usize] as usize;
        let triangle = self.mesh.triangles()[index];
        let [a, b, c] = triangle.map(|i| self.mesh.positions()[i as usize]);
        // The intersection is recomputed in double precision.
        let area = face(self.mesh.positions(), triangle);
        let flat = area.normalize();
        let slope = flat.dot(ray.direction);
        let distance = if slope.abs() > 1e-12 {
            flat.dot(a - ray.origin) / slope
        } else {
            (0.5 * (a + b) - ray.origin).dot(ray.direction)
        };
        let position = ray.origin + distance * ray.direction;
        let share = |p: DVec3, q: DVec3| ((p - position).cross(q - position).dot(flat) / area.length()).clamp(0.0, 1.0);
        let (u, v, w) = (share(b, c), share(c, a), share(a, b));
        let inside = slope > 0.0;
        let facing = if inside { -flat } else { flat };
        // Each normal is flipped to the visible side individually, because files mix both sides.
        // For a sliver, whose plane is unreliable, the ray determines the visible side.
        let given = self.mesh.normals()[index];
        let sliver = (given[0] + given[1] + given[2]).normalize_or_zero().dot(flat).abs() < SLIVER;
        let side = if sliver { -ray.direction } else { facing };
        let [na, nb, nc] = given.map(|n| if n.dot(side) < 0.0 { -n } else { n });
        let normal = (u * na + v * nb + w * nc).try_normalize().unwrap_or(facing);
        // Hanika (2021), Hacking the Shadow Terminator: lifts the point above the tangent planes of
        // the corners, where the smooth surface is, except where it curves inwards.
        let above = |corner: DVec3, n: DVec3| (position - corner).dot(n).min(0.0) * n;
        let lift = -(u * above(a, na) + v * above(b, nb) + w * above(c, nc));
        let clear = position + lift + LIFT * self.radius * normal;
        Some(Hit { distance, position, normal, ray_origin: clear, back_facing: inside })
    }

    fn blocked(&self, origin: DVec3, directions: &[DVec3]) -> Vec<bool> {
        let directions: Vec<Vec3A> = directions.iter().map(|d| Vec3A::from(d.as_vec3())).collect();
        let origin = Vec3A::from(((origin - self.centre) / self.radius).as_vec3());
        let mut blocked = vec![false; directions.len()];
        let (tree, triangles) = (&self.tree, &self.triangles[..]);
        let task = Shadows { tree, triangles, origin, directions: &directions, blocked: &mut blocked };
        pulp::Arch::new().dispatch(task);
        blocked
    }
}
