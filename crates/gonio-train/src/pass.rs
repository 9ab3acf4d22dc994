//! Forward and backward passes of the encoder for some images on one thread.
//!
//! The backward pass is written by hand. The tape of candle 0.11, tried first, adds each gradient
//! to zeros. Its operations on large tensors wait for one pool of threads that all parts of a batch
//! share, so that two threads were slower than one (docs/trials.md).

use gonio::inference::learnt::{Convolution, EncoderShape, NamedLayer, Step, inside_disk, pool, silu, silu_backward};

use crate::dense::{Dense, DenseTrace};

/// Layers of an encoder, without their weights. Weights of a layer are
/// `[neighbourhood + 1][outputs]`, the bias last.
pub(crate) struct Layers {
    steps: Vec<Step>,
    convolutions: Vec<NamedLayer>,
    dense: Dense,
}

/// Values that the forward pass keeps for the backward pass, samples along the first axis.
pub(crate) struct Trace {
    /// Inputs of each convolution, and outputs of the last.
    images: Vec<Vec<f32>>,
    /// Means, maxima and spreads at each [`Step::Pool`].
    pooled: Vec<Vec<f32>>,
    /// Outputs of each convolution before [`silu`].
    before: Vec<Vec<f32>>,
    /// Trace of the dense layers.
    dense: DenseTrace,
}

impl Trace {
    pub(crate) fn outputs(&self) -> &[f32] {
        self.dense.outputs()
    }
}

/// Returns the output of a layer for its input, plus `added`.
pub(crate) fn affine(g: &Convolution, weights: &[f32], input: &[f32], added: Option<&[f32]>) -> Vec<f32> {
    let (weights, bias) = weights.split_at(g.neighbourhood() * g.outputs);
    let mut out = bias.repeat(input.len() / g.input_len() * g.output_len() / g.outputs);
    if let Some(added) = added {
        out.iter_mut().zip(added).for_each(|(o, a)| *o += a);
    }
    g.forward(input, weights, &mut out);
    out
}

/// Returns the gradient with respect to a layer's weights and bias, and adds the gradient with
/// respect to its input to `to_input`.
pub(crate) fn affine_backward(
    g: &Convolution,
    weights: &[f32],
    input: &[f32],
    back: &[f32],
    to_input: Option<&mut [f32]>,
) -> Vec<f32> {
    let mut gradient = vec![0.0; weights.len()];
    let (products, bias) = gradient.split_at_mut(g.neighbourhood() * g.outputs);
    for cell in back.chunks_exact(g.outputs) {
        bias.iter_mut().zip(cell).for_each(|(b, c)| *b += c);
    }
    g.backward(input, &weights[..products.len()], back, products, to_input);
    gradient
}

pub(crate) fn activated(before: &[f32]) -> Vec<f32> {
    let mut out = before.to_vec();
    silu(&mut out);
    out
}

/// Adds the gradient of [`pool`] on one image to the gradient with respect to its activations. The
/// first of equal maxima receives the gradient.
fn pool_backward(image: &[f32], cells: &[usize], pooled: &[f32], back: &[f32], to: &mut [f32]) {
    let channels = pooled.len() / 3;
    let share = 1.0 / cells.len() as f32;
    let mean: Vec<f32> = back[..channels].iter().map(|m| m * share).collect();
    let mut left = back[channels..2 * channels].to_vec();
    // For s = log(v + e) / 2 with the variance v: ds/dx = (x - mean) / (n exp(2 s)).
    let spread: Vec<f32> =
        back[2 * channels..].iter().zip(&pooled[2 * channels..]).map(|(b, s)| b * share * (-2.0 * s).exp()).collect();
    for cell in cells {
        let places = cell * channels..(cell + 1) * channels;
        let (to, image) = (&mut to[places.clone()], &image[places]);
        for c in 0..channels {
            to[c] += mean[c] + spread[c] * (image[c] - pooled[c]);
            if image[c] == pooled[channels + c] {
                to[c] += std::mem::take(&mut left[c]);
            }
        }
    }
}

impl Layers {
    pub(crate) fn new(shape: &EncoderShape) -> Self {
        Self { steps: shape.steps(), convolutions: shape.convolutions(), dense: Dense { layers: shape.dense_layers() } }
    }

    /// All layers: convolutions, then dense layers.
    pub(crate) fn all(&self) -> impl Iterator<Item = &NamedLayer> {
        self.convolutions.iter().chain(&self.dense.layers)
    }

