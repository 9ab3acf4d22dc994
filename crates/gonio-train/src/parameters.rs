//! The numbers that are learnt, and the weights that they make.
//!
//! Convolutions have their weights standardised over the neighbourhood of each output and scaled by a gain that is learnt (Brock et al. 2021), in place of a
//! normalisation of activations; the last one of a residual block has a small factor besides (De & Smith 2020). Dense layers are learnt as they are.

use std::ops::Range;

use candle_core::{D, Device, Result, Tensor, Var};
use gonio::inference::amortised::{Encoder, EncoderError, EncoderShape, MixtureDensity, NamedLayer};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use crate::pass::Layers;

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
    scale: f64,
}

/// What the numbers of all layers mean, in one vector.
pub(crate) struct Parameters {
    slots: Vec<Slots>,
    count: usize,
}

impl Parameters {
    pub(crate) fn new(layers: &Layers) -> Self {
        let mut count = 0;
        let mut take = |n: usize| {
            count += n;
            count - n..count
        };
        let slots = layers
            .all()
            .map(|layer| {
                let g = &layer.geometry;
                let standard = g.side > 1;
                Slots {
                    weights: take(g.neighbourhood() * g.outputs),
                    bias: take(g.outputs),
                    gain: standard.then(|| take(g.outputs)),
                    skip: layer.name.ends_with(".second").then(|| take(1)),
                    // The image is not what `silu` made.
                    scale: if layer.name == "stem" { 1.0 } else { SILU_GAIN },
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

    /// Numbers to start from, for outputs that are a mixture: it is near a standard normal, and its components are not all the same.
    pub(crate) fn random(&self, dimensions: usize, components: usize, seed: u64) -> Vec<f32> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut normal = |deviation: f64| (deviation * Distribution::<f64>::sample(&StandardNormal, &mut rng)) as f32;
        let mut values = vec![0.0; self.count];
        for slots in &self.slots {
            let g = &slots.layer.geometry;
            let last = slots.layer.name == "outputs";
            let scale = if last { 0.1 } else { SILU_GAIN } / (g.neighbourhood() as f64).sqrt();
            values[slots.weights.clone()].fill_with(|| normal(scale));
            slots.gain.iter().for_each(|gain| values[gain.clone()].fill(1.0));
            slots.skip.iter().for_each(|skip| values[skip.clone()].fill(SKIP));
            if last {
                let each = MixtureDensity::outputs(dimensions, 1) - 1;
                for k in 0..components {
                    let means = slots.bias.start + components + k * each;
                    values[means..means + dimensions].fill_with(|| normal(0.5));
                }
            }
        }
        values
    }

    /// Weights `[neighbourhood + 1][outputs]` of all layers, the bias last.
    pub(crate) fn weights(&self, values: &[f32]) -> Result<Vec<Vec<f32>>> {
        self.slots.iter().map(|slots| slots.weights(values)?.1.flatten_all()?.to_vec1()).collect()
    }

    /// The gradient in the numbers for the gradients in [`Self::weights`].
    pub(crate) fn pull(&self, values: &[f32], weights: Vec<Vec<f32>>) -> Result<Vec<f32>> {
        let mut out = Vec::with_capacity(self.count);
        for (slots, back) in self.slots.iter().zip(weights) {
            if slots.gain.is_none() {
                out.extend(back);
                continue;
            }
            let (vars, made) = slots.weights(values)?;
            let back = Tensor::from_vec(back, made.shape(), &Device::Cpu)?;
            let gradients = (made * back)?.sum_all()?.backward()?;
            for var in &vars {
                match gradients.get(var) {
                    Some(g) => out.extend(g.flatten_all()?.to_vec1::<f32>()?),
                    None => out.resize(out.len() + var.elem_count(), 0.0),
                }
            }
        }
        Ok(out)
    }

    /// The encoder of these numbers.
    pub(crate) fn export(
        &self,
        values: &[f32],
        shape: &EncoderShape,
    ) -> Result<std::result::Result<Encoder, EncoderError>> {
        let made =
            self.slots.iter().map(|s| s.weights(values)?.1.flatten_all()?.to_vec1()).collect::<Result<Vec<_>>>()?;
        Ok(Encoder::from_tensors(shape.clone(), |name| {
            let (layer, part) = name.rsplit_once('.')?;
            let at = self.slots.iter().position(|s| s.layer.name == layer)?;
            let layer = &self.slots[at].layer;
            let (weights, bias) = made[at].split_at(self.slots[at].weights.len());
            Some(if part == "bias" {
                (vec![bias.len()], bias.to_vec())
            } else {
                (layer.dimensions(), weights.to_vec())
            })
        }))
    }
}

impl Slots {
    /// The learnt tensors in the order of their places, and the weights that they make.
    fn weights(&self, values: &[f32]) -> Result<(Vec<Var>, Tensor)> {
        let g = &self.layer.geometry;
        let var = |range: &Range<usize>, rows: usize| {
            Var::from_slice(&values[range.clone()], (rows, range.len() / rows), &Device::Cpu)
        };
        let (raw, bias) = (var(&self.weights, g.neighbourhood())?, var(&self.bias, 1)?);
        let mut vars = vec![raw.clone(), bias.clone()];
        let mut weights = raw.into_inner();
        if let Some(gain) = &self.gain {
            let centred = weights.broadcast_sub(&weights.mean_keepdim(0)?)?;
            let variance = (centred.sqr()?.mean_keepdim(0)? * g.neighbourhood() as f64)?;
            let gain = var(gain, 1)?;
            let factor = ((gain.as_tensor() * self.scale)? / (variance + 1e-6)?.sqrt()?)?;
            weights = centred.broadcast_mul(&factor)?;
            vars.push(gain);
        }
        if let Some(skip) = &self.skip {
            let skip = var(skip, 1)?;
            weights = weights.broadcast_mul(&skip)?;
            vars.push(skip);
        }
        Ok((vars, Tensor::cat(&[&weights, bias.as_tensor()], D::Minus2)?))
    }
}
