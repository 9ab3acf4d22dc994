//! Fast computation of reflected radiance at many points.
//!
//! Half vectors lie on rings about the normal. The density of rings is half uniform and half
//! proportional to the reflectance of the materials. Each half vector represents a solid angle: the
//! reflectance is averaged over its ring, the light over its footprint (prefiltered importance
//! sampling, Colbert & Krivanek 2007). Rings and footprints are the same at every point, so images
//! are free of noise. Lamps smaller than the lobes are added individually.

use std::f32::consts::PI;
use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{Vec3, Vec3A};

use super::brdf::Brdf;
use super::prefiltered::PrefilteredLight;
use super::pyramid::{Part, Place, half_side, level, whole};
use crate::parallel;
use crate::reflectance::{BivariateTable, CELLS, THETA_D, THETA_H, angles_of};
use crate::shape::SurfacePoint;

/// Number of rings. With [`MAX_RING_NODES`], radiance has errors of half a percent.
const RINGS: usize = 54;

/// Smallest and largest number of half vectors in a ring.
const MIN_RING_NODES: f64 = 6.0;
const MAX_RING_NODES: f64 = 36.0;

/// Typical cosine of the difference angle, used to choose footprints.
const TYPICAL_COS_DIFFERENCE: f64 = 0.8;

/// Ratio of footprints to the solid angle of their half vectors, outside narrow lobes.
///
/// With a ratio of one, edges of large lamps would cause ripples.
const OVERLAP: f64 = 1.6;

/// Number of steps over which the reflectance of a ring is averaged.
const RING_STEPS: usize = 12;

/// Number of intervals in the root of the half angle at which the density of rings is evaluated.
const INTERVALS: usize = 720;

/// Change of the log reflectance over a lamp above which the lamp is not treated as a point.
const MIN_LAMP_CHANGE: f64 = 0.25;

/// Largest half angle (radians) at which rings may sample lamps.
const LAMP_HALF_ANGLE: f64 = 0.14;

/// Number of azimuths `phi_d` in half a turn at which materials that depend on it are tabulated.
const AZIMUTHS: usize = 20;

/// Half vectors for a group of materials, under lights of one resolution.
pub struct HalfVectorSampler {
    materials: usize,
    /// Number of azimuths in the tables: one if no material depends on `phi_d`, else [`AZIMUTHS`].
    azimuths: usize,
    rings: Vec<Ring>,
    /// Half vectors about a normal along +z, ring by ring.
    halves: Vec<Vec3>,
    /// Mean reflectance of each ring: `[ring][theta_d][phi_d][material]`, in 1/sr.
    means: Vec<Vec3A>,
    /// Reflectance of all materials: `[theta_h][theta_d][phi_d][material]`, in 1/sr.
    full: Vec<Vec3A>,
    /// Half angles (degrees) between which lamps change from samples to points.
    near: (f32, f32),
    /// Number of texels along a side of the lights.
    side: usize,
}

struct Ring {
    /// Index of the first half vector.
    first: usize,
    end: usize,
    /// Solid angle of each half vector.
    solid_angle: f32,
    level: usize,
    /// Fraction of the lamps that are treated as points at this angle.
    points: f32,
}

/// Light from one direction, with the reflectance of each material.
pub struct LightSample<'a> {
    /// Direction of the light.
    pub direction: Vec3,
    /// Radiance times cosine and solid angle.
    pub irradiance: Vec3A,
    values: [&'a [Vec3A]; 4],
    weights: [f32; 4],
    given: Option<Vec3A>,
}

impl LightSample<'_> {
    /// Returns the radiance that a material reflects of this light.
    #[inline(always)]
    pub fn reflected(&self, material: usize) -> Vec3A {
        if let Some(value) = self.given {
            return value * self.irradiance;
        }
        let mixed = self.values[0][material] * self.weights[0]
            + self.values[1][material] * self.weights[1]
            + self.values[2][material] * self.weights[2]
            + self.values[3][material] * self.weights[3];
        mixed * self.irradiance
    }
}

