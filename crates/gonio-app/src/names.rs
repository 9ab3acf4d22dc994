//! Names of the values of settings, which the program and the package share.

use gonio::estimate::Alignment;
use gonio::sphere::OctahedralMap;
use gonio_paper::Solver;

use crate::training::Channel;
use crate::{AppError, ColourMode};

/// Each value with its name and its description, which is empty if the name explains the value.
pub type Names<T> = [(&'static str, &'static str, T)];

/// Rotations of an environment map to try.
pub const ALIGNMENTS: &Names<Alignment> = &[
    ("small", "A few degrees about any axis", Alignment::Small),
    ("vertical", "Any angle about the vertical, and a few degrees about any axis", Alignment::Vertical),
    ("fixed", "No rotation", Alignment::Fixed),
];

/// Rules for the colours of a BRDF.
pub const COLOURS: &Names<ColourMode> = &[
    (
        "estimate",
        "Estimated chroma for every pair of angles; gonio assumes that an unknown light is neutral",
        ColourMode::Estimate,
    ),
    (
        "median",
        "The median colour of the photograph, which includes the light's colour; as in the paper",
        ColourMode::Median,
    ),
    ("none", "No colour: three equal channels", ColourMode::Grey),
];

/// Solvers of the separable posterior.
pub const SOLVERS: &Names<Solver> = &[
    (
        "blocks",
        "Exact minimisation of the paper's cost C_KL by blocks: faster, and reaches a lower cost",
        Solver::Blocks,
    ),
    ("printed", "Algorithm 1 of the paper as printed", Solver::Printed),
];

/// Mappings of the sphere to the square.
pub const MAPPINGS: &Names<OctahedralMap> = &[
    ("equal-area", "Clarberg's equal-area map", OctahedralMap::EqualArea),
    ("praun-hoppe", "Praun and Hoppe's octahedral map, as in the paper", OctahedralMap::PraunHoppe),
];

/// Channels of measured materials.
pub const CHANNELS: &Names<Channel> = &[
    ("red", "", Channel::Red),
    ("green", "", Channel::Green),
    ("blue", "", Channel::Blue),
    ("luminance", "Luminance (Rec. 709 weights)", Channel::Luminance),
];

/// Returns the value with a name. `argument` is the name of the argument in messages.
///
/// # Errors
/// If no value has this name.
pub fn named<T: Copy>(argument: &str, name: &str, names: &Names<T>) -> Result<T, AppError> {
    let found = names.iter().find(|(known, ..)| *known == name);
    found.map(|(.., value)| *value).ok_or_else(|| {
        let quoted: Vec<String> = names.iter().map(|(name, ..)| format!("{name:?}")).collect();
        let (last, others) = quoted.split_last().map_or(("", &[][..]), |(last, others)| (last.as_str(), others));
        AppError::new(format!("{argument} {name:?}: must be {} or {last}", others.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_list_the_names() {
        assert_eq!(named("solver", "printed", SOLVERS), Ok(Solver::Printed));
        assert_eq!(
            named("channel", "x", CHANNELS).unwrap_err().to_string(),
            "channel \"x\": must be \"red\", \"green\", \"blue\" or \"luminance\""
        );
    }
}
