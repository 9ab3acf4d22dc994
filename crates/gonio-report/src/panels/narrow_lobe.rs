//! Splits a material into a narrow lobe, as weights of the levels of a `HalfVectorLight`, and a
//! smooth rest.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::Vec3A;
use gonio::reflectance::{BivariateTable, THETA_D, THETA_H};

use super::half_vector_light::{LEVELS, variances};

/// Half angles in degrees between which the narrow share of a lobe falls from 1 to 0.
const NARROW: (f32, f32) = (4.0, 12.0);
/// Difference angle in degrees below which the lobe of this angle is used. Measured tables drop
/// there, because the camera occludes the lamp; without the limit, each sphere would have a dark
/// dot in its middle.
const BLIND: usize = 5;
/// Number of rows of the table below the larger angle of [`NARROW`], plus one.
const ROWS: usize = 34;

/// The narrow part of a material.
pub(super) struct NarrowLobe {
    /// Weights of the levels at each degree of the difference angle.
    weights: Vec<[Vec3A; LEVELS]>,
}

/// Splits a material into its narrow lobe and the rest. `pixel` is the width of a pixel in radians
/// of the normal, where the normal faces the camera. Lobes are not narrower than a pixel.
///
/// Over the half angle, a table is a sum of discs. The height of each disc is the step from a row
/// to the next. Small discs form the narrow lobe; the rest is smooth.
pub(super) fn split(tables: &[BivariateTable; 3], pixel: f32) -> (NarrowLobe, [BivariateTable; 3]) {
    let share = |i: usize| {
        let degrees = 90.0 * edge(i).powi(2);
        let x = ((NARROW.1 - degrees) / (NARROW.1 - NARROW.0)).clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    };
    let step = |i: usize, j: usize| {
        Vec3A::from(tables.each_ref().map(|t| t.cell(i, j) - if i + 1 < THETA_H { t.cell(i + 1, j) } else { 0.0 }))
    };
    let weights = |j: usize| {
        let cos = (j as f32).to_radians().cos();
        let levels = variances(cos);
        let floor = pixel * pixel / 24.0 * (1.0 + cos.max(0.1).powi(-2));
        let mut weights = [Vec3A::ZERO; LEVELS];
        for i in 0..ROWS {
            let radius = edge(i).powi(2) * FRAC_PI_2;
            let flux = step(i, j) * (share(i) * TAU * (1.0 - radius.cos()));
            let variance = 0.25 * radius * radius + floor;
            let next = levels.iter().position(|v| *v > variance).unwrap_or(LEVELS - 1).max(1);
            let part = ((variance - levels[next - 1]) / (levels[next] - levels[next - 1])).clamp(0.0, 1.0);
            weights[next - 1] += flux * (1.0 - part);
            weights[next] += flux * part;
        }
        weights
    };
    let rest = [0, 1, 2].map(|channel| {
        let mut values = tables[channel].as_slice().to_vec();
        for j in 0..THETA_D {
            let mut narrow = 0.0;
            for i in (0..ROWS).rev() {
                narrow += share(i) * step(i, j)[channel];
                values[i * THETA_D + j] -= narrow;
            }
        }
        BivariateTable::from_vec(values.into_iter().map(|v| v.max(0.0)).collect())
    });
    let degrees = (0..=90).map(|j: usize| weights(j.clamp(BLIND, THETA_D - 1)));
    (NarrowLobe { weights: degrees.collect() }, rest)
}

/// Returns the square root of the half angle between a row and the next, in units of 90 degrees.
fn edge(i: usize) -> f32 {
    (i as f32 + 0.5) / THETA_H as f32
}

impl NarrowLobe {
    /// Returns the weights of the levels of the light at an index from [`degree`]. The weighted sum
    /// of the levels times `4 cos^2` is the radiance.
    pub(super) fn at(&self, degree: usize) -> &[Vec3A; LEVELS] {
        &self.weights[degree]
    }
}

/// Returns the index for [`NarrowLobe::at`] of a normal with this cosine to the view direction.
pub(super) fn degree(cos: f32) -> usize {
    (cos.clamp(0.0, 1.0).acos().to_degrees() + 0.5) as usize
}
