//! Pictures of a ball of many materials in one light, quickly.
//!
//! Thousands of lights are gathered for the training of the posterior, each as a matrix from tables to pictures. Here the light of a point is sampled at half
//! vectors, in rings about its normal that are as fine as the table, and each sample is the mean over its own solid angle (prefiltered importance
//! sampling, Colbert & Krivanek 2007). That is a hundred times faster than
//! [`Relighter`](crate::render::Relighter) and within some percent of it.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use glam::Vec3;
use rayon::prelude::*;

use super::pyramid::{LightPyramid, Part};
use crate::reflectance::{BivariateTable, CELLS, THETA_D, THETA_H};

/// Rings of half vectors about a normal, even in the square root of the angle as the rows of a table are.
const RINGS: usize = 90;

/// Samples of a ring: at least, and at most.
const SPOKES: (f32, f32) = (8.0, 44.0);

/// A cosine of the difference angle to choose levels by.
const TYPICAL: f64 = 0.8;

/// Points that are gathered before they are multiplied with the tables.
const CHUNK: usize = 24;

/// Half vectors about a normal along z.
#[derive(Clone, Debug)]
pub struct BallRenderer {
    samples: Vec<Sample>,
}

/// A half vector.
#[derive(Clone, Copy, Debug)]
struct Sample {
    half: Vec3,
    solid_angle: f32,
    /// Row of the table below it, as an index of cells, and how far it is to the next.
    row: u32,
    beyond: f32,
    /// Level of the light whose texels are as large as what the sample stands for.
    level: u32,
    /// Share of the lamps that is counted one by one at this half angle, not by samples.
    counted: f32,
}

/// Half angles in degrees between which lamps pass from samples, which show their shape in a sharp highlight, to points, which are exact in a wide one.
const NEAR: (f32, f32) = (3.0, 6.0);

/// Share of the lamps that are points at a half angle in degrees.
fn counted(theta_h: f32) -> f32 {
    ((theta_h - NEAR.0) / (NEAR.1 - NEAR.0)).clamp(0.0, 1.0)
}

impl Default for BallRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl BallRenderer {
    /// The rings.
    pub fn new() -> Self {
        let mut samples = Vec::new();
        let right = std::f64::consts::FRAC_PI_2;
        for ring in 0..RINGS {
            let edge = |r: usize| (r as f64 / RINGS as f64).powi(2) * right;
            // The middle by the root of the angle, in which tables are linear.
            let root = (ring as f64 + 0.5) / RINGS as f64;
            let theta = root * root * right;
            let (low, high) = (edge(ring), edge(ring + 1));
            let wanted = std::f64::consts::TAU * theta.sin() / (high - low);
            let spokes = wanted.clamp(f64::from(SPOKES.0), f64::from(SPOKES.1)).round() as usize;
            let solid_angle = std::f64::consts::TAU * (low.cos() - high.cos()) / spokes as f64;
            let place = (root * THETA_H as f64).min((THETA_H - 1) as f64 - 1e-6);
            for spoke in 0..spokes {
                // Rings are turned against each other by the golden section.
                let phi = std::f64::consts::TAU * ((spoke as f64 + 0.5) / spokes as f64 + 0.618_034 * ring as f64);
                let half =
                    Vec3::new((theta.sin() * phi.cos()) as f32, (theta.sin() * phi.sin()) as f32, theta.cos() as f32);
                let row = (place as usize * THETA_D) as u32;
                let level = LightPyramid::level(4.0 * TYPICAL * solid_angle) as u32;
                let counted = counted(theta.to_degrees() as f32);
                samples.push(Sample {
                    half,
                    solid_angle: solid_angle as f32,
                    row,
                    beyond: place.fract() as f32,
                    level,
                    counted,
                });
            }
        }
        Self { samples }
    }

    /// Luminance of points with these normals, seen from +z, of each of the tables: `[table][point]`.
    pub fn render(&self, normals: &[Vec3], tables: &[BivariateTable], light: &LightPyramid) -> Vec<Vec<f32>> {
        let mut matrix = Vec::with_capacity(tables.len() * CELLS);
        tables.iter().for_each(|t| matrix.extend_from_slice(t.as_slice()));
        let tables_as_columns = MatRef::from_column_major_slice(&matrix, CELLS, tables.len());
        let parts: Vec<Vec<f32>> = normals
            .par_chunks(CHUNK)
            .map_init(
                || vec![0.0_f32; CHUNK * CELLS],
                |rows, normals| {
                    let rows = &mut rows[..normals.len() * CELLS];
                    rows.fill(0.0);
                    for (normal, row) in normals.iter().zip(rows.chunks_exact_mut(CELLS)) {
                        self.gather(*normal, light, row);
                    }
                    let mut out = vec![0.0_f32; normals.len() * tables.len()];
                    let product = MatMut::from_column_major_slice_mut(&mut out, normals.len(), tables.len());
                    let rows = MatRef::from_row_major_slice(rows, normals.len(), CELLS);
                    matmul(product, Accum::Replace, rows, tables_as_columns, 1.0, Par::Seq);
                    out
                },
            )
            .collect();
        let mut pictures = vec![Vec::with_capacity(normals.len()); tables.len()];
        for (part, normals) in parts.iter().zip(normals.chunks(CHUNK)) {
            for (picture, values) in pictures.iter_mut().zip(part.chunks_exact(normals.len())) {
                picture.extend_from_slice(values);
            }
        }
        pictures
    }

