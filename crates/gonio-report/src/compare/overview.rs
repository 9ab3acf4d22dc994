//! Table of the results.

use glam::Vec3;
use gonio::picture::Plane;
use gonio_io::result::{Colour, GlossUnits, Quantiles, Residual, ResultDocument, SimilarMaterial};
use maud::{Markup, html};

use super::{Entry, FolderContents, Highlight, plain};
use crate::page::figure;
use crate::report::{hex, percent, short};

/// Columns after the name.
const COLUMNS: [&str; 9] = [
    "photograph",
    "in a new light",
    "roughness",
    "peak height",
    "gloss units",
    "colours",
    "most similar highlight",
    "misfit",
    "uncertainty, warnings",
];

pub(super) fn table(entries: &[Entry]) -> Markup {
    html! {
        div.scroll role="region" aria-label="The results" tabindex="0" {
            table.results {
                caption { "All intervals are 90 % intervals. Gloss units (ASTM D523, black glass has 100) are \
                    proportional to the albedo at normal incidence. A photograph under unknown light does not \
                    determine this albedo; the table states it if it is not 0.5." }
                thead { tr { th scope="col" { "result" } @for column in COLUMNS { th scope="col" { (column) } } } }
                tbody { @for (at, entry) in entries.iter().enumerate() { tr { (row(at, entry)) } } }
            }
        }
    }
}

fn row(at: usize, entry: &Entry) -> Markup {
    let name = plain(&entry.name);
    html! {
        th scope="row" {
            (at + 1) " "
            @match &entry.report { Some(report) => { a href=(report) { (name) } } None => { (name) } }
            @if let Ok(found) = &entry.contents { (origin(&found.result)) }
        }
        @match &entry.contents {
            Ok(found) => { (cells(&name, found)) }
            Err(why) => { td.words colspan=(COLUMNS.len()) { strong { "No result: " } (plain(why)) } }
        }
    }
}

/// Renders the photographs and the method of a result.
fn origin(result: &ResultDocument) -> Markup {
    let images: Vec<&str> = result.images().collect();
    html! {
        @if !images.is_empty() { small { (plain(&images.join(", "))) } }
        @if !result.method.is_empty() { small { (plain(&result.method)) } }
    }
}

fn cells(name: &str, found: &FolderContents) -> Markup {
    let FolderContents { result, photograph, sphere, table: _, faults } = found;
    let Highlight { roughness, peak } = Highlight::of(result);
    let posterior = result.posterior.as_ref();
    let picture = |picture: Option<&Plane<Vec3>>, words: &str| {
        html! { td { @match picture { Some(picture) => { (figure::picture(picture, words)) } None => { "–" } } } }
    };
    html! {
        (picture(photograph.as_ref(), &format!("The photograph of {name}")))
        (picture(sphere.as_ref(), &format!("A sphere of the material of {name}")))
        (interval(roughness))
        (interval(peak))
        td { (gloss_units(posterior.and_then(|posterior| posterior.highlight.gloss_units))) }
        td { (colours(&result.colour)) }
        td.words { (nearest(posterior.and_then(|posterior| posterior.materials.first()))) }
        td { (misfit(result.residual)) }
        td.words { (trust(result, faults)) }
    }
}

fn interval(quantiles: Option<[f64; 3]>) -> Markup {
    html! {
        td {
            @match quantiles {
                Some([low, median, high]) => { strong { (short(median)) } small { (short(low)) " to " (short(high)) } }
                None => { "–" }
            }
        }
    }
}

fn gloss_units(units: Option<GlossUnits>) -> Markup {
    let Some(GlossUnits { albedo, at_20, at_60 }) = units else { return html! { "–" } };
    html! {
        @for (angle, Quantiles { low, median, high }) in [("20°", at_20), ("60°", at_60)] {
            div { (angle) ": " strong { (short(median)) } small { (short(low)) " to " (short(high)) } }
        }
        @if albedo != gonio::estimate::ALBEDO { small { "albedo " (short(albedo)) } }
    }
}

fn colours(colour: &Colour) -> Markup {
    let parts = [("body", &colour.body), ("highlight", &colour.highlight)];
    let known: Vec<_> = parts.into_iter().filter_map(|(part, found)| Some((part, hex(&found.as_ref()?.rgb)))).collect();
    html! {
        @if known.is_empty() { "–" }
        @for (part, hex) in known {
            div.colour { span.swatch style={ "background: " (hex) } {} " " code { (hex) } small { (part) } }
        }
    }
}

