//! Thresholds of the test of a normal map, and the measurements behind them.

use serde::{Deserialize, Serialize};

use super::{Fault, Fit};

/// Settings of the test of a normal map's channels.
///
/// The values lie between what right and what wrong orders of channels reach on maps whose order is
/// known: a sphere, ellipsoids, a quarter of a sphere, cylinders, a relief and the built-in shapes,
/// all of 240 pixels; a real ball, goblet and cat. "Flipped" below means x or y alone, "swapped" x
/// with y. Most of the made-up maps were also coded in 8, 6 and 5 bits, and given Gaussian noise of
/// 0.02 to 0.2 in each channel. With 0.02 every wrong order of the whole objects is named; with
/// more there come to be several corrections, then none. No right order was blamed at any noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrientationSettings {
    /// Share of normals that may face away under an order that is offered, 0 to 1. Right orders of
    /// the real maps leave up to 0.009, from pixels at the rim.
    pub most_away: f64,
    /// Share of normals facing away above which an order is wrong, 0 to 1. It is at least 0.99 with
    /// z flipped, and 0.42 to 0.59 with another channel in place of z on whole objects.
    pub grossly_away: f64,
    /// Number of grid cells along the longer side of the object, at least one; closed paths go
    /// around squares of the grid. Smaller squares average less noise: with 48 cells noise of 0.02
    /// brings the right order of the sphere from a circulation of 0.20 to 0.40. Larger ones do not
    /// fit into narrow objects: with 12 cells the goblet has 6 squares instead of 63.
    pub cells: usize,
    /// Least `z` of a normal, 0 to 1, on a path that counts: pixels cannot resolve steeper slopes.
    /// With 0.1 the circulation of the right order of the goblet rises from 0.03 to 0.23; with 0.6
    /// nearly half of its squares are lost.
    pub least_z: f64,
    /// Least number of squares for a verdict, so that no few of them decide. The goblet, the
    /// narrowest of the real objects, has 63.
    pub fewest_squares: usize,
    /// Least share of the twist of the slopes (of x along y) in all bending for a verdict, 0 to 1:
    /// a surface without twist closes in any order. Shapes that tell have 0.14 to 0.34, an upright
    /// cylinder at most 0.02, from rounding to 5 bits.
    pub least_twist: f64,
    /// Circulation below which an order fits, 0 to 1. Right orders reach 0.03, with 5 bits 0.11,
    /// with noise of 0.02 0.31. Pure noise has about 0.7 in any order, a noisy cylinder too.
    pub closed: f64,
    /// Circulation above which an order is wrong, 0 to 1. Flipped maps have 1.00, with noise of
    /// 0.05 at least 0.81. Pure noise exceeds it too, but no correction of noise fits.
    pub open: f64,
    /// Least difference between the circulation of a wrong order and that of its correction. Orders
    /// of pure noise differ by 0.03, those of a noisy cylinder by up to 0.33; a flip differs by at
    /// least 0.64 with noise of 0.02.
    pub apart: f64,
    /// Circulation by which a correction that the rim alone asks for may be worse than the given
    /// order. For swapped maps it is better by 0.27 or more, and as good in the worst case with
    /// noise of 0.02, for which the slack is.
    pub slack: f64,
    /// Difference in circulation within which orders that fit are left to the rim. A hill and its
    /// hollow have the same; any other order has at least 0.18 more.
    pub tied: f64,
    /// Half side, in pixels, of the window whose centre of mass gives the direction out of the
    /// outline; at least one. Any from 2 to 8 gives cosines within 0.02, but 8 takes the goblet
    /// below `along`.
    pub reach: usize,
    /// Least sine of the angle between normal and view for a pixel of the outline to belong to a
    /// rim, 0 to 1. It leaves out where an object is cut off: on the quarter of a sphere 0.5 makes
    /// the cosine of the right order 0.62 instead of 0.78. A higher one loses blurred rims: 0.95
    /// leaves 909 instead of 1,164 pixels of the goblet.
    pub rim_tilt: f64,
    /// Least number of pixels of a rim for a verdict. Whole objects have 399 to 1,164.
    pub fewest_at_rim: usize,
    /// Least share of them in the outline within the picture, 0 to 1. Whole objects have at least
    /// 0.79, a quarter of a sphere 0.54.
    pub rim_share: f64,
    /// Mean absolute cosine between normals at a rim and the direction out of it above which an
    /// order is right, 0 to 1. Right orders of whole objects have 0.91 (the goblet), all others at
    /// least 0.97.
    pub along: f64,
    /// The same below which an order is wrong. Flipped objects have 0.70 to 0.80, swapped ones 0.44
    /// to 0.58. The right order of the quarter of a sphere has 0.78, but no correction of it
    /// reaches `along`.
    pub across: f64,
    /// Difference in mean cosine by which orders whose normals point less outwards give way to that
    /// of a rounder object, 0 to 2. A hill and its hollow differ by at least 1.44.
    pub rounder: f64,
}

impl Default for OrientationSettings {
    fn default() -> Self {
        Self {
            most_away: 0.02,
            grossly_away: 0.2,
            cells: 24,
            least_z: 0.3,
            fewest_squares: 20,
            least_twist: 0.05,
            closed: 0.35,
            open: 0.65,
            apart: 0.4,
            slack: 0.05,
            tied: 0.1,
            reach: 4,
            rim_tilt: 0.8,
            fewest_at_rim: 40,
            rim_share: 0.4,
            along: 0.9,
            across: 0.8,
            rounder: 0.3,
        }
    }
}

impl OrientationSettings {
    /// Returns what shows that an order is wrong, the surest evidence first.
    pub(super) fn fault(&self, given: &Fit) -> Option<Fault> {
        if given.away > self.grossly_away {
            return Some(Fault::Away);
        }
        if given.circulation.is_some_and(|c| c > self.open) {
            return Some(Fault::Open);
        }
        given.rim.is_some_and(|r| r.1 < self.across).then_some(Fault::Across)
    }

    /// Whether an order mends the fault of the given one and makes nothing worse.
    pub(super) fn mends(&self, fault: Fault, given: &Fit, other: &Fit) -> bool {
        let gain = other.gain_over(given);
        let mended = match fault {
            Fault::Away => true,
            Fault::Open => gain.is_some_and(|gain| gain > self.apart),
            Fault::Across => other.rim.is_some_and(|r| r.1 > self.along) && gain.is_none_or(|gain| gain > -self.slack),
        };
        mended && other.away <= self.most_away && other.circulation.is_some_and(|c| c < self.closed)
    }
}
