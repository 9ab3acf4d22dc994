//! Pictures of estimates: the worst cells, and every material.

use std::collections::{BTreeMap, BTreeSet};

use maud::{Markup, html};

use crate::bench::errors::Record;
use crate::bench::estimators::Estimator;
use crate::metrics::Class;
use gonio_report::page::figure;

/// Number of cells shown as the worst.
const WORST: usize = 12;
/// Side of a picture on the page, CSS pixels.
const PICTURE_SIDE: usize = 96;

/// Records of one photograph, by estimator.
type Photograph<'a> = BTreeMap<Estimator, &'a Record>;

fn photographs<'a>(mine: &[&'a Record]) -> BTreeMap<(&'a str, &'a str), Photograph<'a>> {
    let mut all: BTreeMap<(&str, &str), Photograph<'_>> = BTreeMap::new();
    for record in mine {
        all.entry((record.material.as_str(), record.light.as_str())).or_default().insert(record.estimator, record);
    }
    all
}

/// The row of pictures of one photograph: the reference first, then the estimates with their
/// errors.
fn row(photograph: &Photograph<'_>) -> Markup {
    let reference = photograph.get(&Estimator::TrueBivariate).or_else(|| photograph.values().next());
    let order = photograph.values().filter(|r| r.estimator != Estimator::TrueBivariate);
    html! {
        div.tiles {
            @if let Some(reference) = reference {
                div.tile style={ "width:" (PICTURE_SIDE) "px" } {
                    (figure::encoded(&reference.photograph, PICTURE_SIDE, "the photograph"))
                    span { "photograph" }
                }
                @if reference.estimator == Estimator::TrueBivariate { (tile(reference)) }
            }
            @for record in order { (tile(record)) }
        }
    }
}

fn tile(record: &Record) -> Markup {
    let title = record.estimator.title();
    let alt = format!("{} by {title}, log relight error {:.2}", record.material, record.log());
    html! {
        div.tile style={ "width:" (PICTURE_SIDE) "px" } {
            @if record.failure.is_some() || record.picture.is_empty() { p { "no estimate" } }
            @else { (figure::encoded(&record.picture, PICTURE_SIDE, &alt)) }
            span {
                (title) br;
                (format!("{:.2} / {:.2} / {:.2}", record.relative(), record.log(), record.rgb(|errors| errors.estimate)))
            }
        }
    }
}

/// Returns the estimator whose worst cells are shown: the last one that is neither an oracle nor
/// trivial.
fn judged(mine: &[&Record]) -> Option<Estimator> {
    let serious = mine.iter().map(|r| r.estimator).filter(|e| !e.is_oracle() && !e.is_trivial());
    serious.max()
}

/// Shows the photographs on which the judged estimator has the largest errors.
pub(super) fn worst(mine: &[&Record]) -> Markup {
    let Some(estimator) = judged(mine) else { return html! { p { "No estimator was run." } } };
    let mut cells: Vec<&Record> = mine.iter().copied().filter(|r| r.estimator == estimator).collect();
    cells.sort_by(|a, b| b.log().total_cmp(&a.log()));
    // Keep one cell for each material: the errors of a mirror are large in every light.
    let mut shown = BTreeSet::new();
    cells.retain(|r| shown.insert(r.material.as_str()));
    let all = photographs(mine);
    html! {
        p {
            "The largest log relight errors of " strong { (estimator.title()) } ", one for each material. Each sphere is shown in "
            (cells.first().and_then(|c| c.relight.first()).map_or("the first light", |r| r.light.as_str()))
            " (or its substitute) at the exposure of the reference, with its relight, log relight and RGB relight error."
        }
        @for cell in cells.iter().take(WORST) {
            h4 {
                (cell.material) " seen in " (cell.light)
                @if let Some([_, reference]) = cell.gloss { " (" (Class::of(&reference).title()) ")" }
                @if cell.left_over > 0.02 {
                    "; energy beyond the light grid: " (format!("{:.0} %", 100.0 * cell.left_over))
                }
            }
            @if let Some(failure) = &cell.failure { p.note { (failure) } }
            @if let Some(photograph) = all.get(&(cell.material.as_str(), cell.light.as_str())) { (row(photograph)) }
        }
    }
}

/// Shows one strip for each material, from the photograph of median error.
pub(super) fn strips(mine: &[&Record]) -> Markup {
    let Some(estimator) = judged(mine) else { return html! {} };
    let all = photographs(mine);
    let mut by_material: BTreeMap<&str, Vec<&Record>> = BTreeMap::new();
    for record in mine.iter().filter(|r| r.estimator == estimator) {
        by_material.entry(&record.material).or_default().push(record);
    }
    let middle = by_material.into_iter().map(|(material, mut cells)| {
        cells.sort_by(|a, b| a.log().total_cmp(&b.log()));
        (material, cells[(cells.len() - 1) / 2])
    });
    html! {
        p { "For each material the photograph on which " strong { (estimator.title()) } " has its median error." }
        @for (material, cell) in middle {
            h4 { (material) " seen in " (cell.light) }
            @if let Some(photograph) = all.get(&(material, cell.light.as_str())) { (row(photograph)) }
        }
    }
}
