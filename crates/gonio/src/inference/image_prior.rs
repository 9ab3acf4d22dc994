//! Priors of exposure and noise, and the requirements on an image.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Parameters of the priors of exposure and noise (paper 3.3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hyperparameters {
    /// `lambda_gamma` of `p(gamma) = Exp(lambda_gamma)`, for an image scaled to the brightness that
    /// the prior means predict. It is small because reflectance is scaled to its maximum, so that a
    /// mirror needs an exposure a thousand times that of chalk.
    pub exposure_rate: f64,
    /// Shape `a` of `p(sigma^-2) = Gamma(a, b)`.
    pub noise_shape: f64,
    /// Rate `b` of that distribution, in squared units of the root mean square of the image.
    pub noise_rate: f64,
}

impl Default for Hyperparameters {
    /// Vague prior of the noise.
    fn default() -> Self {
        Self { exposure_rate: 1e-3, noise_shape: 1e-3, noise_rate: 1e-6 }
    }
}

impl Hyperparameters {
    /// Prior for real images: `Gamma(a, b)` with as much weight as `pixels` observations that all
    /// have an error of [`MODEL_ERROR`].
    ///
    /// The residual of a real image is not noise but the part that grid and basis cannot represent,
    /// and it is correlated between neighbouring pixels.
    pub fn with_model_error(pixels: usize) -> Self {
        let shape = pixels as f64;
        Self { noise_shape: shape, noise_rate: shape * MODEL_ERROR * MODEL_ERROR, ..Self::default() }
    }
}

/// Root mean square of the model's error relative to that of the image.
///
/// With the true light on a 32 x 32 grid, rank-10 reflectance leaves 3 to 7 % of the images of
/// matte and satin materials unexplained.
pub const MODEL_ERROR: f64 = 0.05;

/// Reason why an image cannot be used for inference.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum ImageError {
    /// The image is black.
    #[error("the object is black in the photograph; check the exposure and the mask")]
    Black,
    /// The image has values that are not finite.
    #[error("the observed part of the image has values that are not finite")]
    NotFinite,
}

impl ImageError {
    /// Returns the energy (sum of squares) of an image if inference can use the image.
    ///
    /// # Errors
    /// For black and non-finite images.
    pub fn check(energy: f64) -> Result<f64, Self> {
        match energy {
            e if !e.is_finite() => Err(Self::NotFinite),
            e if e <= 0.0 => Err(Self::Black),
            e => Ok(e),
        }
    }
}
