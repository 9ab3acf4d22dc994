//! The loop over batches.

use gonio::inference::amortised::{Encoder, EncoderError, EncoderShape, MixtureDensity};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::Samples;
use crate::loss::mixture_loss;
use crate::optimiser::{Optimiser, Stride, one_cycle};
use crate::parameters::Parameters;
use crate::pass::Layers;

/// Samples that are worked on together by one thread: few enough for their activations to stay in
/// cache.
pub const PART: usize = 8;

/// How an encoder is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingSettings {
    /// Steps of the optimiser.
    pub steps: usize,
    /// Samples between steps.
    pub batch: usize,
    /// Largest rate of the optimiser; it rises over the first three tenths of the steps and falls
    /// over the rest.
    pub rate: f64,
    /// Decay of weights.
    pub decay: f64,
    /// Share of the units of hidden dense layers left out at random.
    pub drop: f64,
    /// Gaussians of the mixture.
    pub components: usize,
    /// Norm that gradients are cut to.
    pub longest: f64,
    /// Share of the moving average of the weights that stays in each step; the average is what
    /// comes of the training.
    pub average: f64,
    /// As in [`EncoderShape::widths`].
    pub widths: Vec<usize>,
    /// As in [`EncoderShape::hidden`].
    pub hidden: Vec<usize>,
    /// Seed of the first weights and of what is left out.
    pub seed: u64,
}

impl Default for TrainingSettings {
    fn default() -> Self {
        let shape = EncoderShape::new(1, 0, 1);
        Self {
            steps: 2_800,
            batch: 128,
            rate: 2e-3,
            decay: 1e-3,
            drop: 0.0,
            components: 4,
            longest: 5.0,
            average: 0.999,
            widths: shape.widths,
            hidden: shape.hidden,
            seed: 1,
        }
    }
}

