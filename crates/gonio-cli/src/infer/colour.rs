//! The colours of the BRDF found: `--color` and `--light-color`.

use glam::{DQuat, DVec3};
use gonio::colour::{Chroma, white_chroma};
use gonio::estimate::ColouringRule;
use gonio::lighting::EnvironmentMap;
use gonio::sphere::OctahedralMap;

use super::Options;

/// Ways to colour the BRDF.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
pub(super) enum ColourName {
    /// A colour of the body and one of the highlight, each with the light's colour taken off as far
    /// as the photograph tells it
    Estimate,
    /// The median colour of the photograph for all, light and reflectance together: how the paper
    /// displays its results
    Median,
    /// Three equal channels
    None,
}

/// `R,G,B`, linear, positive.
pub(super) fn parse_light(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[r, g, b]) if [r, g, b].iter().all(|x: &f64| x.is_finite() && *x > 0.0) => Ok([r, g, b]),
        _ => Err("give three positive numbers, R,G,B, on a linear scale".into()),
    }
}

/// What the options ask for, and in words what they take for the light's colour.
pub(super) fn rule(options: &Options, known: Option<&EnvironmentMap>) -> (ColouringRule, &'static str) {
    match options.color {
        ColourName::None => return (ColouringRule::Grey, ""),
        ColourName::Median => return (ColouringRule::Median, ""),
        ColourName::Estimate => (),
    }
    let (light, assumption) = match (options.light_color, known) {
        (Some(rgb), _) => (Some(Chroma::of(DVec3::from_array(rgb))), "the light has the colour given by --light-color"),
        (None, Some(map)) => {
            let grid = map.to_grid(OctahedralMap::EqualArea, 32);
            (Some(white_chroma(&grid, DQuat::IDENTITY)), "the light has the mean colour of --light")
        }
        (None, None) => (None, "the light has a colour as captured lights have, around white"),
    };
    (ColouringRule::Estimate { light }, assumption)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_light_are_three_positive_numbers() {
        assert_eq!(parse_light("1, 0.8,0.5"), Ok([1.0, 0.8, 0.5]));
        for wrong in ["", "1,1", "1,1,0", "1,1,nan", "1,1,-1", "1,1,1,1", "red"] {
            assert!(parse_light(wrong).is_err(), "{wrong}");
        }
    }
}
