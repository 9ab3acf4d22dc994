//! The training loop over batches.

use gonio::inference::learnt::{Convolution, Encoder, EncoderError, EncoderShape, NamedLayer};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::InitialPosterior;
use crate::Samples;
use crate::checkpoint::Checkpoint;
use crate::dense::{Dense, DenseTrace};
use crate::loss::contrast;
use crate::optimiser::{Optimiser, StepSettings, one_cycle};
use crate::parameters::Parameters;
use crate::pass::Layers;

/// Number of samples that one thread processes together: few enough for their activations to stay
/// in cache.
pub const MICRO_BATCH: usize = 8;

/// Settings of the training of an encoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingSettings {
    /// Steps of the optimiser.
    pub steps: usize,
    /// Samples in each step.
    pub batch: usize,
    /// Largest learning rate; the rate rises over the first three tenths of the steps and falls
    /// over the rest.
    pub learning_rate: f64,
    /// Weight decay.
    pub weight_decay: f64,
    /// Dimensions of an embedding.
    pub embedding: usize,
    /// Number of materials with which each image's own material is contrasted: those of the
    /// preceding images.
    pub negatives: usize,
    /// Units of the hidden layers between a material and its embedding.
    pub materials: Vec<usize>,
    /// Largest norm of a gradient; longer gradients are scaled down to it.
    pub max_gradient_norm: f64,
    /// Share of the moving average of the weights that is kept in each step; the average is the
    /// result of the training.
    pub ema_decay: f64,
    /// Widths of the encoder, as in [`EncoderShape::widths`].
    pub widths: Vec<usize>,
    /// Hidden layers of the encoder, as in [`EncoderShape::hidden`].
    pub hidden: Vec<usize>,
    /// Number of materials that represent the prior in the posterior. A quarter of the default
    /// would suffice for most photographs, but would leave very few materials to the most certain
    /// posteriors (`docs/trials.md`).
    pub candidates: usize,
    /// Seed of the initial weights.
    pub seed: u64,
}

impl Default for TrainingSettings {
    fn default() -> Self {
        let shape = EncoderShape::new(1, 0, 1);
        Self {
            steps: 2_800,
            batch: 128,
            learning_rate: 2e-3,
            weight_decay: 1e-3,
            embedding: 64,
            negatives: 2048,
            materials: vec![256, 256],
            max_gradient_norm: 5.0,
            ema_decay: 0.999,
            widths: shape.widths,
            hidden: shape.hidden,
            candidates: 8192,
            seed: 1,
        }
    }
}

