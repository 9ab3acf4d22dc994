//! Encodes materials in the format of the RGL database. Mitsuba 3 and pbrt-v4 read them as
//! `measured`.
//!
//! A table over half and difference angle has no measured incident directions. This module
//! therefore chooses the incident directions of the file and the factor by which its values are
//! divided. The density `D` is the lobe of the material, the mean of its table over the difference
//! angle. The remaining values over the warped square are therefore smooth, even for sharp lobes.
//! `sigma` is a constant. Half of the warp follows the lobe, half is uniform over the coordinate of
//! the angle, so that neither the peak nor the tail is sampled coarsely. The warp is the same for
//! all incident directions. `luminance`, from which a renderer draws its samples, contains the part
//! of the density that the warp does not.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::DVec3;
use gonio::reflectance::BivariateTable;

use super::spectra::{self, BASIS};
use super::tensor::{FLOAT32, MAGIC, UINT8};

/// Samples of the density along the angle. They are those of a table, the horizon, and one between
/// each pair.
const DENSITY_ANGLES: usize = 181;
/// Samples along each side of the warped square.
const WARP_SIDE: usize = 64;
/// Incident angles in degrees: dense where Fresnel reflection rises.
const INCIDENT: [f64; 22] = [
    0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 64.0, 68.0, 72.0, 75.0, 78.0, 81.0,
    84.0, 87.0, 89.0,
];
/// Smallest density, as a fraction of the largest; avoids a division by zero.
const MIN_DENSITY: f64 = 1e-9;

/// Colour channels of the values of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// Linear RGB, for Mitsuba's variants of this kind: `NAME_rgb.bsdf`.
    Rgb,
    /// Fifteen wavelengths from 380 to 730 nm: `NAME_spec.bsdf`. The spectrum is smooth and has the
    /// colour under D65. For Mitsuba's spectral variants and pbrt-v4.
    Spectral,
}

/// Encodes a BRDF in 1/sr, given as tables in linear RGB.
pub fn encode(tables: &[BivariateTable; 3], description: &str, channels: Channels) -> Vec<u8> {
    let shape = Shape::of(tables);
    let count = match channels {
        Channels::Rgb => 3,
        Channels::Spectral => BASIS.len(),
    };
    let plane = WARP_SIDE * WARP_SIDE;
    let (mut values, mut luminance) = (vec![0.0_f32; INCIDENT.len() * count * plane], Vec::new());
    for (slice, degrees) in INCIDENT.iter().enumerate() {
        let wi = spherical(degrees.to_radians(), 0.0);
        for v in 0..WARP_SIDE {
            for u in 0..WARP_SIDE {
                let Sample { rgb, density } = shape.sample(tables, wi, u, unit(v, WARP_SIDE));
                for channel in 0..count {
                    let value = match channels {
                        Channels::Rgb => rgb[channel],
                        Channels::Spectral => spectra::at(channel, rgb),
                    };
                    values[(slice * count + channel) * plane + v * WARP_SIDE + u] = value as f32;
                }
                luminance.push(density as f32);
            }
        }
    }
    let incident = INCIDENT.len();
    let of_angle = |at: &dyn Fn(f64) -> f64, rows: usize| -> Vec<f32> {
        (0..rows * DENSITY_ANGLES).map(|i| at(unit(i % DENSITY_ANGLES, DENSITY_ANGLES)) as f32).collect()
    };
    let text = [description.as_bytes(), b"\0"].concat();
    let mut fields = vec![
        Field::bytes("description", text),
        Field::floats("phi_i", &[1], vec![0.0]),
        Field::floats("theta_i", &[incident], INCIDENT.iter().map(|t| t.to_radians() as f32).collect()),
        Field::floats("ndf", &[2, DENSITY_ANGLES], of_angle(&|x| shape.lobe(x), 2)),
        // f cos_o = value D / (4 sigma)
        Field::floats("sigma", &[2, DENSITY_ANGLES], vec![0.25; 2 * DENSITY_ANGLES]),
        Field::floats("vndf", &[1, incident, 2, DENSITY_ANGLES], of_angle(&|x| shape.warp(x), 2 * incident)),
        Field::floats("luminance", &[1, incident, WARP_SIDE, WARP_SIDE], luminance),
        Field::bytes("jacobian", vec![1]),
    ];
    if channels == Channels::Spectral {
        fields.push(Field::floats("wavelengths", &[count], BASIS.iter().map(|b| b.0).collect()));
    }
    let name = if channels == Channels::Rgb { "rgb" } else { "spectra" };
    fields.push(Field::floats(name, &[1, incident, count, WARP_SIDE, WARP_SIDE], values));
    file(&fields)
}

/// Values at a point of the warped square.
struct Sample {
    /// `f cos_o / D`, zero beyond the horizon: renderers reject negative values.
    rgb: [f64; 3],
    /// Density from which samples are drawn within the square.
    density: f64,
}

/// Lobe that a file is built around.
struct Shape {
    /// Luminance of the tables.
    luminance: BivariateTable,
    /// Values at [`DENSITY_ANGLES`] samples of the coordinate `sqrt(2 theta / pi)`.
    lobe: Vec<f64>,
    warp: Vec<f64>,
    /// Coordinates that the warp maps to [`WARP_SIDE`] evenly spaced points.
    places: Vec<f64>,
}

