//! Agreement between the edges of a photograph and a circle, at two scales.
//!
//! Each pixel of a reduced photograph stores the dominant orientation of its edges as a vector in
//! doubled angles. Its product with the doubled direction from a centre is 1 for an edge
//! perpendicular to that direction, -1 for a parallel edge, and zero on average for texture. The
//! score of a circle is the mean of this product along it.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::circle::MIN_BALL_RADIUS;
use super::circle_fit::Circle;
use super::rim::refined;
use super::small::Small;
use crate::parallel;
use crate::picture::Plane;

/// Longer side of the picture at the coarse scale, in pixels.
const COARSE_SIDE: usize = 128;
/// Smallest radius of a circle at the coarse scale, in pixels.
const MIN_COARSE_RADIUS: f32 = 6.0;
/// Largest radius of a circle, as a share of the shorter side.
const MAX_SHARE: f32 = 0.6;
/// Ratio of neighbouring radii in the grid of circles.
const RADIUS_RATIO: f32 = 1.05;
/// Distance between neighbouring centres in the grid of circles, in pixels.
const CENTRE_DISTANCE: usize = 2;
/// Number of directions along a circle.
const DIRECTIONS: usize = 64;
/// Number of directions after which a circle of low score is discarded.
const FIRST_DIRECTIONS: usize = 16;
/// Smallest score of a circle of the grid.
const MIN_GRID_SCORE: f32 = 0.15;
/// Smallest score of a refined circle.
const MIN_SCORE: f32 = 0.25;
/// Largest number of circles of the grid that are refined.
const MAX_REFINED: usize = 400;
/// Number of circles around a candidate that are also tried.
const NEIGHBOUR_CIRCLES: usize = 8;
/// Offset of these circles, as a share of the radius: shading within a ball produces circles that
/// touch its rim.
const NEIGHBOUR_OFFSET: f32 = 0.1;
/// Largest difference of two circles that count as the same, as a share of the radius.
const SAME_CIRCLE: f32 = 0.2;
/// Smallest product of an edge that supports a circle: within 30 degrees of its tangent.
const MIN_EDGE_PRODUCT: f32 = 0.5;
/// Strength of an edge that exceeds noise: squared change of the compressed values per pixel.
const MIN_EDGE_STRENGTH: f32 = 2e-5;
/// Share of the mean edge strength added to the denominator that normalises each edge.
const MEAN_STRENGTH_SHARE: f32 = 0.25;
/// Distance from a rim within which edges belong to its circle, in pixels of the coarse scale.
const RIM_DISTANCE: f32 = 2.5;

/// Edges of a photograph at two scales.
///
/// At the coarse scale, shading produces smooth circles; at the fine scale, texture and noise hide
/// edges. The rim of a ball is present at both scales.
pub(super) struct Edges {
    coarse: Field,
    fine: Field,
    /// Side of a pixel of the coarse scale, in pixels of the photograph.
    step: f64,
    /// Side of a pixel of the coarse scale, in pixels of the fine scale.
    ratio: f32,
}

impl Edges {
    pub(super) fn of(small: &Small) -> Self {
        let coarse = small.reduced(COARSE_SIDE);
        Self {
            coarse: Field::of(&coarse.values),
            fine: Field::of(&small.values),
            step: coarse.step as f64,
            ratio: coarse.step as f32 / small.step as f32,
        }
    }

    /// Returns the edges without those at the rim of a circle.
    pub(super) fn without(&self, ring: &Ring) -> Self {
        let fine = self.fine.without(&ring.scaled(self.ratio), RIM_DISTANCE * self.ratio);
        Self { coarse: self.coarse.without(ring, RIM_DISTANCE), fine, step: self.step, ratio: self.ratio }
    }

    /// Returns the circles of a grid with a high score at the coarse scale, by decreasing weight.
    ///
    /// Each circle is moved to the best position nearby.
    pub(super) fn best(&self) -> Vec<Ring> {
        self.coarse.best()
    }

