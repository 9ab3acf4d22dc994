//! Network that maps an image of an object to outputs: convolutions, pooling over the disk of
//! normals, dense layers.

use super::convolution::silu;
use super::encoder_shape::{EncoderError, EncoderShape, NamedLayer, Step};

/// Returns the cells, row by row, whose centres are inside the unit disk.
///
/// The cells are those of a square of `side` x `side` cells over -1..1.
pub fn inside_disk(side: usize) -> Vec<usize> {
    let centre = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
    (0..side * side).filter(|at| centre(at % side).hypot(centre(at / side)) <= 1.0).collect()
}

/// Constant added to the variance of a channel before its logarithm is taken, which keeps a
/// constant channel finite.
pub(super) const MIN_VARIANCE: f32 = 1e-3;

/// Pools activations `[cell][channel]` over some cells.
///
/// Writes the means of all channels, then their maxima, then half the logarithms of their variances
/// plus 0.001: three numbers per channel.
///
/// # Panics
/// If cells or channels are missing.
pub fn pool(activations: &[f32], cells: &[usize], out: &mut [f32]) {
    let channels = out.len() / 3;
    let (mean, rest) = out.split_at_mut(channels);
    let (max, spread) = rest.split_at_mut(channels);
    mean.fill(0.0);
    max.fill(f32::NEG_INFINITY);
    spread.fill(0.0);
    let of = |cell: &usize| &activations[cell * channels..][..channels];
    for values in cells.iter().map(of) {
        mean.iter_mut().zip(values).for_each(|(m, v)| *m += v);
        max.iter_mut().zip(values).for_each(|(m, v)| *m = if *v > *m { *v } else { *m });
    }
    let share = 1.0 / cells.len() as f32;
    mean.iter_mut().for_each(|m| *m *= share);
    for values in cells.iter().map(of) {
        spread.iter_mut().zip(values).zip(&*mean).for_each(|((s, v), m)| *s += (v - m) * (v - m));
    }
    spread.iter_mut().for_each(|s| *s = 0.5 * (*s * share + MIN_VARIANCE).ln());
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

/// Trained network that maps an image `[side][side][channels]` and a few numbers to outputs and
/// features.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoder {
    shape: EncoderShape,
    convolutions: Vec<Weights>,
    dense: Vec<Weights>,
}

impl Encoder {
    /// Builds the encoder from tensors.
    ///
    /// `find` returns the dimensions and entries of a named tensor. All layers require
    /// `NAME.weight` (of [`NamedLayer::dimensions`]) and `NAME.bias`.
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

    /// Returns name, dimensions and entries of all tensors for [`Self::from_tensors`].
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

    /// Returns the shape of the network.
    pub fn shape(&self) -> &EncoderShape {
        &self.shape
    }

    /// Computes outputs and features for an image and its globals, on one thread and
    /// deterministically.
    ///
    /// # Panics
    /// If the image or the globals do not have the size of the [shape](Self::shape).
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
                    let mut pooled = vec![0.0; 3 * now.len() / (side * side)];
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
    fn tensors_rebuild_the_same_encoder() {
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

    /// Changes a named tensor; returns false to remove it.
    type Change = dyn Fn(&str, &mut Vec<usize>, &mut Vec<f32>) -> bool;

    #[test]
    fn wrong_tensors_and_shapes_are_rejected() {
        let encoder = any(small());
        let tensors = encoder.tensors();
        let load = |shape, change: &Change| {
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
        let mut out = [0.0; 6];
        pool(&activations, &inside_disk(4), &mut out);
        assert_eq!(out[..4], [15.0, 16.0, 28.0, 29.0]);
        // Cells 1, 2, 4 to 11, 13 and 14 have a mean index of 7.5; each has two channels.
        let square = [6.5_f32, 5.5, 3.5, 2.5, 1.5, 0.5].map(|d| 2.0 * (2.0 * d).powi(2)).iter().sum::<f32>() / 12.0;
        for got in &out[4..] {
            assert!((got - 0.5 * (square + MIN_VARIANCE).ln()).abs() < 1e-5, "{got} {square}");
        }
    }
}
