//! Agreement between the edges of a photograph and a circle, at two scales.
//!
//! Each pixel of a reduced photograph stores the dominant orientation of its edges as a vector in
//! doubled angles. Its product with the doubled direction from a centre is 1 for an edge
//! perpendicular to that direction, -1 for a parallel edge, and zero on average for texture. The
//! score of a circle is the mean of this product along it.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::circle::LEAST_RADIUS;
use super::circle_fit::Circle;
use super::rim::refined;
use super::small::Small;
use crate::picture::Plane;

/// Pixels along the longer side of the picture of the coarse scale.
const SIDE: usize = 128;
/// Least radius of a circle there, pixels, and the largest as a share of the shorter side.
const LEAST: f32 = 6.0;
const MOST_SHARE: f32 = 0.6;
/// Ratio of neighbouring radii, and pixels between neighbouring centres.
const GROWTH: f32 = 1.05;
const APART: usize = 2;
/// Directions along a circle, and those after which a poor circle is given up.
const DIRECTIONS: usize = 64;
const FIRST: usize = 16;
/// Least score of a circle after the first directions, and in the end.
const PROMISING: f32 = 0.15;
const LEAST_SCORE: f32 = 0.25;
/// Circles of the grid that are looked at more closely.
const CLOSER: usize = 400;
/// Circles around a promising one that are looked at too, and how far they are off it, as a share
/// of its radius: shading within a ball makes circles that touch its rim.
const AROUND: usize = 8;
const NEARBY: f32 = 0.1;
/// Share of the radius within which two circles are the same.
const SAME: f32 = 0.2;
/// Least product of an edge that supports a circle: within 30 degrees of its tangent.
const SUPPORTS: f32 = 0.5;
/// Strength of an edge that is no noise: squared change of the compressed values by a pixel.
const FAINT: f32 = 2e-5;
/// Share of the mean strength that is added to the strength of an edge before it counts.
const TEXTURE: f32 = 0.25;
/// Distance from a rim within which edges are those of its circle.
const RIM: f32 = 2.5;

/// The edges of a photograph at two scales. Shading shows smooth circles in the coarse one, texture
/// and noise hide edges in the fine one; the rim of a ball is in both.
pub(super) struct Edges {
    coarse: Field,
    fine: Field,
    /// Pixels of the photograph along a side of one of the coarse scale.
    step: f64,
    /// Pixels of the fine scale along a side of one of the coarse.
    ratio: f32,
}

impl Edges {
    pub(super) fn of(small: &Small) -> Self {
        let coarse = small.reduced(SIDE);
        Self {
            coarse: Field::of(&coarse.values),
            fine: Field::of(&small.values),
            step: coarse.step as f64,
            ratio: coarse.step as f32 / small.step as f32,
        }
    }

    /// The same without the edges at the rim of a circle.
    pub(super) fn without(&self, ring: &Ring) -> Self {
        let fine = self.fine.without(&ring.scaled(self.ratio), RIM * self.ratio);
        Self { coarse: self.coarse.without(ring, RIM), fine, step: self.step, ratio: self.ratio }
    }

    /// The circles of a grid with a good score at the coarse scale, each moved to the best place
    /// nearby, the one of most weight first.
    pub(super) fn best(&self) -> Vec<Ring> {
        self.coarse.best()
    }

    /// Share of a circle, of the coarse scale, on which there is an edge along it at either scale,
    /// whichever is less.
    pub(super) fn support(&self, ring: &Ring) -> f64 {
        self.coarse.support(ring).min(self.tight_support(ring))
    }

    /// The same at the fine scale alone.
    pub(super) fn tight_support(&self, ring: &Ring) -> f64 {
        self.fine.support(&ring.scaled(self.ratio))
    }

    /// Gives a circle of the coarse scale the geometric mean of its scores.
    pub(super) fn scored(&self, ring: Ring) -> Ring {
        let of_fine = self.fine.score(&ring.scaled(self.ratio));
        Ring { score: (self.coarse.score(&ring).max(0.0) * of_fine.max(0.0)).sqrt(), ..ring }
    }

    /// A circle of the photograph at the coarse scale.
    pub(super) fn ring(&self, circle: &Circle) -> Ring {
        let [x, y, radius] = [circle.x, circle.y, circle.radius].map(|v| (v / self.step) as f32);
        self.scored(Ring { x, y, radius, score: 0.0 })
    }

