//! Standard normals, independent of the shape of the observed object.

use glam::{DQuat, DVec3};

use crate::parallel;
use crate::shape::SurfacePoint;
use crate::sphere::fibonacci_hemisphere;

/// Number of normals on the visible hemisphere of the lattice, including those beyond
/// [`MAX_ANGLE`]: 3.2 degrees apart.
const NORMALS: usize = 2000;

/// Largest angle between normal and view in degrees, as in the paper.
const MAX_ANGLE: f64 = 80.0;

/// Angle in degrees within which a point belongs to a normal of the lattice: wide enough for about
/// seven of 10,000 observations.
const POINT_RADIUS: f64 = 2.0;

/// Standard normals of the visible hemisphere, in the frame of the view (z towards the camera).
///
/// Under distant light, the brightness of a convex surface depends only on its normal, so every
/// shape can be treated as a sphere.
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

    /// Returns the lattice as points of a sphere seen from `+z` of the frame of `camera`.
    ///
    /// The points serve to render the view of a camera.
    pub fn points(&self, camera: DQuat) -> Vec<SurfacePoint> {
        let view = camera * DVec3::Z;
        self.normals.iter().map(|&n| SurfacePoint { normal: camera * n, view }).collect()
    }

    /// Selects the points that contribute most to means at the normals of the lattice.
    ///
    /// For each normal, selects up to `each` points of the largest weight within two degrees, or
    /// else the nearest point with a weight. Returns their indices in ascending order, each once.
    ///
    /// # Panics
    /// If `points` and `weights` differ in number.
    pub fn choose(&self, points: &[SurfacePoint], weights: &[f64], each: usize) -> Vec<usize> {
        assert_eq!(points.len(), weights.len());
        let normals: Vec<DVec3> = points.iter().map(SurfacePoint::in_view).collect();
        let usable: Vec<usize> = (0..points.len()).filter(|&i| weights[i] > 0.0).collect();
        let reach = POINT_RADIUS.to_radians().powi(2);
        let nearest = |at: usize| {
            let square = |i: usize| (normals[i] - self.normals[at]).length_squared();
            let mut near: Vec<usize> = usable.iter().copied().filter(|&i| square(i) <= reach).collect();
            near.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(square(a).total_cmp(&square(b))));
            near.truncate(each);
            if near.is_empty() {
                near.extend(usable.iter().copied().min_by(|&a, &b| square(a).total_cmp(&square(b))));
            }
            near
        };
        let mut chosen = parallel::flat_map_range(self.normals.len(), nearest);
        chosen.sort_unstable();
        chosen.dedup();
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{ObservationSettings, sphere_points};

    #[test]
    fn chooses_the_heaviest_points_near_each_normal() {
        let lattice = Lattice::new();
        assert_eq!(lattice.normals().len(), 1653);
        let points = sphere_points(&ObservationSettings::default());
        let weights: Vec<f64> = (0..points.len()).map(|i| if i % 3 == 0 { 1.0 } else { 0.5 }).collect();
        let chosen = lattice.choose(&points, &weights, 1);
        assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]) && chosen.len() > 1000, "{}", chosen.len());
        let heavy = chosen.iter().filter(|i| **i % 3 == 0).count();
        assert!(heavy as f64 > 0.9 * chosen.len() as f64, "{heavy} of {}", chosen.len());
    }

    #[test]
    fn fills_gaps_with_the_nearest_point() {
        let lattice = Lattice::new();
        let points = lattice.points(DQuat::IDENTITY);
        let weights: Vec<f64> = points.iter().map(|p| if p.normal.x > 0.0 { 1.0 } else { 0.0 }).collect();
        let chosen = lattice.choose(&points, &weights, 2);
        assert!(chosen.iter().all(|&i| points[i].normal.x > 0.0));
        // Every point with a weight is nearest to itself.
        assert_eq!(chosen.len(), weights.iter().filter(|w| **w > 0.0).count());
    }
}
