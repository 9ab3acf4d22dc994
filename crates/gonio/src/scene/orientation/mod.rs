//! Checks the order and signs of the channels of a normal map: x right, y up, z towards the camera.
//!
//! The normals of any surface have three properties:
//! * visible normals face the camera: z is positive;
//! * the slopes are integrable: they sum to zero around any closed path. This determines the sign
//!   of y relative to x, but does not distinguish a hill from a hollow (x and y both flipped);
//! * at the rim of a rounded object, the normals are perpendicular to the outline: they point out
//!   of the object or, in a hollow, into it.
//!
//! Each property can prove that an order is wrong. A hill and a hollow remain ambiguous; in this
//! case the order of the rounder object is suggested.

mod evidence;
#[cfg(test)]
mod tests;
mod thresholds;

use glam::Vec3;
use thiserror::Error;

use self::evidence::Evidence;
use self::thresholds::{ROUNDER, TIED, fault, mends};
use super::observed::check_size;
use super::{Correction, SceneError};
use crate::picture::Plane;
use crate::suggestion::Suggestion;

/// Fit of an order of channels to a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisFit {
    /// Share of normals that face away from the camera, 0 to 1.
    pub back_facing: f64,
    /// Relative sum of the slopes around closed paths, 0 (a surface) to 1; `None` without evidence:
    /// too few pixels, or a shape such as an upright cylinder.
    pub circulation: Option<f64>,
    /// Mean cosine, at the rim, between the normals and the direction out of the object, -1 (a
    /// hollow) to 1 (a round object), and the mean of its absolute value. `None` without a rim.
    pub rim: Option<(f64, f64)>,
}

impl AxisFit {
    fn outwards(&self) -> Option<f64> {
        self.rim.map(|r| r.0)
    }

    /// Returns the circulation of another order minus that of this one.
    fn gain_over(&self, other: &Self) -> Option<f64> {
        Some(other.circulation? - self.circulation?)
    }
}

/// Evidence that an order is wrong.
#[derive(Clone, Copy, Debug)]
pub(crate) enum AxisFault {
    /// Many normals face away from the camera.
    Away,
    /// The slopes do not integrate to a surface.
    Open,
    /// Normals at the rim are not perpendicular to the outline.
    Across,
}

/// Verdict on the order of the channels of a normal map.
#[derive(Clone, Debug)]
pub(crate) struct Orientation {
    /// Fit of the given order.
    pub given: AxisFit,
    /// Evidence that the given order is wrong, whether or not a correction fits.
    pub fault: Option<AxisFault>,
    /// Corrections that fit, the most common first, if the given order clearly does not; otherwise
    /// empty. There are several if they cannot be distinguished, such as x or y flipped on a relief
    /// without a rim.
    pub corrections: Vec<Correction>,
}

impl Orientation {
    /// Tests the order of the channels of a normal map.
    ///
    /// Only pixels with a `coverage` of at least one half are tested, or all pixels without it.
    /// Normals that have length zero or are not finite count as missing.
    ///
    /// The verdict is cautious: no correction is suggested without evidence, or if the shape
    /// explains the normals as well as an error would.
    ///
    /// # Errors
    /// [`SceneError::Sizes`]; [`SceneError::NoNormals`].
    pub(crate) fn of(normals: &Plane<Vec3>, coverage: Option<&Plane<f32>>) -> Result<Self, SceneError> {
        if let Some(coverage) = coverage {
            check_size("mask", coverage.size(), normals.size())?;
        }
        let surface = Plane::from_fn(normals.width(), normals.height(), |x, y| {
            let covered = coverage.is_none_or(|c| c[(x, y)] >= 0.5);
            normals[(x, y)].as_dvec3().try_normalize().filter(|_| covered)
        });
        let evidence = Evidence::of(&surface).ok_or(SceneError::NoNormals)?;
        let given = evidence.fit(Correction::default());
        let fault = fault(&given);
        let Some(contradicting) = fault else { return Ok(Self { given, fault, corrections: Vec::new() }) };
        let all = Correction::all().into_iter().map(|c| (c, evidence.fit(c)));
        let mut fitting: Vec<(Correction, AxisFit)> =
            all.filter(|(_, fit)| mends(contradicting, &given, fit)).collect();
        let least = fitting.iter().filter_map(|f| f.1.circulation).fold(f64::INFINITY, f64::min);
        fitting.retain(|f| f.1.circulation.is_some_and(|c| c < least + TIED));
        // The rim decides among the remaining orders if every one of them has a rim.
        let outwards = fitting.iter().map(|f| f.1.outwards()).collect::<Option<Vec<f64>>>();
        if let Some(best) = outwards.and_then(|r| r.into_iter().reduce(f64::max)) {
            fitting.retain(|f| f.1.outwards().is_some_and(|r| r > best - ROUNDER));
        }
        Ok(Self { given, fault, corrections: fitting.iter().map(|f| f.0).collect() })
    }

    /// Returns what contradicts the given order; `None` if the order is or may be correct.
    pub(crate) fn contradiction(&self) -> Option<Contradiction> {
        let first = self.corrections.first()?;
        let why = match self.fault? {
            AxisFault::Away => format!("{:.0} % of them face away from the camera", 100.0 * self.given.back_facing),
            AxisFault::Open => {
                format!("their slopes are not integrable (error {:.0} %)", 100.0 * self.given.circulation?)
            }
            AxisFault::Across => "they do not point outwards at the outline".to_owned(),
        };
        let complaint = format!("the normals seem to have {}: {why}", first.words());
        Some(Contradiction { complaint, corrections: self.corrections.iter().take(3).copied().collect() })
    }
}

/// Contradiction within the given normals.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{complaint}")]
pub struct Contradiction {
    complaint: String,
    /// Corrections that resolve it, the most probable first.
    corrections: Vec<Correction>,
}

impl Contradiction {
    /// Returns [`Suggestion::NormalAxes`].
    pub fn suggestion(&self) -> Suggestion {
        Suggestion::NormalAxes(self.corrections.clone())
    }
}
