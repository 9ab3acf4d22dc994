//! Inference with the light integrated out exactly.
//!
//! Given reflectance `f`, an image is linear in the light, `t = g B l + e` with
//! `B = sum_k f_k A_k`; given the scales of its mixtures, the light is Gaussian, with means `mu`
//! and precisions `d`. Hence in closed form
//!
//! `p(t | f, g, b) = N(t; g B mu, g^2 B diag(1/d) B' + I/b)`.
//!
//! The scales are not known. With responsibilities `r_n` for every coefficient,
//! `d_m = sum_n r_n / s_n^2` and
//!
//! `log p(t | f, g, b) >= log N(t; ...) +
//! sum_m { sum_n r_n (log pi_n - log r_n - log(s_n^2)/2) - log(d_m)/2 }`,
//!
//! a variational bound. Expectation maximisation raises it: it alternates between the exact
//! Gaussian posterior of the light given `r` and the optimal `r` given its `<l_m^2>`. The bound is
//! an equality for mixtures of one component. The rectified prior of the coarsest vertical
//! coefficient is exact too. Its integral is that of the whole Gaussian times a ratio: the mass
//! above the threshold after the image over the mass above it before the image.
//!
//! The bound has a local maximum for every choice of components, most of them far too low. The
//! ascent therefore includes component switches: every coefficient takes the components that are
//! best for it alone, if that raises the bound.
//!
//! * `LightInference` is an image with the priors of light, exposure and noise; `Design` is `B`;
//! * `LightInference::posterior` maximises the bound for one `B` and returns it with the posterior
//!   of the light, [`LightPosterior`];
//! * `non_negative_light` is the mean of the light without negative texels;
//! * [`LightProblem`] combines these for a photograph and one BRDF.
//!
//! The ascent also maximises over the logarithms of exposure `g` and precision `b`. The objective
//! includes the densities of `log g` and `log b` that follow from [`Hyperparameters`], so that the
//! optimal `b` is `(a + N/2) / (b_0 + E/2)` as in Algorithm 1.

mod factor;
mod point;
mod positive;
mod posterior;
mod problem;
mod richardson_lucy;
mod scales;
#[cfg(test)]
mod tests;
mod truncated;

use puruspe::ln_gamma;
use thiserror::Error;

pub use positive::{NonNegativeLight, cut_off_at_zero};
use posterior::InferenceSettings;
pub use posterior::LightPosterior;
pub use problem::{LightError, LightProblem};
pub(crate) use richardson_lucy::refine;
use scales::Scales;

use super::{Hyperparameters, ImageError};
use crate::lighting::{LightGrid, LightPrior};

/// Image on r rows with everything that does not depend on reflectance: the priors of light,
/// exposure and noise.
///
/// The image is scaled to root mean square one; bounds are logarithms of the density of the scaled
/// image.
#[derive(Clone, Debug)]
struct LightInference<'a> {
    /// The scaled image on its rows (r).
    target: Vec<f64>,
    /// Factor by which the image was multiplied. Exposure and noise in units of the image are those
    /// of the scaled image divided by it.
    scale: f64,
    scales: Scales<'a>,
    hyper: Hyperparameters,
}

/// Error in computing the evidence.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum LightInferenceError {
    /// The design or its products overflow.
    #[error("the light transport has values that are not finite or too large")]
    NotFinite,
}

impl<'a> LightInference<'a> {
    /// Builds the inference for an image `target` on r rows (linear radiance), for designs of `m`
    /// light coefficients.
    ///
    /// # Errors
    /// For black or non-finite images.
    ///
    /// # Panics
    /// If the prior does not cover `m` coefficients.
    fn new(target: &[f64], m: usize, light: &'a LightPrior, hyper: Hyperparameters) -> Result<Self, ImageError> {
        let energy = target.iter().map(|t| t * t).sum::<f64>();
        ImageError::check(energy)?;
        let scale = (target.len() as f64 / energy).sqrt();
        let priors: Vec<_> = (1..m).map(|m| light.of_index(m).expect("the prior covers the light")).collect();
        Ok(Self {
            target: target.iter().map(|t| t * scale).collect(),
            scale,
            scales: Scales::new(LightGrid::normalised_dc(), &priors),
            hyper,
        })
    }

    /// Number of rows r, which is N of eq. 9.
    fn rows(&self) -> f64 {
        self.target.len() as f64
    }

    /// `log p(log g)` of the exponential prior of `g`.
    fn log_exposure_prior(&self, log_g: f64) -> f64 {
        let rate = self.hyper.exposure_rate;
        rate.ln() + log_g - rate * log_g.exp()
    }

    /// `log p(log b)` of the Gamma prior of `b`.
    fn log_noise_prior(&self, log_b: f64) -> f64 {
        let Hyperparameters { noise_shape: shape, noise_rate: rate, .. } = self.hyper;
        shape * (rate.ln() + log_b) - ln_gamma(shape) - rate * log_b.exp()
    }
}