    /// Adds the light that reaches a point to the cells by whose reflectance it is seen.
    fn gather(&self, normal: Vec3, light: &LightPyramid, row: &mut [f32]) {
        let (right, up) = normal.any_orthonormal_pair();
        for sample in &self.samples {
            let half = sample.half.x * right + sample.half.y * up + sample.half.z * normal;
            let cos_d = half.z;
            if cos_d <= 0.0 {
                continue;
            }
            let towards = 2.0 * cos_d * half - Vec3::Z;
            let cosine = towards.dot(normal);
            if cosine <= 0.0 {
                continue;
            }
            let solid_angle = 4.0 * cos_d * sample.solid_angle;
            let level = sample.level as usize;
            let radiance = match sample.counted {
                0.0 => light.at(Part::All, towards, level),
                1.0 => light.at(Part::Even, towards, level),
                share => {
                    share * light.at(Part::Even, towards, level) + (1.0 - share) * light.at(Part::All, towards, level)
                }
            };
            add(row, sample.row as usize, sample.beyond, cos_d, radiance * cosine * solid_angle);
        }
        for &(towards, irradiance) in light.lamps() {
            let cosine = towards.dot(normal);
            let sum = towards + Vec3::Z;
            let twice_cos_d = sum.length();
            if cosine <= 0.0 || twice_cos_d < 1e-3 {
                continue;
            }
            let theta_h = degrees_of_cosine(sum.dot(normal) / twice_cos_d);
            let share = counted(theta_h);
            if share > 0.0 {
                let place = (theta_h / 90.0).sqrt() * THETA_H as f32;
                let place = place.min((THETA_H - 1) as f32 - 1e-3);
                let below = place as usize;
                add(row, below * THETA_D, place - below as f32, 0.5 * twice_cos_d, share * irradiance * cosine);
            }
        }
    }
}

/// Adds light to the four cells around a half angle (as a row of the table and a share of the way to the next) and a difference angle.
fn add(cells: &mut [f32], row: usize, beyond: f32, cos_d: f32, weight: f32) {
    let place = degrees_of_cosine(cos_d).min((THETA_D - 1) as f32 - 1e-3);
    let column = place as usize;
    let next = weight * (place - column as f32);
    let at = row + column;
    cells[at] += (1.0 - beyond) * (weight - next);
    cells[at + 1] += (1.0 - beyond) * next;
    cells[at + THETA_D] += beyond * (weight - next);
    cells[at + THETA_D + 1] += beyond * next;
}

/// The angle in 0..=90 degrees of a cosine, to 0.01 degrees (Abramowitz & Stegun 4.4.45).
fn degrees_of_cosine(cosine: f32) -> f32 {
    let x = cosine.min(1.0);
    let polynomial = 1.570_728_8 + x * (-0.212_114_4 + x * (0.074_261 - 0.018_729_3 * x));
    (1.0 - x).sqrt() * polynomial.to_degrees()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::lighting::EnvironmentMap;
    use crate::picture::Plane;
    use crate::render::{IntegratorSettings, LightTree, Relighter};
    use crate::sphere::{direction_of_lat_long, fibonacci_hemisphere};
    use crate::transfer::SurfacePoint;

    #[test]
    fn angles_of_cosines() {
        for i in 0..=900 {
            let angle = 0.1 * f64::from(i);
            let got = degrees_of_cosine(angle.to_radians().cos() as f32);
            assert!((f64::from(got) - angle).abs() < 0.02, "{angle} {got}");
        }
    }

    #[test]
    fn it_shows_what_the_integrator_does() {
        let lamp = DVec3::new(0.4, 0.5, 0.6).normalize();
        let light = |d: DVec3| if d.angle_between(lamp) < 0.05 { 300.0 } else { 1.0 + d.y };
        let map = EnvironmentMap::new(Plane::from_fn(1024, 512, |x, y| {
            Vec3::splat(light(direction_of_lat_long((x as f64 + 0.5) / 1024.0, (y as f64 + 0.5) / 512.0)) as f32)
        }));
        let normals: Vec<DVec3> = fibonacci_hemisphere(120).filter(|n| n.z > 0.2).collect();
        let points: Vec<SurfacePoint> = normals.iter().map(|&normal| SurfacePoint { normal, view: DVec3::Z }).collect();
        let lobe =
            |width: f64| BivariateTable::from_fn(move |h, d| 0.1 + d + 3.0 / (1.0 + (h / width).powi(2)).powi(2));
        for (width, median, worst) in [(1.0, 0.01, 0.06), (0.2, 0.01, 0.1), (0.05, 0.02, 0.25), (0.02, 0.03, 0.4)] {
            let tables = [lobe(width)];
            let fine = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
            let want = Relighter::new(&points, &tables, &LightTree::of_map(map.as_ref().unwrap()), &fine);
            let want = want.render(&tables[0]);
            let seen: Vec<Vec3> = normals.iter().map(|n| n.as_vec3()).collect();
            let got = BallRenderer::new().render(&seen, &tables, &LightPyramid::new(light));
            let mut errors: Vec<f64> = got[0].iter().zip(&want).map(|(a, b)| (f64::from(*a) / b - 1.0).abs()).collect();
            errors.sort_by(f64::total_cmp);
            let (middle, last) = (errors[errors.len() / 2], errors[errors.len() - 1]);
            assert!(middle < median && last < worst, "{width}: {middle} {last}");
        }
    }
}
