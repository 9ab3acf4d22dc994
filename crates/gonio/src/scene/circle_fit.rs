//! Circle fit to scattered points: Taubin's algebraic fit, then robust least squares of the
//! distances.

use faer::Mat;
use faer::linalg::solvers::SolveLstsq;
use glam::{DMat3, DVec2, DVec3};
use gonio_linalg::clear_registers;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::picture::Plane;
use crate::statistics::median;

/// A circle in a picture: the outline of a ball under an orthographic camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Circle {
    /// Column of the centre, in pixels from the left edge (the centre of the first pixel is at
    /// 0.5).
    pub x: f64,
    /// Row of the centre, in pixels from the top edge.
    pub y: f64,
    /// Radius, in pixels.
    pub radius: f64,
}

impl Circle {
    /// Returns the share (0..1) of each pixel of a picture that the disk covers.
    pub fn coverage(&self, (width, height): (usize, usize)) -> Plane<f32> {
        Plane::from_fn(width, height, |x, y| {
            let from_centre = (x as f64 + 0.5 - self.x).hypot(y as f64 + 0.5 - self.y);
            (self.radius - from_centre + 0.5).clamp(0.0, 1.0) as f32
        })
    }
}

/// Distance, in multiples of the spread, beyond which a point is ignored (Tukey's biweight at 95 %
/// efficiency).
const FAR: f64 = 4.685;
/// Smallest spread assumed, in pixels: no mask is more accurate.
const MIN_SPREAD: f64 = 0.15;

/// Number of triples of points that are drawn, and of points to which their circles are compared.
const TRIPLES: usize = 200;
const COMPARED: usize = 400;

/// A circle and how well it fits the points.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub circle: Circle,
    /// Robust spread of the distances to the circle, from their median, in pixels.
    pub spread: f64,
    /// Points near the circle.
    pub near: Vec<DVec2>,
}

/// Fits a circle to most of the `points` by robust least squares.
///
/// Returns `None` if the points lie on a line or no circle fits.
pub(super) fn fit_circle(points: &[DVec2]) -> Option<Fit> {
    refined(points, taubin(points)?)
}

/// Fits a circle to the outline of a ball that is hidden in part, where up to half of the `points`
/// are on the edge of what hides it.
///
/// Starts from the circle through three of the points that has the smallest median distance to all,
/// out of many triples drawn at random (Rousseeuw 1984).
pub(super) fn fit_arc(points: &[DVec2]) -> Option<Fit> {
    let some: Vec<DVec2> = points.iter().copied().step_by(points.len().div_ceil(COMPARED).max(1)).collect();
    let mut rng = Pcg64::seed_from_u64(1);
    let mut any = || some[rng.random_range(0..some.len())];
    let triples: Vec<[DVec2; 3]> =
        (0..if some.is_empty() { 0 } else { TRIPLES }).map(|_| [any(), any(), any()]).collect();
    let circles = triples.iter().filter_map(|triple| taubin(triple));
    let start = circles.min_by(|a, b| median_distance(&some, a).total_cmp(&median_distance(&some, b)))?;
    refined(points, start)
}

/// Refines a circle by robust least squares.
fn refined(points: &[DVec2], mut circle: Circle) -> Option<Fit> {
    let mut spread = 0.0;
    // Gauss-Newton on c and r of sum w (|p - c| - r)^2; the weights depend on the distances.
    for _ in 0..100 {
        spread = median_distance(points, &circle) * 1.4826;
        let reach = FAR * spread.max(MIN_SPREAD);
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for p in points {
            let (away, distance) = from_rim(*p, &circle);
            let weight = (1.0 - (distance / reach).powi(2)).max(0.0).powi(2);
            let row = away.extend(1.0);
            normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * weight;
            right += row * distance * weight;
        }
        if normal.determinant().abs() < 1e-9 {
            return None;
        }
        let step = normal.inverse() * right;
        circle = Circle { x: circle.x + step.x, y: circle.y + step.y, radius: circle.radius + step.z };
        if !(circle.radius.is_finite() && circle.radius > 0.0) {
            return None;
        }
        if step.abs().max_element() < 1e-7 {
            break;
        }
    }
    let reach = FAR * spread.max(MIN_SPREAD);
    let near = points.iter().copied().filter(|p| from_rim(*p, &circle).1.abs() < reach).collect();
    Some(Fit { circle, spread, near })
}

/// Returns the unit vector from the centre through `p`, and the distance of `p` from the rim,
/// positive outside.
fn from_rim(p: DVec2, circle: &Circle) -> (DVec2, f64) {
    let from = p - DVec2::new(circle.x, circle.y);
    (from.normalize_or(DVec2::X), from.length() - circle.radius)
}

fn median_distance(points: &[DVec2], circle: &Circle) -> f64 {
    median(points.iter().map(|p| from_rim(*p, circle).1.abs())).unwrap_or(0.0)
}

