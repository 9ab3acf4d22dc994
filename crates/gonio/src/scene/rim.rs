//! Refines the outline of a ball, starting from an approximate circle: finds the largest change of
//! the image along rays from the centre, with subpixel accuracy.

use std::f64::consts::TAU;

use glam::{DVec2, Vec3};

use super::circle_fit::{Circle, fit_circle};
use super::small::Small;
use crate::picture::Plane;

/// Number of rays from the centre.
const RAYS: usize = 180;
/// Share of the radius within which edges are searched to decide whether they form a circle.
const ABOUT: f64 = 0.15;
/// Smallest number of rays with an edge.
const LEAST: usize = 24;
/// Number of samples per pixel along a ray.
const FINE: f64 = 2.0;
/// Smallest change of the compressed values over one pixel that counts as an edge.
const FAINT: f32 = 0.004;

/// Refines a circle, in pixels of the photograph, on edges within `reach` pixels of it: first in
/// the reduced photograph, then in the photograph itself. `None` if no circle fits these edges.
pub(super) fn refined(rgb: &Plane<Vec3>, small: &Small, circle: &Circle, reach: f64) -> Option<Circle> {
    let step = small.step as f64;
    let scaled = |c: &Circle, by: f64| Circle { x: c.x * by, y: c.y * by, radius: c.radius * by };
    let read_small = |at: (usize, usize)| small.values[at];
    let mut circle = scaled(circle, 1.0 / step);
    for reach in [(reach / step).max(2.0), 2.0] {
        circle = near(small.values.size(), &read_small, &circle, reach)?;
    }
    let circle = scaled(&circle, step);
    if small.step == 1 {
        return Some(circle);
    }
    near(rgb.size(), &|at| small.compression.apply(rgb[at]), &circle, 1.5 * step)
}

/// Returns the spread of edges about the circle that fits them best, as a share of its radius.
///
/// The half pixel that the resolution explains is subtracted. The edges are the strongest ones of
/// the reduced photograph within 15 % of the radius of `circle`, which is in pixels of the
/// photograph. Returns `None` if no circle fits them.
pub(super) fn straying(small: &Small, circle: &Circle) -> Option<f64> {
    let step = small.step as f64;
    let circle = Circle { x: circle.x / step, y: circle.y / step, radius: circle.radius / step };
    let reach = (ABOUT * circle.radius).max(2.0);
    let read = |at: (usize, usize)| small.values[at];
    let edges = (0..RAYS).filter_map(|ray| edge(small.values.size(), &read, &circle, reach, ray));
    let points: Vec<DVec2> = edges.collect();
    let fit = fit_circle(&points).filter(|_| points.len() >= LEAST)?;
    Some((fit.spread - 0.5).max(0.0) / fit.circle.radius)
}

/// Fits a circle to the edges within `reach` pixels of `circle`; `None` if it moves too far.
fn near(size: (usize, usize), value: &dyn Fn((usize, usize)) -> Vec3, circle: &Circle, reach: f64) -> Option<Circle> {
    let points: Vec<DVec2> = (0..RAYS).filter_map(|ray| edge(size, value, circle, reach, ray)).collect();
    let fit = fit_circle(&points).filter(|_| points.len() >= LEAST)?;
    let moved = DVec2::new(fit.circle.x - circle.x, fit.circle.y - circle.y).length();
    let stays = moved <= 1.5 * reach && (fit.circle.radius - circle.radius).abs() <= 1.5 * reach;
    stays.then_some(fit.circle)
}

/// Returns the position of the largest change along a ray, within `reach` of the circle.
fn edge(
    size: (usize, usize),
    value: &dyn Fn((usize, usize)) -> Vec3,
    circle: &Circle,
    reach: f64,
    ray: usize,
) -> Option<DVec2> {
    let centre = DVec2::new(circle.x, circle.y);
    let outward = DVec2::from_angle(TAU * (ray as f64 + 0.5) / RAYS as f64);
    let aside = outward.perp();
    let count = (2.0 * reach * FINE).ceil() as usize + 3;
    let radius = |i: f64| circle.radius - reach + (i - 1.0) / FINE;
    // Average along the rim, so that edges across it count less.
    let along = (0..count).map(|i| {
        let at = centre + radius(i as f64) * outward;
        let three = [-1.0, 0.0, 1.0].map(|d| between(size, value, at + d * aside));
        Some((three[0]? + three[1]? + three[2]?) / 3.0)
    });
    let along: Vec<Vec3> = along.collect::<Option<_>>()?;
    // Change over one pixel: half a pixel to either side.
    let change: Vec<f32> = along.windows(3).map(|w| (w[2] - w[0]).length()).collect();
    let most = (0..change.len()).max_by(|a, b| change[*a].total_cmp(&change[*b]))?;
    if most == 0 || most + 1 == change.len() || change[most] < FAINT {
        return None;
    }
    let [before, top, after] = [most - 1, most, most + 1].map(|i| f64::from(change[i]));
    let bend = before - 2.0 * top + after;
    let shift = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    Some(centre + radius(most as f64 + 1.0 + shift) * outward)
}

/// Interpolates the value between pixels; `None` outside the picture.
fn between((width, height): (usize, usize), value: &dyn Fn((usize, usize)) -> Vec3, at: DVec2) -> Option<Vec3> {
    let low = at - 0.5;
    if !(low.x >= 0.0 && low.y >= 0.0 && low.x < width as f64 - 1.0 && low.y < height as f64 - 1.0) {
        return None;
    }
    let (x, y) = (low.x as usize, low.y as usize);
    let (u, v) = (low.fract().x as f32, low.fract().y as f32);
    let row = |y: usize| value((x, y)).lerp(value((x + 1, y)), u);
    Some(row(y).lerp(row(y + 1), v))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refines_a_rough_circle_to_a_fraction_of_a_pixel() {
        let want = Circle { x: 411.3, y: 389.8, radius: 240.6 };
        let rgb = Plane::from_fn(1000, 800, |x, y| {
            let off = (x as f64 + 0.5 - want.x).hypot(y as f64 + 0.5 - want.y) - want.radius;
            Vec3::splat(0.3 + 0.5 * (off + 0.5).clamp(0.0, 1.0) as f32 + 0.01 * ((x * 7 + y * 13) % 5) as f32)
        });
        let small = Small::of(&rgb, 512);
        let rough = Circle { x: 408.0, y: 392.0, radius: 244.0 };
        let got = refined(&rgb, &small, &rough, 8.0).unwrap();
        let error = (got.x - want.x).hypot(got.y - want.y) + (got.radius - want.radius).abs();
        assert!(error < 0.15, "{got:?}");
        let away = Circle { x: 408.0, y: 392.0, radius: 140.0 };
        assert!(refined(&rgb.map(|_| Vec3::ONE), &small.reduced(1), &away, 8.0).is_none());
    }
}
