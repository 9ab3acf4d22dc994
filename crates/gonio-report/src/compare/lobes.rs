//! Chart of the BRDFs of all results.

use gonio::estimate::ALBEDO;
use gonio::reflectance::BivariateTable;
use maud::{Markup, html};

use super::{Entry, MAX_COMPARED, found, left_out, plain};
use crate::page::chart::{Axis, COLOURS, Frame, LINES, Series, chart};
use crate::page::figure;
use crate::report::cut;

/// Difference angle of the cut in degrees: near normal incidence, where highlights are sharpest.
const CUT: usize = 5;

pub(super) fn section(entries: &[Entry]) -> Markup {
    if entries.len() > MAX_COMPARED {
        return left_out("The curves are omitted");
    }
    let tables = found(entries).filter_map(|(entry, found)| Some((entry, scaled(found.table.as_ref()?)?)));
    let series: Vec<Series> = tables
        .enumerate()
        .map(|(at, (entry, table))| {
            // When the colours repeat, the line style changes.
            let mark = LINES[at / COLOURS % LINES.len()];
            Series { name: plain(&entry.name), points: cut(&table, CUT), mark }
        })
        .collect();
    if series.is_empty() {
        return html! { p.note { "No folder contains a BRDF." } };
    }
    let title = format!("At a difference angle of {CUT}°");
    let frame = Frame {
        title: &title,
        x: ("half angle (degrees)", Axis::SquareRoot),
        y: ("BRDF (1/sr)", Axis::Log),
        y_range: None,
    };
    figure::figure(
        &chart(&frame, &series),
        &html! { "The luminance of each BRDF over the half angle; the highlight is on the left. All BRDFs are \
            scaled to an albedo of " (ALBEDO)
        " at normal incidence, because a photograph under unknown light does not determine the albedo." },
    )
}

/// Scales a table to the common albedo; `None` if the table is zero.
fn scaled(table: &BivariateTable) -> Option<BivariateTable> {
    let albedo = table.normal_albedo();
    (albedo.is_finite() && albedo > 0.0).then(|| table.scaled(ALBEDO / albedo))
}

#[cfg(test)]
mod tests {
    use super::super::FolderContents;
    use super::*;

    fn entry(name: String, table: Option<BivariateTable>) -> Entry {
        Entry { name, report: None, contents: Ok(FolderContents { table, ..FolderContents::default() }) }
    }

    #[test]
    fn draws_one_curve_per_nonzero_table() {
        let flat = |value: f64| Some(BivariateTable::from_fn(move |_, _| value));
        let names = |tables: Vec<Option<BivariateTable>>| {
            let entries: Vec<Entry> =
                tables.into_iter().enumerate().map(|(i, table)| entry(format!("n{i}"), table)).collect();
            section(&entries).into_string()
        };
        let drawn = names(vec![flat(0.1), None, flat(0.0), flat(7.0)]);
        assert!(drawn.contains("Shown: n0; n3."), "{drawn}");
        assert!(names(vec![None, flat(0.0)]).contains("No folder contains"));
        // The curves of 24 results differ by colour or line style.
        let all = names((0..MAX_COMPARED).map(|i| flat(0.1 + i as f64)).collect());
        assert_eq!(all.matches("stroke-dasharray=\"6 3\"").count(), 8);
        assert_eq!(all.matches("stroke-dasharray=\"3 4\"").count(), 8);
    }
}
