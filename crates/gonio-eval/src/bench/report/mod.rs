//! The files that a run writes: `results.csv`, `results.json`, `report.html`.

mod page;
mod pictures;

use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use serde::Serialize;

use super::errors::{Record, Records};
use super::grid::id;
use super::store::Conditions;
use super::summary::{Summary, summaries};
use crate::metrics::Class;

/// Writes all three files, and prints the tables.
pub(super) fn write(dir: &Path, conditions: &Conditions, records: &Records) -> Result<()> {
    let summaries = summaries(records);
    gonio_io::atomic::write_file(dir.join("results.csv"), csv(records).as_bytes())?;
    gonio_io::atomic::write_file(dir.join("results.json"), &json(conditions, &summaries, records)?)?;
    let html = page::page(conditions, &summaries, records);
    gonio_io::atomic::write_file(dir.join("report.html"), html.as_bytes())?;
    for summary in &summaries {
        println!("{}", markdown(summary));
    }
    println!("{}", dir.join("report.html").display());
    Ok(())
}

/// Returns the CSV file, one line for each cell.
fn csv(records: &Records) -> String {
    let mut out = String::from(
        "protocol,material,class,light,estimator,relight,relight_log,relight_rgb,rgb_median,rgb_grey,\
         rgb_true_chroma,mean_chroma,brdf_log,gloss,gloss_reference,coverage50,coverage90,\
         left_over,seconds,iterations,converged,cost,noise,note,failure\n",
    );
    for r in records.values() {
        let number = |x: Option<f64>| x.map_or(String::new(), |x| format!("{x:.6}"));
        let cells = [
            id(&r.protocol),
            r.material.clone(),
            r.gloss.map_or("", |g| Class::of(&g[1]).title()).to_owned(),
            r.light.clone(),
            id(&r.estimator),
            number(Some(r.relative())),
            number(Some(r.log())),
            number(Some(r.rgb(|errors| errors.estimate))),
            number(Some(r.rgb(|errors| errors.median))),
            number(Some(r.rgb(|errors| errors.grey))),
            number(Some(r.rgb(|errors| errors.true_chroma))),
            number(r.mean_chroma()),
            number(r.brdf),
            number(r.gloss.map(|g| g[0].peak)),
            number(r.gloss.map(|g| g[1].peak)),
            number(r.coverage.map(|c| c[0])),
            number(r.coverage.map(|c| c[1])),
            format!("{:.3e}", r.left_over),
            format!("{:.3}", r.seconds),
            r.report.iterations.to_string(),
            r.report.converged.map_or(String::new(), |c| c.to_string()),
            number(r.report.cost),
            number(r.report.noise),
            r.report.note.clone(),
            r.failure.clone().unwrap_or_default(),
        ];
        let quoted =
            cells.map(|c| if c.contains([',', '"', '\n']) { format!("\"{}\"", c.replace('"', "\"\"")) } else { c });
        let _ = writeln!(out, "{}", quoted.join(","));
    }
    out
}

/// Returns everything but the pictures as JSON.
fn json(conditions: &Conditions, summaries: &[Summary], records: &Records) -> Result<Vec<u8>> {
    #[derive(Serialize)]
    struct Whole<'a> {
        conditions: &'a Conditions,
        summaries: &'a [Summary],
        cells: Vec<Record>,
    }
    let bare = |r: &Record| Record { picture: String::new(), photograph: String::new(), ..r.clone() };
    let cells = records.values().map(bare).collect();
    Ok(serde_json::to_vec_pretty(&Whole { conditions, summaries, cells })?)
}

/// Returns the Markdown tables for `docs/`.
fn markdown(summary: &Summary) -> String {
    let table = |columns: &[&str], rows: Vec<Vec<String>>| {
        let head = format!("| {} |\n|{}\n", columns.join(" | "), "---|".repeat(columns.len()));
        rows.iter().fold(head, |out, row| format!("{out}| {} |\n", row.join(" | ")))
    };
    let note = if summary.full_tables { "" } else { " (some photographs rendered from bivariate tables)" };
    let Summary { materials, lights, rows, .. } = summary;
    format!(
        "{}: {materials} materials, {lights} lights{note}\n\n{}\nRGB relight error by the colour of the estimate:\n\n{}",
        summary.protocol.title(),
        table(&page::COLUMNS, rows.iter().map(page::entries).collect()),
        table(&page::COLOUR_COLUMNS, rows.iter().map(page::colour_entries).collect()),
    )
}
