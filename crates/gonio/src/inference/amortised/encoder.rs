//! From an image of an object to the outputs of a network: convolutions, what they found inside the disk of normals, dense layers.

use serde::{Deserialize, Serialize};

use super::convolution::{Convolution, silu};

/// How an [`Encoder`] is built. The first convolution (4 x 4) and one at the start of each level (3 x 3) halve the side; two more (3 x 3) on each level
/// make a residual block (He et al. 2016). Between layers is [`silu`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EncoderShape {
    /// Cells along a side of the image, a multiple of two to the number of `widths`.
    pub side: usize,
    /// Channels of the image.
    pub channels: usize,
    /// Numbers that come with the image.
    pub globals: usize,
    /// Channels after the first convolution, then those of each level.
    pub widths: Vec<usize>,
    /// Units of the hidden dense layers; the last are the features.
    pub hidden: Vec<usize>,
    /// Numbers that come out.
    pub outputs: usize,
}

/// What is wrong with the description or the numbers of an encoder.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncoderError {
    /// The description is not one of a network, or of one too large.
    #[error("the encoder's {0} is out of range")]
    Shape(&'static str),
    /// A tensor is not there.
    #[error("the encoder has no tensor {0}")]
    Missing(String),
    /// A tensor has other dimensions than the description asks for.
    #[error("the tensor {name} is {found:?} where the encoder needs {needed:?}")]
    Dimensions {
        /// Name of the tensor.
        name: String,
        /// Its dimensions, or its length if that does not go with them.
        found: Vec<usize>,
        /// Those of the description.
        needed: Vec<usize>,
    },
    /// A tensor has an entry that is not finite.
    #[error("the tensor {0} has an entry that is not finite")]
    NotFinite(String),
}

/// What happens to the activations, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The convolution of this number, then [`silu`].
    Convolve(usize),
    /// The convolutions of this number and the next with [`silu`] between them; what went in is added; [`silu`].
    Block(usize),
    /// Mean and maximum of each channel [inside the disk](inside_disk) are noted.
    Pool,
}

/// A layer with its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedLayer {
    /// Beginning of the names of its tensors.
    pub name: String,
    /// Sizes.
    pub geometry: Convolution,
}

impl NamedLayer {
    /// Dimensions of the weights: `[row][column][input][output]`, or `[input][output]` of a dense layer.
    pub fn dimensions(&self) -> Vec<usize> {
        let g = &self.geometry;
        if g.side == 1 { vec![g.inputs, g.outputs] } else { vec![g.kernel, g.kernel, g.inputs, g.outputs] }
    }
}

impl EncoderShape {
    /// The usual widths, for images of 128 x 128 cells: 66 million products for five channels.
    pub fn new(channels: usize, globals: usize, outputs: usize) -> Self {
        Self { side: 128, channels, globals, widths: vec![16, 32, 64, 96], hidden: vec![256, 256], outputs }
    }

    /// Whether all is there and small enough for the sizes of a 32-bit machine.
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

    /// Convolutions in the order of [`Self::steps`].
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

    /// Dense layers, the outputs last.
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

    /// What is done to an image. Pooled are the first level before its block and each level after it.
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

    /// Numbers that pooling yields.
    pub fn pooled(&self) -> usize {
        2 * (self.widths[1] + self.widths[1..].iter().sum::<usize>())
    }

    /// Products of one pass.
    pub fn products(&self) -> usize {
        let layers = self.convolutions().into_iter().chain(self.dense_layers());
        layers.map(|l| l.geometry.output_len() * l.geometry.neighbourhood()).sum()
    }
}

/// Cells of a square of `side` x `side` over -1..1 whose centres are inside the unit disk, row by row.
pub fn inside_disk(side: usize) -> Vec<usize> {
    let centre = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
    (0..side * side).filter(|at| centre(at % side).hypot(centre(at / side)) <= 1.0).collect()
}

/// Means of all channels over some cells, then their maxima: of activations `[cell][channel]` to twice as many numbers as there are channels.
///
/// # Panics
/// If cells or channels are missing.
pub fn pool(activations: &[f32], cells: &[usize], out: &mut [f32]) {
    let channels = out.len() / 2;
    let (mean, max) = out.split_at_mut(channels);
    mean.fill(0.0);
    max.fill(f32::NEG_INFINITY);
    for cell in cells {
        let values = &activations[cell * channels..][..channels];
        mean.iter_mut().zip(values).for_each(|(m, v)| *m += v);
        max.iter_mut().zip(values).for_each(|(m, v)| *m = if *v > *m { *v } else { *m });
    }
    mean.iter_mut().for_each(|m| *m /= cells.len() as f32);
}

