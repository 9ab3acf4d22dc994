//! The encoder as a graph of tensors.

use candle_core::{Result, Tensor};
use gonio::inference::amortised::{EncoderShape, NamedLayer, Step};

use crate::layers::{Layer, Pool};

/// The layers of an encoder, without their numbers.
pub(crate) struct Graph {
    steps: Vec<Step>,
    convolutions: Vec<NamedLayer>,
    dense: Vec<NamedLayer>,
}

impl Graph {
    pub(crate) fn new(shape: &EncoderShape) -> Self {
        Self { steps: shape.steps(), convolutions: shape.convolutions(), dense: shape.dense_layers() }
    }

    /// All layers in the order of their numbers.
    pub(crate) fn layers(&self) -> impl Iterator<Item = &NamedLayer> {
        self.convolutions.iter().chain(&self.dense)
    }

    /// Outputs `[image][outputs]` for images `[image][side][side][channels]` and globals `[image][globals]`. `weights` are those of [`Self::layers`], each
    /// `[neighbourhood + 1][outputs]` with the bias last. `masks` multiply the units of the hidden layers, `[image][units]`; none for a pass without dropping.
    pub(crate) fn forward(
        &self,
        images: Tensor,
        globals: &Tensor,
        weights: &[Tensor],
        masks: &[Tensor],
    ) -> Result<Tensor> {
        let (count, convolutions) = (images.dim(0)?, self.convolutions.len());
        let convolution = |at: usize| Layer::new(self.convolutions[at].geometry, true, at == 0);
        let (mut now, mut pooled) = (images, Vec::new());
        for step in &self.steps {
            match *step {
                Step::Convolve(at) => now = now.apply_op2(&weights[at], convolution(at))?,
                Step::Block(at) => {
                    let inner = now.apply_op2(&weights[at], convolution(at))?;
                    now = inner.apply_op3(&weights[at + 1], &now, convolution(at + 1))?;
                }
                Step::Pool => pooled.push(now.apply_op1(Pool)?),
            }
        }
        pooled.push(globals.clone());
        let mut now = Tensor::cat(&pooled, 1)?;
        for (at, layer) in self.dense.iter().enumerate() {
            let hidden = at + 1 < self.dense.len();
            let apart = now.reshape((count, 1, 1, layer.geometry.inputs))?;
            let op = Layer::new(layer.geometry, hidden, false);
            now = apart.apply_op2(&weights[convolutions + at], op)?.reshape((count, layer.geometry.outputs))?;
            if let Some(mask) = masks.get(at).filter(|_| hidden) {
                now = (now * mask)?;
            }
        }
        Ok(now)
    }
}