    /// Runs the forward pass for images `[sample][side][side][channels]` and globals
    /// `[sample][globals]`.
    pub(crate) fn forward(&self, images: Vec<f32>, globals: &[f32], count: usize, weights: &[Vec<f32>]) -> Trace {
        let (mut images, mut pooled, mut before) = (vec![images], Vec::new(), Vec::new());
        for step in &self.steps {
            let convolve = |at: usize, input: &[f32], added: Option<&[f32]>| {
                affine(&self.convolutions[at].geometry, &weights[at], input, added)
            };
            let last = images.last().expect("the inputs are always stored");
            match *step {
                Step::Convolve(at) => {
                    let out = convolve(at, last, None);
                    images.push(activated(&out));
                    before.push(out);
                }
                Step::Block(at) => {
                    let first = convolve(at, last, None);
                    let inner = activated(&first);
                    let second = convolve(at + 1, &inner, Some(last));
                    images.extend([inner, activated(&second)]);
                    before.extend([first, second]);
                }
                Step::Pool => {
                    let g = &self.convolutions[images.len() - 2].geometry;
                    let (cells, each) = (inside_disk(g.side_after()), 3 * g.outputs);
                    let mut out = vec![0.0; count * each];
                    for (image, out) in last.chunks_exact(g.output_len()).zip(out.chunks_exact_mut(each)) {
                        pool(image, &cells, out);
                    }
                    pooled.push(out);
                }
            }
        }
        let mut first = Vec::new();
        for at in 0..count {
            for part in pooled.iter().map(Vec::as_slice).chain([globals]) {
                let each = part.len() / count;
                first.extend_from_slice(&part[at * each..][..each]);
            }
        }
        let dense = self.dense.forward(first, &weights[self.convolutions.len()..]);
        Trace { images, pooled, before, dense }
    }

    /// Returns the gradient with respect to the weights of each layer, given the gradient with
    /// respect to the outputs `[sample][outputs]`.
    pub(crate) fn backward(&self, trace: Trace, back: Vec<f32>, weights: &[Vec<f32>]) -> Vec<Vec<f32>> {
        let convolutions = self.convolutions.len();
        let mut gradients = vec![Vec::new(); convolutions];
        let count = trace.outputs().len() / self.dense.layers.last().map_or(1, |l| l.geometry.outputs);
        let Trace { images, mut pooled, mut before, dense } = trace;
        let (dense, vector) = self.dense.backward(dense, back, &weights[convolutions..]);
        let mut end: usize = pooled.iter().map(|p| p.len() / count).sum();
        let mut layer = convolutions;
        let mut now = vec![0.0; images[layer].len()];
        for step in self.steps.iter().rev() {
            match *step {
                Step::Pool => {
                    let last = pooled.pop().expect("one for each pooling step");
                    let g = &self.convolutions[layer - 1].geometry;
                    let (cells, each, size) = (inside_disk(g.side_after()), 3 * g.outputs, g.output_len());
                    end -= each;
                    for at in 0..count {
                        let image = &images[layer][at * size..][..size];
                        let back = &vector[at * (vector.len() / count) + end..][..each];
                        let pooled = &last[at * each..][..each];
                        pool_backward(image, &cells, pooled, back, &mut now[at * size..][..size]);
                    }
                }
                Step::Convolve(at) => {
                    let back = input_gradient(&mut before[at], &now);
                    let input = &images[at];
                    // The gradient with respect to the photograph is not needed.
                    now = vec![0.0; if at == 0 { 0 } else { input.len() }];
                    let to = (at > 0).then_some(now.as_mut_slice());
                    gradients[at] = affine_backward(&self.convolutions[at].geometry, &weights[at], input, &back, to);
                    layer = at;
                }
                Step::Block(at) => {
                    let mut outer = input_gradient(&mut before[at + 1], &now);
                    let (first, second) = (&self.convolutions[at].geometry, &self.convolutions[at + 1].geometry);
                    let mut inner = vec![0.0; images[at + 1].len()];
                    let input = &images[at + 1];
                    gradients[at + 1] = affine_backward(second, &weights[at + 1], input, &outer, Some(&mut inner));
                    let inner = input_gradient(&mut before[at], &inner);
                    // The skip connection takes the gradient of the sum; the gradient through the
                    // block is added to it.
                    gradients[at] = affine_backward(first, &weights[at], &images[at], &inner, Some(&mut outer));
                    (now, layer) = (outer, at);
                }
            }
        }
        gradients.extend(dense);
        gradients
    }
}

/// Returns the gradient with respect to the input of a [`silu`], given the gradient with respect to
/// its output. Consumes `before`, the stored input.
pub(crate) fn input_gradient(before: &mut Vec<f32>, back: &[f32]) -> Vec<f32> {
    let mut values = std::mem::take(before);
    silu_backward(&mut values, back);
    values
}
