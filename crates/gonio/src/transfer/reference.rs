//! Slow, independent reference for the quadrature.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::DVec3;

use crate::lighting::LightGrid;
use crate::reflectance::BivariateTable;
use crate::shape::SurfacePoint;
use crate::sphere::OctahedralMap;

/// Computes `T[t]` of one table in polar coordinates of the half vector about the normal.
///
/// With `h` at `(theta, phi)` about `n`, `w = 2 (h . v) h - v` and `dw = 4 (h . v) dh`. The lobe is
/// resolved regardless of its width, and each sample is added to the texel of its direction. The
/// samples are `rings` midpoints in `sqrt(theta)`, in which the tables are piecewise linear, times
/// `spokes` in `phi`.
pub fn polar_reference(
    point: &SurfacePoint,
    table: &BivariateTable,
    map: OctahedralMap,
    side: usize,
    rings: usize,
    spokes: usize,
) -> Vec<f64> {
    let SurfacePoint { normal: n, view: v } = *point;
    let (x, y) = n.any_orthonormal_pair();
    let mut out = vec![0.0; side * side];
    for ring in 0..rings {
        let s = (ring as f64 + 0.5) / rings as f64;
        let theta = s * s * FRAC_PI_2;
        // d theta = 2 s ds pi/2
        let ring_area = theta.sin() * 2.0 * s * FRAC_PI_2 / rings as f64 * TAU / spokes as f64;
        for spoke in 0..spokes {
            // Rings are rotated against each other, so that no texel border coincides with a spoke
            // of all rings.
            let phi = TAU * ((spoke as f64 + 0.5) / spokes as f64 + 0.618_034 * ring as f64);
            let h: DVec3 = theta.cos() * n + theta.sin() * (phi.cos() * x + phi.sin() * y);
            let cos_d = h.dot(v);
            if cos_d <= 0.0 {
                continue;
            }
            let w = 2.0 * cos_d * h - v;
            let cosine = w.dot(n);
            if cosine > 0.0 {
                let f = table.eval(theta, cos_d.min(1.0).acos());
                out[LightGrid::texel_of(map, side, w)] += f * cosine * 4.0 * cos_d * ring_area;
            }
        }
    }
    out
}
