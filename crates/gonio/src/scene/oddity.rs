//! Warnings about the photograph and its object.

use std::fmt;

use super::Contradiction;
use crate::remedy::Remedy;

/// Something odd about a sighting, displayed as one line.
#[derive(Clone, Debug, PartialEq)]
pub enum Oddity {
    /// The overlap of shape and object is less than it should be.
    Misplaced {
        /// Pixels of both over pixels of either.
        overlap: f64,
    },
    /// Many pixels are back-facing.
    Inside {
        /// Number of back-facing pixels.
        inside: usize,
        /// Number of pixels that see the surface.
        seen: usize,
    },
    /// The depth of the ellipsoid is unknown; holds the semi-axis taken for it, in pixels.
    Depth(f64),
    /// The normals contradict themselves and are used nevertheless.
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
    /// More pixels differ from the pixels around them than a sensor has faulty ones.
    Outliers {
        /// Number of outliers.
        outliers: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// Some pixels differ from the pixels around them as much as outliers, but are used.
    Isolated {
        /// Number of such pixels.
        isolated: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
    /// Regions of another colour are left out.
    OtherColour {
        /// Number of pixels of another colour.
        pixels: usize,
        /// Number of observed pixels on the object.
        observed: usize,
    },
}

impl Oddity {
    /// Lists what may be done about it.
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
                "the shape does not quite fit the object: {:.0} % of the pixels of either belong to both",
                100.0 * overlap
            ),
            Self::Inside { inside, seen } => write!(
                f,
                "{inside} of {seen} pixels see the back of the surface; its normals were turned to the camera there"
            ),
            Self::Depth(depth) => write!(
                f,
                "the outline does not tell how deep the ellipsoid is: {depth:.1} pixels were taken, the geometric mean of the other two \
                 semi-axes"
            ),
            Self::Contradiction(it) => it.fmt(f),
            Self::Clipped { clipped, observed } => {
                write!(f, "{clipped} of {observed} pixels on the object are clipped and left out")
            }
            Self::Faulty { negative, not_finite, observed } => {
                let what = match (negative, not_finite) {
                    (n, 0) => format!("{n} of {observed} pixels on the object are negative"),
                    (0, n) => format!("{n} of {observed} pixels on the object are NaN or infinite"),
                    (n, m) => format!("of {observed} pixels on the object {n} are negative and {m} NaN or infinite"),
                };
                write!(f, "{what}; they are left out")
            }
            Self::Outliers { outliers, observed } => write!(
                f,
                "{outliers} of {observed} pixels on the object differ strongly from the pixels around them and are left out, more \
                 than the hot and dead pixels of a sensor: the photograph is noisy, the rendering has fireflies, or the \
                 material glitters; use a longer exposure, or more samples per pixel"
            ),
            Self::Isolated { isolated, observed } => write!(
                f,
                "{isolated} of {observed} pixels on the object differ strongly from the pixels around them, but are used because \
                 the object has sharp reflections or glitters; if they are hot pixels or fireflies, the estimated gloss is \
                 unreliable: remove them from the photograph"
            ),
            Self::OtherColour { pixels, observed } => {
                write!(
                    f,
                    "{pixels} of {observed} pixels on the object are of another colour than the rest and left out"
                )
            }
        }
    }
}