    /// The best circle on edges of the photograph that are near a rough one or circles around it,
    /// if there is any.
    pub(super) fn settled(&self, rgb: &Plane<Vec3>, small: &Small, rough: &Ring) -> Option<(Ring, Circle)> {
        let on_edges = |ring: Ring| {
            let [x, y, radius] = [ring.x, ring.y, ring.radius].map(|v| f64::from(v) * self.step);
            let circle = refined(rgb, small, &Circle { x, y, radius }, 2.0 * self.step)?;
            let ring = self.ring(&circle);
            (ring.score >= LEAST_SCORE && circle.radius >= LEAST_RADIUS).then_some((ring, circle))
        };
        let heavier = |a: (Ring, Circle), b: (Ring, Circle)| if b.0.weight() > a.0.weight() { b } else { a };
        rough.around().filter_map(on_edges).reduce(heavier)
    }
}

/// A circle at the coarse scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ring {
    x: f32,
    y: f32,
    radius: f32,
    /// Mean product along it, -1..=1.
    score: f32,
}

impl Ring {
    /// Ranking of circles: among equal scores, larger circles are more significant.
    pub(super) fn weight(&self) -> f32 {
        self.score * self.radius.sqrt()
    }

    fn scaled(self, by: f32) -> Self {
        Self { x: self.x * by, y: self.y * by, radius: self.radius * by, ..self }
    }

    /// Itself, and circles that it may touch from within or by chance resembles.
    fn around(self) -> impl Iterator<Item = Self> {
        let turned = move |i: usize| NEARBY * self.radius * Vec2::from_angle(TAU * i as f32 / AROUND as f32);
        let off = std::iter::once(Vec2::ZERO).chain((0..AROUND).map(turned));
        off.flat_map(move |off| {
            let sized = move |by| Self { x: self.x + off.x, y: self.y + off.y, radius: self.radius * by, ..self };
            [1.0, 1.0 + NEARBY].map(sized)
        })
    }

    fn is_same(&self, other: &Self) -> bool {
        let off = (self.x - other.x).abs().max((self.y - other.y).abs()).max((self.radius - other.radius).abs());
        off <= SAME * self.radius.max(other.radius)
    }
}

/// Sorts by falling weight; of equal ones the topmost and leftmost stays first.
pub(super) fn sort<T>(of: &mut [T], ring: impl Fn(&T) -> &Ring) {
    of.sort_by(|a, b| ring(b).weight().total_cmp(&ring(a).weight()));
}

/// The first circles of which none is the same as one before, `most` at most.
pub(super) fn distinct<T>(of: Vec<T>, most: usize, ring: impl Fn(&T) -> &Ring) -> Vec<T> {
    let mut kept: Vec<T> = Vec::new();
    for one in of {
        if kept.len() == most {
            break;
        }
        if kept.iter().all(|other| !ring(&one).is_same(ring(other))) {
            kept.push(one);
        }
    }
    kept
}

/// Dominant edge orientation of each pixel, as a vector in doubled angles.
struct Field {
    edges: Plane<Vec2>,
    /// The directions, in an order whose beginnings are spread evenly, with the doubled ones.
    directions: Vec<(Vec2, Vec2)>,
}

impl Field {
    fn of(values: &Plane<Vec3>) -> Self {
        let tensors = smoothed(&Plane::from_fn(values.width(), values.height(), |x, y| tensor(values, x, y)));
        let typical = tensors.as_slice().iter().map(|t| t.z).sum::<f32>() / tensors.as_slice().len().max(1) as f32;
        let edges = tensors.map(|t| t.truncate() / (t.z + TEXTURE * typical + FAINT));
        let direction = |i: usize| {
            let turned = (i % FIRST) * (DIRECTIONS / FIRST) + i / FIRST;
            let angle = TAU * (turned as f32 + 0.5) / DIRECTIONS as f32;
            (Vec2::from_angle(angle), Vec2::from_angle(2.0 * angle))
        };
        Self { edges, directions: (0..DIRECTIONS).map(direction).collect() }
    }

    /// Sum of the products in the directions of a range; nothing outside the picture.
    fn sum(&self, ring: &Ring, range: std::ops::Range<usize>) -> f32 {
        self.products(ring, range).sum()
    }

    fn products(&self, ring: &Ring, range: std::ops::Range<usize>) -> impl Iterator<Item = f32> {
        let (width, height) = (self.edges.width() as f32, self.edges.height() as f32);
        self.directions[range].iter().map(move |(outward, doubled)| {
            let (x, y) = (ring.x + ring.radius * outward.x, ring.y + ring.radius * outward.y);
            if x >= 0.0 && y >= 0.0 && x < width && y < height {
                self.edges[(x as usize, y as usize)].dot(*doubled)
            } else {
                0.0
            }
        })
    }

    fn score(&self, ring: &Ring) -> f32 {
        self.sum(ring, 0..DIRECTIONS) / DIRECTIONS as f32
    }

