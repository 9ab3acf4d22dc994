//! Self-contained HTML pages with pictures, charts and tables.
//!
//! * [`document`] is the frame: title, contents, one embedded stylesheet, no network requests;
//!   [`Document`] adds to it.
//! * [`figure`]: embedded PNG pictures, rows of tiles, captions. [`table`]: tables with proper
//!   headers.
//! * [`chart`]: embedded SVG charts.
//!
//! All content is [`Markup`], which escapes interpolated values.

pub mod chart;
pub mod figure;
#[cfg(test)]
mod sample;
pub mod table;

use std::sync::LazyLock;

use base64::Engine;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::canvas::{REGULAR_FILE, SEMIBOLD_FILE};

const STYLE: &str = include_str!("style.css");

/// A part of a report with its own heading.
#[derive(Clone)]
pub struct Section {
    /// Anchor: a word of ASCII letters, digits and hyphens, unique within the report.
    pub id: String,
    /// Heading.
    pub title: String,
    /// Content.
    pub body: Markup,
}

/// Style sheet with the embedded typefaces.
static TYPEFACE: LazyLock<String> = LazyLock::new(|| {
    let face = |weight: &str, file: &[u8]| {
        let file = base64::engine::general_purpose::STANDARD.encode(file);
        format!("@font-face{{font-family:Inter;font-weight:{weight};src:url(data:font/ttf;base64,{file})}}")
    };
    [face("100 500", REGULAR_FILE), face("501 900", SEMIBOLD_FILE)].concat()
});

/// Content security policy: the browser loads nothing from outside the page.
const POLICY: &str =
    "default-src 'none'; img-src data:; font-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// Marker near the beginning of each page, which identifies pages that gonio wrote.
pub const GENERATOR: &str = "<meta name=\"generator\" content=\"gonio\">";

/// A whole report.
#[derive(Default)]
pub struct Document<'a> {
    /// Title and main heading.
    pub title: &'a str,
    /// Content under the title, before the contents.
    pub lead: Markup,
    /// Sections.
    pub sections: Vec<Section>,
    /// Styles beyond those of all reports.
    pub style: &'a str,
    /// Script that runs when the page has loaded.
    pub script: &'a str,
}

/// Renders a report without a script. `lead` is placed under the title, before the contents.
pub fn document(title: &str, lead: &Markup, sections: &[Section]) -> String {
    Document { title, lead: lead.clone(), sections: sections.to_vec(), ..Document::default() }.render()
}

impl Document<'_> {
    /// Renders the report as HTML.
    pub fn render(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    (PreEscaped(GENERATOR))
                    meta http-equiv="Content-Security-Policy" content=(POLICY);
                    // Empty icon: without one browsers request it from the server.
                    link rel="icon" href="data:,";
                    title { (self.title) }
                    style { (PreEscaped(&*TYPEFACE)) (PreEscaped(STYLE)) (PreEscaped(self.style)) }
                }
                body {
                    header {
                        h1 { (self.title) }
                        (self.lead)
                        nav aria-label="Contents" {
                            ol { @for section in &self.sections { li { a href={ "#" (section.id) } { (section.title) } } } }
                        }
                    }
                    main {
                        @for section in &self.sections {
                            section id=(section.id) {
                                h2 { (section.title) }
                                (section.body)
                            }
                        }
                    }
                    @if !self.script.is_empty() { script { (PreEscaped(self.script)) } }
                }
            }
        };
        page.into_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_text_and_loads_nothing() {
        let body = html! { p { "a < b & c" } };
        let page = document("x < y", &html! {}, &[Section { id: "one".into(), title: "\"One\"".into(), body }]);
        assert!(page.contains("a &lt; b &amp; c") && page.contains("<title>x &lt; y</title>"));
        assert!(page.contains("<a href=\"#one\">") && page.contains("<section id=\"one\">"));
        for outside in ["http:", "https:", "<script", "@import"] {
            assert!(!page.contains(outside), "{outside}");
        }
        // The typeface is in the page.
        assert!(page.split("url(").skip(1).all(|rest| rest.starts_with("data:font/ttf;base64,")));
    }
}
