//! Errors and warnings of light probes.

use std::fmt;

use thiserror::Error;

use crate::scene::SceneError;
use crate::suggestion::Suggestion;

/// Error of unwrapping a mirror ball; [`ProbeError::suggestions`] lists suggestions.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ProbeError {
    /// The ball was not detected.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The object is not a ball.
    #[error("gonio can unwrap only a ball; specify its outline or a mask")]
    NotABall,
    /// The ball shows too few directions.
    #[error(
        "the ball shows only {:.0} % of all directions, but at least {:.0} % are required; check that the mask or circle lies on \
         the ball",
        100.0 * .share,
        100.0 * .min
    )]
    TooLittle {
        /// Share of the sphere of directions that is visible.
        share: f64,
        /// Smallest accepted share.
        min: f64,
    },
    /// Everything that the ball shows is black.
    #[error("the ball is entirely black; check the exposure, and that the mask or circle lies on the ball")]
    Black,
    /// The reflectance is invalid.
    #[error("invalid reflectance {0}; use numbers above 0 and at most 1")]
    Reflectance(f64),
    /// The number of rows is not accepted.
    #[error("{rows} rows: must be a power of two from {min} to {max}")]
    Rows {
        /// The given number.
        rows: usize,
        /// Smallest accepted number.
        min: usize,
        /// Largest accepted number.
        max: usize,
    },
    /// The angle is not finite.
    #[error("the angle between the cameras must be a finite number of degrees")]
    Angle,
    /// The views do not determine the angle between the cameras.
    #[error(
        "the angle between the two cameras cannot be estimated: the correlation of the views is {:.2} at the best \
         angle and {:.2} at another",
        .best,
        .second
    )]
    AmbiguousAzimuth {
        /// Correlation of both maps at the best angle, -1..=1.
        best: f64,
        /// Largest correlation at an angle far from the best.
        second: f64,
    },
}

impl ProbeError {
    /// Lists suggestions, the most probable first.
    pub fn suggestions(&self) -> Vec<Suggestion> {
        match self {
            // A mirror ball cannot have another shape.
            Self::Scene(error) => error
                .suggestions()
                .into_iter()
                .filter(|suggestion| matches!(suggestion, Suggestion::Outline | Suggestion::Mask | Suggestion::Camera))
                .collect(),
            Self::AmbiguousAzimuth { .. } => vec![Suggestion::SecondAzimuth],
            _ => Vec::new(),
        }
    }
}

/// Warning about a light probe, displayed as one line.
#[derive(Clone, Debug, PartialEq)]
pub enum ProbeWarning {
    /// Some pixels are clipped, so the map underestimates bright lamps.
    Clipped {
        /// Number of clipped pixels.
        clipped: usize,
        /// Number of pixels of the ball that are used.
        used: usize,
    },
    /// Some pixels have values that are not radiances.
    Faulty {
        /// Number of such pixels.
        faulty: usize,
        /// Number of pixels of the ball that are used.
        used: usize,
    },
    /// The ball appears matte; contains the share of its variation that smooth shading explains.
    Matte(f64),
    /// Much of the sphere is not visible; contains the share that is not.
    Unseen(f64),
    /// Two views show different light where they overlap.
    InconsistentViews {
        /// Median difference of both, relative to their mean.
        difference: f64,
        /// Correlation of the logarithms of both.
        correlation: f64,
    },
    /// Two views have different exposures; contains the brightness ratio of the second to the
    /// first.
    Brightness(f64),
}

impl fmt::Display for ProbeWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Clipped { clipped, used } => write!(
                f,
                "{clipped} of {used} pixels on the ball are clipped; the environment map underestimates the radiance \
                 there; add shorter exposures"
            ),
            Self::Faulty { faulty, used } => {
                write!(
                    f,
                    "gonio ignores {faulty} pixels on the ball that are negative, NaN or infinite; {used} are valid"
                )
            }
            Self::Matte(share) => write!(
                f,
                "the ball appears matte, not like a mirror: smooth shading explains {:.1} % of its variation",
                100.0 * share
            ),
            Self::Unseen(share) => {
                write!(
                    f,
                    "{:.0} % of all directions are not visible in the ball; gonio interpolates them from \
                    their surroundings",
                    100.0 * share
                )
            }
            Self::InconsistentViews { difference, correlation } => write!(
                f,
                "the two views differ by {:.0} % where they overlap (correlation {correlation:.2}); check the angle \
                 between them, that both cameras were level, and that the light did not change",
                100.0 * difference
            ),
            Self::Brightness(ratio) => write!(
                f,
                "the second view is {ratio:.2} times as bright as the first where they overlap; gonio divided \
                 the second view by this factor"
            ),
        }
    }
}
