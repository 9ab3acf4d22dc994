//! Sections on colours and colour spaces.

use serde::{Deserialize, Serialize};

/// Colours of BRDF and light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct Colour {
    /// Origin of the colours: `estimate`, `median` (the median colour of the photograph, which
    /// includes the colour of the light), `grey photograph`, or `none`.
    pub source: String,
    /// Assumption on the colour of the light, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub assumption: Option<String>,
    /// The median colour of the photograph: linear Rec. 709, scaled to a luminance of one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rgb: Option<[f64; 3]>,
    /// Mean colour at half angles of 30 to 70 degrees and difference angles below 60 degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<UncertainColour>,
    /// Mean colour at half angles below 2 degrees and difference angles below 60 degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub highlight: Option<UncertainColour>,
    /// Colour of a white matte ball at the position of the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<UncertainColour>,
}

/// An estimated colour with its uncertainty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct UncertainColour {
    /// Linear Rec. 709, scaled to a luminance of one.
    pub rgb: [f64; 3],
    /// `ln R/G` and `ln B/G`.
    #[serde(default)]
    pub log_chroma: [f64; 2],
    /// 90 % intervals of both numbers in `log_chroma`: low and high.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval_90: Option<[[f64; 2]; 2]>,
    /// Standard deviation of both numbers in `log_chroma`, of a combined result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_chroma_sd: Option<[f64; 2]>,
    /// Colours at the 5, 25, 50, 75 and 95 % quantiles along the most uncertain direction.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub quantile_colours: Vec<[f64; 3]>,
}

/// Colour spaces of the photograph and of the files. Colours in the document are linear Rec. 709.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct ColourSpaces {
    /// Colour space of the photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<String>,
    /// Origin of the information on the colour space of the photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// Number of pixels outside the gamut of Rec. 709, whose negative channels were set to zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clamped_pixels: Option<usize>,
    /// Linear colour space of the BRDF in `brdf.npz` and of `light.exr`. The quantiles in
    /// `brdf.npz` are linear Rec. 709.
    pub output: String,
}
