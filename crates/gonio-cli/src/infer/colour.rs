//! The colours of the BRDF found: `--color` and `--light-color`.

use glam::{DQuat, DVec3, Vec3};
use gonio::appearance::Lattice;
use gonio::colour::{
    Chroma, ClueFinder, ColourModel, ColourPosterior, TwoColours, highlight_share, is_grey, white_chroma,
};
use gonio::lighting::EnvironmentMap;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio::render::median_colour;
use gonio::scene::Observations;
use gonio::sphere::OctahedralMap;
use serde_json::{Value, json};

use super::Options;

/// Ways to colour the BRDF.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
pub(super) enum ColourName {
    /// A colour of the body and one of the highlight, each with the light's colour taken off as far as the photograph tells it
    Estimate,
    /// The median colour of the photograph for all, light and reflectance together: how the paper displays its results
    Median,
    /// Three equal channels
    None,
}

/// What the BRDF is coloured with.
pub(super) struct Colouring {
    /// Of the BRDF.
    pub(super) colours: TwoColours,
    /// Of the light, linear RGB of luminance one; white where it is not estimated.
    pub(super) light: Vec3,
    /// The section of result.json.
    pub(super) notes: Value,
}

/// `R,G,B`, linear, positive.
pub(super) fn parse_light(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[r, g, b]) if [r, g, b].iter().all(|x: &f64| x.is_finite() && *x > 0.0) => Ok([r, g, b]),
        _ => Err("give three positive numbers, R,G,B, on a linear scale".into()),
    }
}

/// The colours of an answer whose luminance is `table`.
pub(super) fn colouring(
    options: &Options,
    observations: &Observations,
    table: &BivariateTable,
    known: Option<&EnvironmentMap>,
) -> Colouring {
    let plain =
        |how: &str| Colouring { colours: TwoColours::default(), light: Vec3::ONE, notes: json!({ "how": how }) };
    let seen: Vec<Vec3> = observations.colours.iter().flatten().copied().collect();
    if options.color == ColourName::None {
        return plain("none");
    }
    if is_grey(&seen) {
        return plain("grey photograph");
    }
    if options.color == ColourName::Median {
        let median = median_colour(&Plane::from_vec(seen.len(), 1, seen), |_| true);
        let colours = TwoColours::same(Chroma::of(median.as_dvec3()));
        return Colouring {
            colours,
            light: Vec3::ONE,
            notes: json!({
                "how": "median",
                "rgb": colours.body.rgb().to_array(),
                "note": "the median colour of the photograph, of luminance one, light and reflectance together",
            }),
        };
    }
    let (light, assumption) = match (options.light_color, known) {
        (Some(rgb), _) => (Some(Chroma::of(DVec3::from_array(rgb))), "the light has the colour given by --light-color"),
        (None, Some(map)) => {
            let grid = map.to_grid(OctahedralMap::EqualArea, 32);
            (Some(white_chroma(&grid, DQuat::IDENTITY)), "the light has the mean colour of --light")
        }
        (None, None) => (None, "the light has a colour as captured lights have, around white"),
    };
    let lattice = Lattice::new();
    let image = lattice.gather_colours(&observations.points, &observations.colours);
    let clues = ClueFinder::new(&lattice).of(&image, highlight_share(table));
    let posterior = ColourModel::default().posterior(&clues, light);
    Colouring {
        colours: posterior.colours(),
        light: posterior.light().rgb().as_vec3(),
        notes: notes(&posterior, clues.share, assumption),
    }
}

fn notes(posterior: &ColourPosterior, share: f64, assumption: &str) -> Value {
    let intervals = posterior.intervals();
    let part = |chroma: Chroma, at: usize| {
        json!({
            "rgb": chroma.rgb().to_array(),
            "log_chroma": chroma.0,
            "interval_90": [intervals[at], intervals[at + 1]],
        })
    };
    let colours = posterior.colours();
    json!({
        "how": "estimate",
        "assumption": assumption,
        "body": part(colours.body, 0),
        "highlight": part(colours.highlight, 2),
        "light": part(posterior.light(), 4),
        "coloured_highlight": posterior.coloured,
        "highlight_share": share,
        "note": "rgb: linear, of luminance one; log_chroma: ln R/G and ln B/G, with their 90 % intervals; each channel of \
                 brdf.binary is rgb of the body times the luminance BRDF far from the highlight plus rgb of the highlight times the \
                 rest; coloured_highlight: probability that the highlight is coloured as a metal's is; light: of a white \
                 matte ball in the object's place",
    })
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
