//! Minus the log density of a mixture, in tensors. The same as
//! [`MixtureDensity::log_density`](gonio::inference::amortised::MixtureDensity::log_density).

use candle_core::{D, Device, Result, Tensor, Var};
use gonio::inference::amortised::LARGEST_LOG;

/// What is the same for all batches of a mixture.
pub(crate) struct MixtureLoss {
    dimensions: usize,
    components: usize,
    /// For each entry of the whole square of a factor its place among the outputs of a component, or that of a zero after them.
    square: Tensor,
    /// Places of the diagonal among the outputs of a component.
    diagonal: Tensor,
    /// One on the diagonal of a square.
    identity: Tensor,
}

impl MixtureLoss {
    pub(crate) fn new(dimensions: usize, components: usize) -> Result<Self> {
        let d = dimensions;
        let triangle = |i: usize, j: usize| (d + i * (i + 1) / 2 + j) as u32;
        let zero = triangle(d, 0);
        let square: Vec<u32> =
            (0..d * d).map(|at| (at / d, at % d)).map(|(i, j)| if j < i { triangle(i, j) } else { zero }).collect();
        let diagonal: Vec<u32> = (0..d).map(|i| triangle(i, i)).collect();
        Ok(Self {
            dimensions,
            components,
            square: Tensor::from_vec(square, d * d, &Device::Cpu)?,
            diagonal: Tensor::from_vec(diagonal, d, &Device::Cpu)?,
            identity: Tensor::eye(d, candle_core::DType::F32, &Device::Cpu)?,
        })
    }

    /// The sum over samples, and its gradient in the outputs; both as for [`Self::sum`].
    pub(crate) fn gradient(&self, outputs: &[f32], targets: Vec<f32>, count: usize) -> Result<(f64, Vec<f32>)> {
        let outputs = Var::from_slice(outputs, (count, outputs.len() / count), &Device::Cpu)?;
        let targets = Tensor::from_vec(targets, (count, self.dimensions), &Device::Cpu)?;
        let sum = self.sum(&outputs, &targets)?;
        let gradients = sum.backward()?;
        let gradient = match gradients.get(&outputs) {
            Some(g) => g.flatten_all()?.to_vec1()?,
            None => vec![0.0; outputs.elem_count()],
        };
        Ok((f64::from(sum.to_scalar::<f32>()?), gradient))
    }

    /// Sum over samples, for outputs `[sample][outputs]` and targets `[sample][dimensions]`.
    pub(crate) fn sum(&self, outputs: &Tensor, targets: &Tensor) -> Result<Tensor> {
        let (d, k, count) = (self.dimensions, self.components, outputs.dim(0)?);
        let logits = outputs.narrow(1, 0, k)?.contiguous()?;
        let rest = outputs.narrow(1, k, outputs.dim(1)? - k)?.reshape((count * k, ()))?;
        let mean = rest.narrow(1, 0, d)?.reshape((count, k, d))?;
        let gap = targets.unsqueeze(1)?.broadcast_sub(&mean)?.reshape((count * k, 1, d))?;
        let bound = f64::from(LARGEST_LOG);
        let log_diagonal = rest.index_select(&self.diagonal, 1)?.clamp(-bound, bound)?;
        let padded = rest.pad_with_zeros(1, 0, 1)?;
        let below = padded.index_select(&self.square, 1)?.reshape((count * k, d, d))?;
        let factor = (below + log_diagonal.exp()?.unsqueeze(2)?.broadcast_mul(&self.identity)?)?;
        let whitened = factor.broadcast_mul(&gap)?.sum(D::Minus1)?;
        let constant = 0.5 * d as f64 * std::f64::consts::TAU.ln();
        let log_density =
            ((log_diagonal.sum(1)? - (whitened.sqr()?.sum(1)? * 0.5)?)? - constant)?.reshape((count, k))?;
        let joint = log_sum_exp(&(&logits + &log_density)?)?;
        (log_sum_exp(&logits)? - joint)?.sum_all()
    }
}

/// Over the second dimension; the largest is taken off first, and has no gradient.
fn log_sum_exp(values: &Tensor) -> Result<Tensor> {
    let largest = values.max_keepdim(1)?.detach();
    values.broadcast_sub(&largest)?.exp()?.sum_keepdim(1)?.log()? + largest
}
