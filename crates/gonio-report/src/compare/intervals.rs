//! Intervals of all results on one axis.

use maud::{Markup, html};

use super::{Entry, Highlight, found, plain};
use crate::page::chart::Axis;
use crate::page::chart::scale::{Scale, short as tick};
use crate::report::short;

/// Largest number of marks on the axis.
const MARKS: usize = 6;

pub(super) fn section(entries: &[Entry]) -> Markup {
    let highlights: Vec<(String, Highlight)> =
        found(entries).map(|(entry, found)| (plain(&entry.name), Highlight::of(&found.result))).collect();
    let of = |measure: fn(&Highlight) -> Option<[f64; 3]>| -> Vec<(&str, [f64; 3])> {
        highlights.iter().filter_map(|(name, highlight)| Some((name.as_str(), measure(highlight)?))).collect()
    };
    let charts = [
        chart("Roughness (decreases with sharpness)", &of(|highlight| highlight.roughness)),
        chart("Peak height (increases with sharpness)", &of(|highlight| highlight.peak)),
    ];
    html! {
        @if charts.iter().all(Option::is_none) { p.note { "No result has intervals." } }
        @else {
            div.grid { @for chart in charts.iter().flatten() { (chart) } }
            p.note { "Bars are 90 % intervals and dots are estimates, on logarithmic axes." }
        }
    }
}

/// Draws intervals as bars on a logarithmic axis; `None` if there are no intervals.
fn chart(title: &str, intervals: &[(&str, [f64; 3])]) -> Option<Markup> {
    if intervals.is_empty() {
        return None;
    }
    let scale = Scale::around(Axis::Log, intervals.iter().flat_map(|(_, interval)| *interval), None);
    let at = |value: f64| format!("{:.2}%", 100.0 * scale.share(value));
    let width = |low: f64, high: f64| format!("{:.2}%", 100.0 * (scale.share(high) - scale.share(low)));
    let marks = scale.marks(MARKS);
    Some(html! {
        div.intervals role="group" aria-label=(title) {
            p { strong { (title) } }
            @for (name, [low, median, high]) in intervals {
                @let words = format!("{} ({} to {})", short(*median), short(*low), short(*high));
                div.interval {
                    span.who title=(name) { (name) }
                    span.track role="img" aria-label=(words) title=(words) {
                        @for mark in &marks { i.mark style={ "left:" (at(*mark)) } {} }
                        i.bar style={ "left:" (at(*low)) ";width:" (width(*low, *high)) } {}
                        i.dot style={ "left:" (at(*median)) } {}
                    }
                }
            }
            div.axis aria-hidden="true" {
                span.who {}
                span.track { @for mark in &marks { span style={ "left:" (at(*mark)) } { (tick(*mark)) } } }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the percentages of a style in all elements of a class.
    fn styles(html: &str, class: &str, style: &str) -> Vec<f64> {
        let within = |rest: &str| rest.split(style).nth(1)?.split('%').next()?.parse().ok();
        html.split(&format!("<i class=\"{class}\" style=\"")).skip(1).filter_map(within).collect()
    }

    #[test]
    fn bars_are_at_their_values() {
        let html = chart("gloss", &[("a", [1.0, 10.0, 100.0]), ("b", [10.0, 100.0, 1000.0])]).unwrap().into_string();
        let (left, width) = (styles(&html, "bar", "left:"), styles(&html, "bar", "width:"));
        let dots = styles(&html, "dot", "left:");
        assert_eq!((left.len(), width.len(), dots.len()), (2, 2, 2));
        // All decades have equal lengths. The second interval begins at the first estimate.
        assert!((width[0] - width[1]).abs() < 0.02 && (dots[0] - left[1]).abs() < 0.02, "{html}");
        assert!((left[0] + width[0] - dots[1]).abs() < 0.02 && (0.0..10.0).contains(&left[0]));
        assert!(html.contains("aria-label=\"10 (1.0 to 100)\"") && html.contains(">100<"), "{html}");
    }

    #[test]
    fn intervals_without_width_are_drawn() {
        let html = chart("alpha", &[("a", [1.0; 3]), ("b", [1e-300, 1.0, 1e300])]).unwrap().into_string();
        assert!(!html.contains("NaN") && !html.contains("inf"), "{html}");
        assert!(chart("alpha", &[]).is_none());
    }
}
