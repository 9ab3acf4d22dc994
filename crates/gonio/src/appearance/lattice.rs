//! An image on standard normals, whatever the shape it was observed on.

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::sphere::fibonacci_hemisphere;
use crate::transfer::SurfacePoint;

/// Normals on the visible hemisphere of the lattice, those beyond [`MAX_ANGLE`] included: 3.2 degrees apart.
const NORMALS: usize = 2000;

/// Largest angle between normal and view in degrees, as in the paper.
const MAX_ANGLE: f64 = 80.0;

/// Observations are averaged with a Gaussian of this standard deviation in degrees: finer than the lattice, so that
/// values stay nearly point samples, as wide as is needed to find one or two of 10,000 observations.
const WIDTH: f64 = 0.5;

/// Observations farther than so many standard deviations away do not count.
const REACH: f64 = 4.0;

/// Standard normals of the visible hemisphere, in the frame of the view (z towards the camera). Light from far away makes the
/// brightness of a convex surface a function of its normal, so that every shape is seen as a sphere.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    normals: Vec<DVec3>,
}

/// An image on a [`Lattice`].
#[derive(Clone, Debug, PartialEq)]
pub struct Gathered {
    /// A value for each normal of the lattice, on the scale of the observations; not negative.
    pub values: Vec<f32>,
    /// Normals without an observation within 2 degrees: their value is a mean over the nearest there are.
    pub filled: usize,
}

impl Default for Lattice {
    fn default() -> Self {
        Self::new()
    }
}

impl Lattice {
    /// The lattice of all statistics: the Fibonacci lattice up to 80 degrees, 1,653 normals.
    pub fn new() -> Self {
        let least = MAX_ANGLE.to_radians().cos();
        Self { normals: fibonacci_hemisphere(NORMALS).filter(|n| n.z > least).collect() }
    }

    /// The normals.
    pub fn normals(&self) -> &[DVec3] {
        &self.normals
    }

    /// The lattice as points of a sphere seen from `+z` of the frame that `camera` turns to, for rendering what a camera would see.
    pub fn points(&self, camera: DQuat) -> Vec<SurfacePoint> {
        let view = camera * DVec3::Z;
        self.normals.iter().map(|&n| SurfacePoint { normal: camera * n, view }).collect()
    }

    /// The mean of the observations around each normal of the lattice. Where none is near, wider means are taken.
    ///
    /// Points beyond 80 degrees count as others do; `None` is not observed.
    ///
    /// # Panics
    /// If `points` and `values` differ in number or nothing is observed.
    pub fn gather(&self, points: &[SurfacePoint], values: &[Option<f64>]) -> Gathered {
        self.gather_weighted(points, values, &vec![1.0; points.len()])
    }

    /// As [`Self::gather`], with a weight for each observation. Those of weight zero are not observed.
    ///
    /// # Panics
    /// Likewise, and if the weights differ in number.
    pub fn gather_weighted(&self, points: &[SurfacePoint], values: &[Option<f64>], weights: &[f64]) -> Gathered {
        assert!(points.len() == values.len() && points.len() == weights.len());
        let grey = |(v, &weight): (&Option<f64>, &f64)| v.filter(|_| weight > 0.0).map(|v| ([v], weight));
        let (values, filled) = self.means(points, values.iter().zip(weights).map(grey));
        Gathered { values: values.into_iter().map(|[v]| v).collect(), filled }
    }

    /// As [`Self::gather`], of linear RGB.
    ///
    /// # Panics
    /// Likewise.
    pub fn gather_colours(&self, points: &[SurfacePoint], colours: &[Option<Vec3>]) -> Vec<Vec3> {
        assert_eq!(points.len(), colours.len());
        let rgb = |c: &Option<Vec3>| c.map(|c| (c.as_dvec3().to_array(), 1.0));
        self.means(points, colours.iter().map(rgb)).0.into_iter().map(Vec3::from_array).collect()
    }

