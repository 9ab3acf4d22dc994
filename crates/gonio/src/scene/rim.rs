//! Refines the outline of a ball, starting from an approximate circle: finds the largest change of
//! the image along rays from the centre, with subpixel accuracy.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3, Vec3};

use super::circle_fit::{Circle, fit_circle};
use super::small::Small;
use crate::picture::Plane;

/// Number of rays from the centre.
const RAYS: usize = 180;
/// Share of the radius within which edges are searched to decide whether they form a circle.
const ABOUT: f64 = 0.15;
/// Smallest number of rays with an edge.
const MIN_RAYS: usize = 24;
/// Number of samples per pixel along a ray.
const SAMPLES_PER_PIXEL: f64 = 2.0;
/// Distance by which a refined circle may be off, in pixels of the reduced photograph.
const COMMON: f64 = 3.0;
/// Largest number of steps of the search grid on either side.
const MAX_SPAN: f64 = 8.0;
/// Distance of the outside of a rim from the rim, in pixels.
const OUTSIDE: f64 = 1.5;
/// Distance in pixels within which the last fit searches the edges.
const CLOSE: f64 = 1.0;
/// Number of sectors of rays that are left out in turn to estimate the standard error.
const SECTORS: usize = 12;
/// Standard error of an outline whose sectors agree, in pixels: the discretisation of the edges.
const MIN_ERROR: f64 = 0.1;
/// Smallest change of the compressed values over one pixel that counts as an edge.
const FAINT: f32 = 0.004;

/// Refines a circle, in pixels of the photograph, on edges within `reach` pixels of it: first in
/// the reduced photograph, then in the photograph itself. `None` if no circle fits these edges.
pub(super) fn refined(rgb: &Plane<Vec3>, small: &Small, circle: &Circle, reach: f64) -> Option<Circle> {
    let step = small.step as f64;
    let reduced = Pixels { size: small.values.size(), value: &|at| small.values[at] };
    let circle = reduced.fit(&scaled(circle, 1.0 / step), (reach / step).max(2.0))?;
    let circle = scaled(&reduced.fit(&circle, 2.0)?, step);
    if small.step == 1 {
        return Some(circle);
    }
    Pixels { size: rgb.size(), value: &|at| small.compression.apply(rgb[at]) }.fit(&circle, 1.5 * step)
}

/// Moves the outline of a ball to the outermost edge that most rays have in common.
///
/// Reflections within a ball are compressed towards its rim. Single rays often have their strongest
/// edge there.
pub(super) fn polished(rgb: &Plane<Vec3>, small: &Small, circle: &Circle) -> Circle {
    let step = small.step as f64;
    let reduced = Pixels { size: small.values.size(), value: &|at| small.values[at] };
    let mut polished =
        reduced.common(&scaled(circle, 1.0 / step), COMMON).map_or(*circle, |circle| scaled(&circle, step));
    let whole = Pixels { size: rgb.size(), value: &|at| small.compression.apply(rgb[at]) };
    if small.step > 1 {
        polished = whole.common(&polished, COMMON * step).unwrap_or(polished);
    }
    whole.fit(&polished, CLOSE).unwrap_or(polished)
}

/// Estimates the standard error of an outline, in pixels: the largest of those of the coordinates
/// of the centre and of the radius; infinite if there are too few edges.
///
/// The estimate is a jackknife over sectors of the outline, because the errors of neighbouring
/// edges are correlated.
pub(super) fn standard_error(rgb: &Plane<Vec3>, small: &Small, circle: &Circle) -> f64 {
    let whole = Pixels { size: rgb.size(), value: &|at| small.compression.apply(rgb[at]) };
    let edges = whole.edges(circle, CLOSE);
    let sector = |edge: &DVec2| {
        let turn = (edge - DVec2::new(circle.x, circle.y)).to_angle().rem_euclid(TAU) / TAU;
        (turn * SECTORS as f64) as usize
    };
    let without = |out: usize| {
        let rest: Vec<DVec2> = edges.iter().filter(|edge| sector(edge) != out).copied().collect();
        let fit = fit_circle(&rest).filter(|_| rest.len() >= MIN_RAYS)?.circle;
        Some(DVec3::new(fit.x, fit.y, fit.radius))
    };
    let Some(fits) = (0..SECTORS).map(without).collect::<Option<Vec<DVec3>>>() else { return f64::INFINITY };
    let mean = fits.iter().sum::<DVec3>() / SECTORS as f64;
    let squares = fits.iter().map(|fit| (fit - mean) * (fit - mean)).sum::<DVec3>();
    let variance = (SECTORS - 1) as f64 / SECTORS as f64 * squares.max_element();
    (variance + MIN_ERROR * MIN_ERROR).sqrt()
}

fn scaled(circle: &Circle, by: f64) -> Circle {
    Circle { x: circle.x * by, y: circle.y * by, radius: circle.radius * by }
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
    let reduced = Pixels { size: small.values.size(), value: &|at| small.values[at] };
    let points = reduced.edges(&circle, reach);
    let fit = fit_circle(&points).filter(|_| points.len() >= MIN_RAYS)?;
    Some((fit.spread - 0.5).max(0.0) / fit.circle.radius)
}

/// The pixels of a photograph.
struct Pixels<'a> {
    size: (usize, usize),
    value: &'a (dyn Fn((usize, usize)) -> Vec3 + Sync),
}

