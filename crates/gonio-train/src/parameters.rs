//! The numbers that are learnt, and the weights that they make.
//!
//! Convolutions have their weights standardised over the neighbourhood of each output and scaled by
//! a gain that is learnt (Brock et al. 2021), in place of a normalisation of activations; the last
//! one of a residual block has a small factor besides (De & Smith 2020). Dense layers are learnt as
//! they are.

use std::ops::Range;

use gonio::inference::learnt::{Encoder, EncoderError, EncoderShape, NamedLayer};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// `silu` of a standard normal times this has variance one.
const SILU_GAIN: f64 = 1.788_129;

/// Factor of residual blocks at the start.
const SKIP: f32 = 0.2;

/// Where the numbers of a layer are among all.
struct Slots {
    layer: NamedLayer,
    weights: Range<usize>,
    bias: Range<usize>,
    /// One for each output of a convolution, times `scale`.
    gain: Option<Range<usize>>,
    /// The factor of a residual block, at its end.
    skip: Option<Range<usize>>,
    scale: f32,
}

/// What the numbers of all layers mean, in one vector.
pub(crate) struct Parameters {
    slots: Vec<Slots>,
    count: usize,
}

impl Parameters {
    pub(crate) fn new<'a>(layers: impl Iterator<Item = &'a NamedLayer>) -> Self {
        let mut count = 0;
        let mut take = |n: usize| {
            count += n;
            count - n..count
        };
        let slots = layers
            .map(|layer| {
                let g = &layer.geometry;
                let standard = g.side > 1;
                Slots {
                    weights: take(g.neighbourhood() * g.outputs),
                    bias: take(g.outputs),
                    gain: standard.then(|| take(g.outputs)),
                    skip: layer.name.ends_with(".second").then(|| take(1)),
                    // The image is not what `silu` made.
                    scale: if layer.name == "stem" { 1.0 } else { SILU_GAIN as f32 },
                    layer: layer.clone(),
                }
            })
            .collect();
        Self { slots, count }
    }

    /// Places of the numbers that decay: all weights, but no bias, gain or factor.
    pub(crate) fn decaying(&self) -> impl Iterator<Item = Range<usize>> {
        self.slots.iter().map(|s| s.weights.clone())
    }

    /// Places of each tensor.
    #[cfg(test)]
    pub(crate) fn ranges(&self) -> Vec<Range<usize>> {
        let all = self.slots.iter().map(|s| (Some(&s.weights), Some(&s.bias), s.gain.as_ref(), s.skip.as_ref()));
        all.flat_map(|(w, b, g, s)| [w, b, g, s]).flatten().cloned().collect()
    }

    /// Numbers to start from.
    pub(crate) fn random(&self, seed: u64) -> Vec<f32> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut normal = |deviation: f64| (deviation * Distribution::<f64>::sample(&StandardNormal, &mut rng)) as f32;
        let mut values = vec![0.0; self.count];
        for slots in &self.slots {
            let scale = SILU_GAIN / (slots.layer.geometry.neighbourhood() as f64).sqrt();
            values[slots.weights.clone()].fill_with(|| normal(scale));
            slots.gain.iter().for_each(|gain| values[gain.clone()].fill(1.0));
            slots.skip.iter().for_each(|skip| values[skip.clone()].fill(SKIP));
        }
        values
    }

    /// Weights `[neighbourhood + 1][outputs]` of all layers, the bias last.
    pub(crate) fn weights(&self, values: &[f32]) -> Vec<Vec<f32>> {
        self.slots.par_iter().map(|slots| slots.weights(values)).collect()
    }

    /// The gradient in the numbers for the gradients in [`Self::weights`].
    pub(crate) fn pull(&self, values: &[f32], weights: &[Vec<f32>]) -> Vec<f32> {
        let parts: Vec<Vec<f32>> =
            self.slots.par_iter().zip(weights).map(|(slots, back)| slots.pull(values, back)).collect();
        parts.concat()
    }

    /// The encoder of these numbers.
    pub(crate) fn export(&self, values: &[f32], shape: &EncoderShape) -> Result<Encoder, EncoderError> {
        let made = self.weights(values);
        Encoder::from_tensors(shape.clone(), |name| {
            let (layer, part) = name.rsplit_once('.')?;
            let at = self.slots.iter().position(|s| s.layer.name == layer)?;
            let layer = &self.slots[at].layer;
            let (weights, bias) = made[at].split_at(self.slots[at].weights.len());
            Some(if part == "bias" {
                (vec![bias.len()], bias.to_vec())
            } else {
                (layer.dimensions(), weights.to_vec())
            })
        })
    }
}