    /// Means of what is given with a weight for each point, and how many of them had to reach farther than they should.
    fn means<const N: usize>(
        &self,
        points: &[SurfacePoint],
        values: impl Iterator<Item = Option<([f64; N], f64)>>,
    ) -> (Vec<[f32; N]>, usize) {
        let observed: Vec<Observed<N>> = points
            .iter()
            .zip(values)
            .filter_map(|(p, v)| {
                v.map(|(v, weight)| Observed { normal: p.in_view(), value: v.map(|v| v.max(0.0)), weight })
            })
            .collect();
        assert!(!observed.is_empty(), "an image without observations");
        let gathered: Vec<([f32; N], bool)> = self.normals.par_iter().map(|n| mean_around(*n, &observed)).collect();
        let filled = gathered.iter().filter(|(_, filled)| *filled).count();
        (gathered.into_iter().map(|(v, _)| v).collect(), filled)
    }

    /// Of points with weights those that matter most to [`Self::gather_weighted`]: for each normal of the lattice up to `each` of the greatest weight
    /// within two degrees, or the nearest one. In order, each once.
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
struct Observed<const N: usize> {
    normal: DVec3,
    value: [f64; N],
    weight: f64,
}

/// The weighted mean around a normal, and whether it had to reach farther than it should.
fn mean_around<const N: usize>(normal: DVec3, observed: &[Observed<N>]) -> ([f32; N], bool) {
    // Chords in place of angles: alike where they are small, and monotone.
    let squares: Vec<f64> = observed.iter().map(|o| (o.normal - normal).length_squared()).collect();
    let nearest = squares.iter().copied().fold(f64::INFINITY, f64::min);
    let reach = (REACH * WIDTH).to_radians().powi(2);
    let filled = nearest > reach;
    // Beyond its reach the Gaussian grows until the nearest observation is two standard deviations away.
    let variance = if filled { nearest / 4.0 } else { WIDTH.to_radians().powi(2) };
    let (mut sum, mut weights) = ([0.0; N], 0.0);
    for (square, observed) in squares.iter().zip(observed) {
        if *square <= REACH * REACH * variance {
            let weight = observed.weight * (-0.5 * square / variance).exp();
            sum.iter_mut().zip(&observed.value).for_each(|(s, v)| *s += weight * v);
            weights += weight;
        }
    }
    (sum.map(|s| (s / weights) as f32), filled)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{ObservationSettings, sphere_points};

    fn smooth(n: DVec3) -> f64 {
        1.0 + 0.5 * n.x + 0.3 * n.y * n.z
    }

    #[test]
    fn a_sphere_is_gathered_as_it_is() {
        let lattice = Lattice::new();
        assert_eq!(lattice.normals().len(), 1653);
        let points = sphere_points(&ObservationSettings::default());
        let values: Vec<Option<f64>> = points.iter().map(|p| Some(smooth(p.normal))).collect();
        let got = lattice.gather(&points, &values);
        assert_eq!(got.filled, 0);
        for (n, v) in lattice.normals().iter().zip(&got.values) {
            assert!((smooth(*n) - f64::from(*v)).abs() < 0.01, "{n} {v}");
        }
    }

    #[test]
    fn only_the_angle_to_the_view_counts() {
        let lattice = Lattice::new();
        let turn = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(-0.2);
        let points = lattice.points(turn);
        let values: Vec<Option<f64>> = lattice.normals().iter().map(|n| Some(n.z)).collect();
        let got = lattice.gather(&points, &values);
        // The turn back is not the inverse of `turn`, but both leave the angle to the view alone.
        for (n, v) in lattice.normals().iter().zip(&got.values) {
            assert!((n.z - f64::from(*v)).abs() < 0.06, "{n} {v}");
        }
    }

    #[test]
    fn gaps_are_filled_from_their_border() {
        let lattice = Lattice::new();
        let points = lattice.points(DQuat::IDENTITY);
        let hole = DVec3::new(0.3, 0.2, 0.9).normalize();
        let values: Vec<Option<f64>> =
            points.iter().map(|p| (p.normal.angle_between(hole) > 0.25).then(|| smooth(p.normal))).collect();
        let got = lattice.gather(&points, &values);
        let inside = lattice.normals().iter().filter(|n| n.angle_between(hole) <= 0.25).count();
        assert!(got.filled > inside / 2 && got.filled <= inside, "{} of {inside}", got.filled);
        for (n, v) in lattice.normals().iter().zip(&got.values) {
            assert!((smooth(*n) - f64::from(*v)).abs() < 0.2, "{n} {v}");
        }
    }
}
