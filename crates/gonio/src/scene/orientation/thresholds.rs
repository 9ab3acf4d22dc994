//! Thresholds of the test of a normal map, and the measurements behind them.
//!
//! Each value lies between those of correct and of wrong orders of channels on maps whose order is
//! known. The synthetic maps, all of 240 pixels, are a sphere, ellipsoids, a quarter of a sphere,
//! cylinders, a relief and the built-in shapes. The real maps are a ball, a goblet and a cat.
//! "Flipped" below means x or y alone, "swapped" x with y. Most of the synthetic maps were also
//! coded in 8, 6 and 5 bits, and given Gaussian noise of 0.02 to 0.2 in each channel. With noise of
//! 0.02, every wrong order of the whole objects is detected; with more noise, several corrections
//! remain, then none. No correct order was rejected at any noise.

use super::{AxisFault, AxisFit};

/// Largest share of normals that may face away under a suggested order, 0 to 1. Correct orders of
/// the real maps reach 0.009, from pixels at the rim.
pub(super) const MAX_AWAY: f64 = 0.02;

/// Share of normals facing away above which an order is wrong, 0 to 1. It is at least 0.99 with z
/// flipped, and 0.42 to 0.59 with another channel in place of z on whole objects.
pub(super) const GROSSLY_AWAY: f64 = 0.2;

/// Number of grid cells along the longer side of the object, at least one; closed paths follow the
/// squares of the grid. Smaller squares average less noise: with 48 cells, noise of 0.02 increases
/// the circulation of the correct order of the sphere from 0.20 to 0.40. Larger squares do not fit
/// into narrow objects: with 12 cells, the goblet has 6 squares instead of 63.
pub(super) const GRID_CELLS: usize = 24;

/// Smallest `z` of the normals along a path, 0 to 1: pixels cannot resolve steeper slopes. With
/// 0.1, the circulation of the correct order of the goblet increases from 0.03 to 0.23; with 0.6,
/// nearly half of its squares are lost.
pub(super) const MIN_Z: f64 = 0.3;

/// Smallest number of squares for a verdict, so that a few squares do not decide. The goblet, the
/// narrowest of the real objects, has 63.
pub(super) const MIN_SQUARES: usize = 20;

/// Smallest share of twist (of x along y) in the total bending of the slopes for a verdict, 0 to 1:
/// a surface without twist closes in any order. Conclusive shapes have 0.14 to 0.34, an upright
/// cylinder at most 0.02, from rounding to 5 bits.
pub(super) const MIN_TWIST: f64 = 0.05;

/// Circulation below which an order fits, 0 to 1. Correct orders reach 0.03, with 5 bits 0.11, with
/// noise of 0.02 0.31. Pure noise has about 0.7 in any order, as does a noisy cylinder.
pub(super) const CLOSED: f64 = 0.35;

/// Circulation above which an order is wrong, 0 to 1. Flipped maps have 1.00, with noise of 0.05 at
/// least 0.81. Pure noise also exceeds the threshold, but no correction of noise fits.
pub(super) const OPEN: f64 = 0.65;

/// Smallest difference between the circulation of a wrong order and that of its correction. Orders
/// of pure noise differ by 0.03, those of a noisy cylinder by up to 0.33; a flip differs by at
/// least 0.64 with noise of 0.02.
pub(super) const MIN_CIRCULATION_GAIN: f64 = 0.4;

/// Largest increase in circulation by a correction for which the rim is the only evidence. The
/// correction of swapped maps decreases the circulation by 0.27 or more; with noise of 0.02 it
/// leaves the circulation unchanged in the worst case, which requires this slack.
pub(super) const SLACK: f64 = 0.05;

/// Difference in circulation within which the rim decides between orders that fit. A hill and its
/// hollow have the same circulation; any other order has at least 0.18 more.
pub(super) const TIED: f64 = 0.1;

/// Half side, in pixels, of the window whose centre of mass gives the outward direction of the
/// outline; at least one. Sizes from 2 to 8 give cosines within 0.02, but with 8 the goblet falls
/// below `ALONG`.
pub(super) const REACH: usize = 4;

/// Smallest sine of the angle between normal and view for a pixel of the outline to belong to a
/// rim, 0 to 1. It excludes edges where an object is cut off: on the quarter of a sphere, 0.5 makes
/// the cosine of the correct order 0.62 instead of 0.78. A higher value loses blurred rims: 0.95
/// leaves 909 instead of 1,164 pixels of the goblet.
pub(super) const RIM_TILT: f64 = 0.8;

/// Smallest number of pixels of a rim for a verdict. Whole objects have 399 to 1,164.
pub(super) const MIN_RIM_PIXELS: usize = 40;

/// Smallest share of these pixels in the outline within the picture, 0 to 1. Whole objects have at
/// least 0.79, a quarter of a sphere 0.54.
pub(super) const RIM_SHARE: f64 = 0.4;

/// Mean absolute cosine between the normals at a rim and the outward direction above which an order
/// is correct, 0 to 1. Correct orders of whole objects have at least 0.97, except the goblet with
/// 0.91.
pub(super) const ALONG: f64 = 0.9;

/// Mean absolute cosine below which an order is wrong, 0 to 1. Flipped objects have 0.70 to 0.80,
/// swapped ones 0.44 to 0.58. The correct order of the quarter of a sphere has 0.78, but no
/// correction of it reaches `ALONG`.
pub(super) const ACROSS: f64 = 0.8;

/// Difference in mean cosine above which orders whose normals point less outwards are dropped in
/// favour of the order of a rounder object, 0 to 2. A hill and its hollow differ by at least 1.44.
pub(super) const ROUNDER: f64 = 0.3;

/// Returns the most reliable evidence that an order is wrong, if there is any.
pub(super) fn fault(given: &AxisFit) -> Option<AxisFault> {
    if given.back_facing > GROSSLY_AWAY {
        return Some(AxisFault::Away);
    }
    if given.circulation.is_some_and(|c| c > OPEN) {
        return Some(AxisFault::Open);
    }
    given.rim.is_some_and(|r| r.1 < ACROSS).then_some(AxisFault::Across)
}

/// Whether an order removes the fault of the given one and makes nothing worse.
pub(super) fn mends(fault: AxisFault, given: &AxisFit, other: &AxisFit) -> bool {
    let gain = other.gain_over(given);
    let mended = match fault {
        AxisFault::Away => true,
        AxisFault::Open => gain.is_some_and(|gain| gain > MIN_CIRCULATION_GAIN),
        AxisFault::Across => other.rim.is_some_and(|r| r.1 > ALONG) && gain.is_none_or(|gain| gain > -SLACK),
    };
    mended && other.back_facing <= MAX_AWAY && other.circulation.is_some_and(|c| c < CLOSED)
}
