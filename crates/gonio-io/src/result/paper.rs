//! Sections on settings and on the methods of the paper.

use gonio_paper::StartReport;
use serde::{Deserialize, Serialize};

use super::number_or_nan;

/// Settings of a method. Settings that a method does not have are absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct SettingsSection {
    /// Texels per side of the light grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid: Option<usize>,
    /// Whether integer values of the photograph were read as linear radiance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linear: Option<bool>,
    /// Largest number of observations from which the light is estimated; under a known light, the
    /// number used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observations: Option<usize>,
    /// Largest number of steps of the estimator of the light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<usize>,
    /// Whether the estimate under a known light converged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub converged: Option<bool>,
    /// Seed of the random starts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Number of starts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub starts: Option<usize>,
    /// Name of the solver.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver: Option<String>,
    /// Whether all settings are those of the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paper: Option<bool>,
    /// Assumed relative error of the model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_error: Option<f64>,
    /// Whether the inference uses all observations instead of a projection.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub all_observations: Option<bool>,
}

/// Light transport of a method of the paper.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct Transfer {
    /// Name of the known light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<String>,
    /// Number of rows of the projection, or of observations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rank: Option<usize>,
    /// Share of the prior's energy that the projection leaves out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truncated_prior_energy: Option<f64>,
    /// Share of the photograph's energy that the projection cannot reproduce.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unexplained_energy: Option<f64>,
}

/// Objective of a method of the paper.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct Cost {
    /// Name of the objective: `C_KL` or `minus log posterior`.
    pub name: String,
    /// Objective of the best start after each iteration.
    pub trace: Vec<f64>,
    /// Outcome of each start.
    pub starts: Vec<StartCost>,
    /// Index of the start with the smallest objective.
    pub best_start: usize,
}

/// Outcome of a start of the solver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StartCost {
    /// Final objective.
    #[serde(deserialize_with = "number_or_nan")]
    pub cost: f64,
    /// Number of iterations.
    pub iterations: usize,
    /// Whether the start converged.
    pub converged: bool,
}

impl From<&StartReport> for StartCost {
    fn from(StartReport { cost, iterations, converged }: &StartReport) -> Self {
        Self { cost: *cost, iterations: *iterations, converged: *converged }
    }
}
