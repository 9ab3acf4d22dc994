//! Brackets: several exposures of a still scene, as coded by a camera, merged into one picture of
//! linear radiance.
//!
//! An [`Exposure`] contains integer codes and the amount of light. A [`Response`] contains the
//! exposure that each code represents; [`Response::recover`] estimates it from the bracket itself.
//! [`merge()`] aligns the exposures, corrects their gains and veiling glare, and weights the
//! exposures of each pixel by the precision with which their codes determine the radiance. It
//! returns the status of each pixel: see [`MergedPixelStatus`].

mod align;
mod consistency;
mod error;
mod flicker;
mod frame;
mod merge;
mod pixels;
mod recover;
mod response;
mod table;
#[cfg(test)]
mod tests;

pub use error::BracketError;
pub use frame::ExposureCorrection;
pub use merge::{MergeReport, MergeSettings, Merged, MergedPixelStatus, merge};
pub use response::Response;

use crate::picture::Plane;

/// Largest number of exposures in a bracket.
pub const MAX_EXPOSURES: usize = 64;

/// Codes of a picture: red, green and blue of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub enum Codes {
    /// Codes from 0 to 255.
    Eight(Plane<[u8; 3]>),
    /// Codes from 0 to 65535.
    Sixteen(Plane<[u16; 3]>),
}

impl Codes {
    /// Returns the numbers of columns and rows.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Eight(plane) => plane.size(),
            Self::Sixteen(plane) => plane.size(),
        }
    }

    /// Returns the largest code: 255 or 65535.
    pub fn max(&self) -> u16 {
        match self {
            Self::Eight(_) => u16::from(u8::MAX),
            Self::Sixteen(_) => u16::MAX,
        }
    }

    /// Returns the codes of the pixel at this index, row by row from the top.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn at(&self, index: usize) -> [u16; 3] {
        match self {
            Self::Eight(plane) => plane.as_slice()[index].map(u16::from),
            Self::Sixteen(plane) => plane.as_slice()[index],
        }
    }
}

/// One picture of a bracket.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposure {
    /// Codes of each pixel.
    pub codes: Codes,
    /// Amount of light, on any scale common to the bracket: the exposure time in seconds, if
    /// necessary times sensitivity and aperture. Positive.
    pub amount: f64,
}

/// Checks that all pictures have one size and depth, and positive amounts of light.
fn check(exposures: &[Exposure]) -> Result<(), BracketError> {
    let Some(first) = exposures.first() else { return Err(BracketError::Count { count: 0 }) };
    if exposures.len() > MAX_EXPOSURES {
        return Err(BracketError::Count { count: exposures.len() });
    }
    for (i, exposure) in exposures.iter().enumerate() {
        if !(exposure.amount.is_finite() && exposure.amount > 0.0) {
            return Err(BracketError::Amount { exposure: i + 1, amount: exposure.amount });
        }
        let ((width, height), (first_width, first_height)) = (exposure.codes.size(), first.codes.size());
        if (width, height) != (first_width, first_height) {
            return Err(BracketError::Sizes { exposure: i + 1, width, height, first_width, first_height });
        }
        if exposure.codes.max() != first.codes.max() {
            return Err(BracketError::Depths { exposure: i + 1 });
        }
    }
    if first.codes.size().0 * first.codes.size().1 == 0 {
        return Err(BracketError::Empty);
    }
    Ok(())
}
