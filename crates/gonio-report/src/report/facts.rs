//! Tables and sentences of the report.

use gonio::estimate::{MaterialEstimate, WIDE};
use gonio::scene::ObservationReport;
use gonio_io::result::{Colour, GlossUnits, Quantiles, ResultDocument, UncertainColour};
use maud::{Markup, html};

use super::{codes, hex, percent, short};
use crate::page::table;

/// States finish, roughness and certainty; the finish is bold.
pub(super) fn verdict_of(material: &MaterialEstimate) -> Markup {
    let verdict = material.verdict();
    let finish = material.finish().name();
    html! { strong { (finish) } (verdict.strip_prefix(finish).unwrap_or(&verdict)) "." }
}

/// Shows misfit and scatter, and the expected misfit, if known.
pub(super) fn verdict(misfit: Option<f64>, expected: Option<f64>, scatter: Option<f64>) -> Markup {
    let beside = expected.map(|e| format!("; about {} is expected from noise and the light's resolution", percent(e)));
    let words = format!("relative root mean square residual of the photograph{}", beside.unwrap_or_default());
    let numbers = [
        (misfit, "misfit", words.as_str()),
        (
            scatter,
            "scatter",
            "relative difference between pixels with the same normal, caused by noise, texture, \
            shadows or wrong normals",
        ),
    ];
    html! {
        @if misfit.or(scatter).is_some() {
            dl.facts.verdict {
                @for (value, name, words) in numbers {
                    @if let Some(value) = value {
                        div { dt { (name) } dd { strong { (percent(value)) } span.note { " " (words) } } }
                    }
                }
            }
        }
    }
}

/// Shows the warnings.
pub(super) fn warnings(lines: &[String]) -> Markup {
    html! {
        @if !lines.is_empty() {
            div.warnings role="note" aria-label="Warnings" {
                strong { @if lines.len() == 1 { "Warning" } @else { "Warnings" } }
                ul { @for line in lines { li { (line) } } }
            }
        }
    }
}

/// Summarises the estimate in words.
pub(super) fn facts(material: &MaterialEstimate, result: &ResultDocument) -> Markup {
    let interval = |[low, median, high]: [f64; 3]| {
        html! { strong { (short(median)) } ", 90 % interval " (short(low)) " to " (short(high)) }
    };
    html! {
        dl.facts {
            div {
                dt { "roughness" }
                dd { (interval(material.highlight.roughness())) span.note { " (as in the principled BSDFs of Mitsuba and Blender)" } }
            }
            div {
                dt { "GGX alpha" }
                dd { (interval(material.highlight.alpha)) span.note { " (square of the roughness)" } }
            }
            @if let Some(units) = result.posterior.as_ref().and_then(|posterior| posterior.highlight.gloss_units) {
                (gloss_units(units, result.reflectance.absolute))
            }
            div {
                dt { "peak height" }
                dd { (interval(material.peak_height)) span.note { (SCALE) } }
            }
            div {
                dt { "uncertain share of the BRDF" }
                dd {
                    strong { (percent(material.wider_than(WIDE))) }
                    " with a 90 % interval wider than a factor of " (WIDE) "; "
                    strong { (percent(material.undetermined_share)) }
                    " not determined by the photograph"
                }
            }
            (colours(&result.colour))
        }
    }
}

/// Shows the colours of body and highlight with copy buttons, each with a strip of its posterior.
pub(super) fn colours(colour: &Colour) -> Markup {
    html! {
        @for (name, part, found) in [("body colour", "body", &colour.body), ("highlight colour", "highlight", &colour.highlight)] {
            @if let Some(UncertainColour { rgb, quantile_colours, .. }) = found {
                @let [r, g, b] = codes(rgb);
                @let hex = hex(rgb);
                div {
                    dt { (name) }
                    dd.hex {
                        span.swatch style={ "background: " (hex) } {} " "
                        code id={ "colour-" (part) } { (hex) } " "
                        button type="button" data-copy={ "colour-" (part) } aria-label={ "Copy " (name) } { "Copy" }
                        @if !quantile_colours.is_empty() {
                            span.strip role="img" aria-label={ "The " (name) " from 5 to 95 % of its posterior" } {
                                @for rgb in quantile_colours { span style={ "background: " (self::hex(rgb)) } {} }
                            }
                            " "
                        }
                        span.note {
                            @if !quantile_colours.is_empty() { "5 to 95 % of the posterior;" }
                            " sRGB " (r) ", " (g) ", " (b) " at 70 % brightness; linear, scaled to a luminance of one: "
                            (rgb.iter().map(|x| format!("{x:.2}")).collect::<Vec<_>>().join(", "))
                        }
                    }
                }
            }
        }
    }
}

/// Description of the scale of the ratio.
const SCALE: &str = " (relative to the body: about 1 for chalk, tens for satin paint, thousands for polished \
    metal, above 100,000 for a mirror)";

/// Shows gloss units with the albedo for which they hold.
fn gloss_units(units: GlossUnits, absolute: bool) -> Markup {
    let GlossUnits { albedo, at_20, at_60 } = units;
    html! {
        div {
            dt { "gloss units" }
            dd {
                @for (i, (angle, Quantiles { low, median, high })) in [("20°", at_20), ("60°", at_60)].into_iter().enumerate() {
                    @if i > 0 { "; " }
                    (angle) ": " strong { (short(median)) } " (" (short(low)) " to " (short(high)) ")"
                }
                span.note {
                    " (ASTM D523, black glass has 100; "
                    @if absolute { "for the estimated albedo of " (short(albedo)) ")" }
                    @else { "proportional to the albedo at normal incidence, which the photograph does not \
                        determine; here for an albedo of " (albedo) ")" }
                }
            }
        }
    }
}

/// Builds the table of pixels by status, and of points in self-shadow.
pub(super) fn counts(report: &ObservationReport) -> Markup {
    let rows: Vec<Vec<String>> = [
        ("pixels on the object", report.observed_pixels),
        ("pixels used", report.used_pixels),
        ("pixels clipped", report.clipped_pixels),
        ("pixels negative, NaN or infinite", report.negative + report.not_finite),
        ("pixels ignored as outliers", report.outliers),
        ("pixels ignored as another colour or paint", report.other_colour_pixels),
        ("pixels converted from a second paint", report.converted_pixels),
        ("pixels ignored as dark outliers", report.dark_outliers),
        ("pixels ignored at edges", report.at_edges),
        ("points in self-shadow", report.in_shadow),
    ]
    .into_iter()
    .enumerate()
    .filter(|(i, (_, count))| *i < 2 || *count > 0)
    .map(|(_, (name, count))| vec![name.to_owned(), count.to_string()])
    .collect();
    table::table("Used and ignored pixels", &["kind", "number"], &rows)
}
