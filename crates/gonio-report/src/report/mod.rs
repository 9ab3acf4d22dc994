//! Self-contained HTML report of an estimate with its uncertainty.

mod combined;
mod facts;
mod lobes;
mod packed;
mod reflectance;
mod renderers;
pub mod sphere;

use glam::Vec3;
use gonio::estimate::{MaterialEstimate, WIDE};
use gonio_io::result::ResultDocument;
use maud::{Markup, PreEscaped, html};

use self::facts::{colours, counts, facts, verdict, verdict_of, warnings};
use crate::page::{Document, Section, figure};
use crate::panels::{PANEL, Panels, Subject, resolution, used};
use crate::uncertainty::{svg, width};
pub use combined::{CombinedPhotograph, CombinedReport};
pub(crate) use reflectance::cut;
pub use renderers::Fits;

/// Styles of results beyond those of all reports.
const RESULT_STYLE: &str = include_str!("report.css");
/// Styles and scripts of the page beyond those of all reports.
const STYLE: &str = concat!(include_str!("report.css"), include_str!("../../viewer/viewer.css"));
const SCRIPT: &str = concat!(
    include_str!("../../viewer/renderer.js"),
    include_str!("../../viewer/viewer.js"),
    include_str!("report.js"),
    include_str!("../page/copy.js")
);

/// Width of the picture of a draw, in pixels: five fit in a row.
const DRAW: usize = 210;

/// Width of the picture of a similar material, in pixels: two fit beside the map of widths.
const SIMILAR: usize = 230;

/// Width at which most pictures are shown: half of their pixels, for high-resolution screens.
const SHOWN: usize = PANEL / 2;

/// Content of the page.
pub struct Report<'a> {
    /// Name of the photograph, for title and files.
    pub name: &'a str,
    /// Photograph and estimate.
    pub subject: &'a Subject<'a>,
    /// Pictures of the subject.
    pub panels: &'a Panels,
    /// Best fits of renderer models to the BRDF.
    pub fits: &'a Fits,
    /// Warnings to the user, one line each.
    pub warnings: &'a [String],
    /// Content of `result.json`. The page omits sections that are missing.
    pub result: &'a ResultDocument,
}