impl HalfVectorSampler {
    /// Places half vectors for these materials under lights of the resolution of `light`.
    ///
    /// # Panics
    /// If there is no material, or if there are several and one of them depends on `phi_d`.
    pub fn new(materials: &[&dyn Brdf], light: &PrefilteredLight) -> Self {
        assert!(!materials.is_empty(), "no material");
        let tables: Vec<Option<[BivariateTable; 3]>> = materials.iter().map(|m| m.tables()).collect();
        let azimuthal = tables.iter().any(Option::is_none);
        assert!(!azimuthal || materials.len() == 1, "only a single material may depend on phi_d");
        let side = light.side();
        let envelopes: Vec<BivariateTable> = materials.iter().map(|m| m.envelope()).collect();
        let envelope = super::linear::envelope(&envelopes);
        let near = near(&envelope, (4.0 * std::f64::consts::PI).sqrt() / side as f64);
        let edges = edges(&envelope);
        let at_cell =
            |table: &[BivariateTable; 3], cell: usize| Vec3A::from(table.each_ref().map(|t| t.as_slice()[cell]));
        let full = if azimuthal {
            let value = |at: usize| {
                let (theta_h, theta_d) = angles_of(at / AZIMUTHS);
                let phi_d = std::f64::consts::PI * (at % AZIMUTHS) as f64 / AZIMUTHS as f64;
                materials[0].eval(theta_h, theta_d, phi_d).as_vec3a()
            };
            parallel::map_range(CELLS * AZIMUTHS, value)
        } else {
            (0..CELLS).flat_map(|cell| tables.iter().flatten().map(move |t| at_cell(t, cell))).collect()
        };
        let mut sampler = Self {
            materials: materials.len(),
            azimuths: if azimuthal { AZIMUTHS } else { 1 },
            rings: Vec::with_capacity(RINGS),
            halves: Vec::new(),
            means: Vec::new(),
            full,
            near,
            side,
        };
        edges.windows(2).enumerate().for_each(|(i, edge)| sampler.add_ring(i, (edge[0], edge[1])));
        sampler
    }

    /// Adds the ring between two square roots of half angles, in units of a right angle.
    fn add_ring(&mut self, index: usize, (low, high): (f64, f64)) {
        let angle = |root: f64| root * root * FRAC_PI_2;
        // Midpoints in the root of the half angle, in which tables are linear, weighted by solid
        // angle.
        let steps: [(f64, f64); RING_STEPS] = std::array::from_fn(|k| {
            let edge = |k: usize| low + (high - low) * k as f64 / RING_STEPS as f64;
            (0.5 * (edge(k) + edge(k + 1)), angle(edge(k)).cos() - angle(edge(k + 1)).cos())
        });
        let total: f64 = steps.iter().map(|s| s.1).sum();
        let theta_h = steps.iter().map(|(root, w)| angle(*root) * w).sum::<f64>() / total;
        let wanted = TAU * theta_h.sin() / (angle(high) - angle(low));
        let spokes = wanted.clamp(MIN_RING_NODES, MAX_RING_NODES).round() as usize;
        let solid_angle = TAU * total / spokes as f64;
        let points = ramp(theta_h.to_degrees() as f32, self.near);
        let first = self.halves.len();
        self.halves.extend((0..spokes).map(|spoke| {
            // Successive rings are rotated against each other by the golden section.
            let phi = TAU * ((spoke as f64 + 0.5) / spokes as f64 + 0.618_034 * index as f64);
            let (sin, cos) = theta_h.sin_cos();
            Vec3::new((sin * phi.cos()) as f32, (sin * phi.sin()) as f32, cos as f32)
        }));
        self.rings.push(Ring {
            first,
            end: first + spokes,
            solid_angle: solid_angle as f32,
            level: level(
                self.side,
                4.0 * TYPICAL_COS_DIFFERENCE * solid_angle * if points >= 1.0 { OVERLAP } else { 1.0 },
            ),
            points,
        });
        let row = self.row();
        let mut mean = vec![Vec3A::ZERO; row];
        for (root, weight) in steps {
            let place = (root * THETA_H as f64).min((THETA_H - 1) as f64 - 1e-6);
            let (i, beyond) = (place as usize, place.fract() as f32);
            let share = (weight / total) as f32;
            for (k, m) in mean.iter_mut().enumerate() {
                *m += (self.full[i * row + k] * (1.0 - beyond) + self.full[(i + 1) * row + k] * beyond) * share;
            }
        }
        self.means.append(&mut mean);
    }

    /// Returns the number of values at one half angle.
    fn row(&self) -> usize {
        THETA_D * self.azimuths * self.materials
    }

