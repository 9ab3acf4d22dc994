//! Self-contained HTML page that compares several results.

mod agreement;
mod intervals;
mod lobes;
mod matrix;
mod overview;

use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use maud::{Markup, html};
use serde_json::Value;

pub use agreement::{Agreement, Pair};

use crate::page::{Document, Section};
use crate::panels::resize;
use agreement::Highlight;

const STYLE: &str = include_str!("compare.css");

/// Results whose BRDFs are drawn over each other and compared, at most.
pub const MOST: usize = 24;
/// Results that are shown with pictures, at most.
pub const MOST_PICTURES: usize = 200;

/// Longer side of the pictures of a result, pixels: shown at half of it.
const THUMBNAIL: usize = 224;
/// Letters of a text from a folder that are shown, at most.
const LETTERS: usize = 400;

/// A result.
pub struct Entry {
    /// Name.
    pub name: String,
    /// Address of its own page, relative to this one.
    pub report: Option<String>,
    /// Contents of its folder, or the error.
    pub found: Result<Found, String>,
}

/// What a folder of results holds. All of it may be missing, and nothing in it is taken for
/// granted.
#[derive(Default)]
pub struct Found {
    /// `result.json`.
    pub notes: Value,
    /// The photograph, as [`thumbnail`] makes it.
    pub photograph: Option<Plane<Vec3>>,
    /// A sphere of the material, as [`thumbnail`] makes it.
    pub sphere: Option<Plane<Vec3>>,
    /// Luminance of the BRDF (1/sr); read if there are not more than [`MOST`] results.
    pub table: Option<BivariateTable>,
    /// Errors of its files, one line each.
    pub faults: Vec<String>,
}

/// Makes a picture as small as the page shows it.
pub fn thumbnail(picture: &Plane<Vec3>) -> Plane<Vec3> {
    let (width, height) = picture.size();
    let longest = width.max(height).max(1);
    let small = |side: usize| (side * THUMBNAIL.min(longest) / longest).max(1);
    resize(picture, small(width), small(height))
}

/// Results side by side.
pub struct Comparison {
    entries: Vec<Entry>,
    /// Every two of them, if there are at most [`MOST`]: without those that were not found.
    pub pairs: Vec<Pair>,
}

impl Comparison {
    /// Compares results.
    pub fn of(entries: Vec<Entry>) -> Self {
        let pairs = if entries.len() <= MOST { agreement::pairs(&entries) } else { Vec::new() };
        Self { entries, pairs }
    }

    /// Number of results, those that were not found among them.
    pub fn count(&self) -> usize {
        self.entries.len()
    }

    /// Names of two results, as the page shows them.
    pub fn names(&self, pair: &Pair) -> [String; 2] {
        pair.of.map(|at| plain(&self.entries[at].name))
    }

    /// Renders the page as HTML.
    pub fn render(&self) -> String {
        let section = |id: &str, title: &str, body: Markup| Section { id: id.into(), title: title.into(), body };
        let mut sections = vec![
            section("results", "Results", overview::table(&self.entries)),
            section("intervals", "Gloss and width of the highlight", intervals::section(&self.entries)),
        ];
        if self.entries.len() > 1 {
            sections.push(section("brdfs", "BRDFs", lobes::section(&self.entries)));
            sections.push(section("agreement", "Agreement", matrix::section(self)));
        }
        let title = match self.entries.len() {
            1 => "One result".to_owned(),
            count => format!("Comparison of {count} results"),
        };
        Document { title: &title, lead: self.lead(), sections, style: STYLE, script: "" }.render()
    }

    /// Says first whether they agree.
    fn lead(&self) -> Markup {
        let missing = self.entries.iter().filter(|entry| entry.found.is_err()).count();
        html! {
            @if let [pair] = &self.pairs[..] { p.answer { (pair.sentence) } }
            @else if !self.pairs.is_empty() { p.answer { (matrix::counts(&self.pairs)) } }
            @if missing > 0 { p { (missing) " of " (self.entries.len()) " results are missing." } }
            @if self.entries.len() > MOST_PICTURES {
                p.note { "Pictures are omitted, because there are more than " (MOST_PICTURES) " results." }
            }
        }
    }
}

/// Notes that a part of the page is omitted because of too many results.
fn left_out(what: &str) -> Markup {
    html! { p.note { (what) ", because there are more than " (MOST) " results." } }
}

/// The results that were found.
fn found(entries: &[Entry]) -> impl Iterator<Item = (&Entry, &Found)> {
    entries.iter().filter_map(|entry| Some((entry, entry.found.as_ref().ok()?)))
}

