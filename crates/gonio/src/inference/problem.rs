//! Inference problem: the image on its rows, and the priors.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::lighting::{CoefficientPrior, LightGrid, LightPrior};
use crate::transfer::{Bilinear, Projected};

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

/// Error in building a problem.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ProblemError {
    /// The image is black.
    #[error("the object is black in the photograph; check the exposure and the mask")]
    Black,
    /// The image has values that are not finite.
    #[error("the observed part of the image has values that are not finite")]
    NotFinite,
    /// The number of rates differs from that of the basis functions.
    #[error("{rates} rates for {k} basis functions")]
    Rates {
        /// Rates given.
        rates: usize,
        /// Basis functions of the operator.
        k: usize,
    },
}

/// Model `I_i = g l' A_i f + e_i` with the priors of `l`, `f`, `g` and the precision of `e`. The
/// image is scaled so that `g` near one is plausible.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    pub(crate) bilinear: &'a Bilinear,
    /// Image on the rows, times `scale`.
    pub(crate) target: Vec<f64>,
    /// Squared norm of the scaled image, including the part outside the rows.
    pub(crate) energy: f64,
    /// Number of pixels, N of eq. 9.
    pub(crate) pixels: f64,
    /// Factor that the image was multiplied by.
    pub(crate) scale: f64,
    /// Prior of each light coefficient from 1 on; DC is fixed at `dc`.
    pub(crate) light: Vec<&'a CoefficientPrior>,
    /// The constant DC coefficient.
    pub(crate) dc: f64,
    /// `lambda_k`.
    pub(crate) rates: Vec<f64>,
    pub(crate) hyper: Hyperparameters,
    /// Reflectance coefficients of known materials, from which starts are drawn if there are any.
    pub(crate) examples: Vec<Vec<f64>>,
}

impl<'a> Problem<'a> {
    /// Builds the blind problem, whose light is unknown, with prior `light`.
    ///
    /// # Errors
    /// For black or non-finite images and rates that do not fit the operator.
    pub fn blind(
        image: &'a Projected,
        light: &'a LightPrior,
        rates: &[f64],
        hyper: Hyperparameters,
    ) -> Result<Self, ProblemError> {
        let m = image.bilinear.m();
        let priors = (1..m).map(|m| light.of_index(m).expect("the prior covers the grid of the plan")).collect();
        Self::new(image, priors, LightGrid::normalised_dc(), rates, hyper)
    }

    /// Builds the problem with known light: `image.bilinear` has one light coefficient, of value
    /// one, and its rows are the images of the basis functions under that light.
    ///
    /// # Errors
    /// Those of [`Self::blind`].
    pub fn with_known_light(image: &'a Projected, rates: &[f64], hyper: Hyperparameters) -> Result<Self, ProblemError> {
        assert_eq!(image.bilinear.m(), 1, "a known light has one coefficient");
        Self::new(image, Vec::new(), 1.0, rates, hyper)
    }

    fn new(
        image: &'a Projected,
        light: Vec<&'a CoefficientPrior>,
        dc: f64,
        rates: &[f64],
        hyper: Hyperparameters,
    ) -> Result<Self, ProblemError> {
        let bilinear = &image.bilinear;
        if rates.len() != bilinear.k() {
            return Err(ProblemError::Rates { rates: rates.len(), k: bilinear.k() });
        }
        let energy = image.energy();
        if !energy.is_finite() {
            return Err(ProblemError::NotFinite);
        }
        if energy <= 0.0 {
            return Err(ProblemError::Black);
        }
        // Scales the root mean square to one: the paper starts with a noise variance of one, as
        // large as the signal. The units then change the plausible exposure only by a factor that
        // the broad prior of g absorbs.
        let scale = (image.pixels as f64 / energy).sqrt();
        Ok(Self {
            bilinear,
            target: image.target.iter().map(|x| x * scale).collect(),
            energy: energy * scale * scale,
            pixels: image.pixels as f64,
            scale,
            light,
            dc,
            rates: rates.to_vec(),
            hyper,
            examples: Vec::new(),
        })
    }

    /// Sets the coefficients of known materials from which the starts draw their reflectances.
    ///
    /// By default, they draw from the exponential prior.
    pub fn starting_from(mut self, examples: Vec<Vec<f64>>) -> Self {
        assert!(examples.iter().all(|e| e.len() == self.rates.len()));
        self.examples = examples;
        self
    }

    pub(crate) fn k(&self) -> usize {
        self.bilinear.k()
    }

    pub(crate) fn m(&self) -> usize {
        self.bilinear.m()
    }

    /// `a` of `q(sigma^-2) = Gamma(a, b)`.
    pub(crate) fn noise_shape(&self) -> f64 {
        self.hyper.noise_shape + 0.5 * self.pixels
    }
}
