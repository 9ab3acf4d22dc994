//! Status of each pixel: used, or ignored with a reason.

use glam::Vec3;

use super::cells::SurfaceGeometry;
use super::observed::{clip_level, is_clipped};
use super::outliers::outliers;
use super::paint_segmentation::segment_paint;
use super::pattern::{Pattern, segment_pattern};
use super::{ObservationReport, ObservationSettings, SceneError};
use crate::picture::{Plane, luminance};

/// Status of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum PixelStatus {
    /// The pixel is not on the object, not within the circle, or seen at too steep an angle.
    #[default]
    Outside,
    /// The pixel is valid and may be observed.
    Used,
    /// The pixel shows a second paint, and its value is converted to the first one.
    Converted,
    /// A channel is at or above the clip level.
    Clipped,
    /// The luminance is negative, or zero because a channel is negative.
    Negative,
    /// A channel is NaN or infinite.
    NotFinite,
    /// A channel differs from the pixels around it by far more than noise and structure explain: a
    /// hot or dead pixel, or a firefly.
    Outlier,
    /// The pixel belongs to a region of another colour, or to the smaller part of a pattern of two
    /// paints, and is not converted.
    OtherColour,
    /// The surface ends, steps back or folds next to the pixel.
    Edge,
    /// The pixel is far darker than all its neighbours.
    Speck,
    /// The pixel is on the object but has no valid normal.
    NoNormal,
}

