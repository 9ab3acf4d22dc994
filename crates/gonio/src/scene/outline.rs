//! Outlines that are not circles: ellipsoids, and balls seen in perspective.

use faer::Mat;
use glam::{DMat3, DVec2, DVec3};
use gonio_linalg::solve_positive;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::SceneError;
use super::circle::{MIN_BALL_RADIUS, outline};
use crate::picture::Plane;
use crate::shape::{Camera, Ellipsoid};
use crate::statistics::{median, quantile};

/// Number of random draws of points. If a third of the outline is not on the ellipse (a stand, a
/// finger), 1 in 17 draws for an ellipse and 1 in 8 for a ball contain no such point.
const DRAWS: usize = 120;
/// Largest semi-major axis, in root mean square distances of the outline from its centroid: longer
/// ellipses fit two lines.
const MAX_LENGTH: f64 = 8.0;
/// Number of rounds of reweighting.
const ROUNDS: usize = 12;
/// Share of the outline that must lie near the fit.
const NEAR_SHARE: f64 = 0.7;
/// Tolerance of these points, relative to the shorter semi-axis (or the angular radius of a ball);
/// half a pixel is added.
const MAX_STRAY: f64 = 0.02;

/// An ellipse in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse {
    /// Column and row of the centre, in pixels from the top left corner.
    pub centre: (f64, f64),
    /// Longer and shorter semi-axis, in pixels.
    pub axes: (f64, f64),
    /// Angle from the rightward direction to the longer axis, counterclockwise as seen in the
    /// picture, in radians, -pi/2 to pi/2.
    pub angle: f64,
}

impl Ellipse {
    /// Builds the ellipsoid that has this outline, with its third axis towards the camera.
    ///
    /// The camera looks along -z, maps one unit to one pixel, and has its principal point in the
    /// corner of the picture. The third semi-axis has a length of `depth` pixels.
    ///
    /// # Errors
    /// [`SceneError::TooSmall`] if an axis is too short.
    pub(crate) fn with_depth(&self, depth: f64) -> Result<Ellipsoid, SceneError> {
        let (long, short) = self.axes;
        let along = DVec3::from((DVec2::from_angle(self.angle), 0.0));
        let axes = DMat3::from_cols(long * along, short * DVec3::Z.cross(along), depth * DVec3::Z);
        let centre = DVec3::new(self.centre.0, -self.centre.1, -2.0 * depth);
        Ellipsoid::new(centre, axes).map_err(|_| SceneError::TooSmall { radius: short.min(depth) })
    }
}

/// Detects the outline of an orthographic ellipsoid in a mask or an alpha channel.
///
/// The border of the picture may crop the outline.
///
/// # Errors
/// See [`find_sphere`](super::find_sphere); [`SceneError::NotAnEllipse`] when less than 70 % of the
/// outline is closer to the fit than half a pixel plus 2 % of the shorter semi-axis, or when the
/// outline is a strip.
pub(crate) fn find_ellipse(coverage: &Plane<f32>) -> Result<Ellipse, SceneError> {
    let rim = outline(coverage)?;
    let none = |residual: f64| SceneError::NotAnEllipse { residual, rim: rim.len() };
    // Coordinates relative to the centroid, in units of the root mean square distance, so that all
    // columns have similar magnitude.
    let middle = rim.iter().sum::<DVec2>() / rim.len().max(1) as f64;
    let unit = (rim.iter().map(|p| p.distance_squared(middle)).sum::<f64>() / rim.len().max(1) as f64).sqrt();
    if !(unit.is_finite() && unit > 0.0) {
        return Err(none(0.0));
    }
    let points: Vec<DVec2> = rim.iter().map(|p| (*p - middle) / unit).collect();
    let rows: Vec<Vec<f64>> = points.iter().map(|p| vec![p.x * p.x, p.x * p.y, p.y * p.y, p.x, p.y]).collect();
    let conic = |c: &[f64], p: DVec2| {
        let value = c[0] * p.x * p.x + c[1] * p.x * p.y + c[2] * p.y * p.y + c[3] * p.x + c[4] * p.y - 1.0;
        let slope = DVec2::new(2.0 * c[0] * p.x + c[1] * p.y + c[3], c[1] * p.x + 2.0 * c[2] * p.y + c[4]);
        // Approximate distance (Sampson).
        value / slope.length().max(1e-9)
    };
    let c = fit(&rows, |c, i| conic(c, points[i]), 0.5 / unit).ok_or_else(|| none(0.0))?;
    let determinant = 4.0 * c[0] * c[2] - c[1] * c[1];
    let centre = DVec2::new(c[1] * c[4] - 2.0 * c[2] * c[3], c[1] * c[3] - 2.0 * c[0] * c[4]) / determinant;
    let level = 1.0 + c[0] * centre.x * centre.x + c[1] * centre.x * centre.y + c[2] * centre.y * centre.y;
    let (mean, half) = (0.5 * (c[0] + c[2]), 0.5 * (c[0] - c[2]).hypot(c[1]));
    let axes = (level / (mean - half), level / (mean + half));
    if !(determinant > 0.0 && axes.0 > 0.0 && axes.1 > 0.0 && axes.0 < 1e6 * axes.1) {
        return Err(none(0.0));
    }
    // In the picture y points down; the major axis is the direction in which the quadratic form
    // grows most slowly.
    let steep = 0.5 * c[1].atan2(c[0] - c[2]);
    let flat = if steep > 0.0 { steep - std::f64::consts::FRAC_PI_2 } else { steep + std::f64::consts::FRAC_PI_2 };
    let (long, short) = (unit * axes.0.sqrt(), unit * axes.1.sqrt());
    let mut distances: Vec<f64> = points.iter().map(|p| unit * conic(&c, *p).abs()).collect();
    let residual = quantile(&mut distances, NEAR_SHARE).ok_or_else(|| none(0.0))?;
    if residual > 0.5 + MAX_STRAY * short || long > MAX_LENGTH * unit {
        return Err(none(residual));
    }
    if short < MIN_BALL_RADIUS {
        return Err(SceneError::TooSmall { radius: short });
    }
    let centre = middle + unit * centre;
    Ok(Ellipse { centre: (centre.x, centre.y), axes: (long, short), angle: -flat })
}

