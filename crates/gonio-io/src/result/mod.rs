//! The document `result.json`: all numbers of an estimate, without its tables and pictures.
//!
//! [`ResultDocument`] is the result for one material, [`RegionsDocument`] the list of the regions
//! of a photograph. Both are written with [`encode`] and read with [`read`].
//! `docs/result.schema.json` is the JSON schema of the types in this module.

mod colour;
mod export;
mod light;
mod observations;
mod paper;
mod posterior;

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{Error, json};

pub use colour::{Colour, ColourSpaces, UncertainColour};
pub use export::{ExportDocument, ExportEntry};
pub use light::{
    AbsoluteScale, ClippedLight, ColourResidual, Evidence, Exposure, KnownLight, Light, MirrorBall, Patch, Reference,
    ReferenceKind, Residual,
};
pub use observations::{
    Bracket, BracketReport, Circle, Correction, DetectionReport, Ellipse, MeshReport, Observations, PixelCounts,
    Projection, Shape, SurfacePixels, Visibility,
};
pub use paper::{Cost, SettingsSection, StartCost, Transfer};
pub use posterior::{GlossUnits, Highlight, PeakHeight, Posterior, Quantiles, Reflectance, SimilarMaterial, WideCells};

/// Value of `format` of a [`ResultDocument`].
pub const FORMAT: &str = "gonio-result";
/// Value of `format` of a [`RegionsDocument`].
pub const REGIONS_FORMAT: &str = "gonio-regions";
/// Version of both formats.
pub const VERSION: u32 = 2;

/// The result for one material. Sections that a method does not estimate are absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct ResultDocument {
    /// `gonio-result`.
    pub format: String,
    /// Version of the format: 2.
    pub version: u32,
    /// Version of gonio that wrote the document.
    pub gonio: String,
    /// Name of the photograph; absent if the result combines several photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// The photographs of a combined result.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub photographs: Vec<CombinedPhotograph>,
    /// Method: `learnt`, `known-light`, `combine`, or a method of the paper.
    pub method: String,
    /// The model that inferred the result.
    pub model: ModelSection,
    /// The detected object and the status of the pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observations: Option<Observations>,
    /// Merge of the exposures, if the photograph is a bracket.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bracket: Option<Bracket>,
    /// The material with its uncertainty.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posterior: Option<Posterior>,
    /// Scale and coefficients of the BRDF.
    pub reflectance: Reflectance,
    /// Colours of BRDF and light.
    pub colour: Colour,
    /// The estimated light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<Light>,
    /// The known light and its estimated corrections.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known_light: Option<KnownLight>,
    /// Scale between photograph, light and BRDF.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<Exposure>,
    /// The neutral reference in the photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<Reference>,
    /// Albedo at normal incidence relative to that of the brightest region of the photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative_albedo: Option<f64>,
    /// Difference between the photograph and its reproduction by the estimate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual: Option<Residual>,
    /// Settings of the method.
    pub settings: SettingsSection,
    /// Light transport of a method of the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfer: Option<Transfer>,
    /// Objective of a method of the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost: Option<Cost>,
    /// Colour spaces of the photograph and of the files.
    pub colorspace: ColourSpaces,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
    /// Seconds by stage, and their sum as `total`.
    pub seconds: BTreeMap<String, f64>,
}

/// The model that inferred a result.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct ModelSection {
    /// Origin of the model: data and version.
    pub provenance: String,
    /// Number of functions in the reflectance basis of the paper's methods.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rank: Option<usize>,
    /// Octahedral map of the light prior: `equal-area` or `praun-hoppe`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
}

/// A photograph of a combined result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CombinedPhotograph {
    /// Folder of its result.
    pub folder: String,
    /// Names of its images.
    #[serde(default)]
    pub images: Vec<String>,
    /// Log odds that it shows the same material as the others.
    #[serde(deserialize_with = "number_or_nan")]
    pub agreement: f64,
}