impl PixelStatus {
    /// Whether the value of the pixel is observed.
    pub fn is_used(self) -> bool {
        matches!(self, Self::Used | Self::Converted)
    }

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
pub(super) struct PixelClassification {
    pub(super) statuses: Plane<PixelStatus>,
    /// Report with the counts of pixels filled in.
    pub(super) report: ObservationReport,
    /// See [`Observations::albedo_map`](super::Observations::albedo_map).
    pub(super) albedo_map: Option<Plane<Vec3>>,
    /// The picture with pixels of a second paint converted to the first.
    pub(super) converted: Option<Plane<Vec3>>,
}

/// Determines the status of the pixels of `region`.
///
/// They are on the object and not seen at too steep an angle. `report` contains the counts that
/// only the caller can provide.
///
/// # Errors
/// [`SceneError::BadPixels`] if more than half of the pixels are faulty.
pub(super) fn classify_pixels(
    rgb: &Plane<Vec3>,
    region: &Plane<bool>,
    settings: &ObservationSettings,
    surface: &SurfaceGeometry<'_>,
    report: ObservationReport,
) -> Result<PixelClassification, SceneError> {
    let (width, height) = rgb.size();
    let status = |(&colour, &inside): (&Vec3, &bool)| match inside {
        true => PixelStatus::fault(colour).unwrap_or(PixelStatus::Used),
        false => PixelStatus::Outside,
    };
    let statuses: Vec<PixelStatus> = rgb.as_slice().iter().zip(region.as_slice()).map(status).collect();
    let mut statuses = Plane::from_vec(width, height, statuses);
    let sound = statuses.map(|status| *status == PixelStatus::Used);
    let outliers = outliers(rgb, &sound);
    for pixel in outliers.excluded {
        statuses.as_mut_slice()[pixel] = PixelStatus::Outlier;
    }
    let sound = statuses.map(|status| *status == PixelStatus::Used);
    let clip_level = clip_level(rgb, &sound, settings.clip);
    for (status, colour) in statuses.as_mut_slice().iter_mut().zip(rgb.as_slice()) {
        if matches!(status, PixelStatus::Used | PixelStatus::Negative | PixelStatus::Outlier)
            && is_clipped(*colour, clip_level)
        {
            *status = PixelStatus::Clipped;
        }
    }
    let (mut pattern_ratio, mut albedo_map, mut converted) = (None, None, None);
    if !settings.one_material {
        let usable = |at| statuses[at] == PixelStatus::Used;
        let other = match segment_pattern(rgb, &usable, surface) {
            Some(Pattern { mut other, converted: own, ratio, mut relative }) => {
                pattern_ratio = Some(ratio);
                let picture = Plane::from_fn(width, height, |x, y| own[(x, y)].unwrap_or(rgb[(x, y)]));
                // Small regions of a third paint.
                if let Some(third) = segment_paint(&picture, &|at| usable(at) && !other[at], surface) {
                    let both = other.as_mut_slice().iter_mut().zip(relative.as_mut_slice());
                    for ((other, relative), _) in both.zip(third.as_slice()).filter(|(_, third)| **third) {
                        (*other, *relative) = (true, Vec3::ZERO);
                    }
                }
                albedo_map = Some(relative);
                converted = Some(picture);
                Some(other)
            }
            None => segment_paint(rgb, &usable, surface),
        };
        for (status, other) in statuses.as_mut_slice().iter_mut().zip(other.iter().flat_map(Plane::as_slice)) {
            if *other && *status == PixelStatus::Used {
                *status = PixelStatus::OtherColour;
            }
        }
        let values = converted.iter().flat_map(Plane::as_slice).zip(rgb.as_slice());
        for (status, (value, original)) in statuses.as_mut_slice().iter_mut().zip(values) {
            if *status == PixelStatus::Used && value != original {
                *status = PixelStatus::Converted;
            }
        }
    }
    let count = |which: PixelStatus| statuses.as_slice().iter().filter(|status| **status == which).count();
    let tainted = |(status, colour): &(&PixelStatus, &Vec3)| status.is_used() && colour.min_element() < 0.0;
    let report = ObservationReport {
        observed_pixels: region.as_slice().iter().filter(|inside| **inside).count(),
        clipped_pixels: count(PixelStatus::Clipped),
        clip_level,
        negative: count(PixelStatus::Negative),
        not_finite: count(PixelStatus::NotFinite),
        outliers: count(PixelStatus::Outlier),
        possible_outliers: outliers.kept,
        negative_channels: statuses.as_slice().iter().zip(rgb.as_slice()).filter(tainted).count(),
        other_colour_pixels: count(PixelStatus::OtherColour),
        converted_pixels: count(PixelStatus::Converted),
        pattern_ratio,
        ..report
    };
    if 2 * (report.negative + report.not_finite) > report.observed_pixels {
        return Err(SceneError::bad_pixels(&report));
    }
    Ok(PixelClassification { statuses, report, albedo_map, converted })
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
            (Vec3::new(0.1, -1.0, 0.1), Some(PixelStatus::Negative)),
            (Vec3::splat(-1e-6), Some(PixelStatus::Negative)),
            (Vec3::new(1.0, 1.0, f32::NAN), Some(PixelStatus::NotFinite)),
            (Vec3::new(1.0, f32::INFINITY, 1.0), Some(PixelStatus::NotFinite)),
            (Vec3::new(f32::NEG_INFINITY, 1.0, 1.0), Some(PixelStatus::NotFinite)),
        ] {
            assert_eq!(PixelStatus::fault(colour), want, "{colour}");
        }
    }

    #[test]
    fn rejects_pictures_with_more_than_half_of_the_pixels_faulty() {
        let region = Plane::from_fn(40, 40, |_, _| true);
        let surface = SurfaceGeometry { normal: &|_| Vec3::Z, convex: true };
        let judged = |faulty: usize| {
            let value = |x, y| if 40 * y + x < faulty { f32::NAN } else { 1.0 + 0.01 * x as f32 };
            let rgb = Plane::from_fn(40, 40, |x, y| Vec3::splat(value(x, y)));
            classify_pixels(&rgb, &region, &ObservationSettings::default(), &surface, ObservationReport::default())
        };
        assert_eq!(judged(800).unwrap().report.not_finite, 800);
        let refused = judged(801).err().unwrap();
        assert_eq!(refused, SceneError::BadPixels { negative: 0, not_finite: 801, observed: 1600 });
    }
}