/// Detects a ball in a mask or an alpha channel of a picture taken by a camera.
///
/// The ball is placed at a distance of one (at an arbitrary distance if the camera is
/// orthographic). In perspective, its outline is the intersection of a cone with the picture: an
/// ellipse, except in the middle. The border of the picture may crop the outline.
///
/// # Errors
/// See [`find_sphere`](super::find_sphere); [`SceneError::NotAnEllipse`] when less than 70 % of the
/// outline is closer to the fit than half a pixel plus 2 % of the half-angle of the cone.
pub(crate) fn find_ball(coverage: &Plane<f32>, camera: &Camera) -> Result<Ellipsoid, SceneError> {
    let rim = outline(coverage)?;
    let none = |residual: f64| SceneError::NotAnEllipse { residual, rim: rim.len() };
    let rays: Vec<DVec3> = rim.iter().map(|p| camera.ray((p.x, p.y)).direction).collect();
    let axis = rays.iter().sum::<DVec3>().normalize_or(DVec3::NEG_Z);
    let pixel = camera.ray((rim[0].x + 1.0, rim[0].y)).direction.angle_between(rays[0]);
    if pixel < 1e-9 {
        // Parallel rays.
        let found = super::find_sphere(coverage).map_err(|error| match error {
            SceneError::Elliptic { aspect, .. } => SceneError::Elliptic { aspect, under_camera: true },
            error => error,
        })?;
        let found = found.circle;
        let scale = match camera.projection {
            crate::shape::Projection::Orthographic { pixels_per_unit } => pixels_per_unit,
            crate::shape::Projection::Perspective { .. } => return Err(none(0.0)),
        };
        let centre = camera.ray((found.x, found.y)).origin - 2.0 * found.radius / scale * DVec3::Z;
        return Ellipsoid::sphere(centre, found.radius / scale).map_err(|_| none(0.0));
    }
    // r . a = cos(alpha) for all rays of the outline: r . b = 1 with b = a / cos(alpha), linear.
    // The system is solved in a frame about the mean ray, where b is nearly z.
    let (u, v) = axis.any_orthonormal_pair();
    let rows: Vec<Vec<f64>> = rays.iter().map(|r| vec![r.dot(u), r.dot(v), r.dot(axis)]).collect();
    let cone = |b: &[f64], i: usize| {
        let b = DVec3::from_slice(b);
        let r = DVec3::from_slice(&rows[i]);
        r.angle_between(b) - (1.0 / b.length()).clamp(-1.0, 1.0).acos()
    };
    let b = fit(&rows, cone, 0.5 * pixel).ok_or_else(|| none(0.0))?;
    let length = DVec3::from_slice(&b).length();
    if length.is_nan() || length <= 1.0 {
        return Err(none(0.0));
    }
    let mut strays: Vec<f64> = (0..rows.len()).map(|i| cone(&b, i).abs()).collect();
    let residual = quantile(&mut strays, NEAR_SHARE).ok_or_else(|| none(0.0))?;
    let radius = (1.0 - 1.0 / (length * length)).sqrt();
    if residual > 0.5 * pixel + MAX_STRAY * radius.asin() {
        return Err(none(residual / pixel));
    }
    if radius.asin() < MIN_BALL_RADIUS * pixel {
        return Err(SceneError::TooSmall { radius: radius.asin() / pixel });
    }
    let centre = (b[0] * u + b[1] * v + b[2] * axis) / length;
    Ellipsoid::sphere(centre, radius).map_err(|_| none(0.0))
}

