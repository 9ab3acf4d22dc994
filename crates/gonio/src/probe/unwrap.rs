//! Conversion of an image of the ball to a lat-long map.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};

use super::{Reflectance, View};
use crate::parallel;
use crate::sphere::direction_of_lat_long;

/// Smallest and largest number of samples along a side of a texel: two per pixel that it covers.
const SAMPLES: (usize, usize) = (2, 32);
/// Angles from the direction of the camera, in radians: up to the first, a view shows mostly the
/// camera; from the second on, it does not show the camera.
pub(super) const CAMERA: (f64, f64) = (0.20, 0.35);
/// Factor on the trust in texels that show the camera: they count only without another view.
const LITTLE: f64 = 1e-5;

/// One texel of a map, from one view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Texel {
    /// Mean radiance of the visible part.
    pub(super) radiance: DVec3,
    /// Share of the texel that is visible, 0..=1.
    pub(super) coverage: f64,
    /// Weight of the view relative to others: high where the ball is seen from the front, low at
    /// the rim and where it reflects the camera.
    pub(super) trust: f64,
}

/// Unwraps a view to a map of `rows` by twice as many columns, row-major.
///
/// The camera is rotated by `turn` radians about the vertical axis from that of the map: a
/// direction `d` of the view is `R_y(turn) d` of the map.
///
/// A texel is the mean of its sub-texels, weighted by solid angle. Each sub-texel takes the
/// radiance of the picture at the point that reflects its direction. Reflection preserves radiance,
/// so a lamp keeps its flux as long as sub-texels are finer than pixels.
pub(super) fn unwrap(view: &View, rows: usize, turn: f64, reflectance: &Reflectance) -> Vec<Texel> {
    let back = DQuat::from_rotation_y(-turn);
    let (wide, high) = ((2 * rows) as f64, rows as f64);
    let direction = |u: f64, v: f64| back * direction_of_lat_long(u / wide, v / high);
    let texel = |column: usize, row: usize| {
        let (u, v) = (column as f64, row as f64);
        // Distance between the centres of opposite sides, in pixels.
        let across = |a: DVec3, b: DVec3| match (view.ball().place_of(a), view.ball().place_of(b)) {
            (Some(a), Some(b)) => (a.at.0 - b.at.0).hypot(a.at.1 - b.at.1),
            _ => SAMPLES.1 as f64 / 4.0,
        };
        let samples = |pixels: f64| ((2.0 * pixels).ceil() as usize).clamp(SAMPLES.0, SAMPLES.1);
        let columns = samples(across(direction(u, v + 0.5), direction(u + 1.0, v + 0.5)));
        let lines = samples(across(direction(u + 0.5, v), direction(u + 0.5, v + 1.0)));
        let (mut radiance, mut trust, mut covered, mut all) = (DVec3::ZERO, 0.0, 0.0, 0.0);
        for j in 0..lines {
            let v = v + (j as f64 + 0.5) / lines as f64;
            let weight = (PI * v / high).sin();
            for i in 0..columns {
                let direction = direction(u + (i as f64 + 0.5) / columns as f64, v);
                all += weight;
                if let Some(sample) = view.sample(direction, reflectance) {
                    radiance += weight * sample.radiance;
                    trust += weight * trusted(sample.cosine, direction.angle_between(view.ball().axis()));
                    covered += weight;
                }
            }
        }
        if covered > 0.0 {
            Texel { radiance: radiance / covered, coverage: covered / all, trust: trust / all }
        } else {
            Texel::default()
        }
    };
    parallel::map_range(2 * rows * rows, |at| texel(at % (2 * rows), at / (2 * rows)))
}

/// Returns the trust in a point of the ball.
///
/// Towards the rim, the range of directions that a pixel covers increases with the inverse of the
/// cosine, and so does the effect of an error of the outline.
fn trusted(cosine: f64, from_camera: f64) -> f64 {
    let (near, far) = CAMERA;
    let aside = ((from_camera - near) / (far - near)).clamp(0.0, 1.0);
    cosine.powi(4) * (LITTLE + (1.0 - LITTLE) * aside)
}