/// Why there is no encoder.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A setting makes no sense.
    #[error("the setting `{0}` is out of range")]
    Setting(&'static str),
    /// The encoder cannot be built, or not be exported.
    #[error(transparent)]
    Encoder(#[from] EncoderError),
    /// The loss or its gradient is not finite: a sample that is not, or too large a rate.
    #[error("the loss is not finite at step {step}")]
    Diverged {
        /// Counted from zero.
        step: usize,
    },
}

/// Images, globals and targets of some samples, one after the other.
pub(crate) struct Part {
    pub(crate) count: usize,
    pub(crate) images: Vec<f32>,
    pub(crate) globals: Vec<f32>,
    pub(crate) targets: Vec<f32>,
}

impl Part {
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

/// An encoder in training.
pub(crate) struct Model {
    pub(crate) shape: EncoderShape,
    pub(crate) layers: Layers,
    pub(crate) parameters: Parameters,
    components: usize,
    drop: f64,
}

impl Model {
    pub(crate) fn new(samples: &dyn Samples, settings: &TrainingSettings) -> Result<Self, TrainError> {
        let dimensions = samples.dimensions();
        let check = |ok: bool, name| if ok { Ok(()) } else { Err(TrainError::Setting(name)) };
        check((1..=256).contains(&settings.components), "components")?;
        check(settings.batch > 0, "batch")?;
        check((0.0..1.0).contains(&settings.drop), "drop")?;
        check((0.0..1.0).contains(&settings.average), "average")?;
        check(settings.longest > 0.0, "longest")?;
        check(dimensions <= 64, "dimensions")?;
        let shape = EncoderShape {
            side: samples.side(),
            channels: samples.channels(),
            globals: samples.globals(),
            widths: settings.widths.clone(),
            hidden: settings.hidden.clone(),
            outputs: MixtureDensity::outputs(dimensions, settings.components),
        };
        shape.check()?;
        let layers = Layers::new(&shape);
        let parameters = Parameters::new(&layers);
        Ok(Self { shape, layers, parameters, components: settings.components, drop: settings.drop })
    }

    /// Sum of the loss over a part, and its gradient in the weights of each layer. Units are left
    /// out by `seed`.
    fn gradient(&self, part: Part, weights: &[Vec<f32>], seed: u64) -> (f64, Vec<Vec<f32>>) {
        let masks = self.masks(part.count, seed);
        let trace = self.layers.forward(part.images, &part.globals, part.count, weights, &masks);
        let mut back = trace.outputs().to_vec();
        let samples =
            back.chunks_exact_mut(self.shape.outputs).zip(part.targets.chunks_exact(part.targets.len() / part.count));
        let value = samples.map(|(outputs, target)| mixture_loss(outputs, target, self.components)).sum();
        (value, self.layers.backward(trace, back, weights, &masks))
    }

    /// What the units of the hidden layers are multiplied by: zero for those left out, and more
    /// than one for the rest to keep the mean.
    fn masks(&self, count: usize, seed: u64) -> Vec<Vec<f32>> {
        if self.drop == 0.0 {
            return Vec::new();
        }
        let mut rng = Pcg64::seed_from_u64(seed);
        let rest = (1.0 / (1.0 - self.drop)) as f32;
        let mut draw = || if rng.random_range(0.0..1.0) < self.drop { 0.0 } else { rest };
        self.shape.hidden.iter().map(|units| (0..count * units).map(|_| draw()).collect()).collect()
    }

    /// Mean of the loss over the samples from `first` on, and its gradient in all that is learnt.
    pub(crate) fn batch(
        &self,
        samples: &dyn Samples,
        values: &[f32],
        first: u64,
        count: usize,
        seed: u64,
    ) -> (f64, Vec<f32>) {
        let weights = self.parameters.weights(values);
        let parts: Vec<(f64, Vec<Vec<f32>>)> = (0..count.div_ceil(PART))
            .into_par_iter()
            .map(|at| {
                let part = Part::draw(samples, first + (at * PART) as u64, PART.min(count - at * PART));
                // Neighbouring seeds of the generator give streams that have nothing in common.
                self.gradient(part, &weights, (seed << 32).wrapping_add(first).wrapping_add((at * PART) as u64))
            })
            .collect();
        let scale = 1.0 / count as f32;
        let sums: Vec<Vec<f32>> = (0..weights.len())
            .into_par_iter()
            .map(|layer| {
                let mut sum = vec![0.0; weights[layer].len()];
                for (_, part) in &parts {
                    sum.iter_mut().zip(&part[layer]).for_each(|(s, g)| *s += scale * g);
                }
                sum
            })
            .collect();
        let value = parts.iter().map(|p| p.0).sum::<f64>() / count as f64;
        (value, self.parameters.pull(values, &sums))
    }
}

/// Fits an encoder whose outputs are a [`MixtureDensity`] of `settings.components` to the samples:
/// step `i` sees those from `i * batch` on. `progress` is told the share of the steps done and the
/// mean loss (minus the log density, in nats) of the last one. Runs on the threads of rayon's pool;
/// deterministic for the seed, whatever their number.
pub fn train(
    samples: &dyn Samples,
    settings: &TrainingSettings,
    progress: &(dyn Fn(f64, f64) + Sync),
) -> Result<Encoder, TrainError> {
    let model = Model::new(samples, settings)?;
    let mut values = model.parameters.random(samples.dimensions(), settings.components, settings.seed);
    let mut optimiser = Optimiser::new(&values);
    for step in 0..settings.steps {
        let first = (step * settings.batch) as u64;
        let (loss, gradient) = model.batch(samples, &values, first, settings.batch, settings.seed);
        if !loss.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            return Err(TrainError::Diverged { step });
        }
        let stride = Stride {
            rate: (settings.rate * one_cycle(step as f64 / settings.steps as f64)) as f32,
            decay: settings.decay as f32,
            longest: settings.longest,
            average: settings.average as f32,
        };
        optimiser.step(&mut values, &gradient, model.parameters.decaying(), &stride);
        progress((step + 1) as f64 / settings.steps as f64, loss);
    }
    Ok(model.parameters.export(optimiser.average(), &model.shape)?)
}

/// Mean loss (minus the log density, in nats) of an encoder of so many components over samples.
/// Deterministic; on rayon's threads.
///
/// # Panics
/// If the encoder is not one for such samples, or if there are none.
pub fn evaluate(encoder: &Encoder, components: usize, samples: &dyn Samples, indices: std::ops::Range<u64>) -> f64 {
    assert!(!indices.is_empty(), "no samples");
    let count = (indices.end - indices.start) as f64;
    let losses: Vec<f64> = indices
        .into_par_iter()
        .map(|index| {
            let part = Part::draw(samples, index, 1);
            let (outputs, _) = encoder.apply(&part.images, &part.globals);
            let target: Vec<f64> = part.targets.iter().map(|v| f64::from(*v)).collect();
            -MixtureDensity::of(&outputs, target.len(), components).log_density(&target)
        })
        .collect();
    losses.iter().sum::<f64>() / count
}
