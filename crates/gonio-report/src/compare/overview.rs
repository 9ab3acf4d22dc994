//! Table of the results.

use glam::Vec3;
use gonio::picture::Plane;
use maud::{Markup, html};
use serde_json::Value;

use super::{Entry, Found, Highlight, plain};
use crate::page::figure;
use crate::report::{hex, linear, percent, short, three};

/// Columns after the name.
const COLUMNS: [&str; 9] = [
    "photograph",
    "in a new light",
    "gloss",
    "GGX alpha",
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
            @if let Ok(found) = &entry.found { (origin(&found.notes)) }
        }
        @match &entry.found {
            Ok(found) => { (cells(&name, found)) }
            Err(why) => { td.words colspan=(COLUMNS.len()) { strong { "No result: " } (plain(why)) } }
        }
    }
}

/// Renders the photographs and the method of a result.
fn origin(notes: &Value) -> Markup {
    let of_many = notes["photographs"].as_array().into_iter().flatten();
    let images = of_many.flat_map(|photograph| texts(&photograph["images"]));
    let images: Vec<String> = text(&notes["image"]).into_iter().chain(images).collect();
    html! {
        @if !images.is_empty() { small { (plain(&images.join(", "))) } }
        @if let Some(method) = text(&notes["method"]) { small { (method) } }
    }
}

fn cells(name: &str, found: &Found) -> Markup {
    let Found { notes, photograph, sphere, table: _, faults } = found;
    let Highlight { gloss, alpha } = Highlight::of(notes);
    let picture = |picture: Option<&Plane<Vec3>>, words: &str| {
        html! { td { @match picture { Some(picture) => { (figure::picture(picture, words)) } None => { "–" } } } }
    };
    html! {
        (picture(photograph.as_ref(), &format!("The photograph of {name}")))
        (picture(sphere.as_ref(), &format!("A sphere of the material of {name}")))
        (interval(gloss))
        (interval(alpha))
        td { (units(&notes["posterior"]["gloss"]["units"])) }
        td { (colours(&notes["colour"])) }
        td.words { (nearest(&notes["posterior"]["materials"][0])) }
        td { (misfit(&notes["noise"])) }
        td.words { (trust(notes, faults)) }
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

fn units(units: &Value) -> Markup {
    let at = |angle: &str| Some((format!("{angle}°"), three(&units[angle])?));
    let known: Vec<_> = ["20", "60"].into_iter().filter_map(at).collect();
    let albedo = units["albedo"].as_f64().filter(|albedo| *albedo != gonio::estimate::ALBEDO);
    html! {
        @if known.is_empty() { "–" }
        @for (angle, [low, median, high]) in known {
            div { (angle) ": " strong { (short(median)) } small { (short(low)) " to " (short(high)) } }
        }
        @if let Some(albedo) = albedo { small { "albedo " (short(albedo)) } }
    }
}

fn colours(colour: &Value) -> Markup {
    let of = |part: &'static str| Some((part, hex(&linear(&colour[part]["rgb"])?)));
    let known: Vec<_> = ["body", "highlight"].into_iter().filter_map(of).collect();
    html! {
        @if known.is_empty() { "–" }
        @for (part, hex) in known {
            div.colour { span.swatch style={ "background: " (hex) } {} " " code { (hex) } small { (part) } }
        }
    }
}

fn nearest(material: &Value) -> Markup {
    html! {
        @match text(&material["name"]) {
            Some(name) => {
                (name)
                @if let Some(weight) = material["weight"].as_f64() { small { (percent(weight)) " of the posterior" } }
            }
            None => { "–" }
        }
    }
}

fn misfit(noise: &Value) -> Markup {
    html! {
        @match noise["misfit"].as_f64() {
            Some(misfit) => {
                strong { (percent(misfit)) }
                @if let Some(expected) = noise["expected"].as_f64() { small { "expected " (percent(expected)) } }
            }
            None => { "–" }
        }
    }
}

/// Renders the uncertainty of a result, its warnings (folded) and its errors.
fn trust(notes: &Value, faults: &[String]) -> Markup {
    let warnings = texts(&notes["warnings"]);
    html! {
        (text(&notes["posterior"]["gloss"]["verdict"]).unwrap_or_else(|| "–".to_owned()))
        @if !warnings.is_empty() {
            details {
                summary { @if warnings.len() == 1 { "1 warning" } @else { (warnings.len()) " warnings" } }
                ul { @for warning in &warnings { li { (warning) } } }
            }
        }
        @for fault in faults { small { (plain(fault)) } }
    }
}

fn text(value: &Value) -> Option<String> {
    value.as_str().map(plain)
}

fn texts(list: &Value) -> Vec<String> {
    list.as_array().into_iter().flatten().filter_map(text).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn row_contains_the_numbers_of_its_result() {
        let three = |low: f64| json!({ "5": low, "50": 2.0 * low, "95": 4.0 * low });
        let mut gloss = three(10.0);
        gloss["ggx_alpha"] = three(0.1);
        gloss["units"] = json!({ "albedo": 0.25, "20": three(1.0), "60": three(5.0) });
        gloss["verdict"] = json!("known to a factor of 4.0");
        let notes = json!({
            "image": "ball.exr", "method": "learnt",
            "posterior": { "gloss": gloss, "materials": [{ "name": "brass", "weight": 0.32 }] },
            "noise": { "misfit": 0.018, "expected": 0.15 },
            "colour": { "body": { "rgb": [1.0, 0.0, 0.0] }, "highlight": { "rgb": [1.0, 1.0, 1.0] } },
            "warnings": ["one", "two"],
        });
        let found = Found { notes, faults: vec!["brdf.binary: is cut short".into()], ..Found::default() };
        let entry = Entry { name: "a".into(), report: Some("./a/report.html".into()), found: Ok(found) };
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
            "known to a factor of 4.0",
            "<summary>2 warnings</summary><ul><li>one</li><li>two</li></ul>",
            "<small>brdf.binary: is cut short</small>",
        ] {
            assert!(html.contains(text), "{text} in {html}");
        }
        assert_eq!(html.matches("<td").count(), COLUMNS.len());
    }

    #[test]
    fn unknown_values_are_dashes() {
        let found = Found { notes: json!({ "format": "gonio-result" }), ..Found::default() };
        let html = row(0, &Entry { name: "old".into(), report: None, found: Ok(found) }).into_string();
        assert_eq!((html.matches("<td").count(), html.matches('–').count()), (9, 9), "{html}");
    }
}
