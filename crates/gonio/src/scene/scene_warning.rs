//! Warnings about the photograph and its object.

use std::fmt;

use glam::Vec3;

use super::{Circle, Contradiction, ObservationReport, PixelStatus};
use crate::picture::Plane;
use crate::suggestion::Suggestion;

/// Share of the used pixels in which an empty channel is zero or negative.
const EMPTY: f64 = 0.5;

/// Warning about a detected object, displayed as one line.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneWarning {
    /// The overlap of shape and object is too small.
    Misaligned {
        /// Pixels of both over pixels of either.
        overlap: f64,
    },
    /// The edges of the photograph form another circle than the given one.
    Outline(Circle),
    /// Many pixels are back-facing.
    BackFacing {
        /// Number of back-facing pixels.
        inside: usize,
        /// Number of pixels that show the surface.
        visible: usize,
    },
    /// The depth of the ellipsoid is unknown; contains the assumed semi-axis, in pixels.
    UnknownSemiAxis(f64),
    /// The normals are inconsistent, but the checks are disabled.
    Contradiction(Contradiction),
    /// Pixels of the normal map are ignored, because they form a background of one normal.
    FlatBackground {
        /// Number of ignored pixels.
        pixels: usize,
    },
    /// Some pixels are clipped.
    Clipped {
        /// Number of clipped pixels.
        clipped: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// Some pixels have values that are not radiances.
    Faulty {
        /// Number of pixels of negative luminance.
        negative: usize,
        /// Number of pixels that are NaN or infinite.
        not_finite: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// A channel is zero or negative in most of the used pixels.
    EmptyChannel {
        /// 0 for red, 1 for green, 2 for blue.
        channel: usize,
        /// Number of these pixels.
        empty: usize,
        /// Number of used pixels.
        used: usize,
    },
    /// There are more outliers than a sensor has faulty pixels.
    Outliers {
        /// Number of outliers.
        outliers: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// Some pixels differ from their neighbours as much as outliers, but are used.
    PossibleOutliers {
        /// Number of such pixels.
        pixels: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// The smaller part of a pattern of two paints is ignored or converted.
    Pattern {
        /// Number of ignored pixels of this part and of its margin.
        pixels: usize,
        /// Number of converted pixels of this part.
        converted: usize,
        /// Number of observed pixels on the object.
        observed: usize,
        /// Ratio of its reflectance to that of the larger part (luminance).
        ratio: f64,
    },
    /// Small spots are ignored, because they mislead the estimate.
    Spots {
        /// Number of spots.
        count: usize,
    },
    /// Regions of another colour are ignored.
    OtherColour {
        /// Number of pixels of another colour.
        pixels: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
}

impl SceneWarning {
    /// Returns the warning about another paint, if any.
    pub(super) fn of_paint(report: &ObservationReport) -> Option<Self> {
        let (pixels, observed) = (report.other_colour_pixels, report.observed_pixels);
        match report.pattern_ratio {
            Some(ratio) => Some(Self::Pattern { pixels, converted: report.converted_pixels, observed, ratio }),
            None => (pixels > 0).then_some(Self::OtherColour { pixels, observed }),
        }
    }

    /// Returns the warnings about channels that are zero or negative in most of the used pixels.
    pub(super) fn of_empty_channels(rgb: &Plane<Vec3>, statuses: &Plane<PixelStatus>) -> Vec<Self> {
        let pixels = rgb.as_slice().iter().zip(statuses.as_slice());
        let used: Vec<&Vec3> = pixels.filter(|(_, status)| status.is_used()).map(|(colour, _)| colour).collect();
        let empty = |channel: usize| {
            let empty = used.iter().filter(|colour| colour[channel] <= 0.0 && colour.max_element() > 0.0).count();
            let warning = Self::EmptyChannel { channel, empty, used: used.len() };
            (empty as f64 > EMPTY * used.len() as f64).then_some(warning)
        };
        (0..3).filter_map(empty).collect()
    }

    /// Lists suggestions.
    pub fn suggestions(&self) -> Vec<Suggestion> {
        match self {
            Self::UnknownSemiAxis(_) => vec![Suggestion::DepthAxis],
            Self::Outline(circle) => vec![Suggestion::OneOf(vec![*circle])],
            Self::Contradiction(it) => vec![it.suggestion()],
            Self::OtherColour { .. } | Self::Pattern { .. } | Self::Spots { .. } => vec![Suggestion::OneMaterial],
            _ => Vec::new(),
        }
    }
}

impl fmt::Display for SceneWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Misaligned { overlap } => write!(
                f,
                "the shape is not exactly aligned with the object: the intersection over union of their pixels is {:.0} %",
                100.0 * overlap
            ),
            Self::Outline(circle) => write!(
                f,
                "the specified circle does not match the edge of the ball, which has the centre ({:.1}, {:.1}) and the radius {:.1}",
                circle.x, circle.y, circle.radius
            ),
            Self::BackFacing { inside, visible } => write!(
                f,
                "{inside} of {visible} pixels show the back of the surface; gonio flips its normals towards the camera \
                 there"
            ),
            Self::UnknownSemiAxis(depth) => write!(
                f,
                "the outline does not determine the depth of the ellipsoid; gonio assumes a semi-axis of {depth:.1} \
                 pixels, the geometric mean of the other two"
            ),
            Self::Contradiction(it) => it.fmt(f),
            Self::FlatBackground { pixels } => write!(
                f,
                "gonio ignores {pixels} pixels around the object that have the same normal, because they probably show the \
                 background; specify a mask to use them"
            ),
            Self::Clipped { clipped, observed } => {
                write!(
                    f,
                    "gonio ignores {clipped} of {observed} pixels on the object, because they are clipped; use a shorter exposure"
                )
            }
            Self::Faulty { negative, not_finite, observed } => {
                let what = match (negative, not_finite) {
                    (n, 0) => format!("{n} of {observed} pixels on the object are negative"),
                    (0, n) => format!("{n} of {observed} pixels on the object are NaN or infinite"),
                    (n, m) => {
                        format!("{n} of {observed} pixels on the object are negative, and {m} are NaN or infinite")
                    }
                };
                write!(f, "{what}; gonio ignores them")
            }
            Self::EmptyChannel { channel, empty, used } => write!(
                f,
                "the {} channel is zero or negative in {empty} of {used} pixels; the colours of the BRDF are wrong; \
                 check the black level and the colour space of the photograph",
                ["red", "green", "blue"][*channel]
            ),
            Self::Outliers { outliers, observed } => write!(
                f,
                "gonio ignores {outliers} of {observed} pixels on the object, which differ strongly from their neighbours; \
                 possible causes are noise, fireflies and glitter; use a longer exposure or more samples per pixel"
            ),
            Self::PossibleOutliers { pixels, observed } => write!(
                f,
                "{pixels} of {observed} pixels look like outliers, but gonio uses them, because the object has sharp \
                 reflections or glitters; remove hot pixels and fireflies, which make the roughness unreliable"
            ),
            Self::Pattern { pixels, converted, observed, ratio } => {
                write!(
                    f,
                    "the object has two paints; gonio estimates the one that covers more, and ignores {pixels} of {observed} \
                     pixels on or near the other, which reflects {ratio:.2} times as much light"
                )?;
                match converted {
                    0 => Ok(()),
                    _ => write!(f, "; gonio converts {converted} more pixels of that paint to the estimated one"),
                }
            }
            Self::Spots { count } => write!(
                f,
                "gonio ignores {count} small spots on the object, such as dust, scratches or print, because they would \
                 make the estimate too glossy; clean the object, or specify a mask without them"
            ),
            Self::OtherColour { pixels, observed } => {
                write!(
                    f,
                    "{pixels} of {observed} pixels on the object have another colour than the rest; gonio ignores them"
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warns_of_channels_that_are_empty_in_most_used_pixels() {
        let statuses = Plane::from_fn(4, 4, |_, y| if y == 3 { PixelStatus::Outside } else { PixelStatus::Used });
        // 12 pixels are used; blue is negative in `count` of them.
        let picture = |count: usize| {
            Plane::from_fn(4, 4, |x, y| Vec3::new(0.2, 0.1, if 4 * y + x < count { -0.01 } else { 0.05 }))
        };
        assert_eq!(SceneWarning::of_empty_channels(&picture(6), &statuses), []);
        let expected = SceneWarning::EmptyChannel { channel: 2, empty: 12, used: 12 };
        assert_eq!(SceneWarning::of_empty_channels(&picture(16), &statuses), [expected]);
        // Black pixels have no light in any channel.
        assert_eq!(SceneWarning::of_empty_channels(&Plane::from_fn(4, 4, |_, _| Vec3::ZERO), &statuses), []);
    }
}
