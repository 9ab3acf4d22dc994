//! An exposure with its corrections: alignment, gain and veiling glare.

use super::{Codes, Exposure};

/// Correction of an exposure relative to the others of its bracket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureCorrection {
    /// Columns and rows by which the scene is displaced relative to the first exposure, in pixels.
    pub shift: (i32, i32),
    /// Factor of each channel's amount of light: 1 if the exposure time is exact and the light
    /// does not flicker.
    pub gain: [f64; 3],
    /// Additional light of each channel, in units of the response: veiling glare.
    pub veiling_glare: [f64; 3],
}

impl ExposureCorrection {
    /// No correction.
    pub const NONE: Self = Self { shift: (0, 0), gain: [1.0; 3], veiling_glare: [0.0; 3] };
}

/// An exposure with its correction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<'a> {
    codes: &'a Codes,
    /// Index of the exposure in its bracket.
    pub(super) index: usize,
    /// Amount of light by the exposure time.
    pub(super) nominal: f64,
    pub(super) correction: ExposureCorrection,
}

impl<'a> Frame<'a> {
    pub(super) fn new(exposures: &'a [Exposure], index: usize, shift: (i32, i32)) -> Self {
        let Exposure { codes, amount } = &exposures[index];
        Self { codes, index, nominal: *amount, correction: ExposureCorrection { shift, ..ExposureCorrection::NONE } }
    }

    /// Returns the codes that show pixel `index` of the first exposure; `None` outside the picture.
    pub(super) fn at(&self, index: usize) -> Option<[u16; 3]> {
        let (dx, dy) = self.correction.shift;
        if (dx, dy) == (0, 0) {
            return Some(self.codes.at(index));
        }
        let (width, height) = self.codes.size();
        let moved = |at: usize, by: i32, most: usize| at.checked_add_signed(by as isize).filter(|at| *at < most);
        let (x, y) = (moved(index % width, dx, width)?, moved(index / width, dy, height)?);
        Some(self.codes.at(y * width + x))
    }

    /// Returns the corrected amount of light of a channel.
    pub(super) fn amount(&self, channel: usize) -> f64 {
        self.nominal * self.correction.gain[channel]
    }

    /// Returns the exposure of a channel that the scene caused, given that of its code.
    pub(super) fn without_veil(&self, exposure: f64, channel: usize) -> f64 {
        exposure - self.correction.veiling_glare[channel]
    }

    pub(super) fn size(&self) -> (usize, usize) {
        self.codes.size()
    }

    pub(super) fn max(&self) -> u16 {
        self.codes.max()
    }
}
