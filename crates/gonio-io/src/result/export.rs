//! The document `export.json`: files of an export and their errors.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::number_or_nan;

/// Contents of `export.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct ExportDocument {
    /// `gonio-export`.
    pub format: String,
    /// Version of the format: 1.
    pub version: u32,
    /// Version of gonio that wrote the document.
    pub gonio: String,
    /// Source of the BRDF.
    pub input: String,
    /// Name of the material.
    pub name: String,
    /// Luminance albedo of the exported BRDF at normal incidence.
    pub albedo: f64,
    /// Origin of the albedo: `option`, `input` (as in the input), or `fit` (the photograph does not
    /// determine the scale; the models of renderers fit best at this albedo).
    pub albedo_source: String,
    /// Light of the scenes: `of the results` or `studio`.
    pub light: String,
    /// Exports by target.
    pub exports: BTreeMap<String, ExportEntry>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}

/// Files of a target.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct ExportEntry {
    /// Names of the files.
    pub files: Vec<String>,
    /// Parameters of the fitted model.
    #[serde(skip_serializing_if = "serde_json::Value::is_null")]
    pub parameters: serde_json::Value,
    /// The 90 % interval of each parameter, in the structure of `parameters`: the fits of the model
    /// to draws from the posterior. Absent if the input has no posterior.
    #[serde(skip_serializing_if = "serde_json::Value::is_null")]
    pub intervals: serde_json::Value,
    /// Relative RMS error of a sphere rendered with the export in a studio light, compared with the
    /// BRDF.
    #[serde(deserialize_with = "number_or_nan")]
    pub relight: f64,
    /// The same error of logarithms, for values above 1 % of the mean.
    #[serde(deserialize_with = "number_or_nan")]
    pub log_relight: f64,
    /// Conventions of the parameters or tables.
    pub conventions: String,
    /// Linear colour space of the colours. `light.exr` is in `rec709`.
    pub colorspace: String,
}

impl ExportDocument {
    /// Value of `format`.
    pub const FORMAT: &str = "gonio-export";
    /// Value of `version`.
    pub const VERSION: u32 = 1;
}
