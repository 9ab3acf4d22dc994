//! A small dense network, its gradient, and its optimiser.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// One affine layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    /// Number of inputs.
    pub inputs: usize,
    /// `[output][input]`.
    pub weights: Vec<f32>,
    /// One for each output.
    pub bias: Vec<f32>,
}

/// Affine layers with `x sigmoid(x)` between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// From the input on.
    pub layers: Vec<Dense>,
}

/// What a loss makes of a network's outputs for one sample: its value, and its gradient written over the outputs.
pub(super) type Loss<'a> = dyn Fn(usize, &mut [f32]) -> f64 + Sync + 'a;

/// Samples that are worked on as one matrix. Batches are sums over such chunks in order, whatever the number of threads.
const CHUNK: usize = 64;

impl Dense {
    fn outputs(&self) -> usize {
        self.bias.len()
    }

    fn matrix(&self) -> MatRef<'_, f32> {
        MatRef::from_row_major_slice(&self.weights, self.outputs(), self.inputs)
    }
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// What a pass forward leaves for the pass back: the input of each layer, and the slope of what made it.
struct Trace {
    inputs: Vec<Mat<f32>>,
    slopes: Vec<Mat<f32>>,
    output: Mat<f32>,
}

impl Network {
    /// Layers of these widths, the first that of the input, with random weights of variance one over the number of inputs.
    pub fn random(widths: &[usize], seed: u64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let layers = widths
            .windows(2)
            .map(|w| {
                let scale = (1.0 / w[0] as f64).sqrt();
                let mut draw = || (scale * Distribution::<f64>::sample(&StandardNormal, &mut rng)) as f32;
                Dense { inputs: w[0], weights: (0..w[0] * w[1]).map(|_| draw()).collect(), bias: vec![0.0; w[1]] }
            })
            .collect();
        Self { layers }
    }

    /// Outputs for one input.
    ///
    /// # Panics
    /// If the input has not the length of the first layer's.
    pub fn apply(&self, input: &[f32]) -> Vec<f32> {
        assert_eq!(input.len(), self.layers[0].inputs);
        let columns = MatRef::from_column_major_slice(input, input.len(), 1);
        let output = self.forward(columns.to_owned(), 0.0, 0).output;
        output.col(0).iter().copied().collect()
    }

    fn parameters(&self) -> usize {
        self.layers.iter().map(|l| l.weights.len() + l.bias.len()).sum()
    }

    /// `input` has a sample in each column. Of the hidden units a share `drop` is left out, chosen by `seed`, and the rest
    /// made larger to keep the mean.
    fn forward(&self, input: Mat<f32>, drop: f32, seed: u64) -> Trace {
        let mut rng = Pcg64::seed_from_u64(seed);
        let (mut inputs, mut slopes) = (vec![input], Vec::new());
        for (at, layer) in self.layers.iter().enumerate() {
            let columns = inputs[at].ncols();
            let mut out = Mat::<f32>::from_fn(layer.outputs(), columns, |i, _| layer.bias[i]);
            matmul(out.as_mut(), Accum::Add, layer.matrix(), inputs[at].as_ref(), 1.0, Par::Seq);
            if at + 1 == self.layers.len() {
                return Trace { inputs, slopes, output: out };
            }
            let mut slope = Mat::<f32>::zeros(layer.outputs(), columns);
            for j in 0..columns {
                for i in 0..layer.outputs() {
                    let keep = if drop > 0.0 && rng.random_range(0.0..1.0) < drop { 0.0 } else { 1.0 / (1.0 - drop) };
                    let (x, s) = (out[(i, j)], sigmoid(out[(i, j)]));
                    slope[(i, j)] = keep * s * (1.0 + x * (1.0 - s));
                    out[(i, j)] = keep * x * s;
                }
            }
            slopes.push(slope);
            inputs.push(out);
        }
        unreachable!("a network has layers")
    }

