//! Adaptive quadrature of reflectance over the texels of an octahedral light grid.
//!
//! For a point with normal `n` seen from `v`, basis function `phi_k` and texel `t`:
//!
//! ```text
//! T[t, k] = integral over t of phi_k(theta_h, theta_d) max(n . w, 0) dw,    h = (w + v) / |w + v|
//! ```
//!
//! Measured materials have lobes of a fraction of a degree around `h = n`, sampled by MERL at steps
//! of hundredths of a degree; a texel of a 32 x 32 grid is 6 degrees wide. So the square is divided
//! as a quadtree: a cell is divided while its half vectors spread over more than a given fraction
//! of its angle to the normal. Cells never cross the borders of texels, and each undivided one is
//! evaluated at its centre.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;

use super::kernels;
use crate::reflectance::{BivariateTable, THETA_D, THETA_H};
use crate::shape::SurfacePoint;
use crate::sphere::OctahedralMap;

/// Several bivariate tables, interleaved so that looking up all of them touches four runs of
/// memory.
#[derive(Clone, Debug)]
pub struct InterleavedTables {
    count: usize,
    /// `[theta_d][theta_h][table]`, tables padded to [`Self::stride`].
    values: Vec<f32>,
}

impl InterleavedTables {
    /// Interleaves tables.
    pub fn new(tables: &[BivariateTable]) -> Self {
        let count = tables.len();
        let stride = count.next_multiple_of(kernels::LANES);
        let mut values = vec![0.0; THETA_D * THETA_H * stride];
        for (k, table) in tables.iter().enumerate() {
            for j in 0..THETA_D {
                for i in 0..THETA_H {
                    values[(j * THETA_H + i) * stride + k] = table.cell(i, j);
                }
            }
        }
        Self { count, values }
    }

    /// Number of tables.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Distance between the values of neighbouring cells: the number of tables rounded up to whole
    /// SIMD lanes.
    pub fn stride(&self) -> usize {
        self.count.next_multiple_of(kernels::LANES)
    }

    /// Adds `weight` times the value of every table at `(theta_h, theta_d)` (radians) to `out` (of
    /// length `stride`).
    #[inline(always)]
    fn add(&self, theta_h: f32, theta_d: f32, weight: f32, out: &mut [f32]) {
        let stride = self.stride();
        let x = (theta_h / FRAC_PI_2).sqrt() * THETA_H as f32;
        let y = theta_d * (180.0 / PI);
        let (x, y) = (x.clamp(0.0, (THETA_H - 1) as f32), y.clamp(0.0, (THETA_D - 1) as f32));
        let (i, j) = ((x as usize).min(THETA_H - 2), (y as usize).min(THETA_D - 2));
        let (s, t) = (x - i as f32, y - j as f32);
        let at = (j * THETA_H + i) * stride;
        let near = &self.values[at..at + 2 * stride];
        let far = &self.values[at + THETA_H * stride..at + THETA_H * stride + 2 * stride];
        let w = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t].map(|w| w * weight);
        kernels::add_four(out, [&near[..stride], &near[stride..], &far[..stride], &far[stride..]], w);
    }
}

/// Fineness of the quadrature.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct QuadratureSettings {
    /// Every cell is divided at least down to `2^base` cells a side (or the light grid, if that is
    /// finer).
    pub base: u32,
    /// A cell is divided while its spread of half vectors exceeds this fraction of their angle to
    /// the normal.
    pub ratio: f32,
    /// Angle (radians) added to the angle to the normal in that test: lobes are resolved to
    /// `ratio * core`.
    pub core: f32,
}

impl Default for QuadratureSettings {
    /// Settings chosen by `gonio-eval quadrature` (`docs/quadrature.md`).
    fn default() -> Self {
        Self { base: 6, ratio: 0.3, core: 0.003 }
    }
}

impl QuadratureSettings {
    /// Settings twice as fine in every respect: the difference of the two results measures the
    /// error of the coarser one.
    pub fn refined(self) -> Self {
        Self { base: self.base + 1, ratio: self.ratio / 2.0, core: self.core / 2.0 }
    }
}

