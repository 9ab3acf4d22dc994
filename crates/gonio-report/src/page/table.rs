//! Tables.

use maud::{Markup, html};

/// Builds a table: headings of the columns, then rows whose first entry is the heading of the row.
/// On a narrow screen the table scrolls.
///
/// Rows can be shorter or longer than the headings.
pub fn table(caption: &str, columns: &[&str], rows: &[Vec<String>]) -> Markup {
    html! {
        // Makes the scrolling region reachable by keyboard.
        div.scroll role="region" aria-label=(caption) tabindex="0" {
            table {
                caption { (caption) }
                thead { tr { @for column in columns { th scope="col" { (column) } } } }
                tbody {
                    @for row in rows {
                        tr {
                            @for (i, entry) in row.iter().enumerate() {
                                @if i == 0 { th scope="row" { (entry) } } @else { td { (entry) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_have_a_scope() {
        let html = table("Errors", &["material", "rms"], &[vec!["a<b".into(), "1.5".into()]]).into_string();
        assert!(html.contains("<th scope=\"col\">rms</th>") && html.contains("<caption>Errors</caption>"));
        assert!(html.contains("<th scope=\"row\">a&lt;b</th><td>1.5</td>"), "{html}");
    }
}