impl Shape {
    fn of(tables: &[BivariateTable; 3]) -> Self {
        let luminance = BivariateTable::luminance(tables);
        let mean = |i: usize| -> f64 {
            let theta = angle(unit(i, DENSITY_ANGLES));
            let over = (0..=60).map(|d| luminance.eval(theta, f64::from(d).to_radians()));
            over.sum::<f64>() / 61.0
        };
        let mut lobe: Vec<f64> = (0..DENSITY_ANGLES).map(mean).collect();
        let least = MIN_DENSITY * lobe.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        lobe.iter_mut().for_each(|x| *x = x.max(least));
        // Lobe times the projected solid angle of the half vectors per coordinate.
        let carried = |i: usize| {
            let (x, theta) = (unit(i, DENSITY_ANGLES), angle(unit(i, DENSITY_ANGLES)));
            lobe[i] * x * theta.sin() * theta.cos()
        };
        let carried: Vec<f64> = (0..DENSITY_ANGLES).map(carried).collect();
        let total = carried.iter().sum::<f64>() / (DENSITY_ANGLES - 1) as f64;
        let warp: Vec<f64> = carried.iter().map(|c| 0.5 + 0.5 * c / total).collect();
        let mut shape = Self { luminance, lobe, warp, places: Vec::new() };
        shape.places = (0..WARP_SIDE).map(|u| shape.place(unit(u, WARP_SIDE))).collect();
        shape
    }

    fn lobe(&self, x: f64) -> f64 {
        between(&self.lobe, x)
    }

    fn warp(&self, x: f64) -> f64 {
        between(&self.warp, x)
    }

    /// Returns the coordinate below which the fraction `share` of the warp lies.
    fn place(&self, share: f64) -> f64 {
        let cells = self.warp.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
        let total: f64 = cells.clone().sum();
        let mut left = share * total;
        for (i, (cell, pair)) in cells.zip(self.warp.windows(2)).enumerate() {
            if left <= cell {
                // Solves a s + (b - a) s^2 / 2 = left.
                let (a, b) = (pair[0], pair[1]);
                let s = 2.0 * left / (a + (a * a + 2.0 * (b - a) * left).max(0.0).sqrt());
                return (i as f64 + s.min(1.0)) / (DENSITY_ANGLES - 1) as f64;
            }
            left -= cell;
        }
        1.0
    }

    fn sample(&self, tables: &[BivariateTable; 3], wi: DVec3, u: usize, v: f64) -> Sample {
        let x = self.places[u];
        let (theta, phi) = (angle(x), TAU * (v - 0.5));
        let m = spherical(theta, phi);
        let cosine = wi.dot(m);
        let below = 2.0 * cosine * m.z - wi.z;
        let theta_d = cosine.clamp(0.0, 1.0).acos();
        let f = tables.each_ref().map(|table| table.eval(theta, theta_d));
        let solid = x * theta.sin() * cosine.max(0.0);
        let density = self.luminance.eval(theta, theta_d) * below.max(0.0) * solid / self.warp(x);
        Sample { rgb: f.map(|f| f * below.max(0.0) / self.lobe(x)), density }
    }
}

/// Interpolates between samples on the unit interval.
fn between(samples: &[f64], x: f64) -> f64 {
    let at = x * (samples.len() - 1) as f64;
    let i = (at as usize).min(samples.len() - 2);
    samples[i] + (at - i as f64) * (samples[i + 1] - samples[i])
}

/// Returns the unit vector at an angle to the normal, `+z`, and an azimuth.
fn spherical(theta: f64, phi: f64) -> DVec3 {
    let ((s, c), (sin, cos)) = (theta.sin_cos(), phi.sin_cos());
    DVec3::new(s * cos, s * sin, c)
}

/// Returns the angle to the normal at a unit coordinate.
fn angle(x: f64) -> f64 {
    x * x * FRAC_PI_2
}

/// Returns the position of sample `i` of `n` in the unit interval.
fn unit(i: usize, n: usize) -> f64 {
    i as f64 / (n - 1) as f64
}

/// An array of the file.
struct Field {
    name: &'static str,
    kind: u8,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Field {
    fn floats(name: &'static str, shape: &[usize], values: Vec<f32>) -> Self {
        debug_assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}");
        let bytes = values.into_iter().flat_map(f32::to_le_bytes).collect();
        Self { name, kind: FLOAT32, shape: shape.to_vec(), bytes }
    }

    fn bytes(name: &'static str, bytes: Vec<u8>) -> Self {
        Self { name, kind: UINT8, shape: vec![bytes.len()], bytes }
    }
}

/// Encodes fields: a header, then values at multiples of eight bytes.
fn file(fields: &[Field]) -> Vec<u8> {
    let header: usize = MAGIC.len() + 6 + fields.iter().map(|f| 13 + f.name.len() + 8 * f.shape.len()).sum::<usize>();
    let mut bytes = [MAGIC, &[1, 0]].concat();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let mut offset = header.next_multiple_of(8);
    for field in fields {
        bytes.extend((field.name.len() as u16).to_le_bytes());
        bytes.extend(field.name.bytes());
        bytes.extend((field.shape.len() as u16).to_le_bytes());
        bytes.push(field.kind);
        bytes.extend((offset as u64).to_le_bytes());
        bytes.extend(field.shape.iter().flat_map(|n| (*n as u64).to_le_bytes()));
        offset = (offset + field.bytes.len()).next_multiple_of(8);
    }
    for field in fields {
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes.extend(&field.bytes);
    }
    bytes
}