    /// Calls `take` with the light from every direction from which a point may reflect light.
    #[inline(always)]
    pub fn gather(&self, point: &SurfacePoint, light: &PrefilteredLight, mut take: impl FnMut(&LightSample<'_>)) {
        debug_assert_eq!(light.side(), self.side);
        let (normal, view) = (point.normal.as_vec3a(), point.view.as_vec3a());
        let (right, up) = point.normal.as_vec3().any_orthonormal_pair();
        let (right, up) = (Vec3A::from(right), Vec3A::from(up));
        let (pyramid, row, azimuthal) = (light.pyramid(), self.row(), self.azimuths > 1);
        for (index, ring) in self.rings.iter().enumerate() {
            let half_side = half_side(self.side, ring.level);
            for local in &self.halves[ring.first..ring.end] {
                let half = right * local.x + up * local.y + normal * local.z;
                let cos_d = half.dot(view);
                let towards = half * (2.0 * cos_d) - view;
                let cosine = towards.dot(normal);
                if cos_d <= 0.0 || cosine <= 0.0 {
                    continue;
                }
                let place = Place::of(light.turned(towards), half_side);
                let radiance = if ring.points >= 1.0 {
                    pyramid.at(Part::WithoutLamps, ring.level, &place)
                } else {
                    let all = pyramid.at(Part::All, ring.level, &place);
                    if ring.points <= 0.0 {
                        all
                    } else {
                        all + (pyramid.at(Part::WithoutLamps, ring.level, &place) - all) * ring.points
                    }
                };
                // `4 cos_d` is the ratio of the solid angle of light to that of half vectors.
                let irradiance = radiance * (cosine * 4.0 * cos_d * ring.solid_angle);
                let direction = Vec3::from(towards);
                let (column, next) = column_of(cos_d);
                if azimuthal {
                    let given =
                        between_azimuths(&self.means, index * row, (column, next), azimuth(normal, half, towards));
                    take(&LightSample {
                        direction,
                        irradiance,
                        values: [&[]; 4],
                        weights: [0.0; 4],
                        given: Some(given),
                    });
                    continue;
                }
                let at = index * row + column as usize * self.materials;
                let pair = &self.means[at..at + 2 * self.materials];
                let (here, beyond) = pair.split_at(self.materials);
                let weights = [1.0 - next, next, 0.0, 0.0];
                take(&LightSample { direction, irradiance, values: [here, beyond, here, here], weights, given: None });
            }
        }
        self.gather_lamps(point, light, take);
    }

    /// Calls `take` with the light of each lamp.
    #[inline(always)]
    fn gather_lamps(&self, point: &SurfacePoint, light: &PrefilteredLight, mut take: impl FnMut(&LightSample<'_>)) {
        let (normal, view) = (point.normal.as_vec3a(), point.view.as_vec3a());
        let row = self.row();
        for &(towards, irradiance) in light.lamps() {
            let cosine = towards.dot(normal);
            if cosine <= 0.0 {
                continue;
            }
            let sum = towards + view;
            let length = sum.length();
            if length < 1e-4 {
                continue;
            }
            let theta_h = degrees_of_cosine((sum.dot(normal) / length).max(0.0));
            let points = ramp(theta_h, self.near);
            if points <= 0.0 {
                continue;
            }
            let irradiance = irradiance * (cosine * points);
            let direction = Vec3::from(towards);
            let (line, beyond) = whole(((theta_h / 90.0).sqrt() * THETA_H as f32).min((THETA_H - 1) as f32 - 1e-3));
            let (column, next) = column_of((0.5 * length).min(1.0));
            if self.azimuths > 1 {
                let place = azimuth(normal, sum / length, towards);
                let [upper, lower] =
                    [0, 1].map(|i| between_azimuths(&self.full, (line as usize + i) * row, (column, next), place));
                let given = Some(upper + (lower - upper) * beyond);
                take(&LightSample { direction, irradiance, values: [&[]; 4], weights: [0.0; 4], given });
                continue;
            }
            let at = line as usize * row + column as usize * self.materials;
            let [upper, lower] =
                [at, at + row].map(|at| self.full[at..at + 2 * self.materials].split_at(self.materials));
            take(&LightSample {
                direction,
                irradiance,
                values: [upper.0, upper.1, lower.0, lower.1],
                weights: [(1.0 - beyond) * (1.0 - next), (1.0 - beyond) * next, beyond * (1.0 - next), beyond * next],
                given: None,
            });
        }
    }

    /// Returns the radiance that each material reflects at a point.
    ///
    /// `open` returns the fraction of the light that arrives from a direction.
    pub fn radiance(&self, point: &SurfacePoint, light: &PrefilteredLight, open: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
        let mut out = vec![Vec3A::ZERO; self.materials];
        self.gather(point, light, |sample| {
            let open = open(sample.direction);
            out.iter_mut().enumerate().for_each(|(m, sum)| *sum += sample.reflected(m) * open);
        });
        out.into_iter().map(Vec3::from).collect()
    }
}

/// Returns the index of `phi_d` among [`AZIMUTHS`] and the fraction of the way to the next.
///
/// See [`half_difference`](crate::sphere::half_difference) for `phi_d`.
#[inline(always)]
fn azimuth(normal: Vec3A, half: Vec3A, towards: Vec3A) -> (usize, f32) {
    let y = normal.cross(half);
    let turn = share_of_half_turn(towards.dot(y), towards.dot(y.cross(half))) * AZIMUTHS as f32;
    let first = (turn as usize).min(AZIMUTHS - 1);
    (first, turn - first as f32)
}

/// Returns the angle of the direction `(x, y)` or its opposite in half turns.
///
/// The angle is in 0..=1 and accurate to 1e-5 (Abramowitz & Stegun 4.4.47).
#[inline(always)]
fn share_of_half_turn(y: f32, x: f32) -> f32 {
    let (steep, flat) = (y.abs().max(x.abs()), y.abs().min(x.abs()));
    let a = flat / steep.max(1e-30);
    let b = a * a;
    let angle = a * (0.999_866 + b * (-0.330_299_5 + b * (0.180_141 + b * (-0.085_133 + b * 0.020_835_1)))) / PI;
    let angle = if y.abs() > x.abs() { 0.5 - angle } else { angle };
    if (y < 0.0) == (x < 0.0) { angle } else { 1.0 - angle }
}

/// Interpolates a material between azimuths and difference angles in a row of its table.
#[inline(always)]
fn between_azimuths(table: &[Vec3A], row: usize, (column, next): (u32, f32), (first, beyond): (usize, f32)) -> Vec3A {
    let at = row + column as usize * AZIMUTHS;
    let second = (first + 1) % AZIMUTHS;
    let along = |at: usize| table[at + first] + (table[at + second] - table[at + first]) * beyond;
    let here = along(at);
    here + (along(at + AZIMUTHS) - here) * next
}

/// Returns the position of `x` between `low` and `high`, in 0..=1; one if the range is empty.
#[inline(always)]
fn ramp(x: f32, (low, high): (f32, f32)) -> f32 {
    if high <= low { 1.0 } else { ((x - low) / (high - low)).clamp(0.0, 1.0) }
}

/// Returns the half angles (degrees) between which lamps change from samples to points.
///
/// Up to the first angle, the envelope varies over a lamp as wide as `texel` (radians).
fn near(envelope: &BivariateTable, texel: f64) -> (f32, f32) {
    let theta_d = 0.5;
    // A half vector moves by half as much as the light.
    let step = 0.5 * texel;
    let changes = |theta: f64| {
        let (here, there) = (envelope.eval(theta, theta_d), envelope.eval(theta + step, theta_d));
        (here.max(1e-300) / there.max(1e-300)).ln().abs() > MIN_LAMP_CHANGE
    };
    let angles = (0..=100).map(|i| LAMP_HALF_ANGLE * f64::from(i) / 100.0);
    angles.filter(|theta| changes(*theta)).fold((0.0, 0.0), |_, theta| {
        let theta = (theta + step).to_degrees() as f32;
        (theta, 1.5 * theta)
    })
}

/// Returns the edges of the rings, from zero to one.
///
/// Edges are square roots of half angles in units of a right angle.
fn edges(envelope: &BivariateTable) -> Vec<f64> {
    let density = |i: usize| {
        let root = (i as f64 + 0.5) / INTERVALS as f64;
        let theta = root * root * FRAC_PI_2;
        envelope.eval(theta, 0.5) * theta.sin() * theta.cos() * root
    };
    let energy: Vec<f64> = (0..INTERVALS).map(density).collect();
    let total = energy.iter().sum::<f64>().max(1e-300);
    let mut edges = vec![0.0];
    let (mut sum, mut next) = (0.0, 1.0);
    for (i, e) in energy.iter().enumerate() {
        let share = 0.5 * (e / total + 1.0 / INTERVALS as f64) * RINGS as f64;
        while next <= sum + share && edges.len() < RINGS {
            edges.push((i as f64 + (next - sum) / share) / INTERVALS as f64);
            next += 1.0;
        }
        sum += share;
    }
    edges.push(1.0);
    edges
}

/// Returns the column of a table below a difference angle, and the fraction of the way to the next.
#[inline(always)]
pub(crate) fn column_of(cos_d: f32) -> (u32, f32) {
    whole(degrees_of_cosine(cos_d).min((THETA_D - 1) as f32 - 1e-3))
}

/// Returns the angle in 0..=90 degrees of a cosine, to 0.01 degrees (Abramowitz & Stegun 4.4.45).
#[inline(always)]
pub(crate) fn degrees_of_cosine(cosine: f32) -> f32 {
    let x = cosine.min(1.0);
    let polynomial = 1.570_728_8 + x * (-0.212_114_4 + x * (0.074_261 - 0.018_729_3 * x));
    (1.0 - x).sqrt() * polynomial * (180.0 / PI)
}

#[cfg(test)]
mod tests;
