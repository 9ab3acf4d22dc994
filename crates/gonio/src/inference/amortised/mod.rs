//! The posterior of the material with the light integrated out over captured lights (eq. 3), learnt beforehand.
//!
//! The captured lights are samples of `p(L)`, measured materials and what lies between them samples of `p(F)`: photographs
//! simulated from both are samples of `p(F, I)`, and a regression from the image to the material fitted to them is the
//! posterior `p(F | I)`, marginal over light by construction. It knows of lamps, horizons and edges what no prior of independent wavelet
//! coefficients can say. An image is reduced to its [`Statistics`](crate::appearance::Statistics); a small network turns them into a Gaussian over the
//! [`Coordinates`](crate::reflectance::Coordinates) of materials (Papamakarios & Murray 2016 call it neural posterior estimation);
//! and the entries of a [`Dictionary`] are weighted by its density.

mod convolution;
mod encoder;
mod encoder_shape;
mod head;
mod mixture;
mod network;
mod numbers;
mod posterior;
mod simulate;
#[cfg(test)]
pub(crate) mod tests;
mod train;
mod unshadow;

use crate::appearance::STATISTICS;
use crate::reflectance::Dictionary;

pub use convolution::{Convolution, silu, silu_backward};
pub use encoder::{Encoder, inside_disk, pool};
pub use encoder_shape::{EncoderError, EncoderShape, NamedLayer, Step};
pub use mixture::{LARGEST_LOG, MixtureDensity};
pub use network::{Dense, Network};
pub use numbers::{Ranking, peak_over_base};
pub use posterior::{MaterialPosterior, Neighbour};
pub use simulate::{Simulation, SimulationSettings};
pub use train::{Scaling, TrainingSettings};
pub use unshadow::{UnshadowSettings, Unshadowed, unshadow};

/// What was learnt: from the statistics of an image to the posterior of its material.
#[derive(Clone, Debug, PartialEq)]
pub struct Amortised {
    /// Materials to weigh.
    pub dictionary: Dictionary,
    /// One for each statistic.
    pub scaling: Vec<Scaling>,
    /// From scaled statistics to a Gaussian over coordinates.
    pub network: Network,
}

impl Amortised {
    /// Outputs of a network for a Gaussian over so many coordinates: its mean, and the factor of its precision.
    pub fn outputs(dimensions: usize) -> usize {
        head::outputs(dimensions)
    }

    /// The posterior of the material in an image of these [`STATISTICS`] (see [`Statistics::of`](crate::appearance::Statistics::of)).
    ///
    /// # Panics
    /// If there are not as many; [`Self::strangeness`] likewise.
    pub fn posterior(&self, statistics: &[f32]) -> MaterialPosterior {
        assert_eq!(statistics.len(), STATISTICS);
        let scaled: Vec<f32> = statistics.iter().zip(&self.scaling).map(|(v, s)| s.apply(*v)).collect();
        let outputs = self.network.apply(&scaled);
        let gaussian = head::Gaussian::of(&outputs, self.dictionary.coordinates.axes.len());
        let densities: Vec<f64> = self.dictionary.places.iter().map(|z| gaussian.log_density(z)).collect();
        MaterialPosterior::of(&self.dictionary, &densities)
    }

    /// Share of the statistics that are outside of what was seen in training: near 0.002 for a photograph like those simulated, and large for
    /// one unlike them, whose posterior is not to be trusted.
    pub fn strangeness(&self, statistics: &[f32]) -> f64 {
        assert_eq!(statistics.len(), STATISTICS);
        let outside = statistics.iter().zip(&self.scaling).filter(|(v, s)| **v < s.low || **v > s.high).count();
        outside as f64 / STATISTICS as f64
    }
}
