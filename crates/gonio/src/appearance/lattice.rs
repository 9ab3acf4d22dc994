//! Image on standard normals, independent of the shape it was observed on.

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::shape::SurfacePoint;
use crate::sphere::fibonacci_hemisphere;

/// Normals on the visible hemisphere of the lattice, those beyond [`MAX_ANGLE`] included: 3.2
/// degrees apart.
const NORMALS: usize = 2000;

/// Largest angle between normal and view in degrees, as in the paper.
const MAX_ANGLE: f64 = 80.0;

/// Standard deviation, in degrees, of the Gaussian with which observations are averaged: finer than
/// the lattice, so that values stay nearly point samples, but wide enough to find one or two of
/// 10,000 observations.
const WIDTH: f64 = 0.5;

/// Number of standard deviations beyond which an observation does not count.
const REACH: f64 = 4.0;

/// Standard normals of the visible hemisphere, in the frame of the view (z towards the camera).
/// Under light from far away the brightness of a convex surface is a function of its normal, so
/// every shape can be treated as a sphere.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    normals: Vec<DVec3>,
}

impl Default for Lattice {
    fn default() -> Self {
        Self::new()
    }
}

impl Lattice {
    /// Builds the lattice of all statistics: the Fibonacci lattice up to 80 degrees, 1,653 normals.
    pub fn new() -> Self {
        let least = MAX_ANGLE.to_radians().cos();
        Self { normals: fibonacci_hemisphere(NORMALS).filter(|n| n.z > least).collect() }
    }

    /// Returns the normals.
    pub fn normals(&self) -> &[DVec3] {
        &self.normals
    }

    /// Returns the lattice as points of a sphere seen from `+z` of the frame that `camera` turns
    /// to, for rendering the view of a camera.
    pub fn points(&self, camera: DQuat) -> Vec<SurfacePoint> {
        let view = camera * DVec3::Z;
        self.normals.iter().map(|&n| SurfacePoint { normal: camera * n, view }).collect()
    }

    /// Averages the colours (linear RGB) around each normal of the lattice; `None` is not observed.
    /// Where none is near, wider means are taken.
    ///
    /// # Panics
    /// If `points` and `colours` differ in number or nothing is observed.
    pub fn gather_colours(&self, points: &[SurfacePoint], colours: &[Option<Vec3>]) -> Vec<Vec3> {
        assert_eq!(points.len(), colours.len());
        let seen = |(p, c): (&SurfacePoint, &Option<Vec3>)| {
            c.map(|c| Observed { normal: p.in_view(), colour: c.as_dvec3().max(DVec3::ZERO) })
        };
        let observed: Vec<Observed> = points.iter().zip(colours).filter_map(seen).collect();
        assert!(!observed.is_empty(), "an image without observations");
        self.normals.par_iter().map(|n| mean_around(*n, &observed)).collect()
    }

    /// Chooses the weighted points that matter most to means at the lattice's normals: for each of
    /// these up to `each` of the greatest weight within two degrees, or the nearest one. Returns
    /// their indices in order, each once.
    ///
    /// # Panics
    /// If `points` and `weights` differ in number.
    pub fn choose(&self, points: &[SurfacePoint], weights: &[f64], each: usize) -> Vec<usize> {
        assert_eq!(points.len(), weights.len());
        let normals: Vec<DVec3> = points.iter().map(SurfacePoint::in_view).collect();
        let usable: Vec<usize> = (0..points.len()).filter(|&i| weights[i] > 0.0).collect();
        let reach = (REACH * WIDTH).to_radians().powi(2);
        let mut chosen: Vec<usize> = self
            .normals
            .par_iter()
            .flat_map_iter(|n| {
                let square = |i: usize| (normals[i] - *n).length_squared();
                let mut near: Vec<usize> = usable.iter().copied().filter(|&i| square(i) <= reach).collect();
                near.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(square(a).total_cmp(&square(b))));
                near.truncate(each);
                if near.is_empty() {
                    near.extend(usable.iter().copied().min_by(|&a, &b| square(a).total_cmp(&square(b))));
                }
                near
            })
            .collect();
        chosen.sort_unstable();
        chosen.dedup();
        chosen
    }
}

/// An observation in the frame of its own view.
struct Observed {
    normal: DVec3,
    colour: DVec3,
}

/// Returns the weighted mean around a normal.
fn mean_around(normal: DVec3, observed: &[Observed]) -> Vec3 {
    // Chords instead of angles: nearly equal where they are small, and monotone.
    let squares: Vec<f64> = observed.iter().map(|o| (o.normal - normal).length_squared()).collect();
    let nearest = squares.iter().copied().fold(f64::INFINITY, f64::min);
    let reach = (REACH * WIDTH).to_radians().powi(2);
    // Beyond its reach the Gaussian widens until the nearest observation is two standard deviations
    // away.
    let variance = if nearest > reach { nearest / 4.0 } else { WIDTH.to_radians().powi(2) };
    let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
    for (square, observed) in squares.iter().zip(observed) {
        if *square <= REACH * REACH * variance {
            let weight = (-0.5 * square / variance).exp();
            sum += weight * observed.colour;
            weights += weight;
        }
    }
    (sum / weights).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{ObservationSettings, sphere_points};

    fn smooth(n: DVec3) -> Vec3 {
        DVec3::new(1.0 + 0.5 * n.x, 1.0 + 0.3 * n.y * n.z, n.z).as_vec3()
    }

    #[test]
    fn a_sphere_is_gathered_as_it_is() {
        let lattice = Lattice::new();
        assert_eq!(lattice.normals().len(), 1653);
        let points = sphere_points(&ObservationSettings::default());
        let colours: Vec<Option<Vec3>> = points.iter().map(|p| Some(smooth(p.normal))).collect();
        for (n, c) in lattice.normals().iter().zip(lattice.gather_colours(&points, &colours)) {
            assert!((smooth(*n) - c).abs().max_element() < 0.02, "{n} {c}");
        }
    }

    #[test]
    fn only_the_angle_to_the_view_counts() {
        let lattice = Lattice::new();
        let turn = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(-0.2);
        let points = lattice.points(turn);
        let colours: Vec<Option<Vec3>> = lattice.normals().iter().map(|n| Some(Vec3::splat(n.z as f32))).collect();
        // The rotation back is not the inverse of `turn`, but both preserve the angle to the view.
        for (n, c) in lattice.normals().iter().zip(lattice.gather_colours(&points, &colours)) {
            assert!((n.z - f64::from(c.y)).abs() < 0.06, "{n} {c}");
        }
    }

    #[test]
    fn gaps_are_filled_from_their_border() {
        let lattice = Lattice::new();
        let points = lattice.points(DQuat::IDENTITY);
        let hole = DVec3::new(0.3, 0.2, 0.9).normalize();
        let colours: Vec<Option<Vec3>> =
            points.iter().map(|p| (p.normal.angle_between(hole) > 0.25).then(|| smooth(p.normal))).collect();
        for (n, c) in lattice.normals().iter().zip(lattice.gather_colours(&points, &colours)) {
            assert!((smooth(*n) - c).abs().max_element() < 0.2, "{n} {c}");
        }
    }
}