    /// Returns the share of a circle, at the coarse scale, that has edges along it.
    ///
    /// The result is the smaller share of the two scales.
    pub(super) fn support(&self, ring: &Ring) -> f64 {
        self.coarse.support(ring).min(self.tight_support(ring))
    }

    /// Returns this share at the fine scale alone.
    pub(super) fn tight_support(&self, ring: &Ring) -> f64 {
        self.fine.support(&ring.scaled(self.ratio))
    }

    /// Sets the score of a circle of the coarse scale to the geometric mean over both scales.
    pub(super) fn scored(&self, ring: Ring) -> Ring {
        let of_fine = self.fine.score(&ring.scaled(self.ratio));
        Ring { score: (self.coarse.score(&ring).max(0.0) * of_fine.max(0.0)).sqrt(), ..ring }
    }

    /// Converts a circle of the photograph to the coarse scale and computes its score.
    pub(super) fn ring(&self, circle: &Circle) -> Ring {
        let [x, y, radius] = [circle.x, circle.y, circle.radius].map(|v| (v / self.step) as f32);
        self.scored(Ring { x, y, radius, score: 0.0 })
    }

    /// Returns the best circle on edges of the photograph near a rough circle, if any.
    ///
    /// Circles around the rough one are also tried.
    pub(super) fn refined(&self, rgb: &Plane<Vec3>, small: &Small, rough: &Ring) -> Option<(Ring, Circle)> {
        let on_edges = |ring: Ring| {
            let [x, y, radius] = [ring.x, ring.y, ring.radius].map(|v| f64::from(v) * self.step);
            let circle = refined(rgb, small, &Circle { x, y, radius }, 2.0 * self.step)?;
            let ring = self.ring(&circle);
            (ring.score >= MIN_SCORE && circle.radius >= MIN_BALL_RADIUS).then_some((ring, circle))
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
    /// Mean product along the circle, -1..=1.
    score: f32,
}

impl Ring {
    /// Returns the rank of the circle: among equal scores, larger circles are more significant.
    pub(super) fn weight(&self) -> f32 {
        self.score * self.radius.sqrt()
    }

    fn scaled(self, by: f32) -> Self {
        Self { x: self.x * by, y: self.y * by, radius: self.radius * by, ..self }
    }

    /// Iterates over the circle and shifted and enlarged ones, which it may touch from within.
    fn around(self) -> impl Iterator<Item = Self> {
        let turned = move |i: usize| {
            NEIGHBOUR_OFFSET * self.radius * Vec2::from_angle(TAU * i as f32 / NEIGHBOUR_CIRCLES as f32)
        };
        let off = std::iter::once(Vec2::ZERO).chain((0..NEIGHBOUR_CIRCLES).map(turned));
        off.flat_map(move |off| {
            let sized = move |by| Self { x: self.x + off.x, y: self.y + off.y, radius: self.radius * by, ..self };
            [1.0, 1.0 + NEIGHBOUR_OFFSET].map(sized)
        })
    }

    fn is_same(&self, other: &Self) -> bool {
        let off = (self.x - other.x).abs().max((self.y - other.y).abs()).max((self.radius - other.radius).abs());
        off <= SAME_CIRCLE * self.radius.max(other.radius)
    }
}

/// Sorts by decreasing weight; circles of equal weight stay in order, topmost and leftmost first.
pub(super) fn sort<T>(of: &mut [T], ring: impl Fn(&T) -> &Ring) {
    of.sort_by(|a, b| ring(b).weight().total_cmp(&ring(a).weight()));
}

/// Returns the first circles that differ from all before them, at most `most`.
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
    /// Directions, and vectors of twice their angles; the first [`FIRST_DIRECTIONS`] are
    /// evenly spread.
    directions: Vec<(Vec2, Vec2)>,
}

impl Field {
    fn of(values: &Plane<Vec3>) -> Self {
        let tensors = smoothed(&Plane::from_fn(values.width(), values.height(), |x, y| tensor(values, x, y)));
        let typical = tensors.as_slice().iter().map(|t| t.z).sum::<f32>() / tensors.as_slice().len().max(1) as f32;
        let edges = tensors.map(|t| t.truncate() / (t.z + MEAN_STRENGTH_SHARE * typical + MIN_EDGE_STRENGTH));
        let direction = |i: usize| {
            let turned = (i % FIRST_DIRECTIONS) * (DIRECTIONS / FIRST_DIRECTIONS) + i / FIRST_DIRECTIONS;
            let angle = TAU * (turned as f32 + 0.5) / DIRECTIONS as f32;
            (Vec2::from_angle(angle), Vec2::from_angle(2.0 * angle))
        };
        Self { edges, directions: (0..DIRECTIONS).map(direction).collect() }
    }

