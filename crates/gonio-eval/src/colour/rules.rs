//! Rules that colour a luminance BRDF.

use glam::{DVec3, Vec3};
use gonio::colour::{Chroma, Clues, ColourModel, TwoColours};
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio::render::median_colour;

/// One photograph, its luminance estimate, and the ground truth.
pub(super) struct View {
    pub(super) image: Vec<Vec3>,
    /// The luminance estimate.
    pub(super) table: BivariateTable,
    pub(super) clues: Clues,
    /// True chroma of the light.
    pub(super) light: Chroma,
    /// True colours of the material.
    pub(super) truth: TwoColours,
}

/// Rule that colours a luminance BRDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rule {
    /// Three equal channels.
    Grey,
    /// The median colour of the photograph: the paper's display rule.
    Median,
    /// The mean colour.
    Mean,
    /// The median colour without that of the light, which is given.
    MedianKnown,
    /// The colour of the true albedo along the normal: the best single colour.
    One,
    /// The colours of the posterior.
    Estimate,
    /// The colours of the posterior given the colour of the light.
    EstimateKnown,
    /// The true two colours.
    Two,
    /// The true table of each channel.
    Truth,
}

/// All rules, in the order of the report.
pub(super) const RULES: [Rule; 9] = [
    Rule::Grey,
    Rule::Median,
    Rule::Mean,
    Rule::Estimate,
    Rule::MedianKnown,
    Rule::EstimateKnown,
    Rule::One,
    Rule::Two,
    Rule::Truth,
];

impl Rule {
    pub(super) fn id(self) -> &'static str {
        match self {
            Self::Grey => "grey",
            Self::Median => "median",
            Self::Mean => "mean",
            Self::Estimate => "estimate",
            Self::MedianKnown => "median-known-light",
            Self::EstimateKnown => "estimate-known-light",
            Self::One => "one-colour",
            Self::Two => "two-colours",
            Self::Truth => "truth",
        }
    }

    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Grey => "grey",
            Self::Median => "median colour (the paper's display rule)",
            Self::Mean => "mean colour (grey world)",
            Self::Estimate => "**estimate**",
            Self::MedianKnown => "median colour, light's colour given",
            Self::EstimateKnown => "**estimate**, light's colour given",
            Self::One => "best single colour (oracle)",
            Self::Two => "true two colours (oracle)",
            Self::Truth => "true RGB table (floor)",
        }
    }

    /// Returns the BRDF, its colours, and how many of their four chroma coordinates lie in the 90 %
    /// intervals.
    pub(super) fn apply(
        self,
        view: &View,
        model: &ColourModel,
        rgb: &[BivariateTable; 3],
    ) -> ([BivariateTable; 3], TwoColours, Option<usize>) {
        let median = || {
            let plane = Plane::from_vec(view.image.len(), 1, view.image.clone());
            Chroma::of(median_colour(&plane, |_| true).as_dvec3())
        };
        let less = |a: Chroma| Chroma([a.0[0] - view.light.0[0], a.0[1] - view.light.0[1]]);
        let posterior = |light| {
            let found = model.posterior(&view.clues, light);
            let truth = [view.truth.body.0, view.truth.highlight.0].concat();
            let inside = found.intervals().iter().zip(&truth).filter(|([low, high], x)| low <= x && *x <= high).count();
            (found.colours(), Some(inside))
        };
        let (colours, covered) = match self {
            Self::Truth => return (rgb.clone(), view.truth, None),
            Self::Grey => (TwoColours::default(), None),
            Self::Median => (TwoColours::same(median()), None),
            Self::Mean => {
                let mean = view.image.iter().map(|c| c.as_dvec3()).sum::<DVec3>();
                (TwoColours::same(Chroma::of(mean)), None)
            }
            Self::MedianKnown => (TwoColours::same(less(median())), None),
            Self::One => {
                let albedo = rgb.each_ref().map(BivariateTable::normal_albedo);
                (TwoColours::same(Chroma::of(DVec3::from_array(albedo))), None)
            }
            Self::Estimate => posterior(None),
            Self::EstimateKnown => posterior(Some(view.light)),
            Self::Two => (view.truth, None),
        };
        (colours.tables(&view.table), colours, covered)
    }
}