impl Pixels<'_> {
    /// Fits a circle to the strongest edge of each ray within `reach` pixels of `circle`; `None` if
    /// it moves too far.
    fn fit(&self, circle: &Circle, reach: f64) -> Option<Circle> {
        let points = self.edges(circle, reach);
        let fit = fit_circle(&points).filter(|_| points.len() >= MIN_RAYS)?;
        let moved = DVec2::new(fit.circle.x - circle.x, fit.circle.y - circle.y).length();
        let stays = moved <= 1.5 * reach && (fit.circle.radius - circle.radius).abs() <= 1.5 * reach;
        stays.then_some(fit.circle)
    }

    /// Returns the positions of the largest change along each ray, within `reach` of the circle.
    fn edges(&self, circle: &Circle, reach: f64) -> Vec<DVec2> {
        let centre = DVec2::new(circle.x, circle.y);
        let edge = |ray: usize| {
            let change = self.change(circle, reach, ray)?;
            let most = (0..change.len()).max_by(|a, b| change[*a].total_cmp(&change[*b]))?;
            if most == 0 || most + 1 == change.len() || change[most] < FAINT {
                return None;
            }
            let [before, top, after] = [most - 1, most, most + 1].map(|i| f64::from(change[i]));
            let bend = before - 2.0 * top + after;
            let shift = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
            Some(centre + (circle.radius - reach + (most as f64 + shift) / SAMPLES_PER_PIXEL) * direction(ray))
        };
        (0..RAYS).filter_map(edge).collect()
    }

    /// Moves a circle to the outermost edge that most rays share.
    ///
    /// A first search covers `reach` pixels in each coordinate and the radius. A second search,
    /// around its result, covers 1.5 pixels. Finer grids may extend each search by a pixel.
    ///
    /// Each ray votes for the radii with a large share of its changes. Votes outside of the circle
    /// count against it, since the edges of a background do not follow the rim.
    fn common(&self, circle: &Circle, reach: f64) -> Option<Circle> {
        let mut circle = *circle;
        // The rim moves linearly with the centre only for small shifts, so the search is repeated.
        for reach in [reach, 1.5] {
            let margin = 2.0 * reach + OUTSIDE;
            let profile = |ray| Some((direction(ray), shares(&self.change(&circle, margin, ray)?)));
            let profiles: Vec<(DVec2, Vec<f32>)> = (0..RAYS).filter_map(profile).collect();
            if profiles.len() < MIN_RAYS {
                return None;
            }
            let score = |shift: DVec3| -> f64 {
                let vote = |(outward, shares): &(DVec2, Vec<f32>)| {
                    let rim = shift.x * outward.x + shift.y * outward.y + shift.z + margin;
                    sampled(shares, rim * SAMPLES_PER_PIXEL) - sampled(shares, (rim + OUTSIDE) * SAMPLES_PER_PIXEL)
                };
                profiles.iter().map(vote).sum()
            };
            let shift = highest(&score, reach);
            circle = Circle { x: circle.x + shift.x, y: circle.y + shift.y, radius: circle.radius + shift.z };
        }
        Some(circle)
    }

    /// Returns the changes over one pixel along a ray, from `reach` inside to `reach` outside the
    /// circle; `None` if the ray leaves the picture.
    fn change(&self, circle: &Circle, reach: f64, ray: usize) -> Option<Vec<f32>> {
        let centre = DVec2::new(circle.x, circle.y);
        let (outward, count) = (direction(ray), (2.0 * reach * SAMPLES_PER_PIXEL).ceil() as usize + 3);
        let aside = outward.perp();
        // Average along the rim, so that edges across it count less.
        let along = (0..count).map(|i| {
            let at = centre + (circle.radius - reach + (i as f64 - 1.0) / SAMPLES_PER_PIXEL) * outward;
            let three = [-1.0, 0.0, 1.0].map(|d| between(self.size, self.value, at + d * aside));
            Some((three[0]? + three[1]? + three[2]?) / 3.0)
        });
        let along: Vec<Vec3> = along.collect::<Option<_>>()?;
        // Half a pixel to either side.
        Some(along.windows(3).map(|w| (w[2] - w[0]).length()).collect())
    }
}

fn direction(ray: usize) -> DVec2 {
    DVec2::from_angle(TAU * (ray as f64 + 0.5) / RAYS as f64)
}

/// Returns the share of each change in the squared changes of a ray.
fn shares(change: &[f32]) -> Vec<f32> {
    let square = |v: &f32| v * v;
    let mean = change.iter().map(square).sum::<f32>() / change.len() as f32 + FAINT * FAINT;
    change.iter().map(|v| square(v) / (square(v) + mean)).collect()
}

/// Interpolates between samples; zero outside.
fn sampled(of: &[f32], at: f64) -> f64 {
    let low = at as usize;
    if at < 0.0 || low + 1 >= of.len() {
        return 0.0;
    }
    f64::from(of[low]) + at.fract() * f64::from(of[low + 1] - of[low])
}

/// Returns the shift of highest score within `reach`: the best of a grid, then of finer grids.
fn highest(score: &dyn Fn(DVec3) -> f64, reach: f64) -> DVec3 {
    let mut step = f64::max(0.5, reach / MAX_SPAN);
    let (mut best, mut most) = (DVec3::ZERO, score(DVec3::ZERO));
    let mut span = (reach / step) as i32;
    while step > 0.02 {
        let middle = best;
        let along = move || (-span..=span).map(move |i| step * f64::from(i));
        for dx in along() {
            for dy in along() {
                for dr in along() {
                    let shift = middle + DVec3::new(dx, dy, dr);
                    let value = score(shift);
                    if value > most {
                        (best, most) = (shift, value);
                    }
                }
            }
        }
        (step, span) = (0.5 * step, 2);
    }
    best
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
