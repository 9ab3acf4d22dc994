//! Posterior of the material when the light is known.
//!
//! Given the light, the image is linear in the reflectance of the 8,100 cells of a table
//! ([`Relighter`]), at the full resolution of the light. The table is searched around the prior of
//! materials of the learnt posterior: its logarithm is a sum of principal axes of the prior and of
//! splines for what the axes cannot express. The error of the logarithm of the image has a smooth
//! part, since no bivariate table is exact and no light map is, and an independent one with heavy
//! tails; both are estimated from the image. The most probable table is found by Gauss-Newton
//! steps from the best of a thousand materials of the prior, and the posterior is the Gaussian
//! around it (Laplace's approximation).
//!
//! The paper's estimate under a known light, coefficients in ten functions, is
//! [`Method::KnownLight`](super::Method::KnownLight).

mod error_model;
mod fit;
mod space;
#[cfg(test)]
mod tests;

use glam::DVec3;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use thiserror::Error;

use crate::inference::learnt::{LearntPosterior, MaterialPosterior, Neighbour};
use crate::inference::light::Cholesky;
use crate::reflectance::{BivariateTable, CELLS, Coordinates};
use crate::render::{IntegratorSettings, LightTree, Relighter};
use crate::shape::{SurfacePoint, Visibility};
use error_model::{ErrorModel, median};
use fit::Image;
use space::Space;

/// Draws that represent the posterior.
const DRAWS: usize = 256;

/// Standard deviation of the logarithm of reflectance that is added to every draw for intervals:
/// the error that Laplace's approximation does not know of (docs/trials.md).
const SPREAD: f64 = 0.15;

/// Materials of the prior that are compared for the start, at most.
const STARTS: usize = 1000;

/// Observations by which they are compared, at most.
const COMPARED: usize = 200;

/// Observations that the posterior is found from, by default: with more it takes longer, and their
/// errors are correlated anyway.
pub const ROWS: usize = 1000;

/// Materials of the prior for which the light is divided finely enough, at most.
const EXAMPLES: usize = 200;

/// Accuracy of the pictures of a material.
const ACCURACY: IntegratorSettings = IntegratorSettings { tolerance: 0.3, max_cells: 8_000 };

/// The matrix from a table to the luminance of points under a light, divided as finely as the
/// sharpest materials at these places need.
pub fn operator(
    points: &[SurfacePoint],
    visibility: Option<&Visibility>,
    light: &LightTree,
    coordinates: &Coordinates,
    places: &[Vec<f64>],
) -> Relighter {
    let examples: Vec<Vec<f64>> = places.iter().step_by(places.len().div_ceil(EXAMPLES).max(1)).cloned().collect();
    Relighter::within(points, visibility, &coordinates.tables(&examples), light, &ACCURACY)
}

/// Why there is no posterior.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum KnownLightError {
    /// No light of the map reaches the object.
    #[error("the light given leaves the object dark")]
    Dark,
    /// The photograph is black.
    #[error("the photograph is black where the object is")]
    Black,
    /// The equations have no solution.
    #[error("the photograph and the light given do not go together: no material was found")]
    Unsolvable,
}

/// Posterior of the material under a known light.
#[derive(Clone, Debug)]
pub struct KnownLightPosterior {
    space: Space,
    coefficients: Vec<f64>,
    curvature: Cholesky,
    /// Standard deviation of the independent error of the logarithm of the image: noise, texture,
    /// wrong normals.
    pub noise: f64,
    /// Standard deviation of the smooth error of the logarithm of the image.
    pub discrepancy: f64,
    /// Root mean square of the residual relative to that of the image.
    pub misfit: f64,
    /// Predicted value of each observation.
    pub predicted: Vec<f64>,
    /// Whether the steps settled.
    pub settled: bool,
}

impl KnownLightPosterior {
    /// Finds the posterior from values (positive, linear) at points. `operator` has a row for each
    /// of them; `normals` are in the frame of the view of each point, so that views do not matter;
    /// `trust` is the inverse variance of each value relative to the others, in 0..=1. `places` are
    /// [coordinates](Coordinates) of materials of the prior, of which the best is the start.
    ///
    /// # Errors
    /// If the light or the photograph is black, or the equations have no solution.
    ///
    /// # Panics
    /// If lengths differ, or there are no values or no places.
    pub fn of(
        operator: &Relighter,
        (normals, values, trust): (&[DVec3], &[f64], &[f64]),
        coordinates: &Coordinates,
        places: &[Vec<f64>],
    ) -> Result<Self, KnownLightError> {
        assert!(operator.len() == normals.len() && normals.len() == values.len() && values.len() == trust.len());
        if operator.apply(&vec![1.0; CELLS]).into_iter().all(|v| v <= 0.0) {
            return Err(KnownLightError::Dark);
        }
        if values.iter().all(|v| *v <= 0.0) {
            return Err(KnownLightError::Black);
        }
        let space = Space::new(coordinates);
        let image = Image::new(operator, values, &space);
        let start = image.exposed(space.at(&start(operator, values, coordinates, places)));
        let trust = trust.iter().map(|t| t.clamp(1e-3, 1.0)).collect();
        let found = image.fit(start, ErrorModel::new(normals, trust)).ok_or(KnownLightError::Unsolvable)?;
        let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
        let left = square(&mut values.iter().zip(&found.state.predicted).map(|(v, p)| v - p));
        let misfit = (left / square(&mut values.iter().copied())).sqrt();
        Ok(Self {
            coefficients: found.state.coefficients,
            curvature: found.curvature,
            noise: found.errors.noise,
            discrepancy: found.errors.discrepancy,
            misfit,
            predicted: found.state.predicted,
            settled: found.settled,
            space,
        })
    }