    /// Returns the sum of the products over a range of directions; zero outside the picture.
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

    /// Returns the field without the edges at the rim of a circle.
    fn without(&self, ring: &Ring, reach: f32) -> Self {
        let edges = Plane::from_fn(self.edges.width(), self.edges.height(), |x, y| {
            let off = (x as f32 + 0.5 - ring.x).hypot(y as f32 + 0.5 - ring.y) - ring.radius;
            if off.abs() > reach { self.edges[(x, y)] } else { Vec2::ZERO }
        });
        Self { edges, directions: self.directions.clone() }
    }

    fn support(&self, ring: &Ring) -> f64 {
        let supports = self.products(ring, 0..DIRECTIONS).filter(|product| *product >= MIN_EDGE_PRODUCT);
        supports.count() as f64 / DIRECTIONS as f64
    }

    /// Returns the circles of a grid with a high score, by decreasing weight.
    ///
    /// Each circle is moved to the best position nearby.
    fn best(&self) -> Vec<Ring> {
        let (width, height) = self.edges.size();
        let most = MAX_SHARE * width.min(height) as f32;
        let radii: Vec<f32> = std::iter::successors(Some(MIN_COARSE_RADIUS), |r| Some(r * RADIUS_RATIO))
            .take_while(|r| *r <= most)
            .collect();
        let row = |y: usize| {
            let at = |x: usize| radii.iter().map(move |&radius| (x, radius));
            let rings = (0..width).step_by(CENTRE_DISTANCE).flat_map(at).filter_map(move |(x, radius)| {
                let ring = Ring { x: x as f32 + 0.5, y: y as f32 + 0.5, radius, score: 0.0 };
                let first = self.sum(&ring, 0..FIRST_DIRECTIONS);
                if first < MIN_GRID_SCORE * FIRST_DIRECTIONS as f32 {
                    return None;
                }
                let score = (first + self.sum(&ring, FIRST_DIRECTIONS..DIRECTIONS)) / DIRECTIONS as f32;
                (score >= MIN_GRID_SCORE).then_some(Ring { score, ..ring })
            });
            rings.collect::<Vec<_>>()
        };
        let rows = height.div_ceil(CENTRE_DISTANCE);
        let mut rings: Vec<Ring> = parallel::flat_map_range(rows, |y| row(CENTRE_DISTANCE * y));
        sort(&mut rings, |ring| ring);
        rings.truncate(MAX_REFINED);
        rings = parallel::map(&rings, |ring| self.climbed(*ring));
        rings.retain(|ring| ring.score >= MIN_SCORE);
        sort(&mut rings, |ring| ring);
        rings
    }

    /// Moves a circle uphill in weight, in steps of one pixel and then of half a pixel.
    fn climbed(&self, mut ring: Ring) -> Ring {
        for by in [1.0, 0.5] {
            for _ in 0..8 {
                let moves =
                    [(by, 0.0, 0.0), (-by, 0.0, 0.0), (0.0, by, 0.0), (0.0, -by, 0.0), (0.0, 0.0, by), (0.0, 0.0, -by)];
                let moved = moves.map(|(dx, dy, dr)| {
                    let ring = Ring {
                        x: ring.x + dx,
                        y: ring.y + dy,
                        radius: (ring.radius + dr).max(MIN_COARSE_RADIUS),
                        score: 0.0,
                    };
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

/// Returns the structure tensor of a pixel, summed over the channels.
///
/// The first two components are its traceless part in doubled angles, the third is half its trace.
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

/// Smooths with the weights 1, 2, 1 along rows and columns.
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