/// Weights and bias of a layer.
#[derive(Clone, Debug, PartialEq)]
struct Weights {
    layer: NamedLayer,
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Weights {
    /// Adds the layer's output for one image to `out`.
    fn add(&self, input: &[f32], out: &mut [f32]) {
        out.chunks_exact_mut(self.bias.len())
            .for_each(|cell| cell.iter_mut().zip(&self.bias).for_each(|(o, b)| *o += b));
        self.layer.geometry.forward(input, &self.weights, out);
    }

    fn apply(&self, input: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; self.layer.geometry.output_len()];
        self.add(input, &mut out);
        out
    }
}

/// A trained network from an image `[side][side][channels]` and a few numbers to outputs and features.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoder {
    shape: EncoderShape,
    convolutions: Vec<Weights>,
    dense: Vec<Weights>,
}

impl Encoder {
    /// From tensors: `find` gives dimensions and entries for a name. Needed are `NAME.weight` (of [`NamedLayer::dimensions`]) and `NAME.bias` of all layers.
    pub fn from_tensors(
        shape: EncoderShape,
        mut find: impl FnMut(&str) -> Option<(Vec<usize>, Vec<f32>)>,
    ) -> Result<Self, EncoderError> {
        shape.check()?;
        let mut tensor = |name: String, needed: Vec<usize>| {
            let Some((found, values)) = find(&name) else { return Err(EncoderError::Missing(name)) };
            if found != needed {
                return Err(EncoderError::Dimensions { name, found, needed });
            }
            if values.len() != needed.iter().product::<usize>() {
                return Err(EncoderError::Dimensions { name, found: vec![values.len()], needed });
            }
            if values.iter().any(|v| !v.is_finite()) {
                return Err(EncoderError::NotFinite(name));
            }
            Ok(values)
        };
        let mut load = |layer: NamedLayer| {
            let weights = tensor(format!("{}.weight", layer.name), layer.dimensions())?;
            let bias = tensor(format!("{}.bias", layer.name), vec![layer.geometry.outputs])?;
            Ok(Weights { layer, weights, bias })
        };
        let convolutions = shape.convolutions().into_iter().map(&mut load).collect::<Result<_, _>>()?;
        let dense = shape.dense_layers().into_iter().map(&mut load).collect::<Result<_, _>>()?;
        Ok(Self { shape, convolutions, dense })
    }

    /// Name, dimensions and entries of all tensors, as [`Self::from_tensors`] needs them.
    pub fn tensors(&self) -> Vec<(String, Vec<usize>, &[f32])> {
        let layers = self.convolutions.iter().chain(&self.dense);
        layers
            .flat_map(|w| {
                let name = &w.layer.name;
                [
                    (format!("{name}.weight"), w.layer.dimensions(), w.weights.as_slice()),
                    (format!("{name}.bias"), vec![w.bias.len()], w.bias.as_slice()),
                ]
            })
            .collect()
    }

    /// How it is built.
    pub fn shape(&self) -> &EncoderShape {
        &self.shape
    }

