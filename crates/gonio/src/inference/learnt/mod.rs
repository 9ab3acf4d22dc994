//! The posterior of the material with the light integrated out over captured lights (eq. 3), learnt
//! beforehand.
//!
//! The captured lights are samples of `p(L)`, measured materials and what lies between them samples
//! of `p(F)`: photographs simulated from both ([`simulation`](crate::simulation)) are samples of
//! `p(F, I)`, and the ratio `p(I | F) / p(I)` learnt from them is marginal over light by
//! construction. It knows of lamps, horizons and edges what no prior of independent wavelet
//! coefficients can say, and of noise, texture and wrong normals what no equation of the image does. The image is brought to the [disk of
//! normals](crate::appearance::disk) with how far each of them can be trusted; a small
//! convolutional [`Encoder`] turns it into an embedding, whose dot product with the embedding of a
//! material is the logarithm of the likelihood of the image, up to a constant. [`Candidates`] drawn
//! from the prior, weighed by it, are the posterior. Both embeddings are learnt by telling the
//! material of a photograph from others (contrastive ratio estimation: Durkan, Murray &
//! Papamakarios 2020).

mod candidates;
mod convolution;
mod encoder;
mod encoder_shape;
mod numbers;
mod posterior;
#[cfg(test)]
pub(crate) mod tests;
mod unshadow;

pub use candidates::Candidates;
pub use convolution::{Convolution, silu, silu_backward};
pub use encoder::{Encoder, inside_disk, pool};
pub use encoder_shape::{EncoderError, EncoderShape, NamedLayer, Step};
pub use numbers::{Ranking, peak_over_base};
pub(crate) use posterior::draws;
pub use posterior::{MaterialPosterior, Neighbour, interval_widths};
pub use unshadow::{UnshadowSettings, Unshadowed, unshadow};

use crate::appearance::DiskImage;
use crate::appearance::disk::{CHANNELS, SIDE};
use crate::reflectance::Coordinates;

/// What was learnt: from an image to the posterior of its material.
#[derive(Clone, Debug, PartialEq)]
pub struct LearntPosterior {
    /// Names of the measured materials that were learnt from.
    pub names: Vec<String>,
    /// These materials, in the order of their names.
    pub measured: Candidates,
    /// Materials drawn from the prior.
    pub prior: Candidates,
    /// The space of materials.
    pub coordinates: Coordinates,
    /// Width of the prior's 90 % interval of the logarithm of each cell ([`interval_widths`]).
    pub widths: Vec<f32>,
    /// From the channels and globals of a [`DiskImage`] to its embedding.
    pub encoder: Encoder,
    /// Least and largest value of each feature of the encoder in training, but for one in a
    /// thousand at either end.
    pub ranges: Vec<(f32, f32)>,
}

/// What the encoder makes of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// The embedding of the image.
    pub embedding: Vec<f32>,
    /// Share of the encoder's features that are outside of what was seen in training: near 0.002
    /// for a photograph like those simulated, and large for one unlike them, whose posterior is not
    /// to be trusted.
    pub strangeness: f64,
}

impl LearntPosterior {
    /// Reads an image.
    pub fn read(&self, image: &DiskImage) -> Reading {
        let mut channels = vec![0.0; SIDE * SIDE * CHANNELS];
        let globals = image.write(&mut channels);
        let (embedding, features) = self.encoder.apply(&channels, &globals);
        let outside = features.iter().zip(&self.ranges).filter(|(v, (low, high))| *v < low || *v > high).count();
        Reading { embedding, strangeness: outside as f64 / self.ranges.len().max(1) as f64 }
    }

    /// The posterior of the material of an image.
    pub fn posterior(&self, image: &DiskImage) -> MaterialPosterior {
        MaterialPosterior::of(self, self.read(image).embedding)
    }
}
