//! Reflected radiance at one point, to a given relative error.
//!
//! A cell of light contributes its mean radiance times reflectance and cosine at its centre. Its
//! error is bounded by the deviation of the light in the cell times the variation of the
//! reflectance over it, plus the error of the midpoint rule. The cell with the largest bound is
//! subdivided until the sum of all bounds is small relative to the radiance. Subdivision therefore
//! concentrates on small lamps and sharp lobes.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::brdf::Brdf;
use super::tree::{Cell, LightTree};
use crate::reflectance::{BivariateTable, axis_d, axis_h};
use crate::shape::SurfacePoint;
use crate::sphere::half_difference;

/// Accuracy of the integrator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegratorSettings {
    /// Largest sum of the error bounds of all cells, relative to the radiance.
    ///
    /// The true error is about fifty times smaller, since the bounds ignore cancellation.
    pub tolerance: f64,
    /// Largest number of cells.
    pub max_cells: usize,
}

impl Default for IntegratorSettings {
    fn default() -> Self {
        Self { tolerance: 0.2, max_cells: 20_000 }
    }
}

/// Direction and weight of the light in one cell.
///
/// The weight is `L(w) max(n . w, 0) dw`; the angles are those of the cell's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Half angle, radians.
    pub theta_h: f64,
    /// Difference angle, radians.
    pub theta_d: f64,
    /// Direction of the light.
    pub direction: DVec3,
    /// RGB irradiance of the cell.
    pub weight: DVec3,
}

/// A quadrature of the light at one point.
#[derive(Clone, Debug, PartialEq)]
pub struct Nodes {
    /// Directions of the light with their weights.
    pub nodes: Vec<Node>,
    /// Error bound of the envelope's radiance, relative to that radiance.
    pub bound: f64,
}

