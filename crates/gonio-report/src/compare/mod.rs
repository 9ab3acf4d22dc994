//! Self-contained HTML page that compares several results.

mod agreement;
mod intervals;
mod lobes;
mod matrix;
mod overview;

use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio_io::result::ResultDocument;
use maud::{Markup, html};

pub use agreement::{Agreement, Pair};

use crate::page::{Document, Section};
use crate::panels::resize;
use agreement::Highlight;

const STYLE: &str = include_str!("compare.css");

/// Largest number of results whose BRDFs are drawn in one chart and compared.
pub const MAX_COMPARED: usize = 24;
/// Largest number of results that are shown with pictures.
pub const MAX_PICTURES: usize = 200;

/// Longer side of the pictures of a result, in pixels. The page shows them at half this size.
const THUMBNAIL: usize = 224;
/// Largest number of characters of a text from a folder.
const LETTERS: usize = 400;

/// A result.
pub struct Entry {
    /// Name.
    pub name: String,
    /// URL of its report, relative to this page.
    pub report: Option<String>,
    /// Contents of its folder, or the error.
    pub contents: Result<FolderContents, String>,
}

/// Contents of a folder of results. Pictures and table can be missing.
#[derive(Default)]
pub struct FolderContents {
    /// `result.json`.
    pub result: ResultDocument,
    /// The photograph, as [`thumbnail`] makes it.
    pub photograph: Option<Plane<Vec3>>,
    /// A sphere of the material, as [`thumbnail`] makes it.
    pub sphere: Option<Plane<Vec3>>,
    /// Luminance of the BRDF (1/sr); read if there are not more than [`MAX_COMPARED`] results.
    pub table: Option<BivariateTable>,
    /// Errors of its files, one line each.
    pub faults: Vec<String>,
}

/// Reduces a picture to the size for the page.
pub fn thumbnail(picture: &Plane<Vec3>) -> Plane<Vec3> {
    let (width, height) = picture.size();
    let longest = width.max(height).max(1);
    let small = |side: usize| (side * THUMBNAIL.min(longest) / longest).max(1);
    resize(picture, small(width), small(height))
}

/// Results side by side.
pub struct Comparison {
    entries: Vec<Entry>,
    /// All pairs of results, except missing ones; empty if there are more than [`MAX_COMPARED`]
    /// results.
    pub pairs: Vec<Pair>,
}

impl Comparison {
    /// Compares results.
    pub fn of(entries: Vec<Entry>) -> Self {
        let pairs = if entries.len() <= MAX_COMPARED { agreement::pairs(&entries) } else { Vec::new() };
        Self { entries, pairs }
    }

    /// Returns the number of results, including missing ones.
    pub fn count(&self) -> usize {
        self.entries.len()
    }

    /// Returns the names of two results, as the page shows them.
    pub fn names(&self, pair: &Pair) -> [String; 2] {
        pair.of.map(|at| plain(&self.entries[at].name))
    }