    /// Sum of a loss over samples, and its gradient in all parameters, layer by layer, weights before bias.
    pub(super) fn gradient(
        &self,
        samples: &[usize],
        input: &(dyn Fn(usize, &mut [f32]) + Sync),
        loss: &Loss<'_>,
        drop: f32,
        seed: u64,
    ) -> (f64, Vec<f32>) {
        let chunks: Vec<(f64, Vec<f32>)> = samples
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(at, chunk)| {
                let mut columns = Mat::<f32>::zeros(self.layers[0].inputs, chunk.len());
                for (j, &sample) in chunk.iter().enumerate() {
                    input(sample, column(columns.as_mut(), j));
                }
                // Neighbouring seeds of the generator give streams that have nothing in common.
                let trace = self.forward(columns, drop, seed.wrapping_mul(1 << 20).wrapping_add(at as u64));
                self.backward(trace, chunk, loss)
            })
            .collect();
        let mut sum = (0.0, vec![0.0; self.parameters()]);
        for (value, gradient) in chunks {
            sum.0 += value;
            sum.1.iter_mut().zip(gradient).for_each(|(s, g)| *s += g);
        }
        sum
    }

    fn backward(&self, trace: Trace, samples: &[usize], loss: &Loss<'_>) -> (f64, Vec<f32>) {
        let mut back = trace.output;
        let value = samples.iter().enumerate().map(|(j, &s)| loss(s, column(back.as_mut(), j))).sum();
        let mut parts: Vec<Vec<f32>> = Vec::new();
        for (at, layer) in self.layers.iter().enumerate().rev() {
            let mut gradient = vec![0.0; layer.weights.len() + layer.bias.len()];
            let (weights, bias) = gradient.split_at_mut(layer.weights.len());
            let product = MatMut::from_row_major_slice_mut(weights, layer.outputs(), layer.inputs);
            matmul(product, Accum::Replace, back.as_ref(), trace.inputs[at].transpose(), 1.0, Par::Seq);
            for (i, b) in bias.iter_mut().enumerate() {
                *b = back.row(i).iter().sum();
            }
            parts.push(gradient);
            if at > 0 {
                let mut next = Mat::<f32>::zeros(layer.inputs, back.ncols());
                matmul(next.as_mut(), Accum::Replace, layer.matrix().transpose(), back.as_ref(), 1.0, Par::Seq);
                let slope = &trace.slopes[at - 1];
                for j in 0..next.ncols() {
                    for i in 0..next.nrows() {
                        next[(i, j)] *= slope[(i, j)];
                    }
                }
                back = next;
            }
        }
        (value, parts.into_iter().rev().flatten().collect())
    }

    fn each_parameter(&mut self) -> impl Iterator<Item = (&mut f32, bool)> {
        self.layers
            .iter_mut()
            .flat_map(|l| l.weights.iter_mut().map(|w| (w, true)).chain(l.bias.iter_mut().map(|b| (b, false))))
    }
}

fn column(matrix: MatMut<'_, f32>, j: usize) -> &mut [f32] {
    let column = matrix.col_mut(j).try_as_col_major_mut().expect("a column of an owned matrix");
    column.as_slice_mut()
}

/// Adam (Kingma & Ba 2015) with the decay of weights apart from the gradient (Loshchilov & Hutter 2019).
pub(super) struct Adam {
    mean: Vec<f32>,
    square: Vec<f32>,
    steps: i32,
    decay: f32,
}

impl Adam {
    pub(super) fn new(network: &Network, decay: f32) -> Self {
        let n = network.parameters();
        Self { mean: vec![0.0; n], square: vec![0.0; n], steps: 0, decay }
    }

