//! Forward and backward passes of dense layers.

use gonio::inference::learnt::NamedLayer;

use crate::pass::{activated, affine, affine_backward, input_gradient};

/// Layers one after the other, with [`silu`](gonio::inference::learnt::silu) between them.
/// Weights of a layer are `[inputs + 1][outputs]`, the bias last.
pub(crate) struct Dense {
    pub(crate) layers: Vec<NamedLayer>,
}

/// Values that the forward pass keeps for the backward pass, samples along the first axis.
pub(crate) struct DenseTrace {
    /// Inputs of each layer, and outputs of the last.
    vectors: Vec<Vec<f32>>,
    /// Outputs of each layer but the last, before activation.
    before: Vec<Vec<f32>>,
}

impl DenseTrace {
    pub(crate) fn outputs(&self) -> &[f32] {
        self.vectors.last().expect("the inputs are always stored")
    }
}

impl Dense {
    /// Runs the forward pass for inputs `[sample][inputs]`.
    pub(crate) fn forward(&self, inputs: Vec<f32>, weights: &[Vec<f32>]) -> DenseTrace {
        let mut trace = DenseTrace { vectors: vec![inputs], before: Vec::new() };
        for (at, layer) in self.layers.iter().enumerate() {
            let out = affine(&layer.geometry, &weights[at], trace.outputs(), None);
            if at + 1 == self.layers.len() {
                trace.vectors.push(out);
            } else {
                trace.vectors.push(activated(&out));
                trace.before.push(out);
            }
        }
        trace
    }

    /// Returns the gradients with respect to the weights of each layer and to the inputs, given the
    /// gradient `back` with respect to the outputs.
    pub(crate) fn backward(
        &self,
        mut trace: DenseTrace,
        back: Vec<f32>,
        weights: &[Vec<f32>],
    ) -> (Vec<Vec<f32>>, Vec<f32>) {
        let mut gradients = vec![Vec::new(); self.layers.len()];
        let mut now = back;
        for (at, layer) in self.layers.iter().enumerate().rev() {
            if at + 1 < self.layers.len() {
                now = input_gradient(&mut trace.before[at], &now);
            }
            let input = &trace.vectors[at];
            let mut to = vec![0.0; input.len()];
            gradients[at] = affine_backward(&layer.geometry, &weights[at], input, &now, Some(&mut to));
            now = to;
        }
        (gradients, now)
    }
}
