//! Tables of the errors.

use std::fmt::Write as _;

use super::study::{Errors, Record};
use crate::metrics::median;

/// Three tables: medians and RGB errors of each object, then the errors of each photograph.
pub(super) fn markdown(records: &[Record]) -> String {
    format!("{}\n{}\n{}", objects(records), colours(records), photographs(records))
}

/// Medians over the photographs of each object.
fn objects(records: &[Record]) -> String {
    let mut text = "\
| object | photographs | slice: estimate | Lambertian | profile | relight (log): estimate | Lambertian | profile | measured slice | gloss in interval \
| 50 % / 90 % covered | misfit | warned | seconds |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|
"
    .to_owned();
    for of in records.chunk_by(|a, b| a.object == b.object) {
        let typical = |f: &dyn Fn(&Record) -> f64| median(of.iter().map(f).collect());
        let both = |which: fn(&Record) -> Errors| {
            let (plain, log) = (typical(&|r| which(r).relight), typical(&|r| which(r).relight_log));
            format!("{} ({})", number(plain), number(log))
        };
        let count = |holds: fn(&Record) -> bool| of.iter().filter(|r| holds(r)).count();
        let _ = writeln!(
            text,
            "| {} | {} | **{:.2}** | {:.2} | {:.2} | **{}** | {} | {} | {} | {} of {} | {} | {} | {} of {} | {:.1} |",
            of[0].object,
            of.len(),
            typical(&|r| r.estimate.slice),
            typical(&|r| r.lambert.slice),
            typical(&|r| r.profile.slice),
            both(|r| r.estimate),
            both(|r| r.lambert),
            both(|r| r.profile),
            both(|r| r.measured),
            count(Record::gloss_held),
            of.len(),
            covered([typical(&|r| r.coverage[0]), typical(&|r| r.coverage[1])]),
            percent(typical(&|r| r.misfit)),
            count(|r| !r.warnings.is_empty()),
            of.len(),
            typical(&|r| r.seconds),
        );
    }
    text
}

/// Medians of the RGB relight errors over the photographs of each object.
fn colours(records: &[Record]) -> String {
    let mut text = "\
| object | RGB relight: estimate | grey | median colour | luminance estimate in the best colour | measured slice in the best colour | luminance relight |
|---|---|---|---|---|---|---|
"
    .to_owned();
    for of in records.chunk_by(|a, b| a.object == b.object) {
        let typical = |f: fn(&Record) -> f64| number(median(of.iter().map(f).collect()));
        let _ = writeln!(
            text,
            "| {} | **{}** | {} | {} | {} | {} | {} |",
            of[0].object,
            typical(|r| r.rgb.estimate),
            typical(|r| r.rgb.grey),
            typical(|r| r.rgb.median),
            typical(|r| r.rgb.one),
            typical(|r| r.rgb.measured),
            typical(|r| r.estimate.relight),
        );
    }
    text
}

fn photographs(records: &[Record]) -> String {
    let mut text = "\
| photograph | slice: estimate | Lambertian | relight (log): estimate | Lambertian | measured slice | gloss: measured | estimate (90 % interval) \
| 50 % / 90 % covered | misfit | warnings |
|---|---|---|---|---|---|---|---|---|---|---|
"
    .to_owned();
    for r in records {
        let both = |e: &Errors| format!("{} ({})", number(e.relight), number(e.relight_log));
        let [low, middle, high] = r.gloss;
        let _ = writeln!(
            text,
            "| {}, {} | **{:.2}** | {:.2} | **{}** | {} | {} | {:.1} | {middle:.1} ({low:.1} to {high:.1}){} | {} | {} | {} |",
            r.object,
            r.photograph,
            r.estimate.slice,
            r.lambert.slice,
            both(&r.estimate),
            both(&r.lambert),
            both(&r.measured),
            r.gloss_measured,
            if r.gloss_held() { "" } else { ", not held" },
            covered(r.coverage),
            percent(r.misfit),
            if r.warnings.is_empty() { "-".to_owned() } else { r.warnings.join("; ") },
        );
    }
    text
}

/// Formats an error, `-` if it is NaN.
fn number(x: f64) -> String {
    if x.is_nan() { "-".to_owned() } else { format!("{x:.2}") }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn covered(shares: [f64; 2]) -> String {
    shares.map(percent).join(" / ")
}

/// Returns the CSV file, one line for each photograph.
pub(super) fn csv(records: &[Record]) -> String {
    let mut head = vec!["object".to_owned(), "photograph".to_owned()];
    for estimator in ["estimate", "lambert", "measured", "profile"] {
        head.extend(["slice", "relight", "log"].map(|error| format!("{estimator}_{error}")));
    }
    let rest = "rgb_estimate,rgb_grey,rgb_median,rgb_one,rgb_measured,gloss_measured,gloss_estimate,gloss05,gloss50,gloss95,gloss_held,coverage50,coverage90,misfit,seconds,warnings";
    let mut text = format!("{},{rest}\n", head.join(","));
    for r in records {
        let mut numbers = Vec::new();
        for e in [r.estimate, r.lambert, r.measured, r.profile] {
            numbers.extend([e.slice, e.relight, e.relight_log]);
        }
        numbers.extend([r.rgb.estimate, r.rgb.grey, r.rgb.median, r.rgb.one, r.rgb.measured]);
        numbers.extend([r.gloss_measured, r.gloss_estimate]);
        numbers.extend(r.gloss);
        let numbers: Vec<String> = numbers.iter().map(|x| format!("{x:.4}")).collect();
        let _ = writeln!(
            text,
            "{},{},{},{},{:.4},{:.4},{:.4},{:.2},{}",
            quoted(&r.object),
            quoted(&r.photograph),
            numbers.join(","),
            r.gloss_held(),
            r.coverage[0],
            r.coverage[1],
            r.misfit,
            r.seconds,
            quoted(&r.warnings.join("; ")),
        );
    }
    text
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}