/// A text from a folder as it can be shown: short, and without codes that turn or hide text. The
/// page escapes markup.
fn plain(text: &str) -> String {
    let odd = |c: char| c.is_control() || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let mut shown: String = text.chars().take(LETTERS).map(|c| if odd(c) { ' ' } else { c }).collect();
    if text.chars().nth(LETTERS).is_some() {
        shown.push('…');
    }
    shown
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn entry(name: &str, notes: Value) -> Entry {
        let sphere = Some(thumbnail(&Plane::from_fn(512, 512, |_, _| Vec3::splat(0.5))));
        let table = Some(BivariateTable::from_fn(|h, _| 0.1 + 5.0 * (-(h / 0.2).powi(2)).exp()));
        Entry { name: name.into(), report: None, found: Ok(Found { notes, sphere, table, ..Found::default() }) }
    }

    fn notes(gloss: f64) -> Value {
        json!({ "posterior": {
            "gloss": { "5": gloss / 2.0, "50": gloss, "95": gloss * 2.0, "verdict": "known <well>" },
            "materials": [{ "name": "<b>brass</b>", "weight": 0.5 }],
        }, "warnings": ["odd & <i>"], "noise": { "misfit": 0.02, "expected": 0.1 } })
    }

    #[test]
    fn what_strangers_wrote_is_text() {
        let names = ["<script>alert(1)</script>", "\u{202e}\u{1b}[31m\"'>"];
        let page = Comparison::of(names.map(|name| entry(name, notes(10.0))).into()).render();
        for text in ["&lt;script&gt;", "&lt;b&gt;brass", "odd &amp; &lt;i&gt;", "known &lt;well&gt;"] {
            assert!(page.contains(text), "{text}");
        }
        assert!(!page.contains("<script") && !page.contains("<b>brass") && !page.contains("<i>"));
        assert!(!page.contains(['\u{202e}', '\u{1b}']) && !page.contains("\"'>"));
    }

    #[test]
    fn notes_of_any_kind_make_a_page() {
        let odd = [
            Value::Null,
            json!([1, 2]),
            json!({ "posterior": 3, "warnings": "none", "colour": { "body": { "rgb": ["a"] } } }),
            json!({ "posterior": { "gloss": { "5": -1, "50": 1e308, "95": 0 }, "materials": [7] }, "warnings": [{}] }),
            json!({ "colour": { "body": { "rgb": [] }, "highlight": { "rgb": [1e308, -1, 0] } } }),
        ];
        let mut entries: Vec<Entry> = odd.into_iter().map(|notes| entry("odd", notes)).collect();
        entries.push(Entry { name: "failed".into(), report: None, found: Err("is <gone>".into()) });
        let page = Comparison::of(entries).render();
        assert!(page.contains("is &lt;gone&gt;") && page.contains("1 of 6 results are missing"));
        assert!(!page.contains(">NaN<") && !page.contains("inf<"));
    }

    #[test]
    fn two_results_begin_with_the_sentence() {
        let comparison = Comparison::of(vec![entry("a", notes(10.0)), entry("b", notes(1000.0))]);
        assert_eq!(comparison.pairs[0].agreement, Agreement::Differ);
        let page = comparison.render();
        assert!(page.contains("<p class=\"answer\">a and b differ, because their intervals do not overlap: gloss 10"));
        assert!(page.contains("Comparison of 2 results"));
    }

    #[test]
    fn of_many_results_the_table_and_the_intervals_remain() {
        let of = |count: usize| {
            let mut entries: Vec<Entry> = (0..count).map(|i| entry(&format!("n{i}"), notes(10.0))).collect();
            // Distances of all would take seconds.
            entries.iter_mut().skip(2).for_each(|entry| entry.found.as_mut().unwrap().table = None);
            Comparison::of(entries).render()
        };
        let (few, many) = (of(MOST), of(MOST + 1));
        assert!(few.contains("class=\"distances\"") && few.contains("role=\"img\""));
        assert!(!few.contains("omitted"), "nothing is left out of a few");
        assert!(!many.contains("class=\"distances\""));
        assert_eq!(many.matches("because there are more than 24 results").count(), 2);
        assert_eq!(many.matches("class=\"interval\"").count(), MOST + 1);
    }

    #[test]
    fn one_result_alone_has_nothing_to_agree_with() {
        let page = Comparison::of(vec![entry("only", notes(10.0))]).render();
        assert!(page.contains("One result") && !page.contains("id=\"agreement\""));
    }

    #[test]
    fn thumbnails_keep_their_shape_and_small_pictures_their_size() {
        let size = |w: usize, h: usize| thumbnail(&Plane::from_fn(w, h, |_, _| Vec3::ONE)).size();
        assert_eq!([size(512, 512), size(1000, 100), size(20, 10)], [(224, 224), (224, 22), (20, 10)]);
        assert_eq!(size(5000, 1), (224, 1));
    }

    #[test]
    fn long_texts_are_cut() {
        assert_eq!(plain(&"é".repeat(LETTERS)).chars().count(), LETTERS);
        assert_eq!(plain(&"é".repeat(LETTERS + 1)).chars().count(), LETTERS + 1);
        assert!(plain(&"a".repeat(LETTERS + 9)).ends_with('…'));
    }
}
