//! Learnt parameters, and the weights that they define.
//!
//! The weights of convolutions are standardised over the neighbourhood of each output and scaled by
//! a learnt gain (Brock et al. 2021); activations are not normalised. The last convolution of a
//! residual block also has a small learnt factor (De & Smith 2020). The weights of dense layers are
//! learnt directly.

use std::ops::Range;

use gonio::inference::learnt::{Encoder, EncoderError, EncoderShape, NamedLayer};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Factor that scales `silu` of a standard normal variable to variance one.
const SILU_GAIN: f64 = 1.788_129;

/// Initial factor of residual blocks.
const SKIP: f32 = 0.2;

/// Ranges of the parameters of a layer in the vector of all parameters.
struct Slots {
    layer: NamedLayer,
    weights: Range<usize>,
    bias: Range<usize>,
    /// Gains, one for each output of a convolution, multiplied by `scale`.
    gain: Option<Range<usize>>,
    /// Factor of a residual block, for its last convolution.
    skip: Option<Range<usize>>,
    scale: f32,
}

/// Layout of the parameters of all layers in one vector.
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
                    // The input of the stem is the image, not an output of `silu`.
                    scale: if layer.name == "stem" { 1.0 } else { SILU_GAIN as f32 },
                    layer: layer.clone(),
                }
            })
            .collect();
        Self { slots, count }
    }

    /// Ranges of the parameters that decay: all weights, but no bias, gain or factor.
    pub(crate) fn decaying(&self) -> impl Iterator<Item = Range<usize>> {
        self.slots.iter().map(|s| s.weights.clone())
    }

    /// Ranges of each tensor.
    #[cfg(test)]
    pub(crate) fn ranges(&self) -> Vec<Range<usize>> {
        let all = self.slots.iter().map(|s| (Some(&s.weights), Some(&s.bias), s.gain.as_ref(), s.skip.as_ref()));
        all.flat_map(|(w, b, g, s)| [w, b, g, s]).flatten().cloned().collect()
    }

    /// Random initial parameters.
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

    /// Parameters with the weights of an encoder of the same shape, and random weights in all other
    /// layers.
    pub(crate) fn import(&self, encoder: &Encoder, seed: u64) -> Vec<f32> {
        let mut values = self.random(seed);
        let tensors = encoder.tensors();
        let find = |name: String| tensors.iter().find(|tensor| tensor.0 == name).map(|tensor| tensor.2);
        for slots in &self.slots {
            let name = &slots.layer.name;
            let found = find(format!("{name}.weight")).zip(find(format!("{name}.bias")));
            if let Some((weights, bias)) = found {
                slots.import(weights, bias, &mut values);
            }
        }
        values
    }

    /// Weights `[neighbourhood + 1][outputs]` of all layers, the bias last.
    pub(crate) fn weights(&self, values: &[f32]) -> Vec<Vec<f32>> {
        self.slots.par_iter().map(|slots| slots.weights(values)).collect()
    }

    /// Returns the gradient with respect to the parameters, given the gradients with respect to
    /// [`Self::weights`].
    pub(crate) fn backward(&self, values: &[f32], weights: &[Vec<f32>]) -> Vec<f32> {
        let parts: Vec<Vec<f32>> =
            self.slots.par_iter().zip(weights).map(|(slots, back)| slots.backward(values, back)).collect();
        parts.concat()
    }

    /// Builds the encoder of these parameters.
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

/// Columns of a layer's weights, standardised to mean zero and a sum of squares of one.
struct Standard {
    columns: Vec<f32>,
    /// Root of the sum of squares about the mean of each column before standardising.
    spread: Vec<f32>,
}

/// Sums `f(index, value)` over the rows of each column. `values` has rows of `columns`.
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
    /// Factor of the standardised weights of all outputs, without their gains.
    fn factor(&self, values: &[f32]) -> f32 {
        self.scale * self.skip.as_ref().map_or(1.0, |skip| values[skip.start])
    }

    /// Sets the parameters so that [`Self::weights`] returns these weights and this bias.
    fn import(&self, weights: &[f32], bias: &[f32], values: &mut [f32]) {
        values[self.weights.clone()].copy_from_slice(weights);
        values[self.bias.clone()].copy_from_slice(bias);
        let Some(gain) = &self.gain else { return };
        // Scales the columns like random weights, so that the learning rate has the same relative
        // effect.
        let standard = Standard::of(weights, gain.len());
        let columns = standard.columns.iter().map(|v| SILU_GAIN as f32 * v);
        values[self.weights.clone()].iter_mut().zip(columns).for_each(|(v, column)| *v = column);
        let mean = standard.spread.iter().sum::<f32>() / gain.len() as f32;
        if let Some(skip) = &self.skip {
            values[skip.start] = (mean / self.scale).max(1e-3);
        }
        let factor = self.factor(values);
        values[gain.clone()].iter_mut().zip(&standard.spread).for_each(|(g, spread)| *g = spread / factor);
    }

    /// Weights and bias that the parameters define.
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

    /// Returns the gradient with respect to the layer's parameters, in their order in the vector,
    /// given the gradient with respect to its weights and bias.
    fn backward(&self, values: &[f32], back: &[f32]) -> Vec<f32> {
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
