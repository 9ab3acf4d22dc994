//! Diagnostics of an estimate.

use std::fmt;

use super::MisfitCause;

/// Diagnostic of an estimate, displayed as one line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Diagnostic {
    /// Share of a sphere's normals that are not visible on the object.
    Filled(f64),
    /// Share of the photograph's features outside the range of the training data.
    OutOfDistribution(f64),
    /// Share of the BRDF's domain that is undetermined.
    Undetermined(f64),
    /// Difference between photograph and BRDF from green to magenta, in natural logarithms
    /// ([`ChromaticLight::chroma_residual`](super::ChromaticLight::chroma_residual)). Few lights
    /// explain it.
    Colours(f64),
    /// Relative standard deviation of pixels that share a normal.
    Scatter(f64),
    /// Rotation vector of the environment map in the best fit, in degrees about x, y and z.
    LightRotated([f64; 3]),
    /// The clipped pixels of an environment map are brighter than their values.
    Clipped {
        /// Ratio of the true to the clipped radiance.
        gain: f64,
        /// Standard deviation of the logarithm of `gain`.
        sd: f64,
    },
    /// Width in degrees of a pixel of the environment map, which is wider than the highlight.
    Coarse(f64),
    /// Relative root mean square residual of a channel (0 red, 1 green, 2 blue) of the photograph,
    /// beyond that of the luminance.
    Channel {
        /// The channel of the largest residual.
        channel: usize,
        /// Its residual.
        misfit: f64,
    },
    /// The misfit of the photograph exceeds the value expected from noise and the light's
    /// resolution.
    Misfit {
        /// Residual, relative to the photograph.
        misfit: f64,
        /// Expected residual ([`expected_misfit`](super::expected_misfit)).
        expected: f64,
        /// The most probable cause.
        cause: MisfitCause,
    },
}

impl Diagnostic {
    /// Whether light and material do not reproduce the photograph.
    pub fn is_misfit(&self) -> bool {
        matches!(self, Self::Misfit { .. })
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Filled(share) => write!(
                f,
                "the object has only {:.0} % of the normals of a sphere; gonio interpolated the others, so the true \
                 uncertainty is larger than the reported one",
                100.0 * (1.0 - share)
            ),
            Self::OutOfDistribution(share) => write!(
                f,
                "the photograph is out of distribution: {:.0} % of its features lie outside their range in \
                 training; the result may be wrong",
                100.0 * share
            ),
            Self::Scatter(deviation) => write!(
                f,
                "pixels with the same normal differ by {:.0} %, which hides fine details of the highlights; \
                 possible causes are texture, self-shadowing, several materials, noise, or misaligned normals",
                100.0 * deviation
            ),
            Self::LightRotated([x, y, z]) => {
                let angle = x.hypot(*y).hypot(*z);
                write!(
                    f,
                    "gonio rotated the environment map by {angle:.1} degrees to fit the photograph (rotation vector {x:.1}, \
                     {y:.1}, {z:.1} degrees)"
                )
            }
            Self::Clipped { gain, sd } => write!(
                f,
                "the brightest pixels of the environment map are clipped; according to the photograph, their true \
                 radiance is {gain:.1} times the clipped value (90 % interval {:.1} to {:.1})",
                gain * (-1.645 * sd).exp(),
                gain * (1.645 * sd).exp(),
            ),
            Self::Coarse(degrees) => write!(
                f,
                "the pixels of the environment map are {degrees:.1} degrees wide, wider than the highlight, so the sharpness \
                 of the material is undetermined; use an environment map of higher resolution"
            ),
            Self::Misfit { misfit, expected, cause } => write!(
                f,
                "the misfit (relative RMS residual of the photograph) is {:.0} %, but only {:.0} % is expected; possible \
                 causes are {}",
                100.0 * misfit,
                100.0 * expected,
                match cause {
                    MisfitCause::Texture => "strong texture, scratches, dust and noise",
                    MisfitCause::KnownLight =>
                        "an environment map that is rotated, clipped, too coarse or from another place, several materials, \
                         self-shadowing, and a misaligned outline or normal map",
                    MisfitCause::Geometry =>
                        "a misaligned outline or normal map, a wrong camera or pose, several materials, dust or print, \
                         self-shadowing, nearby lights, and a blurred, sharpened or tone-mapped photograph",
                }
            ),
            Self::Channel { channel, misfit } => write!(
                f,
                "the {} channel has a residual of {:.0} % in addition to the misfit of the luminance; possible \
                 causes are an environment map of another white balance or colour space, and several colours",
                ["red", "green", "blue"][*channel],
                100.0 * misfit,
            ),
            Self::Colours(residual) => write!(
                f,
                "the colours of photograph and BRDF differ by {:.0} % along the green-magenta axis; the BRDF has wrong \
                 colours, or part of the light is green, as over grass",
                100.0 * (residual.exp() - 1.0)
            ),
            Self::Undetermined(share) => write!(
                f,
                "the photograph does not determine {:.0} % of the BRDF (hatched in uncertainty.png); use a light with more \
                 edges, such as windows and lamps",
                100.0 * share
            ),
        }
    }
}