impl Report<'_> {
    /// Renders the page as HTML.
    pub fn render(&self) -> String {
        let section = |id: &str, title: &str, body: Markup| Section { id: id.into(), title: title.into(), body };
        let mut sections = vec![
            section("photograph", "Photograph and light", self.photograph()),
            section("reflectance", "BRDF", reflectance::section(self.subject, self.panels)),
        ];
        if let Some(material) = self.subject.material {
            sections.push(section("trust", "Uncertainty", self.trust(material)));
        }
        sections.push(section("renderers", "Parameters for renderers", renderers::section(self.name, self.fits)));
        sections.push(section("making", "Settings", self.making()));
        let title = format!("Material of {}", self.name);
        let lead = html! {
            (self.lead())
            (warnings(self.warnings))
            (self.next_step())
            (self.verdict())
            section #found { (self.found()) }
            (self.about())
        };
        Document { title: &title, lead, sections, style: STYLE, script: SCRIPT }.render()
    }

    /// States the estimate and its uncertainty in one sentence.
    fn lead(&self) -> Markup {
        html! {
            p.answer {
                @match self.subject.material {
                    Some(material) => { (verdict_of(material)) }
                    None => { "This method estimates no intervals of the BRDF." }
                }
            }
        }
    }

    /// Recommends how to narrow wide intervals.
    fn next_step(&self) -> Markup {
        let is_wide = self.subject.material.is_some_and(|material| material.peak_factor() > WIDE);
        let first =
            if self.warnings.is_empty() { "" } else { "First remove the causes of the warnings (docs/warnings.md). " };
        html! {
            @if is_wide {
                p.note {
                    strong { "Next: " }
                    (first)
                    @if self.subject.known_light.is_none() {
                        "A known light narrows the intervals most: photograph a mirror ball beside the object ("
                        code { "--mirror-ball" } ") or specify a light probe (" code { "--light" } ")."
                    } @else {
                        "Further photographs in other lights narrow the intervals a little (" code { "gonio combine" } ")."
                    }
                }
            }
        }
    }

    /// States whether the light was known, and the scale of the BRDF.
    fn about(&self) -> Markup {
        if self.subject.known_light.is_none() {
            let scale = self.result.reference.as_ref().and_then(|reference| reference.scale);
            let albedo = scale.map(|scale| scale.normal_albedo);
            return html! {
                p.note {
                    "BRDF of an object, estimated from one photograph under unknown light. "
                    @if let Some(albedo) = albedo {
                        "A reference in the image determines the scale: the albedo at normal incidence is " (format!("{albedo:.2}")) "."
                    } @else {
                        "The photograph does not determine the absolute albedo; it is set to 0.5 at normal incidence."
                    }
                }
            };
        }
        let albedo = self.result.exposure.and_then(|exposure| exposure.albedo);
        let absolute = self.result.reflectance.absolute;
        html! {
            p.note {
                "BRDF of an object, estimated from one photograph under a known light. "
                @match (albedo, absolute) {
                    (Some(albedo), true) => {
                        "Photograph and environment map have the same scale: the albedo at normal incidence is " (format!("{albedo:.2}")) "."
                    }
                    (Some(albedo), false) => {
                        "The albedo at normal incidence is set to 0.5. It is " (format!("{albedo:.2}")) " if photograph and environment map have the same scale."
                    }
                    _ => { "The albedo at normal incidence is set to 0.5." }
                }
            }
        }
    }

    fn found(&self) -> Markup {
        html! {
            div.found {
                div {
                    div #sphere {
                        @if let Some((_, sphere)) = self.panels.spheres.first() {
                            img.still src=(figure::source(sphere)) width=(PANEL) height=(PANEL) alt="A sphere of the material in a studio light";
                        }
                        p.note { "The interactive sphere requires JavaScript." }
                    }
                    script #sphere-data type="application/json" { (PreEscaped(sphere::data(self.subject))) }
                }
                div {
                    div.row {
                        @for (label, picture, alt) in [
                            ("photograph", &self.panels.photograph, "The photograph of the object"),
                            ("reproduction", &self.panels.reproduction, "The object, rendered with the estimated BRDF and light"),
                            ("difference", &self.panels.residual, "Difference between the photograph and its reproduction"),
                        ] { div.tile { (figure::sized(picture, SHOWN, alt)) span { (label) } } }
                    }
                    p.note {
                        "Grey means no difference. Where a pixel is lighter or redder, the photograph is lighter or \
                         redder than the reproduction. Black, white and saturated colours mean a difference of 50 % \
                         or more."
                    }
                    @match self.subject.material {
                        Some(material) => { (facts(material, self.result)) }
                        None => { dl.facts { (colours(&self.result.colour)) } }
                    }
                }
            }
        }
    }

    /// Shows misfit and scatter, if known.
    fn verdict(&self) -> Markup {
        let residual = self.result.residual;
        let scatter = self.subject.material.map(|material| material.scatter).filter(|scatter| *scatter > 0.0);
        let misfit = residual.and_then(|residual| residual.misfit.or(residual.relative_noise));
        verdict(misfit, residual.and_then(|residual| residual.expected), scatter)
    }

    fn photograph(&self) -> Markup {
        let Panels { observed, light, .. } = self.panels;
        let given = if self.subject.light.is_some() { "estimated" } else { "known" };
        let light_words = format!("The {given} light as a tone-mapped map of all directions");
        let mut pictures = vec![figure::card(
            "Observations",
            &figure::sized(observed, SHOWN, "The photograph with a dot at each sample point"),
            &html! { "Each dot is a sample point; in small images, points lie between pixels. " span.used { "Teal" } ": used. " span.unused { "Red" } ": visible, but ignored (clipped, faulty, covered, in shadow, or of another colour or paint)." },
        )];
        pictures.extend(self.used());
        pictures.push(figure::card(
            &format!("The {given} light"),
            &figure::picture(light, &light_words),
            &html! {
                "Lat-long map: the centre is behind the object, the left and right edges are behind the camera. "
                @if let Some(grid) = self.subject.light {
                    "This light explains the photograph, given the mean BRDF. Its texels are " (format!("{:.1}", resolution(grid))) "° wide; the picture is blurred by half a texel."
                    @let coarse = self.result.settings.grid.unwrap_or(grid.side());
                    @if grid.side() > coarse {
                        (format!(" Where the object does not reflect the light, it has details of {:.1}° only.", resolution(grid) * grid.side() as f64 / coarse as f64))
                    }
                    @if let Some(share) = self.uncertain() {
                        (format!(" The posterior variance of the coarse light is {} of its mean square variation over directions.", percent(share)))
                    }
                }
            },
        ));
        pictures.push(html! { div { (counts(&self.subject.detection.observations.report)) } });
        html! {
            (figure::grid(18, &pictures))
            @if self.subject.light.is_some() {
                p { "A small difference does not prove that the material is correct: a mirror under a blurred light \
                    can look like a dull surface under a sharp light." }
            }
        }
    }

    /// Returns posterior variance / (posterior variance + squared mean), each summed over all light
    /// coefficients but the mean; `None` if the method does not estimate it.
    fn uncertain(&self) -> Option<f64> {
        let light = self.result.light.as_ref()?;
        // The first coefficient is the mean.
        let squares = |values: &[f64]| values.iter().skip(1).map(|v| v * v).sum::<f64>();
        let (mean, variance) = (squares(&light.coefficients), squares(&light.sd));
        (variance > 0.0).then(|| variance / (mean + variance))
    }

    /// Shows the ignored pixels with the reasons; `None` if only pixels outside were ignored.
    fn used(&self) -> Option<Markup> {
        let (picture, statuses) = (self.panels.used.as_ref()?, self.subject.detection.observations.statuses.as_ref()?);
        let reasons = used::reasons(statuses);
        let dot = |colour: Vec3| {
            let [r, g, b] = colour.to_array().map(|x| (255.0 * gonio::picture::srgb_encode(x)).round());
            format!("--dot: rgb({r} {g} {b})")
        };
        let caption = html! {
            "Ignored pixels: "
            @for (i, (mark, count)) in reasons.iter().enumerate() {
                @if i > 0 { ", " }
                span.mark style=(dot(mark.colour)) { (mark.label) } " (" (count) ")"
            }
            ". Dark: outside the object, or at grazing angles."
        };
        let alt = "The photograph with ignored pixels marked";
        Some(figure::card("Used pixels", &figure::sized(picture, SHOWN, alt), &caption))
    }

    fn trust(&self, material: &MaterialEstimate) -> Markup {
        let similar: Vec<(String, Markup)> = material
            .posterior
            .neighbours
            .iter()
            .zip(&self.panels.similar)
            .map(|(neighbour, picture)| {
                let sphere = figure::sized(picture, SIMILAR, &format!("A sphere with the BRDF of {}", neighbour.name));
                (format!("{}, {}", neighbour.name, percent(neighbour.weight)), sphere)
            })
            .collect();
        let ends = ["dull end (5 %)", "estimate", "glossy end (95 %)"];
        let pictures = [self.panels.ends.first(), self.panels.spheres.first().map(|s| &s.1), self.panels.ends.get(1)];
        let tiles: Vec<(&str, Markup)> = ends
            .into_iter()
            .zip(pictures)
            .filter_map(|(label, p)| {
                Some((label, figure::sized(p?, SHOWN, &format!("A sphere of the material: {label}"))))
            })
            .collect();
        let names = ["draw 1", "draw 2", "draw 3", "draw 4", "draw 5"];
        let draws: Vec<(&str, Markup)> = names
            .into_iter()
            .zip(&self.panels.draws)
            .map(|(label, picture)| {
                (label, figure::sized(picture, DRAW, &format!("A sphere of {label} from the posterior")))
            })
            .collect();
        html! {
            (figure::figure(&figure::tiles(&tiles), &html! {
                "Estimate and both ends of the 90 % interval, in a studio light. gonio draws materials from the posterior and \
                 orders them by their main visible difference in this picture. The two ends lie at 5 % and 95 % of this \
                 order. "
                (format!("They differ most in the {}, by a factor of {:.1}. ", material.ends.region.name(), material.ends.factor))
                "The more they differ, the less the photograph determines the material."
            }))
            (figure::figure(&figure::tiles(&draws), &html! {
                "Five materials drawn from the posterior, in the same light, in order of their position between the two \
                 ends. They are equally likely."
            }))
            (figure::grid(22, &[
                figure::figure(&svg(&[&width(material)], false, "Map of the width of the 90 % interval over half and difference angle"),
                    &html! {
                        "Width of the 90 % interval in each cell, as the ratio of its ends. "
                        (format!("It exceeds a factor of {WIDE} in {} of the cells below 80°. ", percent(material.wider_than(WIDE))))
                        (format!("The photograph does not determine the hatched cells ({} of the cells below 80°). ", percent(material.undetermined_share)))
                        "All cells above 80° are hatched, too."
                    }),
                figure::figure(&figure::tiles(&similar), &html! {
                    "Measured materials (MERL database) with the most similar highlights, in the estimated colours, and \
                     their weights among the measured materials."
                }),
            ]))
        }
    }

    fn making(&self) -> Markup {
        let result = self.result;
        let mut rows: Vec<Vec<String>> = [
            ("method", Some(result.method.clone())),
            ("light grid (texels per side)", result.settings.grid.map(|side| side.to_string())),
            ("gonio", Some(result.gonio.clone())),
            ("model", Some(result.model.provenance.clone())),
        ]
        .into_iter()
        .filter_map(|(name, value)| Some(vec![name.to_owned(), value?]))
        .collect();
        let stages: Vec<String> = result.seconds.iter().map(|(stage, s)| format!("{stage} {s:.1}")).collect();
        if !stages.is_empty() {
            rows.push(vec!["seconds".into(), stages.join(", ")]);
        }
        html! {
            dl.facts { @for row in &rows { div { dt { (row[0]) } dd { (row[1]) } } } }
            p.note { "In the folder of this page, result.json contains all numbers, and brdf.npz the BRDF and its \
                quantiles as numpy arrays. " code { "gonio export" } " converts the BRDF for renderers." }
        }
    }
}

