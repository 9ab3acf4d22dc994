//! Learnt posterior of the material, marginalised over captured lights (eq. 3).
//!
//! The captured lights are samples of `p(L)`, and measured materials and those interpolated between
//! them are samples of `p(F)`. Photographs simulated from both ([`simulation`](crate::simulation))
//! are therefore samples of `p(F, I)`, and the ratio `p(I | F) / p(I)` learnt from them is marginal
//! over light by construction. It accounts for lamps, horizons and edges, which no prior of
//! independent wavelet coefficients can express, and for noise, texture and wrong normals, which no
//! equation of the image contains.
//!
//! The image is mapped to the [disk of normals](crate::appearance::disk), with a confidence for
//! each normal. A small convolutional [`Encoder`] maps the disk to an embedding. The dot product of
//! this embedding with that of a material is the logarithm of the likelihood of the image, up to a
//! constant. [`Candidates`] drawn from the prior and weighted by this likelihood represent the
//! posterior. Training makes the embeddings distinguish the material of a photograph from other
//! materials (contrastive ratio estimation: Durkan, Murray & Papamakarios 2020).

mod candidates;
mod convolution;
mod encoder;
mod encoder_shape;
mod numbers;
mod posterior;
mod predictive;
mod sphere_equivalent;
mod spread;
#[cfg(test)]
pub(crate) mod tests;

pub use candidates::Candidates;
pub use convolution::{Convolution, silu, silu_backward};
pub use encoder::{Encoder, inside_disk, pool};
pub use encoder_shape::{EncoderError, EncoderShape, NamedLayer, Step};
pub use numbers::peak_height;
pub(crate) use posterior::sample;
pub use posterior::{MaterialPosterior, Neighbour, interval_widths};
pub(crate) use predictive::predict;
pub use sphere_equivalent::{SphereEquivalent, to_sphere_equivalent};

use crate::appearance::DiskImage;
use crate::appearance::disk::{CHANNELS, DISK_SIDE};
use crate::colour::ColourModel;
use crate::inference::likelihood::Embedding;
use crate::reflectance::LatentSpace;

/// Trained model from an image to the posterior of its material.
#[derive(Clone, Debug, PartialEq)]
pub struct LearntPosterior {
    /// Names of the measured materials in the training set.
    pub names: Vec<String>,
    /// Measured materials in the order of `names`.
    pub measured: Candidates,
    /// Materials drawn from the prior.
    pub prior: Candidates,
    /// Coordinates of the space of materials.
    pub latent_space: LatentSpace,
    /// Width of the prior's 90 % interval of the logarithm of each cell ([`interval_widths`]).
    pub widths: Vec<f32>,
    /// Network from the channels and globals of a [`DiskImage`] to its embedding.
    pub encoder: Encoder,
    /// Quantiles of 0.1 and 99.9 % of each feature of the encoder in training.
    pub ranges: Vec<(f32, f32)>,
    /// Model of the colours of materials and lights; `None` if only luminance was learnt.
    pub colours: Option<ColourModel>,
}

/// Output of the encoder for an image.
#[derive(Clone, Debug, PartialEq)]
pub struct EncoderOutput {
    /// Embedding of the image.
    pub embedding: Vec<f32>,
    /// Share of the encoder's features outside their range in training.
    ///
    /// The share is near 0.002 for photographs like the simulated ones. It is large for photographs
    /// unlike them, whose posterior is unreliable.
    pub out_of_distribution: f64,
}

impl LearntPosterior {
    /// Runs the encoder on an image.
    pub fn encode(&self, image: &DiskImage) -> EncoderOutput {
        let mut channels = vec![0.0; DISK_SIDE * DISK_SIDE * CHANNELS];
        let globals = image.write(&mut channels);
        let (embedding, features) = self.encoder.apply(&channels, &globals);
        let outside = features.iter().zip(&self.ranges).filter(|(v, (low, high))| *v < low || *v > high).count();
        EncoderOutput { embedding, out_of_distribution: outside as f64 / self.ranges.len().max(1) as f64 }
    }

    /// Computes the posterior mean for an embedding of images, in the coordinates of materials.
    pub fn mean_coordinates(&self, embedding: &Embedding) -> Vec<f64> {
        let mut mean = vec![0.0; self.latent_space.axes.len()];
        for (coordinates, weight) in self.prior.coordinates.iter().zip(self.prior.weights(&embedding.tempered())) {
            mean.iter_mut().zip(coordinates).for_each(|(sum, z)| *sum += weight * f64::from(*z));
        }
        mean
    }

    /// Returns an identifier of the model: a hash (FNV-1a) of its coordinates and embeddings, as 16
    /// hexadecimal digits.
    pub fn id(&self) -> String {
        let numbers = self.latent_space.mean.iter().chain(self.measured.embeddings.iter().flatten());
        let hash = numbers
            .flat_map(|v| v.to_bits().to_le_bytes())
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
        format!("{hash:016x}")
    }

    /// Computes the posterior of the material of an image.
    pub fn posterior(&self, image: &DiskImage) -> MaterialPosterior {
        MaterialPosterior::of_embedding(self, Embedding::of(self.encode(image).embedding))
    }
}