    /// One step down a gradient, which is scaled down if its norm is above `longest`.
    pub(super) fn step(&mut self, network: &mut Network, gradient: &[f32], rate: f32, longest: f64) {
        const MEAN: f32 = 0.9;
        const SQUARE: f32 = 0.999;
        self.steps += 1;
        let norm = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        let scale = if norm > longest { (longest / norm) as f32 } else { 1.0 };
        let (first, second) = (1.0 - MEAN.powi(self.steps), 1.0 - SQUARE.powi(self.steps));
        let moments = self.mean.iter_mut().zip(self.square.iter_mut());
        for (((parameter, decays), gradient), (mean, square)) in network.each_parameter().zip(gradient).zip(moments) {
            let g = scale * gradient;
            *mean = MEAN * *mean + (1.0 - MEAN) * g;
            *square = SQUARE * *square + (1.0 - SQUARE) * g * g;
            if decays {
                *parameter *= 1.0 - rate * self.decay;
            }
            *parameter -= rate * (*mean / first) / ((*square / second).sqrt() + 1e-8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half the squared distance to a target that depends on the sample.
    fn square(sample: usize, outputs: &mut [f32]) -> f64 {
        let mut sum = 0.0;
        for (i, out) in outputs.iter_mut().enumerate() {
            *out -= (sample as f32 * 0.71 + i as f32).sin();
            sum += 0.5 * f64::from(*out).powi(2);
        }
        sum
    }

    fn input(sample: usize, out: &mut [f32]) {
        out.iter_mut().enumerate().for_each(|(i, x)| *x = ((sample + 3 * i) as f32 * 0.71).cos());
    }

    #[test]
    fn the_gradient_is_that_of_the_loss() {
        let network = Network::random(&[5, 7, 6, 3], 4);
        let samples: Vec<usize> = (0..150).collect();
        for drop in [0.0, 0.3] {
            let (_, gradient) = network.gradient(&samples, &input, &square, drop, 9);
            let mut moved = network.clone();
            for at in (0..network.parameters()).step_by(5) {
                let mut value = |step: f32| {
                    *moved.each_parameter().nth(at).unwrap().0 += step;
                    let value = moved.gradient(&samples, &input, &square, drop, 9).0;
                    *moved.each_parameter().nth(at).unwrap().0 -= step;
                    value
                };
                let numeric = (value(1e-2) - value(-1e-2)) / 2e-2;
                let got = f64::from(gradient[at]);
                assert!((numeric - got).abs() < 0.01 * (1.0 + numeric.abs()), "{at}: {numeric} {got}");
            }
        }
    }

    #[test]
    fn steps_go_down_and_do_not_depend_on_threads() {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut network = Network::random(&[5, 16, 3], 4);
                let mut adam = Adam::new(&network, 1e-3);
                let samples: Vec<usize> = (0..300).collect();
                let first = network.gradient(&samples, &input, &square, 0.0, 0).0;
                for step in 0..200 {
                    let (_, gradient) = network.gradient(&samples, &input, &square, 0.1, step);
                    adam.step(&mut network, &gradient, 0.01, 1e9);
                }
                (first, network.gradient(&samples, &input, &square, 0.0, 0).0, network)
            })
        };
        let (first, last, network) = run(1);
        assert!(last < 0.3 * first, "{first} {last}");
        assert_eq!(run(3).2, network);
    }

    #[test]
    fn one_input_is_a_column_of_many() {
        let network = Network::random(&[5, 9, 2], 1);
        let mut x = vec![0.0; 5];
        input(3, &mut x);
        let by_hand: Vec<f32> = {
            let hidden: Vec<f32> = network.layers[0]
                .weights
                .chunks_exact(5)
                .map(|w| w.iter().zip(&x).map(|(w, x)| w * x).sum::<f32>())
                .map(|v| v * sigmoid(v))
                .collect();
            network.layers[1].weights.chunks_exact(9).map(|w| w.iter().zip(&hidden).map(|(w, h)| w * h).sum()).collect()
        };
        for (a, b) in network.apply(&x).iter().zip(&by_hand) {
            assert!((a - b).abs() < 1e-5);
        }
    }
}
