//! Reasons to doubt an estimate.

use std::fmt;

use super::Reason;

/// Reason to doubt an estimate, displayed as one line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Doubt {
    /// Share of a sphere's normals that are not seen on the object.
    Filled(f64),
    /// Share of the photograph's features that are outside the range of the training.
    Strange(f64),
    /// Share of the BRDF's domain that is undetermined.
    Open(f64),
    /// The photograph differs from the BRDF from green to magenta ([`Tint::apart`]), in natural
    /// logarithms, which few lights explain.
    ///
    /// [`Tint::apart`]: super::Tint::apart
    Colours(f64),
    /// Deviation of pixels that share a normal, relative to their mean.
    Scatter(f64),
    /// A light map was turned by this rotation vector, in degrees about x, y and z, to fit.
    Turned([f64; 3]),
    /// The clipped pixels of a light map are brighter than it says.
    Clipped {
        /// By this factor.
        gain: f64,
        /// Standard deviation of its logarithm.
        sd: f64,
    },
    /// A pixel of a light map, of so many degrees, is wider than the highlight.
    Coarse(f64),
    /// Root mean square of what light and material leave of a channel (0 red, 1 green, 2 blue) of
    /// the photograph, without what they leave of the luminance, relative to the channel.
    Channel {
        /// The channel of the largest residual.
        channel: usize,
        /// Its residual.
        left: f64,
    },
    /// Light and material leave more of the photograph unexplained than noise and the light's
    /// resolution account for.
    Misfit {
        /// Residual, relative to the photograph.
        left: f64,
        /// Expected residual ([`expected_misfit`](super::expected_misfit)).
        expected: f64,
        /// The most probable reason.
        reason: Reason,
    },
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Filled(share) => write!(
                f,
                "{:.0} % of the normals of a sphere are not seen on the object and were filled in from others: the answer is less certain than it says",
                100.0 * share
            ),
            Self::Strange(share) => write!(
                f,
                "the photograph is unlike those the posterior was learnt from: {:.0} % of what it is read by is out of range; the answer may be far off",
                100.0 * share
            ),
            Self::Scatter(deviation) => write!(
                f,
                "pixels that share a normal differ by {:.0} %: texture, shadows of the object on itself, several materials, noise, or normals that do not lie \
                 on the picture; what is fine in the highlights cannot be told from it",
                100.0 * deviation
            ),
            Self::Turned([x, y, z]) => {
                let angle = x.hypot(*y).hypot(*z);
                write!(
                    f,
                    "the light map fits the photograph best when it is turned by {angle:.1} degrees (about x, y and z by {x:.1}, {y:.1} \
                     and {z:.1}), and was turned so"
                )
            }
            Self::Clipped { gain, sd } => write!(
                f,
                "the brightest pixels of the light map are clipped: the photograph tells that they are {gain:.1} times as bright \
                 ({:.1} to {:.1})",
                gain * (-1.645 * sd).exp(),
                gain * (1.645 * sd).exp(),
            ),
            Self::Coarse(degrees) => write!(
                f,
                "a pixel of the light map is {degrees:.1} degrees wide, wider than the highlight: how sharp the material is cannot be \
                 told; give a finer map"
            ),
            Self::Misfit { left, expected, reason } => write!(
                f,
                "light and material leave {:.0} % of the photograph unexplained where {:.0} % was to be expected; the likely reason: {}",
                100.0 * left,
                100.0 * expected,
                match reason {
                    Reason::Texture => "a strong texture, or noise",
                    Reason::Light =>
                        "a light map that is turned, clipped, too coarse or of another place, several materials, shadows of the object on itself, or an outline or normals that do not lie on the picture",
                    Reason::Regions =>
                        "several materials, shadows of the object on itself, light that is not far away, or an outline or normals that do not lie on the picture",
                }
            ),
            Self::Channel { channel, left } => write!(
                f,
                "light and material leave {:.0} % of the {} channel unexplained although they explain the luminance; the likely \
                 cause: a light map of another white balance or colour space, or colours that vary over the object",
                100.0 * left,
                ["red", "green", "blue"][*channel],
            ),
            Self::Colours(apart) => write!(
                f,
                "from green to magenta the photograph differs from the BRDF by {:.0} %, more than most light varies: either body \
                 and highlight have other colours than were found, or more than two, or the light is green in part, as over \
                 grass; the intervals of the colours are wider by that",
                100.0 * (apart.exp() - 1.0)
            ),
            Self::Open(share) => write!(
                f,
                "the photograph leaves {:.0} % of the BRDF's domain undetermined (hatched in the picture of the uncertainty)",
                100.0 * share
            ),
        }
    }
}