    /// Renders the page as HTML.
    pub fn render(&self) -> String {
        let section = |id: &str, title: &str, body: Markup| Section { id: id.into(), title: title.into(), body };
        let mut sections = vec![
            section("results", "Results", overview::table(&self.entries)),
            section("intervals", "Roughness and peak height", intervals::section(&self.entries)),
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

    /// Renders the agreement of the results, and notes on missing parts.
    fn lead(&self) -> Markup {
        let missing = self.entries.iter().filter(|entry| entry.contents.is_err()).count();
        html! {
            @if let [pair] = &self.pairs[..] { p.answer { (pair.sentence) } }
            @else if !self.pairs.is_empty() { p.answer { (matrix::counts(&self.pairs)) } }
            @if missing > 0 { p { (missing) " of " (self.entries.len()) " results are missing." } }
            @if self.entries.len() > MAX_PICTURES {
                p.note { "Pictures are omitted, because there are more than " (MAX_PICTURES) " results." }
            }
        }
    }
}

/// Renders a note that a part of the page is omitted because of too many results.
fn left_out(what: &str) -> Markup {
    html! { p.note { (what) ", because there are more than " (MAX_COMPARED) " results." } }
}

/// Iterates over the results that were found.
fn found(entries: &[Entry]) -> impl Iterator<Item = (&Entry, &FolderContents)> {
    entries.iter().filter_map(|entry| Some((entry, entry.contents.as_ref().ok()?)))
}

/// Shortens a text from a folder, and replaces characters that control the output or the text
/// direction. The page escapes markup.
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
    use gonio_io::result::{Highlight, PeakHeight, Posterior, Residual, SimilarMaterial};

    use super::*;

    fn entry(name: &str, result: ResultDocument) -> Entry {
        let sphere = Some(thumbnail(&Plane::from_fn(512, 512, |_, _| Vec3::splat(0.5))));
        let table = Some(BivariateTable::from_fn(|h, _| 0.1 + 5.0 * (-(h / 0.2).powi(2)).exp()));
        Entry {
            name: name.into(),
            report: None,
            contents: Ok(FolderContents { result, sphere, table, ..FolderContents::default() }),
        }
    }

    fn result(peak: f64) -> ResultDocument {
        let peak_height = PeakHeight { quantiles: [peak / 2.0, peak, peak * 2.0].into(), factor: 4.0 };
        let highlight = Highlight { peak_height, verdict: "known <well>".into(), ..Highlight::default() };
        let materials = vec![SimilarMaterial { name: "<b>brass</b>".into(), weight: 0.5 }];
        ResultDocument {
            posterior: Some(Posterior { highlight, materials, ..Posterior::default() }),
            warnings: vec!["odd & <i>".into()],
            residual: Some(Residual { misfit: Some(0.02), expected: Some(0.1), ..Residual::default() }),
            ..ResultDocument::new("learnt", "0.1.0")
        }
    }

    #[test]
    fn escapes_names_and_texts() {
        let names = ["<script>alert(1)</script>", "\u{202e}\u{1b}[31m\"'>"];
        let page = Comparison::of(names.map(|name| entry(name, result(10.0))).into()).render();
        for text in ["&lt;script&gt;", "&lt;b&gt;brass", "odd &amp; &lt;i&gt;", "known &lt;well&gt;"] {
            assert!(page.contains(text), "{text}");
        }
        assert!(!page.contains("<script") && !page.contains("<b>brass") && !page.contains("<i>"));
        assert!(!page.contains(['\u{202e}', '\u{1b}']) && !page.contains("\"'>"));
    }

    #[test]
    fn renders_odd_numbers() {
        let odd = [
            ResultDocument::default(),
            result(-1.0),
            result(1e307),
            ResultDocument { posterior: Some(Posterior::default()), ..ResultDocument::default() },
        ];
        let mut entries: Vec<Entry> = odd.into_iter().map(|result| entry("odd", result)).collect();
        entries.push(Entry { name: "failed".into(), report: None, contents: Err("is <gone>".into()) });
        let page = Comparison::of(entries).render();
        assert!(page.contains("is &lt;gone&gt;") && page.contains("1 of 5 results are missing"));
        assert!(!page.contains(">NaN<") && !page.contains("inf<"));
    }

    #[test]
    fn two_results_begin_with_their_agreement() {
        let comparison = Comparison::of(vec![entry("a", result(10.0)), entry("b", result(1000.0))]);
        assert_eq!(comparison.pairs[0].agreement, Agreement::Differ);
        let page = comparison.render();
        assert!(
            page.contains("<p class=\"answer\">a and b differ, because their intervals do not overlap: peak height 10")
        );
        assert!(page.contains("Comparison of 2 results"));
    }

    #[test]
    fn many_results_have_only_table_and_intervals() {
        let of = |count: usize| {
            let mut entries: Vec<Entry> = (0..count).map(|i| entry(&format!("n{i}"), result(10.0))).collect();
            // Computing all distances would take seconds.
            entries.iter_mut().skip(2).for_each(|entry| entry.contents.as_mut().unwrap().table = None);
            Comparison::of(entries).render()
        };
        let (few, many) = (of(MAX_COMPARED), of(MAX_COMPARED + 1));
        assert!(few.contains("class=\"distances\"") && few.contains("role=\"img\""));
        assert!(!few.contains("omitted"), "no part is omitted");
        assert!(!many.contains("class=\"distances\""));
        assert_eq!(many.matches("because there are more than 24 results").count(), 2);
        assert_eq!(many.matches("class=\"interval\"").count(), MAX_COMPARED + 1);
    }

    #[test]
    fn one_result_has_no_agreement() {
        let page = Comparison::of(vec![entry("only", result(10.0))]).render();
        assert!(page.contains("One result") && !page.contains("id=\"agreement\""));
    }

    #[test]
    fn thumbnails_keep_the_aspect_ratio_and_small_sizes() {
        let size = |w: usize, h: usize| thumbnail(&Plane::from_fn(w, h, |_, _| Vec3::ONE)).size();
        assert_eq!([size(512, 512), size(1000, 100), size(20, 10)], [(224, 224), (224, 22), (20, 10)]);
        assert_eq!(size(5000, 1), (224, 1));
    }

    #[test]
    fn shortens_long_texts() {
        assert_eq!(plain(&"é".repeat(LETTERS)).chars().count(), LETTERS);
        assert_eq!(plain(&"é".repeat(LETTERS + 1)).chars().count(), LETTERS + 1);
        assert!(plain(&"a".repeat(LETTERS + 9)).ends_with('…'));
    }
}
