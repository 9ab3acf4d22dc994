//! Status of each pixel: used, or ignored with a reason.

use glam::Vec3;

use super::foreign::{Underlay, foreign};
use super::observed::{clip_level, is_clipped};
use super::outliers::outliers;
use super::{ObservationReport, ObservationSettings, SceneError};
use crate::picture::{Plane, luminance};

/// Status of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Fate {
    /// The pixel is not on the object, not within the circle, or seen at too steep an angle.
    #[default]
    Outside,
    /// The pixel is valid and may be observed.
    Used,
    /// A channel is at or above the clip level.
    Clipped,
    /// The luminance is negative, or zero because a channel is negative.
    Negative,
    /// A channel is NaN or infinite.
    NotFinite,
    /// A channel differs from the pixels around it by far more than noise and structure explain: a
    /// hot or dead pixel, or a firefly.
    Outlier,
    /// The pixel belongs to a region of another colour than the rest of the object.
    OtherColour,
    /// The surface ends, steps back or folds next to the pixel.
    Edge,
    /// The pixel is far darker than all its neighbours.
    Speck,
    /// The pixel is on the object but has no valid normal.
    NoNormal,
}

impl Fate {
    /// Whether the value of the pixel is invalid.
    pub(crate) fn is_faulty(self) -> bool {
        matches!(self, Self::Negative | Self::NotFinite | Self::Outlier)
    }

    /// Returns the fault of a colour, if any.
    ///
    /// A channel may be negative while the luminance is positive. Colours outside the gamut of a
    /// file's primaries and the ringing of a resampler produce such pixels, and their luminance is
    /// correct. Zero in all channels is valid black: renderings of dark metals have it wherever the
    /// light is black. No surface has negative luminance.
    pub(crate) fn fault(colour: Vec3) -> Option<Self> {
        if !colour.is_finite() {
            Some(Self::NotFinite)
        } else if luminance(colour) > 0.0 || colour == Vec3::ZERO {
            None
        } else {
            Some(Self::Negative)
        }
    }
}

/// Status of all pixels, with counts.
pub(super) struct Judged {
    pub(super) fates: Plane<Fate>,
    /// Report with the counts of pixels filled in.
    pub(super) report: ObservationReport,
}

/// Determines the status of the pixels of `region`.
///
/// They are on the object and not seen at too steep an angle. `report` contains the counts that
/// only the caller can provide.
///
/// # Errors
/// [`SceneError::BadPixels`] if more than half of the pixels are faulty.
pub(super) fn judge(
    rgb: &Plane<Vec3>,
    region: &Plane<bool>,
    settings: &ObservationSettings,
    underlay: &Underlay<'_>,
    report: ObservationReport,
) -> Result<Judged, SceneError> {
    let (width, height) = rgb.size();
    let fate = |(&colour, &inside): (&Vec3, &bool)| match inside {
        true => Fate::fault(colour).unwrap_or(Fate::Used),
        false => Fate::Outside,
    };
    let fates: Vec<Fate> = rgb.as_slice().iter().zip(region.as_slice()).map(fate).collect();
    let mut fates = Plane::from_vec(width, height, fates);
    let sound = fates.map(|fate| *fate == Fate::Used);
    let outliers = outliers(rgb, &sound);
    for pixel in outliers.excluded {
        fates.as_mut_slice()[pixel] = Fate::Outlier;
    }
    let sound = fates.map(|fate| *fate == Fate::Used);
    let clip_level = clip_level(rgb, &sound, settings.clip);
    for (fate, colour) in fates.as_mut_slice().iter_mut().zip(rgb.as_slice()) {
        if matches!(fate, Fate::Used | Fate::Negative | Fate::Outlier) && is_clipped(*colour, clip_level) {
            *fate = Fate::Clipped;
        }
    }
    if !settings.keep_colours
        && let Some(other) = foreign(rgb, &|at| fates[at] == Fate::Used, underlay)
    {
        for (fate, other) in fates.as_mut_slice().iter_mut().zip(other.as_slice()) {
            if *other && *fate == Fate::Used {
                *fate = Fate::OtherColour;
            }
        }
    }
    let count = |which: Fate| fates.as_slice().iter().filter(|fate| **fate == which).count();
    let tainted = |(fate, colour): &(&Fate, &Vec3)| **fate == Fate::Used && colour.min_element() < 0.0;
    let report = ObservationReport {
        observed_pixels: region.as_slice().iter().filter(|inside| **inside).count(),
        clipped_pixels: count(Fate::Clipped),
        clip_level,
        negative: count(Fate::Negative),
        not_finite: count(Fate::NotFinite),
        outliers: count(Fate::Outlier),
        isolated: outliers.kept,
        negative_channels: fates.as_slice().iter().zip(rgb.as_slice()).filter(tainted).count(),
        other_colour_pixels: count(Fate::OtherColour),
        ..report
    };
    if 2 * (report.negative + report.not_finite) > report.observed_pixels {
        return Err(SceneError::bad_pixels(&report));
    }
    Ok(Judged { fates, report })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_depend_on_the_luminance() {
        for (colour, want) in [
            (Vec3::ONE, None),
            (Vec3::new(1.0, -0.1, 0.3), None),
            (Vec3::ZERO, None),
            (-Vec3::ZERO, None),
            (Vec3::new(0.1, -1.0, 0.1), Some(Fate::Negative)),
            (Vec3::splat(-1e-6), Some(Fate::Negative)),
            (Vec3::new(1.0, 1.0, f32::NAN), Some(Fate::NotFinite)),
            (Vec3::new(1.0, f32::INFINITY, 1.0), Some(Fate::NotFinite)),
            (Vec3::new(f32::NEG_INFINITY, 1.0, 1.0), Some(Fate::NotFinite)),
        ] {
            assert_eq!(Fate::fault(colour), want, "{colour}");
        }
    }

    #[test]
    fn rejects_pictures_with_more_than_half_of_the_pixels_faulty() {
        let region = Plane::from_fn(40, 40, |_, _| true);
        let underlay = Underlay { normal: &|_| Vec3::Z, convex: true };
        let judged = |faulty: usize| {
            let value = |x, y| if 40 * y + x < faulty { f32::NAN } else { 1.0 + 0.01 * x as f32 };
            let rgb = Plane::from_fn(40, 40, |x, y| Vec3::splat(value(x, y)));
            judge(&rgb, &region, &ObservationSettings::default(), &underlay, ObservationReport::default())
        };
        assert_eq!(judged(800).unwrap().report.not_finite, 800);
        let refused = judged(801).err().unwrap();
        assert_eq!(refused, SceneError::BadPixels { negative: 0, not_finite: 801, observed: 1600 });
    }
}