impl ResultDocument {
    /// Returns a document without sections; `gonio` is the version of gonio.
    pub fn new(method: &str, gonio: &str) -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            gonio: gonio.to_owned(),
            method: method.to_owned(),
            ..Self::default()
        }
    }

    /// Returns the names of all photographs.
    pub fn images(&self) -> impl Iterator<Item = &str> {
        let combined = self.photographs.iter().flat_map(|photograph| &photograph.images);
        self.image.iter().chain(combined).map(String::as_str)
    }
}

/// The regions of a photograph, each with its own folder of results.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct RegionsDocument {
    /// `gonio-regions`.
    pub format: String,
    /// Version of the format: 2.
    pub version: u32,
    /// Version of gonio that wrote the document.
    pub gonio: String,
    /// Name of the photograph.
    pub image: String,
    /// Method, as in [`ResultDocument::method`].
    pub method: String,
    /// The regions.
    pub regions: Vec<RegionEntry>,
    /// Warnings about the whole photograph, one line each.
    pub warnings: Vec<String>,
}

/// A region of a photograph.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct RegionEntry {
    /// Name of the region.
    pub name: String,
    /// Folder of its result, relative to that of the document.
    pub folder: String,
    /// Finish, roughness and uncertainty in one line, as in [`Highlight::verdict`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
    /// Albedo at normal incidence relative to that of the brightest region; all regions are under
    /// one light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative_albedo: Option<f64>,
    /// Roughness, as in [`Highlight::roughness`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roughness: Option<Quantiles>,
    /// Relative RMS residual of the region.
    #[serde(deserialize_with = "number_or_nan")]
    pub misfit: f64,
    /// Warnings about the region, one line each.
    pub warnings: Vec<String>,
}

/// Contents of a file `result.json`.
#[derive(Clone, Debug, PartialEq)]
pub enum ResultFile {
    /// The result for one material.
    Material(Box<ResultDocument>),
    /// The regions of a photograph.
    Regions(RegionsDocument),
}

/// Reads `result.json`.
///
/// # Errors
/// If the file cannot be read, is longer than 16 MiB, or is not a result of gonio.
pub fn read(path: &Path) -> Result<ResultFile, Error> {
    of_value(path, json::read(path)?)
}

/// Decodes a result held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<ResultFile, Error> {
    of_value(path, json::decode(path, bytes)?)
}

/// Returns the folders of the regions in a document that may be damaged; `None` if gonio did not
/// write the document.
pub fn region_folders(path: &Path) -> Option<Vec<String>> {
    let document: Value = json::read(path).ok()?;
    let regions = match document["format"].as_str()? {
        FORMAT => return Some(Vec::new()),
        REGIONS_FORMAT => document["regions"].as_array().into_iter().flatten(),
        _ => return None,
    };
    Some(regions.filter_map(|region| region["folder"].as_str()).map(str::to_owned).collect())
}

fn of_value(path: &Path, document: Value) -> Result<ResultFile, Error> {
    let damaged = |error: serde_json::Error| Error::damaged(path, format!("is not a valid result of gonio: {error}"));
    let format = document["format"].as_str();
    if !matches!(format, Some(FORMAT | REGIONS_FORMAT)) {
        return Err(Error::invalid(path, "is not a result of gonio infer", "specify a folder that gonio infer wrote"));
    }
    let version = document["version"].as_u64().unwrap_or(VERSION.into());
    if version != u64::from(VERSION) {
        let problem = format!("has version {version} of the format, but this gonio reads version {VERSION}");
        let remedy = if version > u64::from(VERSION) { "update gonio" } else { "run gonio infer again" };
        return Err(Error::unsupported(path, problem, remedy));
    }
    if format == Some(REGIONS_FORMAT) {
        return Ok(ResultFile::Regions(serde_json::from_value(document).map_err(damaged)?));
    }
    Ok(ResultFile::Material(serde_json::from_value(document).map_err(damaged)?))
}

/// Reads a number; null is NaN, since JSON has no other form of numbers that are not finite.
fn number_or_nan<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// Encodes a document as indented JSON.
pub fn encode(document: &impl Serialize) -> String {
    serde_json::to_string_pretty(document).expect("the keys of the document are strings")
}

#[cfg(test)]
mod tests;
