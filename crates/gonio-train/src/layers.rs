//! Operations of the encoder for candle's differentiation.

use std::sync::Mutex;

use candle_core::{CpuStorage, CustomOp1, CustomOp2, CustomOp3, Device, Layout, Result, Shape, Storage, Tensor, bail};
use gonio::inference::amortised::{Convolution, inside_disk, pool, silu, silu_backward};

/// A convolution with bias and, unless it is the last layer, [`silu`]. Arguments: activations `[image][side][side][inputs]`; weights
/// `[neighbourhood][outputs]` with the bias as one more row; for the end of a residual block what is added before [`silu`].
pub(crate) struct Layer {
    geometry: Convolution,
    activate: bool,
    /// Whether what goes in has no gradient to pass on.
    first: bool,
    /// Values before [`silu`], from the pass forward to the pass back.
    kept: Mutex<Vec<f32>>,
}

impl Layer {
    pub(crate) fn new(geometry: Convolution, activate: bool, first: bool) -> Self {
        Self { geometry, activate, first, kept: Mutex::default() }
    }

    /// With the result for activations, weights and what is added.
    fn forward(&self, images: &[f32], weights: &[f32], added: Option<&[f32]>) -> Result<(CpuStorage, Shape)> {
        let g = &self.geometry;
        let (weights, bias) = weights.split_at(g.neighbourhood() * g.outputs);
        let count = images.len() / g.input_len();
        let mut out = bias.repeat(count * g.output_len() / g.outputs);
        if let Some(added) = added {
            out.iter_mut().zip(added).for_each(|(o, a)| *o += a);
        }
        g.forward(images, weights, &mut out);
        if self.activate {
            let before = out.clone();
            silu(&mut out);
            *self.kept.lock().expect("no thread panics while it holds this") = before;
        }
        let side = g.side_after();
        Ok((CpuStorage::F32(out), (count, side, side, g.outputs).into()))
    }

    /// Gradients in the activations, unless this is the first layer, in the weights, and in what was added.
    fn backward(&self, images: &Tensor, weights: &Tensor, back: &Tensor) -> Result<(Option<Tensor>, Tensor, Tensor)> {
        let g = &self.geometry;
        let back = if self.activate {
            let mut kept = std::mem::take(&mut *self.kept.lock().expect("as above"));
            with_slice(&back.contiguous()?, |b| {
                if kept.len() != b.len() {
                    bail!("a layer is passed back through once");
                }
                silu_backward(&mut kept, b);
                Ok(())
            })?;
            Tensor::from_vec(kept, back.shape(), &Device::Cpu)?
        } else {
            back.contiguous()?
        };
        let mut to_images = if self.first { None } else { Some(vec![0.0; images.elem_count()]) };
        let mut to_weights = vec![0.0; weights.elem_count()];
        let (to_products, to_bias) = to_weights.split_at_mut(g.neighbourhood() * g.outputs);
        with_slice(&back, |b| {
            for cell in b.chunks_exact(g.outputs) {
                to_bias.iter_mut().zip(cell).for_each(|(t, c)| *t += c);
            }
            with_slice(images, |images| {
                with_slice(weights, |weights| {
                    let weights = &weights[..to_products.len()];
                    g.backward(images, weights, b, to_products, to_images.as_deref_mut());
                    Ok(())
                })
            })
        })?;
        let to_images = to_images.map(|v| Tensor::from_vec(v, images.shape(), &Device::Cpu)).transpose()?;
        Ok((to_images, Tensor::from_vec(to_weights, weights.shape(), &Device::Cpu)?, back))
    }
}

/// The entries of a tensor whose entries are in order.
pub(crate) fn with_slice<R>(tensor: &Tensor, f: impl FnOnce(&[f32]) -> Result<R>) -> Result<R> {
    let (storage, layout) = tensor.storage_and_layout();
    match &*storage {
        Storage::Cpu(storage) => f(slice(storage, layout)?),
        _ => bail!("not on the CPU"),
    }
}

fn slice<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    match layout.contiguous_offsets() {
        Some((from, to)) => Ok(&storage.as_slice::<f32>()?[from..to]),
        None => bail!("entries are not in order"),
    }
}

impl CustomOp2 for Layer {
    fn name(&self) -> &'static str {
        "layer"
    }

    fn cpu_fwd(&self, s1: &CpuStorage, l1: &Layout, s2: &CpuStorage, l2: &Layout) -> Result<(CpuStorage, Shape)> {
        self.forward(slice(s1, l1)?, slice(s2, l2)?, None)
    }

    fn bwd(
        &self,
        images: &Tensor,
        weights: &Tensor,
        _: &Tensor,
        back: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (to_images, to_weights, _) = self.backward(images, weights, back)?;
        Ok((to_images, Some(to_weights)))
    }
}

impl CustomOp3 for Layer {
    fn name(&self) -> &'static str {
        "layer with what is added"
    }

    fn cpu_fwd(
        &self,
        s1: &CpuStorage,
        l1: &Layout,
        s2: &CpuStorage,
        l2: &Layout,
        s3: &CpuStorage,
        l3: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        self.forward(slice(s1, l1)?, slice(s2, l2)?, Some(slice(s3, l3)?))
    }

    fn bwd(
        &self,
        images: &Tensor,
        weights: &Tensor,
        _: &Tensor,
        _: &Tensor,
        back: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let (to_images, to_weights, to_added) = self.backward(images, weights, back)?;
        Ok((to_images, Some(to_weights), Some(to_added)))
    }
}

/// Means and maxima over the disk ([`pool`]): of `[image][side][side][channels]` to `[image][2 channels]`.
pub(crate) struct Pool;

impl CustomOp1 for Pool {
    fn name(&self) -> &'static str {
        "pool"
    }

    fn cpu_fwd(&self, storage: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (count, side, _, channels) = layout.shape().dims4()?;
        let (values, cells) = (slice(storage, layout)?, inside_disk(side));
        let mut out = vec![0.0; count * 2 * channels];
        for (image, out) in values.chunks_exact(side * side * channels).zip(out.chunks_exact_mut(2 * channels)) {
            pool(image, &cells, out);
        }
        Ok((CpuStorage::F32(out), (count, 2 * channels).into()))
    }

    fn bwd(&self, images: &Tensor, pooled: &Tensor, back: &Tensor) -> Result<Option<Tensor>> {
        let (_, side, _, channels) = images.dims4()?;
        let (cells, size) = (inside_disk(side), side * side * channels);
        let mut to = vec![0.0; images.elem_count()];
        let back = back.contiguous()?;
        with_slice(images, |images| {
            with_slice(pooled, |pooled| {
                with_slice(&back, |back| {
                    for (at, (image, to)) in images.chunks_exact(size).zip(to.chunks_exact_mut(size)).enumerate() {
                        let (mean, max) = back[2 * at * channels..][..2 * channels].split_at(channels);
                        let largest = &pooled[(2 * at + 1) * channels..][..channels];
                        let mean: Vec<f32> = mean.iter().map(|m| m / cells.len() as f32).collect();
                        // Of equal maxima the first moves.
                        let mut left = max.to_vec();
                        for cell in &cells {
                            let places = cell * channels..(cell + 1) * channels;
                            let (to, image) = (&mut to[places.clone()], &image[places]);
                            for c in 0..channels {
                                to[c] = mean[c];
                                if image[c] == largest[c] {
                                    to[c] += std::mem::take(&mut left[c]);
                                }
                            }
                        }
                    }
                    Ok(())
                })
            })
        })?;
        Ok(Some(Tensor::from_vec(to, images.shape(), &Device::Cpu)?))
    }
}
