//! Shape of an encoder: its layers, their sizes, names and order.

use serde::{Deserialize, Serialize};

use super::convolution::Convolution;

/// Shape of an [`Encoder`](super::Encoder). The first convolution (4 x 4) and one at the start of
/// each level (3 x 3) halve the side; two more (3 x 3) on each level make a residual block (He et
/// al. 2016). [`silu`](super::silu) is applied between layers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EncoderShape {
    /// Cells along a side of the image, a multiple of two to the power of the number of `widths`.
    pub side: usize,
    /// Channels of the image.
    pub channels: usize,
    /// Number of globals, the numbers that accompany the image.
    pub globals: usize,
    /// Channels after the first convolution, then those of each level.
    pub widths: Vec<usize>,
    /// Units of the hidden dense layers; the last are the features.
    pub hidden: Vec<usize>,
    /// Number of outputs.
    pub outputs: usize,
}

/// Error in the description or the tensors of an encoder.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncoderError {
    /// The description is invalid, or describes a network that is too large.
    #[error("the encoder's {0} is out of range")]
    Shape(&'static str),
    /// A tensor is missing.
    #[error("the encoder has no tensor {0}")]
    Missing(String),
    /// A tensor has other dimensions than the description requires.
    #[error("tensor {name} has the shape {found:?}, but the encoder requires {needed:?}")]
    Dimensions {
        /// Name of the tensor.
        name: String,
        /// Its dimensions, or its length if that does not match them.
        found: Vec<usize>,
        /// Dimensions that the description requires.
        needed: Vec<usize>,
    },
    /// A tensor has an entry that is not finite.
    #[error("tensor {0} has an entry that is not finite")]
    NotFinite(String),
}

/// Operation on the activations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Convolution of this index, then [`silu`](super::silu).
    Convolve(usize),
    /// Residual block: convolutions of this index and the next with [`silu`](super::silu) between
    /// them, the input added, then [`silu`](super::silu).
    Block(usize),
    /// Mean, maximum and variance of each channel [inside the disk](super::inside_disk).
    Pool,
}

/// A layer with its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedLayer {
    /// Prefix of the names of its tensors.
    pub name: String,
    /// Sizes of the layer.
    pub geometry: Convolution,
}

impl NamedLayer {
    /// Dimensions of the weights: `[row][column][input][output]`, or `[input][output]` of a dense
    /// layer.
    pub fn dimensions(&self) -> Vec<usize> {
        let g = &self.geometry;
        if g.side == 1 { vec![g.inputs, g.outputs] } else { vec![g.kernel, g.kernel, g.inputs, g.outputs] }
    }
}

impl EncoderShape {
    /// Returns the default shape for images of 128 x 128 cells: 66 million products for five
    /// channels.
    pub fn new(channels: usize, globals: usize, outputs: usize) -> Self {
        Self { side: 128, channels, globals, widths: vec![16, 32, 64, 96], hidden: vec![256, 256], outputs }
    }

    /// Checks that no part is missing and that all sizes are small enough for a 32-bit machine.
    pub fn check(&self) -> Result<(), EncoderError> {
        let one = |ok: bool, name| if ok { Ok(()) } else { Err(EncoderError::Shape(name)) };
        one((2..=8).contains(&self.widths.len()), "number of widths")?;
        let coarsest = 1 << self.widths.len();
        one(self.side <= 1024 && self.side >= 2 * coarsest && self.side.is_multiple_of(coarsest), "side")?;
        one((1..=256).contains(&self.channels), "number of channels")?;
        one(self.globals <= 4096, "number of globals")?;
        one(self.widths.iter().all(|w| (1..=1024).contains(w)), "widths")?;
        one((1..=8).contains(&self.hidden.len()), "number of hidden layers")?;
        one(self.hidden.iter().all(|w| (1..=4096).contains(w)), "hidden layers")?;
        one((1..=4096).contains(&self.outputs), "number of outputs")
    }

    /// Returns the convolutions in the order of [`Self::steps`].
    pub fn convolutions(&self) -> Vec<NamedLayer> {
        let mut layers = Vec::new();
        let (mut side, mut inputs) = (self.side, self.channels);
        for (level, &outputs) in self.widths.iter().enumerate() {
            let kernel = if level == 0 { 4 } else { 3 };
            let name = if level == 0 { "stem".into() } else { format!("level{level}.down") };
            layers.push(NamedLayer { name, geometry: Convolution { side, inputs, outputs, kernel, stride: 2 } });
            (side, inputs) = (side / 2, outputs);
            for part in ["first", "second"].iter().filter(|_| level > 0) {
                let geometry = Convolution { side, inputs, outputs, kernel, stride: 1 };
                layers.push(NamedLayer { name: format!("level{level}.{part}"), geometry });
            }
        }
        layers
    }

    /// Returns the dense layers, with the outputs last.
    pub fn dense_layers(&self) -> Vec<NamedLayer> {
        let mut inputs = self.pooled() + self.globals;
        let mut layers = Vec::new();
        for (at, &outputs) in self.hidden.iter().chain([&self.outputs]).enumerate() {
            let name = if at == self.hidden.len() { "outputs".into() } else { format!("hidden{}", at + 1) };
            layers.push(NamedLayer { name, geometry: Convolution::dense(inputs, outputs) });
            inputs = outputs;
        }
        layers
    }

    /// Returns the operations on an image, in order.
    ///
    /// The first level is pooled before and after its block, the other levels only after it.
    pub fn steps(&self) -> Vec<Step> {
        let mut steps = vec![Step::Convolve(0)];
        for level in 1..self.widths.len() {
            steps.push(Step::Convolve(3 * level - 2));
            if level == 1 {
                steps.push(Step::Pool);
            }
            steps.extend([Step::Block(3 * level - 1), Step::Pool]);
        }
        steps
    }

    /// Returns the number of values that pooling yields.
    pub fn pooled(&self) -> usize {
        3 * (self.widths[1] + self.widths[1..].iter().sum::<usize>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_shape_has_the_designed_layers() {
        let shape = EncoderShape::new(5, 3, 180);
        assert_eq!(shape.check(), Ok(()));
        assert_eq!(shape.pooled(), 672);
        let layers = shape.convolutions();
        let of = |l: &NamedLayer| (l.geometry.side_after(), l.geometry.inputs, l.geometry.outputs);
        let want = [
            (64, 5, 16),
            (32, 16, 32),
            (32, 32, 32),
            (32, 32, 32),
            (16, 32, 64),
            (16, 64, 64),
            (16, 64, 64),
            (8, 64, 96),
            (8, 96, 96),
            (8, 96, 96),
        ];
        assert_eq!(layers.iter().map(of).collect::<Vec<_>>(), want);
        let all = shape.convolutions().into_iter().chain(shape.dense_layers());
        let products: usize = all.map(|l| l.geometry.output_len() * l.geometry.neighbourhood()).sum();
        assert!((65_000_000..70_000_000).contains(&products), "{products}");
    }
}