    /// The field without the edges at the rim of a circle.
    fn without(&self, ring: &Ring, reach: f32) -> Self {
        let edges = Plane::from_fn(self.edges.width(), self.edges.height(), |x, y| {
            let off = (x as f32 + 0.5 - ring.x).hypot(y as f32 + 0.5 - ring.y) - ring.radius;
            if off.abs() > reach { self.edges[(x, y)] } else { Vec2::ZERO }
        });
        Self { edges, directions: self.directions.clone() }
    }

    fn support(&self, ring: &Ring) -> f64 {
        let supports = self.products(ring, 0..DIRECTIONS).filter(|product| *product >= SUPPORTS);
        supports.count() as f64 / DIRECTIONS as f64
    }

    /// The circles of a grid with a good score, each moved to the best place nearby, the one of
    /// most weight first.
    fn best(&self) -> Vec<Ring> {
        let (width, height) = self.edges.size();
        let most = MOST_SHARE * width.min(height) as f32;
        let radii: Vec<f32> =
            std::iter::successors(Some(LEAST), |r| Some(r * GROWTH)).take_while(|r| *r <= most).collect();
        let row = |y: usize| {
            let at = |x: usize| radii.iter().map(move |&radius| (x, radius));
            let rings = (0..width).step_by(APART).flat_map(at).filter_map(move |(x, radius)| {
                let ring = Ring { x: x as f32 + 0.5, y: y as f32 + 0.5, radius, score: 0.0 };
                let first = self.sum(&ring, 0..FIRST);
                if first < PROMISING * FIRST as f32 {
                    return None;
                }
                let score = (first + self.sum(&ring, FIRST..DIRECTIONS)) / DIRECTIONS as f32;
                (score >= PROMISING).then_some(Ring { score, ..ring })
            });
            rings.collect::<Vec<_>>()
        };
        let rows = height.div_ceil(APART);
        let mut rings: Vec<Ring> = (0..rows).into_par_iter().flat_map_iter(|y| row(APART * y)).collect();
        sort(&mut rings, |ring| ring);
        rings.truncate(CLOSER);
        rings = rings.into_par_iter().map(|ring| self.climbed(ring)).collect();
        rings.retain(|ring| ring.score >= LEAST_SCORE);
        sort(&mut rings, |ring| ring);
        rings
    }

    /// Moves a circle uphill, by a pixel and then by half of one.
    fn climbed(&self, mut ring: Ring) -> Ring {
        for by in [1.0, 0.5] {
            for _ in 0..8 {
                let moves =
                    [(by, 0.0, 0.0), (-by, 0.0, 0.0), (0.0, by, 0.0), (0.0, -by, 0.0), (0.0, 0.0, by), (0.0, 0.0, -by)];
                let moved = moves.map(|(dx, dy, dr)| {
                    let ring =
                        Ring { x: ring.x + dx, y: ring.y + dy, radius: (ring.radius + dr).max(LEAST), score: 0.0 };
                    Ring { score: self.score(&ring), ..ring }
                });
                let Some(best) = moved.into_iter().max_by(|a, b| a.weight().total_cmp(&b.weight())) else { break };
                if best.weight() <= ring.weight() {
                    break;
                }
                ring = best;
            }
        }
        ring
    }
}

/// Structure tensor of a pixel, summed over the channels: its traceless part in doubled angles, and
/// half its trace.
fn tensor(values: &Plane<Vec3>, x: usize, y: usize) -> Vec3 {
    let (width, height) = values.size();
    let at = |dx: isize, dy: isize| {
        let clamped = |at: usize, by: isize, most: usize| at.saturating_add_signed(by).min(most - 1);
        values[(clamped(x, dx, width), clamped(y, dy, height))]
    };
    let across = |f: &dyn Fn(isize, isize) -> Vec3| {
        let side = |d: isize| f(d, -1) + 2.0 * f(d, 0) + f(d, 1);
        (side(1) - side(-1)) / 8.0
    };
    let (gx, gy) = (across(&at), across(&|d, e| at(e, d)));
    let (xx, yy, xy) = (gx.length_squared(), gy.length_squared(), gx.dot(gy));
    Vec3::new(0.5 * (xx - yy), xy, 0.5 * (xx + yy))
}

/// Means with the neighbours by the weights 1, 2, 1 along rows and columns.
fn smoothed(of: &Plane<Vec3>) -> Plane<Vec3> {
    let (width, height) = of.size();
    let three = |a: Vec3, b: Vec3, c: Vec3| 0.25 * (a + 2.0 * b + c);
    let rows = Plane::from_fn(width, height, |x, y| {
        three(of[(x.saturating_sub(1), y)], of[(x, y)], of[((x + 1).min(width - 1), y)])
    });
    Plane::from_fn(width, height, |x, y| {
        three(rows[(x, y.saturating_sub(1))], rows[(x, y)], rows[(x, (y + 1).min(height - 1))])
    })
}
