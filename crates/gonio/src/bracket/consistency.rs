//! Consistency of exposures: whether one radiance explains all codes of a pixel.

use super::frame::Frame;
use super::table::Table;

/// Tolerance of the logarithm of the radiance, in addition to that of the codes.
const TOLERANCE: f64 = 0.08;

/// Whether no radiance explains the codes of one channel of a pixel.
///
/// `codes` contains a frame and its code for each exposure that shows the pixel. Returns `None` if
/// there is nothing to compare.
pub(super) fn disagree(codes: &[(&Frame<'_>, u16)], channel: usize, table: &Table) -> Option<bool> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    let mut known = false;
    for &(frame, code) in codes {
        let (from, to) = table.bounds(code);
        let log_radiance = |log: f64| {
            let veil = frame.correction.veiling_glare[channel];
            let log = if veil == 0.0 { log } else { (log.exp() - veil).max(0.0).ln() };
            log - frame.amount(channel).ln()
        };
        low = low.max(log_radiance(from) - TOLERANCE);
        high = high.min(log_radiance(to) + TOLERANCE);
        known |= table.is_known(code);
    }
    (codes.len() > 1 && known).then_some(low > high)
}