/// Fits `row . x = 1` by robust regression.
///
/// Computes solutions for a few rows each, drawn at random, and selects the one of least median
/// distance (Rousseeuw 1984). Then refines it by least squares with weights that decrease with the
/// distance (Geman & McClure), on a scale of at least `least`.
fn fit(rows: &[Vec<f64>], distance: impl Fn(&[f64], usize) -> f64, least: f64) -> Option<Vec<f64>> {
    let unknowns = rows.first()?.len();
    let mut rng = Pcg64::seed_from_u64(1);
    let off = |solution: &[f64]| -> Vec<f64> { (0..rows.len()).map(|i| distance(solution, i).abs()).collect() };
    let mut best: Option<(f64, Vec<f64>)> = None;
    for draw in 0..DRAWS {
        let mut weights = vec![if draw == 0 { 1.0 } else { 0.0 }; rows.len()];
        if draw > 0 {
            (0..unknowns + 2).for_each(|_| weights[rng.random_range(0..rows.len())] = 1.0);
        }
        let Some(solution) = least_squares(rows, &weights) else { continue };
        let typical = median(off(&solution))?;
        if typical.is_finite() && best.as_ref().is_none_or(|b| typical < b.0) {
            best = Some((typical, solution));
        }
    }
    let (_, mut solution) = best?;
    for _ in 0..ROUNDS {
        let off = off(&solution);
        let scale = (3.0 * median(off.iter().copied())?).max(least);
        let weights: Vec<f64> = off.iter().map(|d| (1.0 + (d / scale).powi(2)).powi(-2)).collect();
        solution = least_squares(rows, &weights)?;
    }
    Some(solution)
}

