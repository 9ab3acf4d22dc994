//! Warnings about the photograph and its object.

use std::fmt;

use super::Contradiction;
use crate::remedy::Remedy;

/// Warning about a detected object, displayed as one line.
#[derive(Clone, Debug, PartialEq)]
pub enum Oddity {
    /// The overlap of shape and object is too small.
    Misplaced {
        /// Pixels of both over pixels of either.
        overlap: f64,
    },
    /// Many pixels are back-facing.
    Inside {
        /// Number of back-facing pixels.
        inside: usize,
        /// Number of pixels that show the surface.
        seen: usize,
    },
    /// The depth of the ellipsoid is unknown; contains the assumed semi-axis, in pixels.
    Depth(f64),
    /// The normals are inconsistent, but the checks are disabled.
    Contradiction(Contradiction),
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
    /// There are more outliers than a sensor has faulty pixels.
    Outliers {
        /// Number of outliers.
        outliers: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// Some pixels differ from their neighbours as much as outliers, but are used.
    Isolated {
        /// Number of such pixels.
        isolated: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// Regions of another colour are ignored.
    OtherColour {
        /// Number of pixels of another colour.
        pixels: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
}

impl Oddity {
    /// Lists suggestions.
    pub fn remedies(&self) -> Vec<Remedy> {
        match self {
            Self::Depth(_) => vec![Remedy::DepthAxis],
            Self::Contradiction(it) => vec![it.remedy()],
            Self::OtherColour { .. } => vec![Remedy::KeepColours],
            _ => Vec::new(),
        }
    }
}

impl fmt::Display for Oddity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Misplaced { overlap } => write!(
                f,
                "the shape is not exactly aligned with the object: {:.0} % of their pixels overlap",
                100.0 * overlap
            ),
            Self::Inside { inside, seen } => write!(
                f,
                "{inside} of {seen} pixels show the back of the surface; gonio flips its normals towards the camera \
                 there"
            ),
            Self::Depth(depth) => write!(
                f,
                "the outline does not determine the depth of the ellipsoid; gonio assumes a semi-axis of {depth:.1} \
                 pixels, the geometric mean of the other two"
            ),
            Self::Contradiction(it) => it.fmt(f),
            Self::Clipped { clipped, observed } => {
                write!(f, "{clipped} of {observed} pixels on the object are clipped and ignored")
            }
            Self::Faulty { negative, not_finite, observed } => {
                let what = match (negative, not_finite) {
                    (n, 0) => format!("{n} of {observed} pixels on the object are negative"),
                    (0, n) => format!("{n} of {observed} pixels on the object are NaN or infinite"),
                    (n, m) => {
                        format!("of {observed} pixels on the object, {n} are negative and {m} are NaN or infinite")
                    }
                };
                write!(f, "{what}; gonio ignores them")
            }
            Self::Outliers { outliers, observed } => write!(
                f,
                "{outliers} of {observed} pixels on the object differ strongly from their neighbours and are ignored; a sensor \
                 has fewer hot and dead pixels, so the photograph is noisy, the rendering has fireflies, or the material \
                 glitters; use a longer exposure or more samples per pixel"
            ),
            Self::Isolated { isolated, observed } => write!(
                f,
                "{isolated} of {observed} pixels on the object differ strongly from their neighbours; gonio uses them because the \
                 object has sharp reflections or glitters; if they are hot pixels or fireflies, the gloss is unreliable, \
                 so remove them from the photograph"
            ),
            Self::OtherColour { pixels, observed } => {
                write!(
                    f,
                    "{pixels} of {observed} pixels on the object have another colour than the rest and are ignored"
                )
            }
        }
    }
}