/// Deepest level of cells: 0.03 degrees of half angle.
const DEEPEST: u32 = 14;
/// Deepest level whose cell centres are tabulated.
const TABULATED: u32 = 9;

/// Quadrature for one light grid.
#[derive(Debug)]
pub struct Quadrature {
    map: OctahedralMap,
    grid_level: u32,
    settings: QuadratureSettings,
    /// Per level, centre direction and solid angle of each cell, row-major from the top.
    centres: Vec<Vec<(Vec3, f32)>>,
}

/// Centre direction and solid angle of cell `(x, y)` of a level.
fn cell(map: OctahedralMap, level: u32, x: u32, y: u32) -> (Vec3, f32) {
    let n = f64::from(1_u32 << level);
    let (u, v) = ((f64::from(2 * x + 1)) / n - 1.0, 1.0 - f64::from(2 * y + 1) / n);
    (map.direction(u, v).as_vec3(), (map.density(u, v) * 4.0 / (n * n)) as f32)
}

impl Quadrature {
    /// Creates the quadrature over the texels of a grid of `side` by `side`, a power of two.
    pub fn new(map: OctahedralMap, side: usize, settings: QuadratureSettings) -> Self {
        let centres = (0..=TABULATED)
            .map(|level| {
                let n = 1_u32 << level;
                (0..n * n).map(|c| cell(map, level, c % n, c / n)).collect()
            })
            .collect();
        Self { map, grid_level: side.ilog2(), settings, centres }
    }

    /// Number of texels of the light grid.
    pub fn texels(&self) -> usize {
        1 << (2 * self.grid_level)
    }

    /// Adds `T[t, k]` to `out[t * stride + k]` for all texels and tables.
    ///
    /// # Panics
    /// If `out` is not `texels * stride` long.
    pub fn integrate(&self, point: &SurfacePoint, tables: &InterleavedTables, out: &mut [f32]) {
        assert_eq!(out.len(), self.texels() * tables.stride());
        kernels::dispatch(|| self.integrate_inner(point, tables, out));
    }