/// Solves `row . x = 1` by weighted least squares.
fn least_squares(rows: &[Vec<f64>], weights: &[f64]) -> Option<Vec<f64>> {
    let unknowns = rows.first()?.len();
    let mut gram = Mat::<f64>::zeros(unknowns, unknowns);
    let mut right = vec![0.0; unknowns];
    for (row, weight) in rows.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
        for i in 0..unknowns {
            right[i] += weight * row[i];
            (0..unknowns).for_each(|j| gram[(i, j)] += weight * row[i] * row[j]);
        }
    }
    solve_positive(gram, &right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::{Projection, Ray, Surface};
    use crate::suggestion::Suggestion;

    /// Coverage from 8 x 8 samples per pixel.
    fn mask(size: (usize, usize), inside: impl Fn(f64, f64) -> bool) -> Plane<f32> {
        Plane::from_fn(size.0, size.1, |x, y| {
            let at = |i: usize| (i as f64 + 0.5) / 8.0;
            (0..64).filter(|s| inside(x as f64 + at(s % 8), y as f64 + at(s / 8))).count() as f32 / 64.0
        })
    }

    fn ellipse(angle: f64, shift: f64) -> impl Fn(f64, f64) -> bool {
        move |x, y| {
            // The angle is counterclockwise in the picture, where y points down.
            let (dx, dy) = (x - 100.0 - shift, 90.0 - y);
            let (s, c) = angle.sin_cos();
            ((c * dx + s * dy) / 70.0).powi(2) + ((c * dy - s * dx) / 45.0).powi(2) < 1.0
        }
    }

    #[test]
    fn finds_whole_ellipses_cropped_ones_and_those_with_a_stand() {
        for angle in [0.0, 0.4, 1.3, -0.9] {
            let found = find_ellipse(&mask((200, 180), ellipse(angle, 0.0))).unwrap();
            let close = |e: Ellipse, tolerance: f64| {
                let turn = (e.angle - angle).sin().abs();
                (e.centre.0 - 100.0).abs() < tolerance
                    && (e.axes.0 - 70.0).abs() < tolerance
                    && (e.axes.1 - 45.0).abs() < tolerance
                    && turn < 0.01 * tolerance
            };
            assert!(close(found, 0.2), "{angle} {found:?}");
            let stand = mask((200, 180), |x, y| ellipse(angle, 0.0)(x, y) || ((x - 100.0).abs() < 5.0 && y > 90.0));
            let found = find_ellipse(&stand).unwrap();
            assert!(close(found, 1.0), "{angle} {found:?}");
        }
        let found = find_ellipse(&mask((200, 180), ellipse(0.3, 70.0))).unwrap();
        assert!((found.centre.0 - 170.0).abs() < 0.5 && (found.axes.0 - 70.0).abs() < 0.5, "{found:?}");
        let square = mask((200, 180), |x, y| (x - 90.0).abs().max((y - 90.0).abs()) < 60.0);
        assert!(matches!(find_ellipse(&square), Err(SceneError::NotAnEllipse { .. })));
    }

    #[test]
    fn the_ellipsoid_has_the_outline_of_the_ellipse() {
        let found = find_ellipse(&mask((200, 180), ellipse(0.4, 0.0))).unwrap();
        let shape = found.with_depth(30.0).unwrap();
        let seen = mask((200, 180), |x, y| {
            shape.hit(&Ray { origin: DVec3::new(x, -y, 0.0), direction: DVec3::NEG_Z }).is_some()
        });
        let want = mask((200, 180), ellipse(0.4, 0.0));
        let off: f32 = seen.as_slice().iter().zip(want.as_slice()).map(|(a, b)| (a - b).abs()).sum();
        assert!(off < 60.0, "{off}");
    }

    #[test]
    fn finds_a_ball_in_perspective_off_the_axis() {
        let camera = Camera::new(Projection::Perspective { focal: 260.0 }, (120.0, 100.0), (240, 200)).unwrap();
        for (centre, radius) in [(DVec3::new(0.7, 0.4, -2.2), 0.45), (DVec3::new(1.0, -0.1, -2.2), 0.5)] {
            let ball = Ellipsoid::sphere(centre, radius).unwrap();
            let coverage = mask(camera.size, |x, y| ball.hit(&camera.ray((x, y))).is_some());
            let found = find_ball(&coverage, &camera).unwrap();
            let scaled = Ellipsoid::sphere(centre / centre.length(), radius / centre.length()).unwrap();
            for (x, y) in [(centre.x, centre.y), (centre.x - 0.2, centre.y + 0.2)] {
                let ray = Ray { origin: DVec3::ZERO, direction: DVec3::new(x, y, centre.z).normalize() };
                let (got, want) = (found.hit(&ray).unwrap().normal, scaled.hit(&ray).unwrap().normal);
                assert!(got.angle_between(want) < 0.01, "{centre}: {got} {want}");
            }
        }
    }

    #[test]
    fn finds_a_ball_without_perspective() {
        let camera = Camera::new(Projection::Orthographic { pixels_per_unit: 10.0 }, (0.0, 0.0), (240, 200)).unwrap();
        let coverage = mask(camera.size, |x, y| (x - 110.0).hypot(y - 95.0) < 60.0);
        let found = find_ball(&coverage, &camera).unwrap();
        let hit = found.hit(&camera.ray((110.0 + 30.0, 95.0))).unwrap();
        assert!((hit.normal - DVec3::new(0.5, 0.0, 0.75_f64.sqrt())).length() < 0.005, "{}", hit.normal);
    }

    #[test]
    fn a_given_camera_is_not_suggested() {
        let camera = Camera::new(Projection::Orthographic { pixels_per_unit: 10.0 }, (0.0, 0.0), (240, 200)).unwrap();
        let in_perspective = |x: f64, y: f64| ((x - 110.0) / 66.0).powi(2) + ((y - 95.0) / 60.0).powi(2) < 1.0;
        let coverage = mask(camera.size, in_perspective);
        let without = super::super::find_sphere(&coverage).unwrap_err();
        assert!(without.suggestions().contains(&Suggestion::Camera), "{without}");
        let given = find_ball(&coverage, &camera).unwrap_err();
        assert!(matches!(given, SceneError::Elliptic { under_camera: true, .. }), "{given}");
        assert!(!given.suggestions().contains(&Suggestion::Camera) && !given.suggestions().is_empty(), "{given}");
    }
}
