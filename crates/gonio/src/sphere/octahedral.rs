//! Octahedral maps: the sphere unfolded onto a square.
//!
//! The square is -1..1 in `u` (right) and `v` (up). Its centre is the direction +z, towards the
//! camera. Its four corners meet at -z, behind the object, where a photograph constrains the light
//! least. The vertical axis of the square is the vertical axis of the world: `v > 0` exactly where
//! `y > 0`. The top half of the square is therefore the sky, and the coarsest "vertical" wavelet
//! compares light from above with light from below, as the prior of the paper requires.

use std::f64::consts::{FRAC_PI_4, PI};

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Layout of the sphere on the square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OctahedralMap {
    /// Clarberg's map (2008): every part of the square has the same solid angle.
    ///
    /// This is the default because a Haar basis that is orthonormal on the square is then
    /// orthonormal on the sphere. The DC coefficient is the integral of the light over the sphere.
    /// Normalising that integral to one makes the coefficient the same constant for every light.
    #[default]
    EqualArea,
    /// Map of Praun and Hoppe (2003), used in the paper: central projection onto an octahedron.
    ///
    /// Solid angle per area varies by a factor of 5.2, so integrals over the square and over the
    /// sphere differ. The integral over the square is normalised, which again makes the DC
    /// coefficient constant.
    PraunHoppe,
}

impl OctahedralMap {
    /// Returns the unit direction of the point `(u, v)` of the square, both in -1..=1.
    pub fn direction(self, u: f64, v: f64) -> DVec3 {
        match self {
            Self::EqualArea => {
                let (au, av) = (u.abs(), v.abs());
                let signed = 1.0 - au - av;
                let r = 1.0 - signed.abs();
                let phi = if r > 0.0 { ((av - au) / r + 1.0) * FRAC_PI_4 } else { 0.0 };
                let rho = r * (2.0 - r * r).sqrt();
                let z = (1.0 - r * r).copysign(signed);
                DVec3::new((rho * phi.cos()).copysign(u), (rho * phi.sin()).copysign(v), z)
            }
            Self::PraunHoppe => Self::on_octahedron(u, v).normalize(),
        }
    }

    /// Returns the point `(u, v)` of the square for a unit direction.
    pub fn square(self, d: DVec3) -> (f64, f64) {
        let (ax, ay) = (d.x.abs(), d.y.abs());
        let (a, b) = match self {
            Self::EqualArea => {
                // 1 - |z| loses digits near the poles; (x^2 + y^2) / (1 + |z|) is equal and does
                // not cancel.
                let r = ((ax * ax + ay * ay) / (1.0 + d.z.abs())).sqrt();
                let b = r * ay.atan2(ax) / (2.0 * FRAC_PI_4);
                (r - b, b)
            }
            Self::PraunHoppe => {
                let sum = ax + ay + d.z.abs();
                (ax / sum, ay / sum)
            }
        };
        let (a, b) = if d.z >= 0.0 { (a, b) } else { (1.0 - b, 1.0 - a) };
        (a.copysign(d.x), b.copysign(d.y))
    }

    /// Returns the solid angle per area of the square at `(u, v)`, in sr.
    ///
    /// Its integral over the square (area 4) is 4 pi.
    pub fn density(self, u: f64, v: f64) -> f64 {
        match self {
            Self::EqualArea => PI,
            Self::PraunHoppe => Self::on_octahedron(u, v).length().powi(-3),
        }
    }

    /// Returns an upper bound (radians) of the angle from the centre of a cell to its points.
    ///
    /// The cells divide the square into `2^level` by `2^level`. Meant for `level >= 2`, where cells
    /// are small.
    pub(crate) fn cell_radius(self, level: u32) -> f64 {
        // The largest angle from the centre to a corner times 2^level grows with the level to 4.29
        // (equal area) and 4.25 (Praun-Hoppe).
        4.3 / f64::from(1_u32 << level)
    }

    fn on_octahedron(u: f64, v: f64) -> DVec3 {
        let (au, av) = (u.abs(), v.abs());
        let z = 1.0 - au - av;
        if z >= 0.0 { DVec3::new(u, v, z) } else { DVec3::new((1.0 - av).copysign(u), (1.0 - au).copysign(v), z) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [OctahedralMap; 2] = [OctahedralMap::EqualArea, OctahedralMap::PraunHoppe];

    fn cells(n: usize) -> impl Iterator<Item = (f64, f64)> {
        let at = move |i: usize| (2 * i + 1) as f64 / n as f64 - 1.0;
        (0..n * n).map(move |c| (at(c % n), at(c / n)))
    }

    #[test]
    fn square_inverts_direction() {
        for map in BOTH {
            for (u, v) in cells(37).chain([(1e-7, 1e-9), (0.999_999, 0.999_999), (-0.5, 0.5)]) {
                let d = map.direction(u, v);
                assert!((d.length() - 1.0).abs() < 1e-12);
                let (s, t) = map.square(d);
                assert!((s - u).abs() + (t - v).abs() < 1e-7, "{map:?} {u} {v} {s} {t}");
            }
        }
    }

    #[test]
    fn up_is_y_and_the_centre_faces_the_camera() {
        for map in BOTH {
            assert!((map.direction(0.0, 0.0) - DVec3::Z).length() < 1e-12);
            assert!((map.direction(1.0, 1.0) + DVec3::Z).length() < 1e-12);
            for (u, v) in cells(16) {
                let d = map.direction(u, v);
                assert_eq!((d.x > 0.0, d.y > 0.0), (u > 0.0, v > 0.0));
            }
        }
    }

    #[test]
    fn density_is_the_area_on_the_sphere() {
        let e = 1e-4;
        for map in BOTH {
            for (u, v) in cells(10).map(|(u, v)| (0.97 * u, 0.98 * v)) {
                let du = (map.direction(u + e, v) - map.direction(u - e, v)) / (2.0 * e);
                let dv = (map.direction(u, v + e) - map.direction(u, v - e)) / (2.0 * e);
                let area = du.cross(dv).length();
                assert!((area / map.density(u, v) - 1.0).abs() < 1e-5, "{map:?} {u} {v}");
            }
            let n = 400;
            let total: f64 = cells(n).map(|(u, v)| map.density(u, v)).sum::<f64>() * 4.0 / (n * n) as f64;
            assert!((total / (4.0 * PI) - 1.0).abs() < 1e-4, "{map:?} {total}");
        }
    }

    #[test]
    fn cell_radius_is_a_bound() {
        for map in BOTH {
            for level in 2..8 {
                let n = 1 << level;
                let half = 1.0 / n as f64;
                let bound = map.cell_radius(level);
                let mut widest = 0.0_f64;
                for (u, v) in cells(n) {
                    let centre = map.direction(u, v);
                    for (s, t) in [(-half, -half), (half, -half), (-half, half), (half, half), (half, 0.0), (0.0, half)]
                    {
                        widest = widest.max(centre.angle_between(map.direction(u + s, v + t)));
                    }
                }
                assert!(widest <= bound, "{map:?} {level}: {} {}", widest * n as f64, bound * n as f64);
                assert!(widest > 0.8 * bound, "{map:?} {level}: {} {}", widest * n as f64, bound * n as f64);
            }
        }
    }
}
