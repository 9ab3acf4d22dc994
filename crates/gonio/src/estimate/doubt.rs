//! What a user should be told before an estimate is believed.

use std::fmt;

/// A reason to believe an estimate less; each says so in a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Doubt {
    /// So large a share of a sphere's normals is not seen on the object.
    Filled(f64),
    /// So large a share of the photograph's features is out of the range of those learnt from.
    Strange(f64),
    /// So large a share of the BRDF's domain is left open.
    Open(f64),
    /// Pixels that share a normal differ by so much, relative to their mean.
    Scatter(f64),
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
            Self::Open(share) => write!(
                f,
                "the photograph leaves {:.0} % of the BRDF's domain undetermined (hatched in the picture of the uncertainty)",
                100.0 * share
            ),
        }
    }
}