/// Reason why the training failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A setting is out of range.
    #[error("setting `{0}` is out of range")]
    Setting(&'static str),
    /// The checkpoint is from a training with other settings.
    #[error("the checkpoint belongs to a training with other settings")]
    Checkpoint,
    /// The initial posterior has another network.
    #[error("the network of the initial model has another shape; use a model that this version trained")]
    Initial,
    /// The encoder cannot be built or exported.
    #[error(transparent)]
    Encoder(#[from] EncoderError),
    /// The loss or its gradient is not finite, because a sample is not finite or the learning rate
    /// is too large.
    #[error("the loss is not finite at step {step}")]
    Diverged {
        /// Step, counted from zero.
        step: usize,
    },
}

/// Images, globals and targets of some samples, one after the other.
pub(crate) struct MicroBatch {
    pub(crate) count: usize,
    pub(crate) images: Vec<f32>,
    pub(crate) globals: Vec<f32>,
    pub(crate) targets: Vec<f32>,
}

impl MicroBatch {
    pub(crate) fn draw(samples: &dyn Samples, first: u64, count: usize) -> Self {
        let (image, globals, target) =
            (samples.side().pow(2) * samples.channels(), samples.globals(), samples.dimensions());
        let zeros = |each: usize| vec![0.0; each * count];
        let mut part = Self { count, images: zeros(image), globals: zeros(globals), targets: zeros(target) };
        for at in 0..count {
            samples.draw(
                first + at as u64,
                &mut part.images[at * image..][..image],
                &mut part.globals[at * globals..][..globals],
                &mut part.targets[at * target..][..target],
            );
        }
        part
    }
}

/// Number of materials that one thread embeds together.
const ROWS: usize = 128;

/// Bound of the coordinates of materials, in deviations: coordinates of a formula may be
/// arbitrarily large.
const MAX_COORDINATE: f32 = 8.0;

pub(crate) fn bounded(coordinates: &[f32]) -> Vec<f32> {
    coordinates.iter().map(|z| z.clamp(-MAX_COORDINATE, MAX_COORDINATE)).collect()
}

/// An encoder and the embedding of materials in training.
pub(crate) struct Model {
    pub(crate) shape: EncoderShape,
    pub(crate) layers: Layers,
    pub(crate) materials: Dense,
    pub(crate) parameters: Parameters,
}

/// Result of a training: an encoder of images, and the matching embedding of materials.
pub struct Trained {
    /// Encoder of an image; the output is the embedding.
    pub encoder: Encoder,
    model: Model,
    /// Weights of the embedding of materials.
    weights: Vec<Vec<f32>>,
    values: Vec<f32>,
    negatives: Vec<f32>,
}

impl Trained {
    /// Returns the embedding of a material at given coordinates. Its product with that of an image
    /// is the logarithm of the image's likelihood, up to a constant of the image.
    pub fn embed(&self, place: &[f32]) -> Vec<f32> {
        let trace = self.model.materials.forward(bounded(place), &self.weights);
        let scale = 1.0 / (trace.outputs().len() as f32).sqrt();
        trace.outputs().iter().map(|v| scale * v).collect()
    }

    /// Computes the mean loss in nats of `count` samples from `first` on. Their materials are
    /// contrasted with the last materials of the training.
    pub fn loss(&self, samples: &dyn Samples, first: u64, count: usize) -> f64 {
        self.model.learn(&self.values, Batch { samples, first, count, negatives: &self.negatives }).loss
    }
}

/// A batch of samples, and the materials of other samples.
#[derive(Clone, Copy)]
pub(crate) struct Batch<'a> {
    pub(crate) samples: &'a dyn Samples,
    /// Index of the first sample.
    pub(crate) first: u64,
    pub(crate) count: usize,
    /// Coordinates of the materials to contrast with the samples' own, one after the other.
    pub(crate) negatives: &'a [f32],
}

/// Loss and gradient of a batch.
pub(crate) struct BatchGradient {
    /// Mean loss of the samples.
    pub(crate) loss: f64,
    /// Gradient of the mean loss with respect to all parameters.
    pub(crate) gradient: Vec<f32>,
    /// Coordinates of the samples' materials, one after the other.
    pub(crate) coordinates: Vec<f32>,
}

/// Loss and gradients of a part of a batch: sums over its samples.
struct MicroBatchGradient {
    loss: f64,
    /// Gradients with respect to the weights of all layers.
    gradients: Vec<Vec<f32>>,
    to_negatives: Vec<f32>,
    coordinates: Vec<f32>,
}

impl Model {
    pub(crate) fn new(samples: &dyn Samples, settings: &TrainingSettings) -> Result<Self, TrainError> {
        let dimensions = samples.dimensions();
        let check = |ok: bool, name| if ok { Ok(()) } else { Err(TrainError::Setting(name)) };
        check((1..=1024).contains(&settings.embedding), "embedding")?;
        check(settings.negatives > 0, "negatives")?;
        check(settings.candidates > 0, "candidates")?;
        check(settings.materials.iter().all(|units| (1..=4096).contains(units)), "materials")?;
        check(settings.steps > 0, "steps")?;
        check(settings.batch > 0, "batch")?;
        check((0.0..1.0).contains(&settings.ema_decay), "ema_decay")?;
        check(settings.max_gradient_norm > 0.0, "max_gradient_norm")?;
        check((1..=64).contains(&dimensions), "dimensions of the samples")?;
        let shape = EncoderShape {
            side: samples.side(),
            channels: samples.channels(),
            globals: samples.globals(),
            widths: settings.widths.clone(),
            hidden: settings.hidden.clone(),
            outputs: settings.embedding,
        };
        shape.check()?;
        let layers = Layers::new(&shape);
        let sizes: Vec<usize> =
            [dimensions].into_iter().chain(settings.materials.iter().copied()).chain([settings.embedding]).collect();
        let material = |(at, sizes): (usize, &[usize])| NamedLayer {
            name: format!("material{}", at + 1),
            geometry: Convolution::dense(sizes[0], sizes[1]),
        };
        let materials = Dense { layers: sizes.windows(2).enumerate().map(material).collect() };
        let parameters = Parameters::new(layers.all().chain(&materials.layers));
        Ok(Self { shape, layers, materials, parameters })
    }

