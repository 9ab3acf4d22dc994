//! Errors of brackets and responses.

use thiserror::Error;

/// Error that prevents exposures from being merged; each message says what to do about it.
/// Exposures are counted from 1 in the order given.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum BracketError {
    /// There is no exposure, or there are too many.
    #[error("a bracket of {count} exposures cannot be merged: give 1 to 64")]
    Count {
        /// Number of exposures.
        count: usize,
    },
    /// The pictures have no pixels.
    #[error("the exposures have no pixels: give others")]
    Empty,
    /// The amount of light of an exposure is not positive or not finite.
    #[error("exposure {exposure} has the time {amount}: give positive times")]
    Amount {
        /// Number of the exposure.
        exposure: usize,
        /// Amount of light given for it.
        amount: f64,
    },
    /// The pictures differ in size.
    #[error(
        "exposure {exposure} is {width}x{height} pixels and the first {first_width}x{first_height}: give pictures of \
         one size"
    )]
    Sizes {
        /// Number of the exposure that differs from the first.
        exposure: usize,
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// Columns of the first.
        first_width: usize,
        /// Rows of the first.
        first_height: usize,
    },
    /// Eight and sixteen bits are mixed in one bracket.
    #[error("exposure {exposure} has not as many bits a sample as the first: give all with 8 or all with 16")]
    Depths {
        /// Number of the exposure that differs from the first.
        exposure: usize,
    },
    /// A curve is not a response.
    #[error("the response curve of channel {channel} {problem}: a curve rises with the code and is finite")]
    Curve {
        /// Channel: red 1, green 2, blue 3.
        channel: usize,
        /// Problem of the curve.
        problem: &'static str,
    },
    /// The exposures do not determine the response.
    #[error(
        "the response cannot be recovered: {pixels} pixels are neither black nor clipped in two exposures of different \
         times, at least {least} are needed; take exposures closer to each other, or give the response"
    )]
    TooLittleOverlap {
        /// Number of informative pixels, in the channel that has fewest.
        pixels: usize,
        /// Least number that is needed.
        least: usize,
    },
    /// No curve explains the bracket.
    #[error(
        "no response curve explains the exposures: they differ by {percent:.0} % after the best one; check the times, \
         and that nothing moved or changed"
    )]
    NoResponse {
        /// Median disagreement, per cent.
        percent: f64,
    },
    /// The times contradict the pictures.
    #[error(
        "exposures {first} and {second} contradict their times: the pictures differ by a factor of {seen:.2}, the times \
         by {said:.2}; check the times, or the response"
    )]
    Times {
        /// Number of the exposure with the shorter time.
        first: usize,
        /// Number of the exposure with the next longer time.
        second: usize,
        /// Brightness of the second over the first.
        seen: f64,
        /// Brightness of the second over the first according to their times.
        said: f64,
    },
    /// Camera or scene moved.
    #[error(
        "the exposures do not show the same: {moved} of {compared} pixels disagree; camera, object or light moved, or \
         the response is another: take the bracket again from a tripod"
    )]
    Motion {
        /// Number of pixels whose exposures cannot have one radiance.
        moved: usize,
        /// Number of pixels that could be compared.
        compared: usize,
    },
    /// Every pixel is clipped in every exposure, or black in all.
    #[error(
        "nothing is known of any pixel: {clipped} are clipped in every exposure and {dark} black; expose otherwise"
    )]
    NothingKnown {
        /// Number of pixels that are clipped in all exposures.
        clipped: usize,
        /// Number of pixels that are black in all exposures.
        dark: usize,
    },
}
