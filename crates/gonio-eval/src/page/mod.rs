//! Reports as one HTML file: pictures, charts and tables that need nothing but the file itself.
//!
//! * [`document`] is the frame: title, contents, one embedded stylesheet, no script, no request to anywhere.
//! * [`figure`]: pictures as PNG in the text, rows of tiles, captions. [`table`]: tables with proper headers.
//! * [`chart`]: charts as SVG in the text.
//!
//! All content is [`Markup`], which escapes what is interpolated.

pub(crate) mod chart;
pub(crate) mod figure;
#[cfg(test)]
mod sample;
pub(crate) mod table;

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("style.css");

/// A part of a report with its own heading.
pub(crate) struct Section {
    /// Anchor: a word of ASCII letters, digits and hyphens, unique within the report.
    pub(crate) id: String,
    /// Heading.
    pub(crate) title: String,
    /// What it shows.
    pub(crate) body: Markup,
}

/// A whole report. `lead` stands under the title, before the contents.
pub(crate) fn document(title: &str, lead: &Markup, sections: &[Section]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                // An empty icon: without one browsers ask the server for it.
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    h1 { (title) }
                    (lead)
                    nav aria-label="Contents" {
                        ol { @for section in sections { li { a href={ "#" (section.id) } { (section.title) } } } }
                    }
                }
                main {
                    @for section in sections {
                        section id=(section.id) {
                            h2 { (section.title) }
                            (section.body)
                        }
                    }
                }
            }
        }
    };
    page.into_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_nothing_is_fetched() {
        let body = html! { p { "a < b & c" } };
        let page = document("x < y", &html! {}, &[Section { id: "one".into(), title: "\"One\"".into(), body }]);
        assert!(page.contains("a &lt; b &amp; c") && page.contains("<title>x &lt; y</title>"));
        assert!(page.contains("<a href=\"#one\">") && page.contains("<section id=\"one\">"));
        for outside in ["http:", "https:", "<script", "url(", "@import"] {
            assert!(!page.contains(outside), "{outside}");
        }
    }
}
