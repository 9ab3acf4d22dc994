//! Sections on the estimated material.

use serde::{Deserialize, Serialize};

use super::number_or_nan;

/// 5, 50 and 95 % quantiles of a number: the median and its 90 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Quantiles {
    /// The 5 % quantile.
    #[serde(rename = "5", deserialize_with = "number_or_nan")]
    pub low: f64,
    /// The median.
    #[serde(rename = "50", deserialize_with = "number_or_nan")]
    pub median: f64,
    /// The 95 % quantile.
    #[serde(rename = "95", deserialize_with = "number_or_nan")]
    pub high: f64,
}

impl From<[f64; 3]> for Quantiles {
    fn from([low, median, high]: [f64; 3]) -> Self {
        Self { low, median, high }
    }
}

impl From<Quantiles> for [f64; 3] {
    fn from(quantiles: Quantiles) -> Self {
        [quantiles.low, quantiles.median, quantiles.high]
    }
}

/// The material with its uncertainty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Posterior {
    /// Shape of the highlight.
    pub highlight: Highlight,
    /// Measured materials with the most similar highlights, regardless of colour, the most similar
    /// first.
    #[serde(default)]
    pub materials: Vec<SimilarMaterial>,
    /// Share of the BRDF's cells (both angles below 80 degrees) whose 90 % interval, without
    /// the error of the model, is wider than 60 % of the prior's.
    pub undetermined: f64,
    /// Share of the cells with a wide 90 % interval.
    pub wide: WideCells,
    /// Share of the encoder's features outside of their range in the training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub out_of_distribution: Option<f64>,
    /// Standard deviation of pixels that share a normal, relative to their mean: noise, texture,
    /// shadows and wrong normals. Zero if too few pixels share a normal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scatter: Option<f64>,
    /// Number of cells of the disk of normals that the encoder reads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disk_cells: Option<usize>,
    /// Number of these cells without an observation, which gonio interpolates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filled_cells: Option<usize>,
    /// Mean absolute logarithm of the factor that converts observed values to those of a sphere,
    /// for shapes with self-shadowing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub self_shadowing: Option<f64>,
}

/// Shape of the highlight.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Highlight {
    /// The duller of two finishes. By the median roughness: `mirror` below 0.1, `gloss` below 0.25,
    /// `semi-gloss` below 0.4, `satin` below 0.6, else `matte`. By the median gloss units at 60
    /// degrees for an albedo of 0.5: `matte` below 10, `satin` below 35, `semi-gloss` below 70.
    pub finish: String,
    /// Finish, roughness and uncertainty in one line, as printed by gonio.
    pub verdict: String,
    /// Square root of `ggx_alpha`: the roughness of the principled BSDFs of Mitsuba and Blender.
    #[serde(default)]
    pub roughness: Option<Quantiles>,
    /// Width of the GGX lobe that is as sharp as the highlight. Broad lobes (above 0.56) have 0.5
    /// to 0.56; a BRDF without a highlight has 1.
    #[serde(default)]
    pub ggx_alpha: Option<Quantiles>,
    /// Gloss units, for one albedo.
    #[serde(default)]
    pub gloss_units: Option<GlossUnits>,
    /// Height of the peak.
    pub peak_height: PeakHeight,
}

/// Gloss units (ASTM D523: black glass has 100). They are proportional to the albedo, which a
/// photograph under unknown light does not determine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct GlossUnits {
    /// Albedo at normal incidence for which the gloss units hold.
    pub albedo: f64,
    /// Gloss units at 20 degrees.
    #[serde(rename = "20")]
    pub at_20: Quantiles,
    /// Gloss units at 60 degrees.
    #[serde(rename = "60")]
    pub at_60: Quantiles,
}

/// Ratio of the BRDF along the normal to its mean at half angles above 45 degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PeakHeight {
    /// Quantiles of the ratio.
    #[serde(flatten)]
    pub quantiles: Quantiles,
    /// The 95 % quantile divided by the 5 % quantile.
    #[serde(default, deserialize_with = "number_or_nan")]
    pub factor: f64,
}

/// A measured material with a similar highlight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SimilarMaterial {
    /// Name of the material.
    pub name: String,
    /// Its weight, 0..=1; the weights of all measured materials sum to one.
    pub weight: f64,
}

/// Cells of the BRDF with a wide 90 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct WideCells {
    /// Smallest ratio of the ends of a wide interval.
    pub factor: f64,
    /// Share of the cells (both angles below 80 degrees), 0..=1.
    pub share: f64,
}

/// Scale and coefficients of the BRDF.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct Reflectance {
    /// File of the BRDF and its quantiles, in 1/sr.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Whether the scale of the BRDF is measured: photograph and environment map have the same
    /// scale, or the photograph has a reference. Otherwise, `normal_albedo` is assumed.
    pub absolute: bool,
    /// Luminance albedo of the BRDF at normal incidence.
    pub normal_albedo: f64,
    /// Coefficients in the basis of the paper: the BRDF is `scale` times the sum of the basis
    /// functions, weighted by the coefficients.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub coefficients: Vec<f64>,
    /// Standard deviations of the coefficients.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sd: Vec<f64>,
    /// Factor from the coefficients to the BRDF.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
}