    #[inline(always)]
    fn integrate_inner(&self, point: &SurfacePoint, tables: &InterleavedTables, out: &mut [f32]) {
        let (normal, view) = (point.normal.as_vec3(), point.view.as_vec3());
        let stride = tables.stride();
        let finest_uniform = self.settings.base.max(self.grid_level);
        let radius: [f32; DEEPEST as usize + 1] =
            std::array::from_fn(|level| self.map.cell_radius(level.max(2) as u32) as f32);
        let mut stack: Vec<(u32, u32, u32)> = (0..16).map(|c| (2, c % 4, c / 4)).collect();
        while let Some((level, x, y)) = stack.pop() {
            let (light, solid_angle) = match self.centres.get(level as usize) {
                Some(centres) => centres[((y << level) + x) as usize],
                None => cell(self.map, level, x, y),
            };
            let cosine = normal.dot(light);
            // The whole cell is below the horizon of the point.
            if cosine < -radius[level as usize] {
                continue;
            }
            let sum = light + view;
            let twice_cos_d = sum.length();
            // Chords keep their accuracy where the angle is small. The sine of half an angle is
            // half its chord.
            let half = sum / twice_cos_d.max(1e-6);
            let half_chord_square = 0.25 * (half - normal).length_squared();
            let theta_h = 2.0 * kernels::asin_of_sqrt(half_chord_square);
            // A cell of angular radius r spreads its half vectors by at most r / (2 cos theta_d).
            let spread = radius[level as usize] / twice_cos_d.max(0.05);
            let divide = level < finest_uniform
                || (level < DEEPEST && spread > self.settings.ratio * (theta_h + self.settings.core));
            if divide {
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    stack.push((level + 1, 2 * x + dx, 2 * y + dy));
                }
                continue;
            }
            if cosine <= 0.0 {
                continue;
            }
            let sin_d_square = 0.25 * (light - view).length_squared();
            let theta_d = kernels::asin_of_sqrt(sin_d_square);
            let up = level - self.grid_level;
            let texel = (((y >> up) << self.grid_level) + (x >> up)) as usize;
            tables.add(theta_h, theta_d, cosine * solid_angle, &mut out[texel * stride..(texel + 1) * stride]);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::polar_reference;
    use super::*;
    use crate::sphere::fibonacci_hemisphere;

    fn lobe(width: f64) -> BivariateTable {
        BivariateTable::from_fn(|h, _| 1.0 / (1.0 + (h / width).powi(2)).powi(2))
    }

    fn integrate(quadrature: &Quadrature, normal: DVec3, tables: &[BivariateTable]) -> Vec<f32> {
        let tables = InterleavedTables::new(tables);
        let mut out = vec![0.0; quadrature.texels() * tables.stride()];
        quadrature.integrate(&SurfacePoint { normal, view: DVec3::Z }, &tables, &mut out);
        out
    }

    #[test]
    fn normals_are_turned_with_the_view_and_bent_to_face_it() {
        let view = DVec3::new(0.3, -0.2, 0.9).normalize();
        for normal in fibonacci_hemisphere(40) {
            let point = SurfacePoint { normal, view };
            let turned = point.in_view();
            assert!((turned.z - normal.dot(view)).abs() < 1e-12 && (turned.length() - 1.0).abs() < 1e-12);
            let facing = point.facing();
            assert!(facing.normal.dot(view) > 0.999e-3 * 0.5, "{normal}");
            assert_eq!(facing == point, normal.dot(view) >= 1e-3);
        }
    }

    #[test]
    fn a_lambertian_surface_collects_pi_from_a_uniform_light() {
        let one = [BivariateTable::from_fn(|_, _| 1.0)];
        for map in [OctahedralMap::EqualArea, OctahedralMap::PraunHoppe] {
            let quadrature = Quadrature::new(map, 32, QuadratureSettings::default());
            for normal in fibonacci_hemisphere(20) {
                let out = integrate(&quadrature, normal, &one);
                let total: f32 = out.iter().sum();
                assert!((total / PI - 1.0).abs() < 2e-3, "{map:?} {normal} {total}");
            }
        }
    }

    #[test]
    fn sharp_lobes_match_the_polar_reference_texel_by_texel() {
        // Widths of a quarter of a degree, like chrome; half a degree, five, thirty.
        let tables: Vec<BivariateTable> = [0.25, 0.5, 5.0, 30.0_f64].map(|w| lobe(w.to_radians())).to_vec();
        let quadrature = Quadrature::new(OctahedralMap::EqualArea, 32, QuadratureSettings::default());
        for normal in fibonacci_hemisphere(12).filter(|n| n.z > 0.2) {
            let out = integrate(&quadrature, normal, &tables);
            let point = SurfacePoint { normal, view: DVec3::Z };
            for (k, table) in tables.iter().enumerate() {
                let reference = polar_reference(&point, table, OctahedralMap::EqualArea, 32, 1000, 700);
                let stride = kernels::LANES;
                let (mut error, mut norm) = (0.0, 0.0);
                for (t, r) in reference.iter().enumerate() {
                    error += (f64::from(out[t * stride + k]) - r).powi(2);
                    norm += r * r;
                }
                let relative = (error / norm).sqrt();
                assert!(relative < 0.02, "{normal} lobe {k}: {relative}");
            }
        }
    }

    #[test]
    fn refinement_converges() {
        let tables = [lobe(0.4_f64.to_radians())];
        let normal = DVec3::new(0.31, 0.22, 0.8).normalize();
        let mut settings = QuadratureSettings { base: 5, ratio: 1.0, core: 0.02 };
        let mut errors = Vec::new();
        let finest = QuadratureSettings { base: 8, ratio: 0.06, core: 0.001 };
        let best = integrate(&Quadrature::new(OctahedralMap::EqualArea, 32, finest), normal, &tables);
        for _ in 0..4 {
            let out = integrate(&Quadrature::new(OctahedralMap::EqualArea, 32, settings), normal, &tables);
            let norm: f32 = best.iter().map(|x| x * x).sum();
            let error: f32 = out.iter().zip(&best).map(|(a, b)| (a - b).powi(2)).sum();
            errors.push((error / norm).sqrt());
            settings = settings.refined();
        }
        assert!(errors[3] < 0.15 * errors[0] && errors[3] < 5e-3, "{errors:?}");
    }
}
