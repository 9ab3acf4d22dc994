//! Result of the inference.

use serde::{Deserialize, Serialize};

/// Report on one start of a method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartReport {
    /// Final cost: `C_KL`, or minus the log posterior for the joint maximum.
    pub cost: f64,
    /// Iterations spent, updates of the noise included.
    pub iterations: usize,
    /// Whether the stopping rule was met before the limit of iterations.
    pub converged: bool,
}

/// Posterior of light and reflectance, in the units of the image it was inferred from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Posterior {
    /// `<f_k>`.
    pub reflectance: Vec<f64>,
    /// Standard deviation of `f_k`; zero for a point estimate.
    pub reflectance_sd: Vec<f64>,
    /// `<l_m>`, DC first. For a known light, the single coefficient of value one.
    pub light: Vec<f64>,
    /// Standard deviation of `l_m`.
    pub light_sd: Vec<f64>,
    /// `<gamma>`: the image is `gamma l' A f`.
    pub exposure: f64,
    /// Standard deviation of `gamma`.
    pub exposure_sd: f64,
    /// Standard deviation of the noise, `<sigma^-2>^(-1/2)`, in the units of the image.
    pub noise: f64,
    /// Cost of the kept start after every iteration: `C_KL`, or minus the log posterior for the
    /// joint maximum.
    pub trace: Vec<f64>,
    /// Reports of all starts, in the order they were made.
    pub starts: Vec<StartReport>,
    /// Index of the kept start, which has the lowest cost.
    pub best_start: usize,
}
