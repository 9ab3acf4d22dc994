//! Shadow rays from one point, sixteen at a time.

use std::array;

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::triangle::Triangle;

/// Number of rays that traverse the tree together.
const LANES: usize = 16;

type Lanes = [f32; LANES];

/// Factor of the distance at which a ray leaves a box, to tolerate rounding.
const BOX_SLACK: f32 = 1.000_001;

/// Task that determines which of several rays from one origin hit a triangle.
///
/// Rays of similar direction should be consecutive.
pub(super) struct Shadows<'a> {
    /// Bounding boxes of the triangles.
    pub(super) tree: &'a Bvh2,
    /// Triangles, in the order of the tree.
    pub(super) triangles: &'a [Triangle],
    pub(super) origin: Vec3A,
    pub(super) directions: &'a [Vec3A],
    /// Result for each direction.
    pub(super) blocked: &'a mut [bool],
}

impl pulp::NullaryFnOnce for Shadows<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let mut stack = Vec::with_capacity(64);
        for (directions, blocked) in self.directions.chunks(LANES).zip(self.blocked.chunks_mut(LANES)) {
            let mut packet = Packet::of(directions);
            stack.clear();
            stack.push(0);
            packet.trace(&mut stack, self.tree, self.triangles, self.origin);
            blocked.iter_mut().zip(packet.reach).for_each(|(blocked, reach)| *blocked = reach < 0.0);
        }
    }
}

/// Rays with a common origin.
struct Packet {
    direction: [Lanes; 3],
    inverse: [Lanes; 3],
    /// Sum of the directions.
    middle: Vec3A,
    /// Distance up to which a ray is tested: infinity, or -1 for a ray that is already blocked.
    reach: Lanes,
}

impl Packet {
    #[inline(always)]
    fn of(directions: &[Vec3A]) -> Self {
        let ray = |lane: usize| directions[lane.min(directions.len() - 1)];
        let direction = [0, 1, 2].map(|axis| array::from_fn(|lane| ray(lane)[axis]));
        // A finite slope instead of infinity, whose product with zero would not be a number.
        let inverse = |d: f32| if d.abs() < 1e-12 { 1e12 } else { 1.0 / d };
        Self {
            inverse: direction.map(|along: Lanes| along.map(inverse)),
            direction,
            middle: directions.iter().sum(),
            reach: array::from_fn(|lane| if lane < directions.len() { f32::INFINITY } else { -1.0 }),
        }
    }

    #[inline(always)]
    fn trace(&mut self, stack: &mut Vec<u32>, tree: &Bvh2, triangles: &[Triangle], origin: Vec3A) {
        while let Some(at) = stack.pop() {
            let node = &tree.nodes[at as usize];
            let first = node.first_index;
            if node.is_leaf() {
                for triangle in &triangles[first as usize..(first + node.prim_count) as usize] {
                    self.meet(triangle, origin);
                }
                if !self.is_open() {
                    return;
                }
                continue;
            }
            let [a, b] = [first, first + 1].map(|i| tree.nodes[i as usize].aabb());
            let order = if self.middle.dot(b.center() - a.center()) > 0.0 {
                [(first + 1, b), (first, a)]
            } else {
                [(first, a), (first + 1, b)]
            };
            for (index, bounds) in order {
                if self.enters(bounds, origin) {
                    stack.push(index);
                }
            }
        }
    }

    /// Returns whether any ray is not blocked yet.
    #[inline(always)]
    fn is_open(&self) -> bool {
        let mut any = false;
        for reach in &self.reach {
            any |= *reach > 0.0;
        }
        any
    }

    /// Returns whether any ray that is not blocked yet enters a box.
    #[inline(always)]
    fn enters(&self, bounds: &Aabb, origin: Vec3A) -> bool {
        let (low, high) = (bounds.min - origin, bounds.max - origin);
        let [x, y, z] = &self.inverse;
        let mut any = false;
        for lane in 0..LANES {
            let (xa, xb) = (low.x * x[lane], high.x * x[lane]);
            let (ya, yb) = (low.y * y[lane], high.y * y[lane]);
            let (za, zb) = (low.z * z[lane], high.z * z[lane]);
            let near = larger(larger(smaller(xa, xb), smaller(ya, yb)), larger(smaller(za, zb), 0.0));
            let far = smaller(smaller(larger(xa, xb), larger(ya, yb)), smaller(larger(za, zb), self.reach[lane]));
            any |= BOX_SLACK * far >= near;
        }
        any
    }

    /// Marks the rays that hit a triangle.
    ///
    /// A ray hits the triangle if it passes the three planes through the origin and an edge on the
    /// same side. For a common edge, neighbouring triangles have the same plane normal up to its
    /// sign, so no ray passes between them.
    #[inline(always)]
    fn meet(&mut self, triangle: &Triangle, origin: Vec3A) {
        let (a, b, c) = (triangle.v0 - origin, triangle.v1 - origin, triangle.v2 - origin);
        let (u, v, w) = (c.cross(b), a.cross(c), b.cross(a));
        // The sign makes the test independent of the side from which the triangle is hit.
        let side = if a.dot(u) < 0.0 { -1.0 } else { 1.0 };
        let (u, v, w) = (side * u, side * v, side * w);
        let [x, y, z] = &self.direction;
        for lane in 0..LANES {
            let along = |n: Vec3A| n.x * x[lane] + n.y * y[lane] + n.z * z[lane];
            let (u, v, w) = (along(u), along(v), along(w));
            let inside = (smaller(smaller(u, v), w) >= 0.0) & (u + v + w > 0.0);
            self.reach[lane] = if inside { -1.0 } else { self.reach[lane] };
        }
    }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