/// Fits a circle by Taubin's method (1991), solved by Newton's method as in Chernov's book: unlike
/// the simple algebraic fit it does not shrink the circles of short arcs.
fn taubin(points: &[DVec2]) -> Option<Circle> {
    if points.len() < 3 {
        return None;
    }
    let n = points.len() as f64;
    let mean = points.iter().sum::<DVec2>() / n;
    let (mut xx, mut yy, mut xy, mut xz, mut yz, mut zz) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points {
        let d = *p - mean;
        let z = d.length_squared();
        xx += d.x * d.x / n;
        yy += d.y * d.y / n;
        xy += d.x * d.y / n;
        xz += d.x * z / n;
        yz += d.y * z / n;
        zz += z * z / n;
    }
    let z = xx + yy;
    let (cov, var) = (xx * yy - xy * xy, zz - z * z);
    let a3 = 4.0 * z;
    let a2 = -3.0 * z * z - zz;
    let a1 = var * z + 4.0 * cov * z - xz * xz - yz * yz;
    let a0 = xz * (xz * yy - yz * xy) + yz * (yz * xx - xz * xy) - var * cov;
    // The smallest root is the solution; Newton's method reaches it from zero monotonically.
    let mut root = 0.0;
    for _ in 0..100 {
        let step = (a0 + root * (a1 + root * (a2 + root * a3))) / (a1 + root * (2.0 * a2 + root * 3.0 * a3));
        if !step.is_finite() {
            break;
        }
        root -= step;
        if step.abs() <= 1e-13 * z {
            break;
        }
    }
    let determinant = 2.0 * (root * root - root * z + cov);
    let centre = DVec2::new(xz * (yy - root) - yz * xy, yz * (xx - root) - xz * xy) / determinant;
    let radius = (centre.length_squared() + z).sqrt();
    (determinant.abs() > 1e-12 * z * z && radius.is_finite()).then_some(Circle {
        x: mean.x + centre.x,
        y: mean.y + centre.y,
        radius,
    })
}

/// Estimates the ratio of the shorter to the longer axis of the ellipse nearest to the points.
///
/// The estimate uses the second harmonic of the distances from the centre of `circle`:
/// `r(phi) = r0 + c cos phi + s sin phi + a cos 2 phi + b sin 2 phi`. It is valid for slight
/// ellipses of which at least half of the outline is visible.
pub(super) fn aspect(near: &[DVec2], circle: &Circle) -> f64 {
    let rows = Mat::<f64>::from_fn(near.len(), 5, |i, j| {
        let (c, s) = from_rim(near[i], circle).0.into();
        [1.0, c, s, c * c - s * s, 2.0 * c * s][j]
    });
    let distances = Mat::<f64>::from_fn(near.len(), 1, |i, _| from_rim(near[i], circle).1);
    let x = rows.qr().solve_lstsq(&distances);
    clear_registers();
    let mean = circle.radius + x[(0, 0)];
    let amplitude = x[(3, 0)].hypot(x[(4, 0)]);
    (mean - amplitude) / (mean + amplitude)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// Points on the ellipse of semi-axes `a`, `b` about (40, 30), from angle 0 to `arc` radians.
    fn arc(a: f64, b: f64, arc: f64, count: usize) -> Vec<DVec2> {
        (0..count)
            .map(|i| {
                let (s, c) = (arc * i as f64 / count as f64).sin_cos();
                DVec2::new(40.0 + a * c, 30.0 + b * s)
            })
            .collect()
    }

    #[test]
    fn recovers_the_circle_from_exact_arcs() {
        for angle in [0.5, 1.5, 3.0, TAU] {
            let fit = fit_circle(&arc(25.0, 25.0, angle, 90)).unwrap();
            let error = DVec3::new(fit.circle.x - 40.0, fit.circle.y - 30.0, fit.circle.radius - 25.0).length();
            assert!(error < 1e-6, "{angle} {error}");
            assert_eq!(fit.near.len(), 90);
        }
    }

    #[test]
    fn ignores_points_far_off() {
        let mut points = arc(25.0, 25.0, TAU, 200);
        points.extend((0..40).map(|i| DVec2::new(60.0 + f64::from(i), 28.0)));
        let fit = fit_circle(&points).unwrap();
        assert!((fit.circle.radius - 25.0).abs() < 0.02, "{:?}", fit.circle);
        assert!(fit.near.len() < 205);
    }

    #[test]
    fn arcs_are_recovered_beside_a_straight_edge() {
        for depth in [0.0, 0.3, 0.6] {
            // A disc without the part beyond a chord: the arc, and points along the chord.
            let all = arc(25.0, 25.0, TAU, 400);
            let mut points: Vec<DVec2> = all.into_iter().filter(|p| p.x < 40.0 + 25.0 * depth).collect();
            let half = 25.0 * (1.0 - depth * depth).sqrt();
            let chord = (2.0 * half / (TAU * 25.0 / 400.0)) as usize;
            let along = |i: usize| DVec2::new(40.0 + 25.0 * depth, 30.0 - half + 2.0 * half * i as f64 / chord as f64);
            points.extend((0..chord).map(along));
            let fit = fit_arc(&points).unwrap();
            let error = DVec3::new(fit.circle.x - 40.0, fit.circle.y - 30.0, fit.circle.radius - 25.0).length();
            assert!(error < 0.05, "{depth} {:?}", fit.circle);
        }
        assert!(fit_arc(&[]).is_none() && fit_arc(&[DVec2::ONE; 9]).is_none());
    }

    #[test]
    fn lines_and_coincident_points_have_no_circle() {
        let line: Vec<DVec2> = (0..50).map(|i| DVec2::new(f64::from(i), 2.0 * f64::from(i))).collect();
        assert!(fit_circle(&line).is_none_or(|fit| fit.circle.radius > 1e5));
        assert!(fit_circle(&[DVec2::ONE; 9]).is_none());
        assert!(fit_circle(&[]).is_none());
    }

    #[test]
    fn estimates_the_aspect_of_slight_ellipses() {
        for b in [25.0, 24.5, 23.0] {
            let points = arc(25.0, b, TAU, 400);
            let fit = fit_circle(&points).unwrap();
            let got = aspect(&fit.near, &fit.circle);
            assert!((got - b / 25.0).abs() < 2e-3, "{b} {got}");
        }
    }
}
