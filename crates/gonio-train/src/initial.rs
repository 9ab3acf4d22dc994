//! Starts a training from a trained posterior, instead of from random weights.

use gonio::inference::learnt::LearntPosterior;
use gonio::reflectance::LatentSpace;

use crate::TrainError;
use crate::optimiser::{Optimiser, StepSettings, one_cycle};
use crate::train::{Model, bounded};

/// A trained encoder, and materials with their embeddings.
///
/// Materials are described in the coordinates of the new training, which may have other axes than
/// the earlier one.
pub struct InitialPosterior<'a> {
    /// Posterior of an earlier training.
    pub posterior: &'a LearntPosterior,
    /// Axes of the new training.
    pub latent_space: &'a LatentSpace,
}

/// Steps of the regression that fits the embedding of materials to the earlier one.
const STEPS: usize = 3_000;

/// Materials in each of these steps.
const BATCH: usize = 256;

/// Largest learning rate of the regression.
const RATE: f64 = 2e-3;

/// Materials that one pass converts to tables: few enough for a small memory (32 kB each).
const TABLES: usize = 512;

impl InitialPosterior<'_> {
    /// Coordinates of the earlier candidates along the new axes.
    fn coordinates(&self) -> Vec<f32> {
        let Self { posterior, latent_space } = self;
        let old: Vec<Vec<f64>> =
            posterior.prior.coordinates.iter().map(|place| place.iter().map(|z| f64::from(*z)).collect()).collect();
        let new = old.chunks(TABLES).flat_map(|places| posterior.latent_space.tables(places));
        new.flat_map(|table| latent_space.of(&table)).map(|z| z as f32).collect()
    }

    /// Computes the parameters from which the training starts: the weights of the encoder, and an
    /// embedding of materials that was fitted to the earlier embeddings.
    ///
    /// # Errors
    /// If the encoder or the embedding has another shape.
    pub(crate) fn parameters(&self, model: &Model, seed: u64) -> Result<Vec<f32>, TrainError> {
        let encoder = &self.posterior.encoder;
        if encoder.shape() != &model.shape {
            return Err(TrainError::Initial);
        }
        let mut values = model.parameters.import(encoder, seed);
        let places = bounded(&self.coordinates());
        let dimensions = self.latent_space.axes.len();
        let scale = (model.shape.outputs as f32).sqrt();
        let targets: Vec<f32> = self.posterior.prior.embeddings.iter().flatten().map(|v| scale * v).collect();
        let count = places.len() / dimensions;
        let mut optimiser = Optimiser::new(&values);
        for step in 0..STEPS {
            // A stride that is coprime to any power of two visits all materials.
            let rows: Vec<usize> = (0..BATCH).map(|at| (step * BATCH + at) * 4_099 % count).collect();
            let of = |all: &[f32], width: usize| -> Vec<f32> {
                rows.iter().flat_map(|row| &all[row * width..][..width]).copied().collect()
            };
            let gradient = model.regress(&values, of(&places, dimensions), &of(&targets, model.shape.outputs));
            let stride = StepSettings {
                rate: (RATE * one_cycle(step as f64 / STEPS as f64)) as f32,
                decay: 0.0,
                max_gradient_norm: 5.0,
                ema_decay: 0.0,
            };
            optimiser.step(&mut values, &gradient, std::iter::empty(), &stride);
        }
        Ok(values)
    }
}
