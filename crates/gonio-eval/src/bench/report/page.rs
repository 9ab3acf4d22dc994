//! The HTML page: tables, distributions, comparisons, pictures.

use maud::{Markup, html};

use super::pictures;
use crate::bench::errors::{Record, Records};
use crate::bench::estimators::Estimator;
use crate::bench::id;
use crate::bench::store::Conditions;
use crate::bench::summary::{Group, Row, Summary};
use crate::metrics::{Class, Interval};
use gonio_report::page::chart::{Axis, Frame, Series, ecdf, scatter};
use gonio_report::page::{Section, document, figure, table};

/// Headings of the table of estimators.
pub(super) const COLUMNS: [&str; 11] = [
    "estimator",
    "photographs",
    "relight",
    "log relight",
    "RGB relight",
    "BRDF log",
    "gloss order",
    "4x too glossy",
    "50 % / 90 % covered",
    "converged",
    "seconds (most)",
];

/// Headings of the table of colours.
pub(super) const COLOUR_COLUMNS: [&str; 6] =
    ["estimator", "found colours", "median colour", "grey", "true chroma (oracle)", "mean chroma"];

fn interval(i: &Interval, digits: usize) -> String {
    if i.low.is_nan() {
        format!("{:.digits$}", i.value)
    } else {
        format!("{:.digits$} ({:.digits$} to {:.digits$})", i.value, i.low, i.high)
    }
}

/// Row of the table of estimators.
pub(super) fn entries(row: &Row) -> Vec<String> {
    let percent = |x: f64| format!("{:.0} %", 100.0 * x);
    let failed = if row.failures > 0 { format!(" ({} failed)", row.failures) } else { String::new() };
    vec![
        row.estimator.title().to_owned(),
        format!("{}{failed}", row.cells),
        interval(&row.relative, 3),
        interval(&row.log, 3),
        interval(&row.rgb, 3),
        interval(&row.brdf, 2),
        if row.gloss.is_nan() { "-".to_owned() } else { format!("{:.2}", row.gloss) },
        percent(row.too_glossy),
        row.coverage.map_or("-".to_owned(), |[half, ninety]| format!("{} / {}", percent(half), percent(ninety))),
        row.converged.map_or("-".to_owned(), percent),
        format!("{:.1} ({:.1})", row.seconds, row.slowest),
    ]
}

/// Row of the table of colours.
pub(super) fn colour_entries(row: &Row) -> Vec<String> {
    let found = if row.estimator.finds_colours() { interval(&row.rgb, 3) } else { "-".to_owned() };
    vec![
        row.estimator.title().to_owned(),
        found,
        interval(&row.rgb_median, 3),
        interval(&row.rgb_grey, 3),
        interval(&row.rgb_true_chroma, 3),
        interval(&row.mean_chroma, 2),
    ]
}

/// The whole report.
pub(super) fn page(conditions: &Conditions, summaries: &[Summary], records: &Records) -> String {
    let lead = html! {
        p {
            "Each cell is one estimator on one rendered photograph of a sphere in a captured light outside the training data. \
             Errors are measured after the best common scale, which a photograph does not determine, and averaged over the \
             lights in which the estimate is relit: " (conditions.relight.join(", ")) "."
        }
        p.note {
            "Light grid " (conditions.plan.transfer.side) " x " (conditions.plan.transfer.side) ", " (conditions.plan.rank) " rows, "
            (conditions.rank) " basis functions, " (conditions.starts) " start(s), noise " (100.0 * conditions.noise)
            " %, relative to the mean. gonio " (conditions.gonio) ". Reference pictures come from full tables (90 x 90 x 180) of reconstructed or \
            genuine MERL materials, or of materials of other kinds, in lights of full resolution."
        }
    };
    let sections: Vec<Section> = summaries.iter().map(|s| section(s, records)).collect();
    document("How well reflectance is recovered", &lead, &sections)
}

fn section(summary: &Summary, records: &Records) -> Section {
    let mine: Vec<&Record> = records.values().filter(|r| r.protocol == summary.protocol).collect();
    let body = html! {
        p {
            (summary.materials) " materials in " (summary.lights) " lights. Medians over the cells with 95 % bootstrap intervals \
            (whole materials resampled)."
            @if !summary.full_tables {
                " Some photographs were rendered from bivariate tables because full tables were missing; their errors are \
                  slightly smaller than with full tables."
            }
        }
        (estimators(summary))
        (what_it_means())
        h3 { "Distributions" }
        (distributions(summary, &mine))
        h3 { "Which estimator is better, photograph by photograph" }
        (wins(summary))
        h3 { "By kind of material" }
        (groups("Median log relight error by class of material (from its highlight: peak and diffuse share)", summary, &summary.classes))
        h3 { "By light of the photograph" }
        (groups("Median log relight error by light", summary, &summary.by_light))
        h3 { "Gloss" }
        (gloss(summary, &mine))
        h3 { "Worst cells" }
        (pictures::worst(&mine))
        h3 { "Every material" }
        (pictures::strips(&mine))
    };
    Section { id: id(&summary.protocol), title: summary.protocol.title().to_owned(), body }
}