    /// The most probable table, on the scale of photograph and light: its albedo is absolute if
    /// both have the same exposure.
    pub fn table(&self) -> BivariateTable {
        self.space.table(&self.coefficients)
    }

    /// Draws tables from the posterior; the same seed gives the same draws.
    pub fn draws(&self, count: usize, seed: u64) -> Vec<BivariateTable> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let white: Vec<Vec<f64>> = (0..count)
            .map(|_| (0..self.coefficients.len()).map(|_| StandardNormal.sample(&mut rng)).collect())
            .collect();
        let table = |white: &Vec<f64>| {
            let step = self.curvature.colour(white);
            let drawn: Vec<f64> = self.coefficients.iter().zip(&step).map(|(x, d)| x + d).collect();
            self.space.table(&drawn)
        };
        white.par_iter().map(table).collect()
    }

    /// The posterior of the material without its scale, by draws of albedo one along the normal.
    /// `learnt` tells its measured neighbours.
    pub fn posterior(&self, learnt: Option<&LearntPosterior>) -> MaterialPosterior {
        let draws = self.draws(DRAWS, 1).into_par_iter().map(|table| table.with_normal_albedo(1.0).0).collect();
        let mean = self.table().with_normal_albedo(1.0).0;
        let neighbours = learnt.map_or_else(Vec::new, |learnt| self.neighbours(learnt));
        MaterialPosterior { embedding: Vec::new(), draws, mean, neighbours, spread: SPREAD }
    }

    /// Measured materials by falling weight: `exp(-d^2 / 2)` with the distance in coordinates.
    fn neighbours(&self, learnt: &LearntPosterior) -> Vec<Neighbour> {
        let distance =
            |place: &Vec<f32>| self.place().iter().zip(place).map(|(a, b)| (a - f64::from(*b)).powi(2)).sum::<f64>();
        let distances: Vec<f64> = learnt.measured.places.iter().map(distance).collect();
        let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = distances.iter().map(|d| (-0.5 * (d - least)).exp()).collect();
        let total: f64 = weights.iter().sum();
        let named = |(name, weight): (&String, f64)| Neighbour { name: name.clone(), weight: weight / total };
        let mut neighbours: Vec<Neighbour> = learnt.names.iter().zip(weights).map(named).collect();
        neighbours.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        neighbours
    }

    /// Coordinates of the material in the space of the prior.
    pub fn place(&self) -> &[f64] {
        &self.coefficients[..self.space.dimensions]
    }
}

/// The place whose picture is nearest to the image, by the median absolute deviation of the
/// logarithm.
fn start(operator: &Relighter, values: &[f64], coordinates: &Coordinates, places: &[Vec<f64>]) -> Vec<f64> {
    let some = |count: usize, most: usize| (0..count).step_by(count.div_ceil(most).max(1));
    let rows: Vec<usize> = some(values.len(), COMPARED).collect();
    let places: Vec<Vec<f64>> = some(places.len(), STARTS).map(|at| places[at].clone()).collect();
    let floor = 0.01 * values.iter().sum::<f64>() / values.len() as f64;
    let deviation = |table: &BivariateTable| {
        let cells = table.as_slice();
        let picture: Vec<f64> = rows
            .iter()
            .map(|&at| operator.row(at).map(|(cell, w)| f64::from(w) * f64::from(cells[cell])).sum())
            .collect();
        let ratio: f64 = rows.iter().map(|&at| values[at]).sum::<f64>() / picture.iter().sum::<f64>().max(1e-300);
        let logs: Vec<f64> =
            rows.iter().zip(&picture).map(|(&at, p)| ((values[at] + floor) / (ratio * p + floor)).ln()).collect();
        let middle = median(logs.clone());
        median(logs.iter().map(|l| (l - middle).abs()).collect())
    };
    let tables = coordinates.tables(&places);
    let deviations: Vec<f64> = tables.par_iter().map(deviation).collect();
    let best = (0..places.len()).min_by(|a, b| deviations[*a].total_cmp(&deviations[*b]));
    places[best.expect("there are places")].clone()
}