/// The columns of a layer's weights in standard form: mean zero, and one for the sum of squares.
struct Standard {
    columns: Vec<f32>,
    /// Root of the sum of squares about the mean, of each column before.
    spread: Vec<f32>,
}

/// For each column `f` of what is in a row and column, summed over rows. `values` has rows of
/// `columns`.
fn sums(values: &[f32], columns: usize, f: impl Fn(usize, f32) -> f32) -> Vec<f32> {
    let mut sums = vec![0.0; columns];
    for (row, values) in values.chunks_exact(columns).enumerate() {
        for (column, (sum, v)) in sums.iter_mut().zip(values).enumerate() {
            *sum += f(row * columns + column, *v);
        }
    }
    sums
}

impl Standard {
    fn of(weights: &[f32], outputs: usize) -> Self {
        let rows = (weights.len() / outputs) as f32;
        let mean: Vec<f32> = sums(weights, outputs, |_, v| v / rows);
        let spread: Vec<f32> = sums(weights, outputs, |at, v| (v - mean[at % outputs]).powi(2))
            .iter()
            .map(|square| (square + 1e-6).sqrt())
            .collect();
        let one = |(at, v): (usize, &f32)| (v - mean[at % outputs]) / spread[at % outputs];
        Self { columns: weights.iter().enumerate().map(one).collect(), spread }
    }
}

impl Slots {
    /// What the standardised weights of each output are multiplied by, without its gain.
    fn factor(&self, values: &[f32]) -> f32 {
        self.scale * self.skip.as_ref().map_or(1.0, |skip| values[skip.start])
    }

    /// Weights and bias that the numbers make.
    fn weights(&self, values: &[f32]) -> Vec<f32> {
        let mut out = values[self.weights.start..self.bias.end].to_vec();
        if let Some(gain) = &self.gain {
            let (gain, factor) = (&values[gain.clone()], self.factor(values));
            let standard = Standard::of(&values[self.weights.clone()], gain.len());
            for (row, standard) in out.chunks_exact_mut(gain.len()).zip(standard.columns.chunks_exact(gain.len())) {
                row.iter_mut().zip(standard).zip(gain).for_each(|((o, s), g)| *o = factor * g * s);
            }
        }
        out
    }

    /// The gradient in the layer's numbers, in the order of their places, for that in its weights
    /// and bias.
    fn pull(&self, values: &[f32], back: &[f32]) -> Vec<f32> {
        let mut out = back.to_vec();
        let Some(gain) = &self.gain else { return out };
        let (gain, factor, outputs) = (&values[gain.clone()], self.factor(values), gain.len());
        let standard = Standard::of(&values[self.weights.clone()], outputs);
        let rows = self.layer.geometry.neighbourhood() as f32;
        let (back, _) = back.split_at(self.weights.len());
        let mean = sums(back, outputs, |_, b| b / rows);
        let along = sums(back, outputs, |at, b| b * standard.columns[at]);
        for (at, out) in out[..self.weights.len()].iter_mut().enumerate() {
            let o = at % outputs;
            *out = factor * gain[o] / standard.spread[o] * (*out - mean[o] - standard.columns[at] * along[o]);
        }
        out.extend(along.iter().map(|a| factor * a));
        if self.skip.is_some() {
            out.push(self.scale * along.iter().zip(gain).map(|(a, g)| a * g).sum::<f32>());
        }
        out
    }
}