fn estimators(summary: &Summary) -> Markup {
    let rows: Vec<Vec<String>> = summary.rows.iter().map(entries).collect();
    let colours: Vec<Vec<String>> = summary.rows.iter().map(colour_entries).collect();
    html! {
        (table::table("Estimators and references", &COLUMNS, &rows))
        (table::table("RGB relight error by the colour of the estimate", &COLOUR_COLUMNS, &colours))
    }
}

fn what_it_means() -> Markup {
    html! {
        p.note {
            strong { "relight" } ": min over s of |s I^ - I| / |I|. " strong { "log relight" } ": rms of ln((s I^ + e)/(I + e)), e = 1 % of the \
            mean. " strong { "RGB relight" } ": the relight error over all channels, with one scale for the three; estimators without \
            colours are shown in the median colour of the photograph. " strong { "mean chroma" } ": distance of (ln R/G, ln B/G) of the \
            relit sphere's mean from that of the reference. " strong { "BRDF log" } ": rms logarithmic \
            error over the domain below 80 degrees, in luminance. " strong { "gloss order" } ": Spearman correlation \
            of the logarithm of peak over mean reflectance with that of the reference. "
            strong { "4x too glossy" } ": cells whose peak over mean is more than four times that of the reference, a sign of a mirror-like solution. "
            strong { "converged" } ": runs that met their stopping rule. " strong { "seconds" } ": time on one core."
        }
    }
}

/// Charts the distribution of the errors of every estimator, one chart for each measure.
fn distributions(summary: &Summary, mine: &[&Record]) -> Markup {
    let sets = |f: &dyn Fn(&Record) -> f64| -> Vec<(&'static str, Vec<f64>)> {
        let of = |e: Estimator| mine.iter().filter(|r| r.estimator == e).map(|r| f(r)).collect();
        summary.rows.iter().map(|row| (row.estimator.title(), of(row.estimator))).collect()
    };
    let charts = [
        ecdf("Relight error", "relight error", Axis::Linear, &sets(&Record::relative)),
        ecdf("Log relight error", "log relight error", Axis::Log, &sets(&|r| r.log().max(1e-3))),
        ecdf("RGB relight error", "RGB relight error", Axis::Linear, &sets(&|r| r.rgb(|errors| errors.estimate))),
        ecdf("BRDF error", "BRDF log error", Axis::Linear, &sets(&|r| r.brdf.unwrap_or(f64::NAN))),
    ];
    let caption = html! { "Share of the photographs whose error is at most the value on the horizontal axis: further left is better." };
    let figures: Vec<Markup> = charts.iter().map(|c| figure::figure(c, &html! {})).collect();
    html! { (figure::grid(24, &figures)) p.note { (caption) } }
}

fn wins(summary: &Summary) -> Markup {
    let mut columns = vec!["better in log relight than"];
    columns.extend(summary.rows.iter().map(|r| r.estimator.title()));
    let rows: Vec<Vec<String>> = summary
        .rows
        .iter()
        .zip(&summary.wins)
        .enumerate()
        .map(|(i, (row, wins))| {
            let entry = |(j, w): (usize, &f64)| if i == j { String::new() } else { format!("{:.0} %", 100.0 * w) };
            std::iter::once(row.estimator.title().to_owned()).chain(wins.iter().enumerate().map(entry)).collect()
        })
        .collect();
    table::table("How often the estimator of the row is better than that of the column", &columns, &rows)
}

fn groups(caption: &str, summary: &Summary, groups: &[Group]) -> Markup {
    let mut columns = vec!["", "photographs"];
    columns.extend(summary.rows.iter().map(|r| r.estimator.title()));
    let rows: Vec<Vec<String>> = groups
        .iter()
        .map(|g| {
            let errors = g.log.iter().map(|x| interval(x, 3));
            [g.name.clone(), g.photographs.to_string()].into_iter().chain(errors).collect()
        })
        .collect();
    table::table(caption, &columns, &rows)
}

/// Charts the gloss of estimates against that of references, for all but the trivial answers and
/// the true table.
fn gloss(summary: &Summary, mine: &[&Record]) -> Markup {
    let charts: Vec<Markup> = summary
        .rows
        .iter()
        .filter(|row| !row.estimator.is_trivial() && row.estimator != Estimator::TrueBivariate)
        .map(|row| {
            let cells = mine.iter().filter(|r| r.estimator == row.estimator);
            let pairs: Vec<(Class, (f64, f64))> =
                cells.filter_map(|r| r.gloss).map(|[e, t]| (Class::of(&t), (t.peak, e.peak))).collect();
            let series: Vec<Series> = Class::ALL
                .iter()
                .map(|class| {
                    let points = pairs.iter().filter(|(c, _)| c == class).map(|(_, p)| *p).collect();
                    Series::dots(class.title(), points)
                })
                .filter(|s| !s.points.is_empty())
                .collect();
            let frame = Frame {
                title: row.estimator.title(),
                x: ("ln(peak / mean) of the reference", Axis::Linear),
                y: ("of the estimate", Axis::Linear),
                y_range: None,
            };
            figure::figure(&scatter(&frame, &series, true), &html! {})
        })
        .collect();
    figure::grid(24, &charts)
}