fn nearest(material: Option<&SimilarMaterial>) -> Markup {
    html! {
        @match material {
            Some(SimilarMaterial { name, weight }) => { (plain(name)) small { (percent(*weight)) " of the posterior" } }
            None => { "–" }
        }
    }
}

fn misfit(residual: Option<Residual>) -> Markup {
    html! {
        @match residual {
            Some(Residual { misfit: Some(misfit), expected, .. }) => {
                strong { (percent(misfit)) }
                @if let Some(expected) = expected { small { "expected " (percent(expected)) } }
            }
            _ => { "–" }
        }
    }
}

/// Renders the uncertainty of a result, its warnings (folded) and its errors.
fn trust(result: &ResultDocument, faults: &[String]) -> Markup {
    let verdict = result.posterior.as_ref().map(|posterior| posterior.highlight.verdict.as_str());
    let verdict = verdict.filter(|verdict| !verdict.is_empty());
    let warnings: Vec<String> = result.warnings.iter().map(|warning| plain(warning)).collect();
    html! {
        (verdict.map_or_else(|| "–".to_owned(), plain))
        @if !warnings.is_empty() {
            details {
                summary { @if warnings.len() == 1 { "1 warning" } @else { (warnings.len()) " warnings" } }
                ul { @for warning in &warnings { li { (warning) } } }
            }
        }
        @for fault in faults { small { (plain(fault)) } }
    }
}

#[cfg(test)]
mod tests {
    use gonio_io::result::{self, PeakHeight, Posterior, UncertainColour};

    use super::*;

    #[test]
    fn row_contains_the_numbers_of_its_result() {
        let three = |low: f64| Quantiles { low, median: 2.0 * low, high: 4.0 * low };
        let highlight = result::Highlight {
            verdict: "satin: roughness 0.40".into(),
            roughness: Some(three(0.1)),
            gloss_units: Some(GlossUnits { albedo: 0.25, at_20: three(1.0), at_60: three(5.0) }),
            peak_height: PeakHeight { quantiles: three(10.0), factor: 4.0 },
            ..result::Highlight::default()
        };
        let materials = vec![SimilarMaterial { name: "brass".into(), weight: 0.32 }];
        let red = UncertainColour { rgb: [1.0, 0.0, 0.0], ..UncertainColour::default() };
        let result = ResultDocument {
            image: Some("ball.exr".into()),
            posterior: Some(Posterior { highlight, materials, ..Posterior::default() }),
            residual: Some(Residual { misfit: Some(0.018), expected: Some(0.15), ..Residual::default() }),
            colour: Colour { body: Some(red), ..Colour::default() },
            warnings: vec!["one".into(), "two".into()],
            ..ResultDocument::new("learnt", "0.1.0")
        };
        let found =
            FolderContents { result, faults: vec!["brdf.binary: is cut short".into()], ..FolderContents::default() };
        let entry = Entry { name: "a".into(), report: Some("./a/report.html".into()), contents: Ok(found) };
        let html = row(0, &entry).into_string();
        for text in [
            "<a href=\"./a/report.html\">a</a><small>ball.exr</small><small>learnt</small>",
            "<strong>20</strong><small>10 to 40</small>",
            "<strong>0.20</strong><small>0.10 to 0.40</small>",
            "60°: <strong>10</strong><small>5.0 to 20</small>",
            "<small>albedo 0.25</small>",
            "background: #da0000",
            "brass<small>32 % of the posterior</small>",
            "<strong>1.8 %</strong><small>expected 15 %</small>",
            "satin: roughness 0.40",
            "<summary>2 warnings</summary><ul><li>one</li><li>two</li></ul>",
            "<small>brdf.binary: is cut short</small>",
        ] {
            assert!(html.contains(text), "{text} in {html}");
        }
        assert_eq!(html.matches("<td").count(), COLUMNS.len());
    }

    #[test]
    fn unknown_values_are_dashes() {
        let html =
            row(0, &Entry { name: "old".into(), report: None, contents: Ok(FolderContents::default()) }).into_string();
        assert_eq!((html.matches("<td").count(), html.matches('–').count()), (9, 9), "{html}");
    }
}
