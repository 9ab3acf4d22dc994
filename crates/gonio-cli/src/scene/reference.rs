//! Options for a neutral reference in the photograph.

use std::path::PathBuf;

use anyhow::{Result, bail};
use gonio::reference::Corners;
use gonio::scene::Circle;
use gonio_app::{Reference, ReferenceTarget, Source};

use super::parse_circle;
use crate::input::{numbers, parse_share};

/// Options for a neutral reference.
#[derive(clap::Args)]
pub(super) struct ReferenceOptions {
    /// White patch in the photograph: a disk, in pixels from the top left corner
    ///
    /// The patch determines the colour of the light. If it is beside the object and faces the
    /// camera, it also determines the scale of the BRDF (docs/references.md).
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, conflicts_with_all = ["grey_card", "color_checker"])]
    white: Option<Circle>,
    /// Grey card in the photograph: a mask that is white on the card
    ///
    /// The card determines the same quantities as --white.
    #[arg(long, alias = "gray-card", value_name = "MASK", conflicts_with = "color_checker")]
    grey_card: Option<PathBuf>,
    /// Matte grey ball in the photograph: a disk, in pixels from the top left corner
    ///
    /// The ball determines the same quantities as --white. It samples the light for all
    /// visible normals; a patch samples it for one.
    #[arg(long, alias = "gray-ball", value_name = "X,Y,RADIUS", value_parser = parse_circle,
          conflicts_with_all = ["white", "grey_card", "color_checker"])]
    grey_ball: Option<Circle>,
    /// 24-patch colour chart (ColorChecker Classic) in the photograph
    ///
    /// The chart determines the same quantities as --white. With auto or without a value, gonio
    /// detects the chart. CORNERS are the centres of the corner patches as X,Y,X,Y,X,Y,X,Y, in
    /// pixels from the top left corner of the image. Their order is dark skin, bluish green, black,
    /// white.
    #[arg(long, alias = "colour-checker", value_name = "auto|CORNERS", num_args = 0..=1, default_missing_value = "auto",
          value_parser = parse_chart)]
    color_checker: Option<ChartPlace>,
    /// Diffuse reflectance of the reference [default: 0.9 for --white, otherwise 0.18]
    #[arg(long, value_name = "R", value_parser = parse_share)]
    reference_reflectance: Option<f64>,
    /// Use the colour of the reference, but not its brightness
    ///
    /// Use this option if the reference does not face the camera, or is not under the same light
    /// as the object.
    #[arg(long)]
    reference_color_only: bool,
}

/// Position of a chart: its corners, or `None` to detect it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ChartPlace(Option<Corners>);

fn parse_chart(text: &str) -> Result<ChartPlace, String> {
    if text == "auto" {
        return Ok(ChartPlace(None));
    }
    match numbers(text).as_deref() {
        Some(&[a, b, c, d, e, f, g, h]) => Ok(ChartPlace(Some([(a, b), (c, d), (e, f), (g, h)]))),
        _ => {
            Err("expected auto or eight numbers, X,Y of four corner patches; put the photograph before this option"
                .into())
        }
    }
}

impl ReferenceOptions {
    /// The file of the grey card's mask.
    pub(super) fn grey_card(&self) -> &Option<PathBuf> {
        &self.grey_card
    }

    /// Returns the reference that the options describe.
    pub(super) fn reference(&self) -> Option<Reference> {
        let white = self.white.map(ReferenceTarget::White);
        let card = || self.grey_card.clone().map(|mask| ReferenceTarget::GreyCard(Source::File(mask)));
        let ball = || self.grey_ball.map(ReferenceTarget::GreyBall);
        let chart = || self.color_checker.map(|place| ReferenceTarget::Chart(place.0));
        let target = white.or_else(card).or_else(ball).or_else(chart)?;
        Some(Reference { target, reflectance: self.reference_reflectance, colour_only: self.reference_color_only })
    }

    /// Rejects options that would have no effect.
    pub(super) fn check(&self) -> Result<()> {
        let is_patch = self.white.is_some() || self.grey_card.is_some() || self.grey_ball.is_some();
        if self.reference_reflectance.is_some() && !is_patch {
            bail!(
                "--reference-reflectance applies to --white, --grey-card and --grey-ball; the reflectances of a colour chart are \
                 published"
            );
        }
        if self.reference_color_only && !is_patch && self.color_checker.is_none() {
            bail!("--reference-color-only requires --white, --grey-card, --grey-ball or --color-checker");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_positions_of_charts() {
        assert_eq!(parse_chart("auto"), Ok(ChartPlace(None)));
        let corners = [(1.0, 2.0), (3.0, 4.0), (5.5, 6.0), (7.0, 8.0)];
        assert_eq!(parse_chart("1,2, 3,4,5.5,6,7,8"), Ok(ChartPlace(Some(corners))));
        for wrong in ["", "photo.exr", "1,2,3,4,5,6,7", "1,2,3,4,5,6,7,8,9", "a,b,c,d,e,f,g,h"] {
            assert!(parse_chart(wrong).is_err(), "{wrong}");
        }
        assert!(parse_share("0.18") == Ok(0.18) && parse_share("1") == Ok(1.0));
        assert!(["0", "1.1", "-1", "nan", "x"].iter().all(|wrong| parse_share(wrong).is_err()));
    }
}