    /// Outputs and features for an image and its globals. One thread, and the same on each call.
    ///
    /// # Panics
    /// If the image or the globals have not the size of the [shape](Self::shape).
    pub fn apply(&self, image: &[f32], globals: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let shape = &self.shape;
        assert_eq!(image.len(), shape.side * shape.side * shape.channels);
        assert_eq!(globals.len(), shape.globals);
        let (mut now, mut side) = (image.to_vec(), shape.side);
        let mut vector = Vec::with_capacity(shape.pooled() + globals.len());
        for step in shape.steps() {
            match step {
                Step::Convolve(at) => {
                    now = self.convolutions[at].apply(&now);
                    side /= 2;
                    silu(&mut now);
                }
                Step::Block(at) => {
                    let mut inner = self.convolutions[at].apply(&now);
                    silu(&mut inner);
                    self.convolutions[at + 1].add(&inner, &mut now);
                    silu(&mut now);
                }
                Step::Pool => {
                    let mut pooled = vec![0.0; 2 * now.len() / (side * side)];
                    pool(&now, &inside_disk(side), &mut pooled);
                    vector.extend(pooled);
                }
            }
        }
        vector.extend_from_slice(globals);
        let (last, hidden) = self.dense.split_last().expect("checked: there are layers");
        for layer in hidden {
            vector = layer.apply(&vector);
            silu(&mut vector);
        }
        (last.apply(&vector), vector)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> EncoderShape {
        EncoderShape { side: 16, channels: 2, globals: 3, widths: vec![3, 4, 5], hidden: vec![6, 7], outputs: 2 }
    }

    fn any(shape: EncoderShape) -> Encoder {
        let layers: Vec<NamedLayer> = shape.convolutions().into_iter().chain(shape.dense_layers()).collect();
        Encoder::from_tensors(shape, |name| {
            let (layer, part) = name.rsplit_once('.')?;
            let layer = layers.iter().find(|l| l.name == layer)?;
            let dimensions = if part == "bias" { vec![layer.geometry.outputs] } else { layer.dimensions() };
            let count: usize = dimensions.iter().product();
            let scale = 1.5 / (layer.geometry.neighbourhood() as f32).sqrt();
            Some((dimensions, (0..count).map(|i| scale * (i as f32 * 1.7 + name.len() as f32).sin()).collect()))
        })
        .unwrap()
    }

    #[test]
    fn the_usual_shape_is_that_of_the_design() {
        let shape = EncoderShape::new(5, 3, 180);
        assert_eq!(shape.check(), Ok(()));
        assert_eq!(shape.pooled(), 448);
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
        assert!((65_000_000..70_000_000).contains(&shape.products()), "{}", shape.products());
    }

    #[test]
    fn tensors_make_the_same_encoder() {
        let encoder = any(small());
        let tensors = encoder.tensors();
        let find = |name: &str| {
            tensors.iter().find(|t| t.0 == name).map(|(_, dimensions, v)| (dimensions.clone(), v.to_vec()))
        };
        assert_eq!(Encoder::from_tensors(small(), find).as_ref(), Ok(&encoder));
        let image: Vec<f32> = (0..512).map(|i| (i as f32 * 0.3).cos()).collect();
        let (outputs, features) = encoder.apply(&image, &[0.1, 0.2, 0.3]);
        assert_eq!((outputs.len(), features.len()), (2, 7));
        assert!(outputs.iter().chain(&features).all(|v| v.is_finite() && *v != 0.0));
        assert_ne!(encoder.apply(&image, &[0.1, 0.5, 0.3]).0, outputs);
    }

    #[test]
    fn wrong_tensors_and_shapes_are_told() {
        let encoder = any(small());
        let tensors = encoder.tensors();
        let load = |shape, change: &dyn Fn(&str, &mut Vec<usize>, &mut Vec<f32>) -> bool| {
            Encoder::from_tensors(shape, |name| {
                let (_, dimensions, values) = tensors.iter().find(|t| t.0 == name)?;
                let (mut dimensions, mut values) = (dimensions.clone(), values.to_vec());
                change(name, &mut dimensions, &mut values).then_some((dimensions, values))
            })
            .unwrap_err()
        };
        assert_eq!(load(small(), &|n, _, _| n != "stem.bias"), EncoderError::Missing("stem.bias".into()));
        let short = load(small(), &|_, _, v| v.pop().is_some());
        assert!(matches!(short, EncoderError::Dimensions { .. }), "{short}");
        let flat = load(small(), &|_, d, _| d.pop().is_some());
        assert!(matches!(flat, EncoderError::Dimensions { .. }), "{flat}");
        let nan = load(small(), &|n, _, v| n != "level1.first.weight" || std::mem::replace(&mut v[3], f32::NAN) != 0.0);
        assert_eq!(nan, EncoderError::NotFinite("level1.first.weight".into()));
        for shape in [
            EncoderShape { side: 20, ..small() },
            EncoderShape { side: 1 << 40, ..small() },
            EncoderShape { widths: vec![], ..small() },
            EncoderShape { widths: vec![4, usize::MAX], ..small() },
            EncoderShape { hidden: vec![], ..small() },
            EncoderShape { outputs: 0, ..small() },
        ] {
            assert!(matches!(load(shape, &|_, _, _| true), EncoderError::Shape(_)));
        }
    }

    #[test]
    fn only_the_disk_is_pooled() {
        assert_eq!(inside_disk(2).len(), 4);
        assert_eq!(inside_disk(4).len(), 12);
        let share = inside_disk(128).len() as f64 / 128.0 / 128.0;
        assert!((share - std::f64::consts::FRAC_PI_4).abs() < 0.002, "{share}");
        let mut activations: Vec<f32> = (0..32).map(|i| i as f32).collect();
        (activations[0], activations[31]) = (1e9, 1e9);
        let mut out = [0.0; 4];
        pool(&activations, &inside_disk(4), &mut out);
        assert_eq!(out, [15.0, 16.0, 28.0, 29.0]);
    }

    /// Printed, not asserted: machines differ.
    #[test]
    #[ignore = "a measurement"]
    fn one_image_is_quick() {
        let encoder = any(EncoderShape::new(5, 8, 180));
        let image = vec![0.5; 128 * 128 * 5];
        let (runs, start) = (20, std::time::Instant::now());
        for _ in 0..runs {
            std::hint::black_box(encoder.apply(&image, &[0.0; 8]));
        }
        println!("{:.2} ms an image", 1e3 * start.elapsed().as_secs_f64() / f64::from(runs));
    }
}
