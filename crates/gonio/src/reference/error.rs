//! Errors of references in a photograph.

use thiserror::Error;

use super::ball::MAX_RESIDUAL;
use super::chart::MIN_PITCH;
use super::patch::MAX_CHROMA;
use crate::suggestion::Suggestion;

/// Error for a reference that cannot be used; [`ReferenceError::suggestions`] lists suggestions.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ReferenceError {
    /// The reflectance is not a fraction.
    #[error("reflectance {0}: must be above 0 and at most 1")]
    Reflectance(f64),
    /// The reference is not entirely within the photograph.
    #[error(
        "the reference lies partly or completely outside the image of {}x{} pixels; use coordinates inside the image",
        .size.0, .size.1
    )]
    Outside {
        /// Columns and rows of the photograph.
        size: (usize, usize),
    },
    /// Too few pixels of the reference can be used.
    #[error(
        "the reference has only {pixels} usable pixels, but at least {least} are required; mark a larger \
         part of it, or use a larger image"
    )]
    TooFewPixels {
        /// Number of pixels that are finite and not clipped.
        pixels: usize,
        /// Smallest accepted number.
        least: usize,
    },
    /// The reference is on the object.
    #[error(
        "{:.0} % of the reference's pixels lie on the object; mark a reference beside the object",
        100.0 * .share
    )]
    Overlap {
        /// Fraction of the reference's pixels that are on the object, in 0..=1.
        share: f64,
    },
    /// Too many pixels are clipped.
    #[error(
        "{:.0} % of the reference's pixels are clipped; reduce the exposure, or merge several exposures",
        100.0 * .share
    )]
    Clipped {
        /// Fraction of the reference's pixels that are clipped, in 0..=1.
        share: f64,
    },
    /// A channel is black.
    #[error("the reference is black in the {channel} channel; check its position, or increase the exposure")]
    Black {
        /// Name of the channel.
        channel: &'static str,
    },
    /// The patch is not uniform.
    #[error(
        "the reference is not uniform: its {} varies by {:.0} % (limit {:.0} %), because of texture, shading or an \
         edge; mark a smaller, evenly lit part of the patch",
        .what, 100.0 * .variation, 100.0 * .most
    )]
    Uneven {
        /// Quantity that varies: `"brightness"` or `"colour"`.
        what: &'static str,
        /// Relative standard deviation.
        variation: f64,
        /// Largest accepted value.
        most: f64,
    },
    /// The ball does not have the shading of a matte ball.
    #[error(
        "the reference is not a matte ball: its shading deviates by {:.0} % from that of a matte ball (limit \
         {:.0} %); check the circle, gloss and shadows, or use another reference",
        100.0 * .residual, 100.0 * MAX_RESIDUAL
    )]
    NotMatte {
        /// Root mean square residual of the shading, relative to its mean.
        residual: f64,
    },
    /// The patch has more colour than a neutral patch under captured light.
    #[error(
        "the reference is not neutral: its colour, ln(R/G) = {:.2} and ln(B/G) = {:.2}, is {distance:.1} away from \
         white in natural logarithms (limit {MAX_CHROMA}); check that the reference is grey",
        .log_chroma[0], .log_chroma[1]
    )]
    NotNeutral {
        /// `ln(R/G)` and `ln(B/G)` of the patch.
        log_chroma: [f64; 2],
        /// Distance from white in natural logarithms.
        distance: f64,
    },
    /// The corners are not those of a convex quadrilateral.
    #[error(
        "the corners of the colour chart do not form a convex quadrilateral; specify the centres of its four corner \
         patches in the order dark skin, bluish green, black, white"
    )]
    Corners,
    /// The patches are too small.
    #[error(
        "the patches of the colour chart are only {pitch:.1} pixels apart, but at least {MIN_PITCH} are required; \
         use a larger image"
    )]
    SmallChart {
        /// Distance of neighbouring patches, in pixels.
        pitch: f64,
    },
    /// The patches do not have the colours of the chart.
    #[error(
        "the patches at these corners are not those of a ColorChecker Classic in any orientation: {reason}; check \
         that the corners are correct, the values linear, and the chart evenly lit"
    )]
    NotAChart {
        /// Quantity that deviates, in words.
        reason: String,
    },
    /// Too many patches are clipped.
    #[error(
        "{clipped} of the 24 patches of the colour chart are clipped; {usable} patches are usable (14 are required), \
         {neutral} of them neutral (3 are required); reduce the exposure, or merge several exposures"
    )]
    ClippedChart {
        /// Number of clipped patches.
        clipped: usize,
        /// Number of usable patches.
        usable: usize,
        /// Number of usable neutral patches.
        neutral: usize,
    },
    /// No chart was detected.
    #[error("no 24-patch colour chart was reliably detected")]
    NoChart,
    /// More than one chart was detected.
    #[error("several colour charts were detected")]
    SeveralCharts,
}

impl ReferenceError {
    /// Returns suggestions, the most probable first.
    pub fn suggestions(&self) -> Vec<Suggestion> {
        match self {
            Self::NoChart | Self::SeveralCharts => vec![Suggestion::ChartCorners],
            Self::Clipped { .. } => vec![Suggestion::ClipLevel],
            Self::Overlap { .. } => vec![Suggestion::Outline, Suggestion::Mask],
            _ => Vec::new(),
        }
    }
}