/// Cell in the queue, ordered by its error bound.
struct Entry {
    bound: f64,
    value: f64,
    node: Node,
    cell: Cell,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.bound == other.bound
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

/// Radius (radians) below which cells are not subdivided, regardless of their error bound.
const SMALLEST: f64 = 2e-5;

/// Divides the light into cells, for BRDFs that vary no faster than `envelope`.
pub fn nodes(
    point: &SurfacePoint,
    envelope: &BivariateTable,
    light: &LightTree,
    settings: &IntegratorSettings,
) -> Nodes {
    nodes_within(point, envelope, light, settings, f64::INFINITY)
}

/// Divides the light like [`nodes`], but uses an error bound of at least 100 % for cells larger
/// than `largest`.
///
/// `largest` is a radius in radians. Nearly all light then comes from smaller cells. Surfaces with
/// self-shadowing require this, since the error bounds ignore shadows.
pub(crate) fn nodes_within(
    point: &SurfacePoint,
    envelope: &BivariateTable,
    light: &LightTree,
    settings: &IntegratorSettings,
    largest: f64,
) -> Nodes {
    let mut queue = BinaryHeap::with_capacity(1024);
    let mut finished: Vec<Entry> = Vec::new();
    // Running sums over all cells in `queue` and `finished`.
    let (mut total, mut bound) = (0.0, 0.0);
    let mut pending = vec![light.root()];
    loop {
        while let Some(cell) = pending.pop() {
            if let Some(mut entry) = assess(point, envelope, cell) {
                if cell.radius > largest {
                    entry.bound = entry.bound.max(entry.value);
                }
                total += entry.value;
                bound += entry.bound;
                queue.push(entry);
            }
        }
        if bound <= settings.tolerance * total || queue.len() + finished.len() > settings.max_cells {
            break;
        }
        let Some(worst) = queue.pop() else { break };
        if worst.cell.radius < SMALLEST || worst.bound <= 0.0 {
            finished.push(worst);
            continue;
        }
        total -= worst.value;
        bound -= worst.bound;
        pending.extend(light.divide(&worst.cell));
    }
    let all = finished.into_iter().chain(queue.into_vec());
    Nodes { nodes: all.map(|e| e.node).filter(|n| n.weight != DVec3::ZERO).collect(), bound: bound / total.max(1e-300) }
}

impl Nodes {
    /// Returns the reflected RGB radiance of a BRDF.
    pub fn radiance(&self, point: &SurfacePoint, brdf: &dyn Brdf) -> DVec3 {
        let with_phi = brdf.depends_on_phi();
        let each = self.nodes.iter().map(|n| {
            let phi_d = if with_phi { half_difference(point.normal, n.direction, point.view).phi_d } else { 0.0 };
            brdf.eval(n.theta_h, n.theta_d, phi_d) * n.weight
        });
        each.sum()
    }
}

/// Returns the RGB radiance `I = integral of L(w) f(w, v) max(n . w, 0) dw` (eq. 1).
///
/// `envelope` is that of `brdf`.
pub fn radiance(
    point: &SurfacePoint,
    brdf: &dyn Brdf,
    envelope: &BivariateTable,
    light: &LightTree,
    settings: &IntegratorSettings,
) -> DVec3 {
    nodes(point, envelope, light, settings).radiance(point, brdf)
}

/// Returns value and error bound of a cell, or `None` if all of it is below the horizon.
///
/// The value is the contribution of the cell under the envelope.
fn assess(point: &SurfacePoint, envelope: &BivariateTable, cell: Cell) -> Option<Entry> {
    let SurfacePoint { normal, view } = *point;
    let cosine = normal.dot(cell.centre);
    if cell.radius < 1.6 && cosine < -cell.radius.sin() {
        return None;
    }
    let sum = cell.centre + view;
    let twice_cos_d = sum.length();
    let half = sum / twice_cos_d.max(1e-9);
    let theta_h = 2.0 * (0.5 * (half - normal).length()).min(1.0).asin();
    let theta_d = (0.5 * (cell.centre - view).length()).min(1.0).asin();
    // Extent of the half vectors and largest cosine in the cell.
    let spread = cell.radius / twice_cos_d.max(0.02);
    let highest = (cosine + cell.radius).min(1.0);
    // The reflectance is evaluated at the ends of the ranges of both angles. This suffices because
    // tables are smooth between their samples, and the range of a cell that may contain the peak
    // starts at `theta_h = 0`.
    let tilt = 0.5 * cell.radius;
    let (h, d) = (axis_h(theta_h), axis_d(theta_d));
    let centre = envelope.between(h, d);
    let ends = [
        envelope.between(axis_h((theta_h - spread).max(0.0)), d),
        envelope.between(axis_h(theta_h + spread), d),
        envelope.between(h, axis_d((theta_d - tilt).max(0.0))),
        envelope.between(h, axis_d(theta_d + tilt)),
    ];
    let (low, strongest) = ends.iter().fold((centre, centre), |(a, b), &x| (a.min(x), b.max(x)));
    let variation = (strongest - low) / strongest.max(1e-300) + cell.radius / highest.max(1e-3);
    let mean = f64::from(cell.mean.abs().max_element());
    let bound = strongest
        * highest
        * cell.solid_angle
        * (f64::from(cell.deviation) * variation.min(1.0) + mean * (0.25 * variation * variation).min(1.0));
    let weight = cell.mean.as_dvec3() * (cosine.max(0.0) * cell.solid_angle);
    let node = Node { theta_h, theta_d, direction: cell.centre, weight };
    Some(Entry { bound, value: centre * weight.abs().max_element(), node, cell })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::lighting::EnvironmentMap;
    use crate::sphere::fibonacci_hemisphere;
    use crate::testing::environment_map;

    fn lobe(width: f64) -> BivariateTable {
        BivariateTable::from_fn(|h, _| 0.02 + 1.0 / (1.0 + (h / width).powi(2)).powi(2))
    }

    fn at(normal: DVec3) -> SurfacePoint {
        SurfacePoint { normal, view: DVec3::Z }
    }

    /// Computes the same integral independently, in polar coordinates of the half vector.
    fn reference(point: &SurfacePoint, brdf: &BivariateTable, light: &EnvironmentMap, rings: u32) -> f64 {
        let spokes = rings / 2;
        let (n, v) = (point.normal, point.view);
        let (x, y) = n.any_orthonormal_pair();
        let mut sum = 0.0;
        for ring in 0..rings {
            let s = (f64::from(ring) + 0.5) / f64::from(rings);
            let theta = s * s * PI / 2.0;
            let area = theta.sin() * s * PI / f64::from(rings) * 2.0 * PI / f64::from(spokes);
            for spoke in 0..spokes {
                let phi = 2.0 * PI * ((f64::from(spoke) + 0.5) / f64::from(spokes) + 0.618_034 * f64::from(ring));
                let h = theta.cos() * n + theta.sin() * (phi.cos() * x + phi.sin() * y);
                let cos_d = h.dot(v);
                let w = 2.0 * cos_d * h - v;
                if cos_d > 0.0 && w.dot(n) > 0.0 {
                    let f = brdf.eval(theta, cos_d.min(1.0).acos());
                    sum += f * f64::from(light.at(w).x) * w.dot(n) * 4.0 * cos_d * area;
                }
            }
        }
        sum
    }

    fn check(brdf: &BivariateTable, light: &EnvironmentMap, rings: u32, tolerance: f64) {
        let tree = LightTree::of_map(light);
        let fine = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
        for normal in fibonacci_hemisphere(6).filter(|n| n.z > 0.2) {
            let got = radiance(&at(normal), brdf, brdf, &tree, &fine);
            let want = reference(&at(normal), brdf, light, rings);
            assert!((got.x / want - 1.0).abs() < tolerance, "{normal} {} {want}", got.x);
        }
    }

    #[test]
    fn sharp_lobes_under_smooth_light_are_integrated() {
        for width in [0.3, 3.0, 30.0_f64] {
            check(&lobe(width.to_radians()), &environment_map(256, |d| 1.0 + d.y), 1200, 0.01);
        }
    }

    #[test]
    fn small_lamps_are_not_missed() {
        let lamp = DVec3::new(0.4, 0.5, 0.6).normalize();
        let light = environment_map(256, |d| if d.angle_between(lamp) < 0.04 { 5000.0 } else { 0.5 });
        for width in [1.0, 5.0, 60.0_f64] {
            check(&lobe(width.to_radians()), &light, 2400, 0.02);
        }
    }

    #[test]
    fn white_lambertian_ball_in_white_light_is_white() {
        let white = BivariateTable::from_fn(|_, _| 1.0 / PI);
        let tree = LightTree::of_map(&environment_map(256, |_| 1.0));
        let fine = IntegratorSettings { tolerance: 0.02, ..IntegratorSettings::default() };
        for normal in fibonacci_hemisphere(10) {
            let got = radiance(&at(normal), &white, &white, &tree, &fine);
            assert!((got.x - 1.0).abs() < 5e-3, "{normal} {got:?}");
        }
    }
}
