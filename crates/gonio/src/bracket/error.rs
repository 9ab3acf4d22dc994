//! Errors of brackets and responses.

use thiserror::Error;

use crate::suggestion::Suggestion;

/// Error that prevents exposures from being merged.
///
/// Exposures are numbered from 1 in the given order.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum BracketError {
    /// There is no exposure, or there are too many.
    #[error("cannot merge {count} exposures; use 1 to 64")]
    Count {
        /// Number of exposures.
        count: usize,
    },
    /// The pictures have no pixels.
    #[error("the exposures have no pixels; use other files")]
    Empty,
    /// The amount of light of an exposure is not positive or not finite.
    #[error("exposure {exposure} has the time {amount}; use positive times")]
    Amount {
        /// Number of the exposure.
        exposure: usize,
        /// Amount of light given for it.
        amount: f64,
    },
    /// The pictures differ in size.
    #[error(
        "exposure {exposure} is {width}x{height} pixels, but the first is {first_width}x{first_height}; use images \
         of the same size"
    )]
    Sizes {
        /// Number of the exposure that differs from the first.
        exposure: usize,
        /// Number of its columns.
        width: usize,
        /// Number of its rows.
        height: usize,
        /// Number of columns of the first exposure.
        first_width: usize,
        /// Number of rows of the first exposure.
        first_height: usize,
    },
    /// Eight and sixteen bits are mixed in one bracket.
    #[error("exposure {exposure} has another bit depth than the first; use only 8-bit or only 16-bit images")]
    Depths {
        /// Number of the exposure that differs from the first.
        exposure: usize,
    },
    /// A curve is not a response.
    #[error("the response curve of channel {channel} {problem}; use a finite curve that increases with the code")]
    Curve {
        /// Channel: red 1, green 2, blue 3.
        channel: usize,
        /// Problem of the curve.
        problem: &'static str,
    },
    /// The exposures do not determine the response.
    #[error(
        "the response curve cannot be recovered: only {pixels} pixels are neither black nor clipped in two \
         exposures of different times, {least} are required; use exposures with closer times"
    )]
    TooLittleOverlap {
        /// Number of informative pixels, in the first channel that has too few.
        pixels: usize,
        /// Required number.
        least: usize,
    },
    /// All exposures have the same time.
    #[error("the exposures have the same time, so they do not determine the response curve")]
    EqualTimes,
    /// No curve explains the bracket.
    #[error(
        "no response curve explains the exposures: the best curve leaves a median difference of {percent:.0} %; check the \
         times, and that camera, scene and light did not change"
    )]
    NoResponse {
        /// Median disagreement, in per cent.
        percent: f64,
    },
    /// The times contradict the pictures.
    #[error(
        "exposures {first} and {second} contradict their times: the images differ by a factor of {measured:.2}, the \
         times by {stated:.2}; check the times"
    )]
    Times {
        /// Number of the exposure with the shorter time.
        first: usize,
        /// Number of the exposure with the next longer time.
        second: usize,
        /// Brightness of the second over the first.
        measured: f64,
        /// Brightness of the second over the first according to their times.
        stated: f64,
    },
    /// Camera or scene moved.
    #[error(
        "the exposures are inconsistent: {moved} of {compared} pixels disagree; possible causes are motion and a \
         wrong response curve; take the exposures again with a tripod"
    )]
    Motion {
        /// Number of pixels whose exposures no single radiance explains.
        moved: usize,
        /// Number of pixels that could be compared.
        compared: usize,
    },
    /// Every pixel is clipped in every exposure, or black in all.
    #[error(
        "no pixel has a valid exposure: {clipped} are clipped in all exposures and {dark} are black; use other \
         exposure times"
    )]
    NothingKnown {
        /// Number of pixels that are clipped in all exposures.
        clipped: usize,
        /// Number of pixels that are black in all exposures.
        dark: usize,
    },
}

impl BracketError {
    /// Returns suggestions to the user, the most probable first.
    pub fn suggestions(&self) -> Vec<Suggestion> {
        match self {
            Self::EqualTimes => vec![Suggestion::Times, Suggestion::Response],
            Self::TooLittleOverlap { .. } => vec![Suggestion::Response],
            Self::NoResponse { .. } => vec![Suggestion::Times, Suggestion::Response],
            Self::Times { .. } => vec![Suggestion::Times, Suggestion::TrustTimes],
            Self::Motion { .. } => vec![Suggestion::TrustTimes],
            _ => Vec::new(),
        }
    }

    /// Whether exposures contradict each other or their times.
    pub(super) fn is_contradiction(&self) -> bool {
        matches!(self, Self::NoResponse { .. } | Self::Times { .. } | Self::Motion { .. })
    }
}
