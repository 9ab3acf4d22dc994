//! Starts a training from a trained posterior, instead of from random weights.

use gonio::inference::learnt::LearntPosterior;
use gonio::reflectance::LatentSpace;

use crate::TrainError;
use crate::dense::Dense;
use crate::optimiser::{Optimiser, StepSettings, one_cycle};
use crate::parameters::Parameters;
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

/// Steps, for each material, of the regression that fits the embedding of materials to the earlier
/// one. A training after a worse fit begins with a higher loss (`docs/trials.md`).
const STEPS_PER_MATERIAL: usize = 2;

/// Smallest number of these steps.
const MIN_STEPS: usize = 3_000;

/// Materials in each of these steps.
const REGRESSION_BATCH: usize = 256;

/// Largest learning rate of the regression.
const REGRESSION_RATE: f64 = 2e-3;

/// Step between the materials of the regression. It is prime, so that all materials are used unless
/// it divides their number.
const MATERIAL_STRIDE: usize = 4_099;

/// Materials that are converted to tables at a time: few enough for a small memory (32 kB each).
const TABLES_AT_A_TIME: usize = 512;

impl InitialPosterior<'_> {
    /// Coordinates of the earlier candidates along the new axes.
    fn coordinates(&self) -> Vec<f32> {
        let Self { posterior, latent_space } = self;
        let old: Vec<Vec<f64>> = posterior
            .prior
            .coordinates
            .iter()
            .map(|coordinates| coordinates.iter().map(|z| f64::from(*z)).collect())
            .collect();
        let new = old.chunks(TABLES_AT_A_TIME).flat_map(|materials| posterior.latent_space.tables(materials));
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
        let scale = (model.shape.outputs as f32).sqrt();
        let targets: Vec<f32> = self.posterior.prior.embeddings.iter().flatten().map(|v| scale * v).collect();
        let materials = Parameters::new(model.materials.layers.iter());
        let mut own = materials.random(seed);
        let pairs = Regression {
            network: &model.materials,
            parameters: &materials,
            inputs: bounded(&self.coordinates()),
            targets,
            count: self.posterior.prior.embeddings.len(),
        };
        pairs.fit(&mut own);
        // The parameters of the materials are the last.
        let first = values.len() - own.len();
        values[first..].copy_from_slice(&own);
        Ok(values)
    }
}

/// Least-squares regression of dense layers.
pub(crate) struct Regression<'a> {
    pub(crate) network: &'a Dense,
    pub(crate) parameters: &'a Parameters,
    /// Inputs of all samples, one after the other.
    pub(crate) inputs: Vec<f32>,
    /// Outputs to which the network is fitted, in the same order.
    pub(crate) targets: Vec<f32>,
    /// Number of samples.
    pub(crate) count: usize,
}

impl Regression<'_> {
    pub(crate) fn fit(&self, values: &mut [f32]) {
        let mut optimiser = Optimiser::new(values);
        let steps = (STEPS_PER_MATERIAL * self.count).max(MIN_STEPS);
        for step in 0..steps {
            let rows = (0..REGRESSION_BATCH).map(|at| (step * REGRESSION_BATCH + at) * MATERIAL_STRIDE % self.count);
            let gradient = self.gradient(values, rows);
            let settings = StepSettings {
                rate: (REGRESSION_RATE * one_cycle(step as f64 / steps as f64)) as f32,
                decay: 0.0,
                max_gradient_norm: 5.0,
                ema_decay: 0.0,
            };
            optimiser.step(values, &gradient, std::iter::empty(), &settings);
        }
    }

    /// Gradient of the mean square difference between outputs and targets over some samples.
    pub(crate) fn gradient(&self, values: &[f32], rows: impl Iterator<Item = usize> + Clone) -> Vec<f32> {
        let of = |all: &[f32]| -> Vec<f32> {
            let width = all.len() / self.count;
            rows.clone().flat_map(|row| &all[row * width..][..width]).copied().collect()
        };
        let weights = self.parameters.weights(values);
        let trace = self.network.forward(of(&self.inputs), &weights);
        let targets = of(&self.targets);
        let scale = 2.0 / targets.len() as f32;
        let back = trace.outputs().iter().zip(targets).map(|(found, target)| scale * (found - target)).collect();
        self.parameters.backward(values, &self.network.backward(trace, back, &weights).0)
    }
}
