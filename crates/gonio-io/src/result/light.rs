//! Sections on the light, the scale, and the residual of the photograph.

use serde::{Deserialize, Serialize};

use super::{Circle, number_or_nan};

/// The estimated light, given the BRDF.
///
/// Its posterior mean is `exposure` times the Haar synthesis of `coefficients`. If the lobe of the
/// BRDF is narrower than the texels of this synthesis, the default method refines the light: then
/// `light.exr` shows more detail.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct Light {
    /// Haar coefficients in units of the prior, in the order of the model.
    pub coefficients: Vec<f64>,
    /// Standard deviations of the coefficients.
    pub sd: Vec<f64>,
    /// Radiance of a coefficient of one, on the scale of the photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
    /// Texels along a side of the octahedral grid of the estimated light, from which `light.exr` is
    /// made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<usize>,
    /// Number of observations used for the coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub observations: Option<usize>,
    /// How the light was made non-negative: `mean without negative texels`, or `mean cut off at
    /// zero`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimator: Option<String>,
    /// Number of steps of the estimator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<usize>,
    /// Whether the estimator converged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub converged: Option<bool>,
    /// Maximisation of the evidence over noise and exposure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Evidence>,
}

/// Maximisation of the evidence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Evidence {
    /// Final objective.
    #[serde(deserialize_with = "number_or_nan")]
    pub objective: f64,
    /// Effective number of coefficients.
    #[serde(deserialize_with = "number_or_nan")]
    pub effective: f64,
    /// Whether the maximisation converged.
    pub converged: bool,
    /// Objective after each step.
    #[serde(default)]
    pub trace: Vec<f64>,
}

/// The known light, and the corrections that gonio estimates. `light.exr` contains the corrected
/// map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct KnownLight {
    /// Name of the environment map.
    pub map: String,
    /// The mirror ball on which the light was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror_ball: Option<MirrorBall>,
    /// Number of rows of the map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<usize>,
    /// Rotation from the map to the fitted light: rotation vector about x, y and z in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation_degrees: Option<[f64; 3]>,
    /// Correction of clipped pixels of the map; absent if no pixels are clipped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clipped: Option<ClippedLight>,
}

/// A mirror ball in the photograph.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MirrorBall {
    /// Its outline.
    pub circle: Circle,
    /// Its reflectance at normal incidence for red, green and blue.
    pub reflectance: [f64; 3],
}

/// Correction of the clipped pixels of an environment map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ClippedLight {
    /// Estimated ratio of their radiance to their value in the map.
    pub factor: f64,
    /// Standard deviation of the logarithm of the ratio.
    pub log_sd: f64,
}

/// Scale between photograph, light and BRDF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct Exposure {
    /// Luminance albedo at normal incidence if photograph and environment map have the same scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub albedo: Option<f64>,
    /// Albedo of red, green and blue, under the same condition.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub albedo_rgb: Option<[f64; 3]>,
    /// Posterior mean of the exposure, for methods of the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
}

/// A neutral reference in the photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Reference {
    /// Measurement of the reference.
    #[serde(flatten)]
    pub kind: ReferenceKind,
    /// Radiance of a matte surface of reflectance one at the position of the reference: linear RGB
    /// on the scale of the photograph.
    pub white: [f64; 3],
    /// `ln R/G` and `ln B/G` of the light: of this radiance, or of the mean radiance of a grey
    /// ball.
    pub log_chroma: [f64; 2],
    /// Scale of the BRDF, if the reference determines it: it faces the camera under the light of
    /// the object. The quantiles of the BRDF do not include the uncertainty of the scale.
    pub scale: Option<AbsoluteScale>,
}

/// Measurement of a reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "kind")]
pub enum ReferenceKind {
    /// A white patch.
    #[serde(rename = "white patch")]
    WhitePatch(Patch),
    /// A grey card.
    #[serde(rename = "grey card")]
    GreyCard(Patch),
    /// A matte grey ball.
    #[serde(rename = "grey ball")]
    GreyBall {
        /// Centre (x, y) and radius of its outline in pixels.
        circle: [f64; 3],
        /// Its assumed reflectance.
        reflectance: f64,
        /// Radiance at its centre, which faces the camera: linear RGB.
        centre: [f64; 3],
        /// Mean radiance over its visible surface, which determines the colour of the light.
        mean: [f64; 3],
        /// Number of pixels.
        pixels: usize,
        /// Number of clipped pixels, which gonio ignores.
        clipped: usize,
        /// Root mean square residual of the luminance from the shading of a matte ball, relative to
        /// the mean.
        residual: f64,
    },
    /// A chart with 24 patches.
    #[serde(rename = "colour chart")]
    ColourChart {
        /// Centres of the corner patches in pixels: dark skin, bluish green, black, white.
        corners: [(f64, f64); 4],
        /// Whether gonio detected the chart.
        detected: bool,
        /// Number of neutral patches used, of six.
        neutral_patches: usize,
        /// Number of clipped patches, which gonio ignores.
        clipped_patches: usize,
        /// Correlation of the log chroma of the coloured patches with the published one.
        chroma_correlation: f64,
        /// Mean distance of their log chroma from the published one.
        chroma_residual: f64,
        /// Mean absolute logarithm of the luminance relative to the published one.
        luminance_residual: f64,
        /// Angle in degrees between the normal of the chart and the direction to the camera.
        tilt_degrees: f64,
    },
}

/// A measured patch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Patch {
    /// Its assumed reflectance.
    pub reflectance: f64,
    /// Median radiance of each channel.
    pub rgb: [f64; 3],
    /// Number of pixels.
    pub pixels: usize,
    /// Number of clipped pixels, which gonio ignores.
    pub clipped: usize,
    /// Relative standard deviation of the luminance over the patch.
    pub variation: f64,
}

/// Absolute scale of a BRDF.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct AbsoluteScale {
    /// Factor from a BRDF with an albedo of 0.5 at normal incidence.
    pub factor: f64,
    /// Luminance albedo at normal incidence.
    pub normal_albedo: f64,
    /// Its 90 % interval.
    pub normal_albedo_interval_90: [f64; 2],
    /// Standard deviation of the logarithm of the factor.
    pub log_sd: f64,
}

/// Difference between the photograph and its reproduction by the estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Residual {
    /// Root mean square residual relative to that of the photograph, given light and BRDF; absent
    /// for methods of the paper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<f64>,
    /// The misfit from noise and the light's resolution (known light: noise and texture) if light
    /// and BRDF were correct.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected: Option<f64>,
    /// Standard deviation of the noise, on the scale of the photograph.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_sd: Option<f64>,
    /// Standard deviation of the noise, relative to the photograph; under a known light, of the
    /// independent error of the image's logarithm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_noise: Option<f64>,
    /// Standard deviation of the smooth error of the image's logarithm, under a known light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smooth_error: Option<f64>,
    /// Relative RMS residual of red, green and blue beyond that of the luminance, under a known
    /// light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channels: Option<[f64; 3]>,
    /// Residual of the colours, under unknown light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colours: Option<ColourResidual>,
}

/// Residual of the colours under unknown light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ColourResidual {
    /// Relative RMS residual of the channels, given BRDF and light in colour, with the photograph
    /// scaled to the luminance of the reproduction.
    pub misfit: f64,
    /// RMS difference from blue to orange between the chroma of the photograph and that of the
    /// BRDF in a light of uniform colour, in natural logarithms. Captured lights vary in this
    /// direction.
    pub blue_orange: f64,
    /// The same from green to magenta. Captured lights vary little in this direction.
    pub green_magenta: f64,
}