    /// Computes loss and gradients of the images of a part, contrasting their own materials with
    /// the embeddings `negatives`.
    fn micro_batch(&self, part: MicroBatch, weights: &[Vec<f32>], negatives: &[f32]) -> MicroBatchGradient {
        let (encoder, materials) = weights.split_at(self.layers.all().count());
        let images = self.layers.forward(part.images, &part.globals, part.count, encoder);
        let own = self.materials.forward(bounded(&part.targets), materials);
        let (mut to_images, mut to_own) = (images.outputs().to_vec(), own.outputs().to_vec());
        let mut to_negatives = vec![0.0; negatives.len()];
        let loss = contrast(&mut to_images, &mut to_own, negatives, &mut to_negatives, self.shape.outputs);
        let mut gradients = self.layers.backward(images, to_images, encoder);
        gradients.extend(self.materials.backward(own, to_own, materials).0);
        MicroBatchGradient { loss, gradients, to_negatives, coordinates: part.targets }
    }

    pub(crate) fn learn(&self, values: &[f32], batch: Batch<'_>) -> BatchGradient {
        let Batch { samples, first, count, negatives } = batch;
        let weights = self.parameters.weights(values);
        let images = self.layers.all().count();
        let rows = ROWS * samples.dimensions();
        let traces: Vec<DenseTrace> =
            negatives.par_chunks(rows).map(|rows| self.materials.forward(bounded(rows), &weights[images..])).collect();
        let embedded: Vec<f32> = traces.iter().flat_map(|trace| trace.outputs()).copied().collect();
        let parts: Vec<MicroBatchGradient> = (0..count.div_ceil(MICRO_BATCH))
            .into_par_iter()
            .map(|at| {
                let part = MicroBatch::draw(
                    samples,
                    first + (at * MICRO_BATCH) as u64,
                    MICRO_BATCH.min(count - at * MICRO_BATCH),
                );
                self.micro_batch(part, &weights, &embedded)
            })
            .collect();
        let to_negatives = sum(parts.iter().map(|p| p.to_negatives.as_slice()), embedded.len());
        let back: Vec<Vec<Vec<f32>>> = traces
            .into_par_iter()
            .zip(to_negatives.par_chunks(ROWS * self.shape.outputs))
            .map(|(trace, back)| self.materials.backward(trace, back.to_vec(), &weights[images..]).0)
            .collect();
        let scale = 1.0 / count as f32;
        let gradients: Vec<Vec<f32>> = (0..weights.len())
            .into_par_iter()
            .map(|layer| {
                let own = parts.iter().map(|p| p.gradients[layer].as_slice());
                let back = back.iter().filter(|_| layer >= images).map(|b| b[layer - images].as_slice());
                let mut sum = sum(own.chain(back), weights[layer].len());
                sum.iter_mut().for_each(|s| *s *= scale);
                sum
            })
            .collect();
        BatchGradient {
            loss: parts.iter().map(|p| p.loss).sum::<f64>() / count as f64,
            gradient: self.parameters.backward(values, &gradients),
            coordinates: parts.into_iter().flat_map(|p| p.coordinates).collect(),
        }
    }

    fn finish(self, values: Vec<f32>, negatives: Vec<f32>) -> Result<Trained, TrainError> {
        let encoder = self.parameters.export(&values, &self.shape)?;
        let weights = self.parameters.weights(&values).split_off(self.layers.all().count());
        Ok(Trained { encoder, model: self, weights, values, negatives })
    }
}

