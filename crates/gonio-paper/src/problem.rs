//! Inference problem: the image on its rows, and the priors.

use gonio::inference::{Hyperparameters, ImageError};
use gonio::lighting::{CoefficientPrior, LightGrid, LightPrior};
use thiserror::Error;

use crate::{Bilinear, Projected};

/// Error in building a problem.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ProblemError {
    /// The image is black or not finite.
    #[error(transparent)]
    Image(#[from] ImageError),
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
        let energy = ImageError::check(image.energy())?;
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