/// Formats the sRGB codes from [`codes`] in hexadecimal.
pub(crate) fn hex(rgb: &[f64; 3]) -> String {
    let [r, g, b] = codes(rgb);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Formats a share as a percentage, with one decimal below 10 %.
pub(crate) fn percent(share: f64) -> String {
    let value = 100.0 * share;
    if value >= 9.95 || value == 0.0 { format!("{value:.0} %") } else { format!("{value:.1} %") }
}

pub(crate) use gonio::estimate::two_digits as short;

/// Returns the sRGB codes of a linear colour, scaled to 70 % in its largest channel.
fn codes(rgb: &[f64; 3]) -> [u8; 3] {
    let top = rgb.iter().copied().fold(1e-9, f64::max);
    rgb.map(|x| {
        let value = (0.7 * x / top).clamp(0.0, 1.0);
        (255.0 * gonio::picture::srgb_encode(value as f32)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use gonio_io::result::{Colour, UncertainColour};

    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.123, 1.234, 12.34, 1234.0, 99_700.0].map(short), ["0.12", "1.2", "12", "1200", "100000"]);
        assert_eq!([0.0, 0.012, 0.0996, 0.5].map(percent), ["0 %", "1.2 %", "10 %", "50 %"]);
    }

    #[test]
    fn colours_are_valid_in_a_style() {
        assert_eq!(codes(&[1.0, 0.0, 0.0]), [218, 0, 0]);
        let red = UncertainColour { rgb: [1.0, 0.0, 0.0], ..UncertainColour::default() };
        let page = colours(&Colour { body: Some(red), ..Colour::default() }).into_string();
        assert!(
            page.contains("#da0000") && page.contains("data-copy=\"colour-body\"") && !page.contains("highlight"),
            "{page}"
        );
    }

    #[test]
    fn verdict_shows_only_known_numbers() {
        let both = verdict(Some(0.123), Some(0.05), Some(0.034)).into_string();
        assert!(both.contains("12 %") && both.contains("3.4 %"), "{both}");
        assert!(!verdict(Some(0.123), None, None).into_string().contains("scatter"));
        assert_eq!(verdict(None, None, None).into_string(), "");
    }

    #[test]
    fn escapes_warnings_and_omits_empty_lists() {
        assert_eq!(warnings(&[]).into_string(), "");
        assert!(warnings(&["a < b".into()]).into_string().contains("a &lt; b"));
    }
}