/// Sums vectors of the given length, in their order.
fn sum<'a>(vectors: impl Iterator<Item = &'a [f32]>, length: usize) -> Vec<f32> {
    let mut sum = vec![0.0; length];
    for vector in vectors {
        sum.iter_mut().zip(vector).for_each(|(s, v)| *s += v);
    }
    sum
}

/// Observer of a training.
pub struct Monitor<'a> {
    /// Called after each step with the share of completed steps and the loss of the step in nats.
    /// The loss is the negative logarithm of an image's likelihood under its own material over its
    /// likelihood under any of the materials.
    pub progress: &'a (dyn Fn(f64, f64) + Sync),
    /// Called after each step; calls its argument if it is time to keep a [`Checkpoint`].
    pub keep: &'a dyn Fn(&dyn Fn() -> Checkpoint),
}

impl<'a> Monitor<'a> {
    /// Builds an observer that keeps no checkpoint.
    pub fn new(progress: &'a (dyn Fn(f64, f64) + Sync)) -> Self {
        Self { progress, keep: &|_| () }
    }
}

/// Fits an encoder and the embedding of materials to the samples.
///
/// Step `i` uses the samples from `i * batch` on, and contrasts their materials with those of the
/// `settings.negatives` preceding samples. The training begins with the weights of `initial`, if
/// given. If `start` is given, the training continues from it with the same result, and does not
/// use `initial`. Also returns the loss of each step. The training runs on the threads of rayon's
/// pool. The result depends on the seed, but not on the number of threads.
///
/// # Errors
/// If a setting is out of range, the loss is not finite, `start` is from other settings, or
/// `initial` has another network.
pub fn train(
    samples: &mut dyn Samples,
    settings: &TrainingSettings,
    initial: Option<&InitialPosterior<'_>>,
    start: Option<Checkpoint>,
    monitor: &Monitor<'_>,
) -> Result<(Trained, Vec<f32>), TrainError> {
    let model = Model::new(samples, settings)?;
    let mut values = match (initial, &start) {
        (Some(initial), None) => initial.parameters(&model, settings.seed)?,
        _ => model.parameters.random(settings.seed),
    };
    let mut optimiser = Optimiser::new(&values);
    let (mut negatives, mut losses): (Vec<f32>, Vec<f32>) = (Vec::new(), Vec::new());
    let mut first_step = 0;
    if let Some(start) = start {
        let sizes = start.moments.iter().chain([&start.values]).all(|v| v.len() == values.len());
        if !sizes || start.step() > settings.steps || !start.negatives.len().is_multiple_of(samples.dimensions()) {
            return Err(TrainError::Checkpoint);
        }
        first_step = start.step();
        optimiser = Optimiser::resume(start.moments, first_step);
        (values, negatives, losses) = (start.values, start.negatives, start.losses);
    }
    for step in first_step..settings.steps {
        samples.advance(step);
        let first = (step * settings.batch) as u64;
        let batch = Batch { samples, first, count: settings.batch, negatives: &negatives };
        let BatchGradient { loss, gradient, coordinates } = model.learn(&values, batch);
        if !loss.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            return Err(TrainError::Diverged { step });
        }
        let step_settings = StepSettings {
            rate: (settings.learning_rate * one_cycle(step as f64 / settings.steps as f64)) as f32,
            decay: settings.weight_decay as f32,
            max_gradient_norm: settings.max_gradient_norm,
            ema_decay: settings.ema_decay as f32,
        };
        optimiser.step(&mut values, &gradient, model.parameters.decaying(), &step_settings);
        negatives.extend(coordinates);
        negatives.drain(..negatives.len().saturating_sub(settings.negatives * samples.dimensions()));
        losses.push(loss as f32);
        (monitor.progress)((step + 1) as f64 / settings.steps as f64, loss);
        (monitor.keep)(&|| Checkpoint {
            values: values.clone(),
            moments: optimiser.moments(),
            negatives: negatives.clone(),
            losses: losses.clone(),
        });
    }
    let trained = model.finish(optimiser.average().to_vec(), negatives)?;
    Ok((trained, losses))
}
