//! What can be wrong with a bracket or a response.

use thiserror::Error;

/// Why exposures cannot be merged; each says what to do about it. Exposures are counted from 1 as
/// they were given.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum BracketError {
    /// No exposure, or too many.
    #[error("a bracket of {count} exposures cannot be merged: give 1 to 64")]
    Count {
        /// Number of exposures.
        count: usize,
    },
    /// A picture without pixels.
    #[error("the exposures have no pixels: give others")]
    Empty,
    /// An exposure that took in no light, or no finite amount.
    #[error("exposure {exposure} has the time {amount}: give positive times")]
    Amount {
        /// Which one.
        exposure: usize,
        /// What it is said to have taken in.
        amount: f64,
    },
    /// Pictures of different sizes.
    #[error(
        "exposure {exposure} is {width}x{height} pixels and the first {first_width}x{first_height}: give pictures of \
         one size"
    )]
    Sizes {
        /// The one that differs from the first.
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
    /// Eight and sixteen bits in one bracket.
    #[error("exposure {exposure} has not as many bits a sample as the first: give all with 8 or all with 16")]
    Depths {
        /// The one that differs from the first.
        exposure: usize,
    },
    /// A curve that is no response.
    #[error("the response curve of channel {channel} {problem}: a curve rises with the code and is finite")]
    Curve {
        /// Red 1, green 2, blue 3.
        channel: usize,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// The exposures do not tell the response.
    #[error(
        "the response cannot be recovered: {pixels} pixels are neither black nor clipped in two exposures of different \
         times, at least {least} are needed; take exposures closer to each other, or give the response"
    )]
    TooLittleOverlap {
        /// Pixels that tell something, in the channel that has fewest.
        pixels: usize,
        /// Least number.
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
        /// The one with the shorter time.
        first: usize,
        /// The one with the next longer time.
        second: usize,
        /// Brightness of the second over the first.
        seen: f64,
        /// The same according to their times.
        said: f64,
    },
    /// Camera or scene moved.
    #[error(
        "the exposures do not show the same: {moved} of {compared} pixels disagree; camera, object or light moved, or \
         the response is another: take the bracket again from a tripod"
    )]
    Motion {
        /// Pixels whose exposures cannot have one radiance.
        moved: usize,
        /// Pixels that could be compared.
        compared: usize,
    },
    /// Every pixel is clipped in every exposure, or black in all.
    #[error(
        "nothing is known of any pixel: {clipped} are clipped in every exposure and {dark} black; expose otherwise"
    )]
    NothingKnown {
        /// Pixels that are clipped in all.
        clipped: usize,
        /// Pixels that are black in all.
        dark: usize,
    },
}
