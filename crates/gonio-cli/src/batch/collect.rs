//! Merges the results of all rows into one table and one HTML page.

use std::path::Path;

use anyhow::{Result, anyhow, bail};
use gonio_app::compare::{self, ComparedFolder, PAGE};
use gonio_app::results::document_in;
use gonio_io::atomic::write_file;
use gonio_io::table::Table;
use serde_json::json;

use super::manifest::Row;
use super::{OUTCOMES, RowOutcome, TABLE, read_outcome};
use crate::outcome::Outcome;

const COLUMNS: [&str; 16] = [
    "name",
    "status",
    "seconds",
    "material",
    "weight",
    "roughness_5",
    "roughness_50",
    "roughness_95",
    "peak_to_body_5",
    "peak_to_body_50",
    "peak_to_body_95",
    "undetermined",
    "out_of_distribution",
    "misfit",
    "warnings",
    "error",
];

/// Writes `batch.csv` from the outcomes of all rows, and `compare.html` if `page`. If `rows` is
/// given, the table also lists missing rows.
pub(super) fn collect(output: &Path, rows: Option<&[Row]>, page: bool) -> Result<Outcome> {
    let names: Vec<String> = match rows {
        Some(rows) => rows.iter().map(|row| row.name.clone()).collect(),
        None => recorded_names(output)?,
    };
    if names.is_empty() {
        bail!("{}: contains no results of gonio batch", output.display());
    }
    let mut table = Table { columns: COLUMNS.map(str::to_owned).to_vec(), rows: Vec::new() };
    let mut counts = [0_usize; 3];
    let mut all = Vec::new();
    for name in names {
        let note = read_outcome(output, &name);
        let status = match &note {
            None => 2,
            Some(note) => usize::from(note.error.is_some()),
        };
        counts[status] += 1;
        table.rows.push(record(output, &name, ["done", "failed", "missing"][status], note.as_ref()));
        all.push(given(output, name, note));
    }
    let file = output.join(TABLE);
    write_file(&file, &table.encode())?;
    let [done, failed, missing] = counts;
    let text = format!("{}: {done} done, {failed} failed, {missing} missing", file.display());
    let fields = json!({ "output": file.display().to_string(), "done": done, "failed": failed, "missing": missing });
    let warnings = if page { write_page(&output.join(PAGE), &all)? } else { Vec::new() };
    Ok(Outcome::new(text, fields).warning(warnings))
}

/// Writes the page of all rows, unless gonio did not write the existing file.
fn write_page(page: &Path, all: &[ComparedFolder]) -> Result<Vec<String>> {
    if page.exists() && !compare::is_page(page) {
        let warning = format!(
            "{}: exists and was not written by gonio; rename it so that gonio can write the page",
            page.display()
        );
        return Ok(vec![warning]);
    }
    write_file(page, compare::read(all, page).render().as_bytes())?;
    Ok(Vec::new())
}

/// Returns the results of all rows with a recorded outcome, for a page.
pub(crate) fn given_of(output: &Path) -> Result<Vec<ComparedFolder>> {
    let of = |name: String| {
        let note = read_outcome(output, &name);
        given(output, name, note)
    };
    Ok(recorded_names(output)?.into_iter().map(of).collect())
}

fn given(output: &Path, name: String, note: Option<RowOutcome>) -> ComparedFolder {
    let failed = match note {
        None => Some("not yet inferred".to_owned()),
        Some(note) => note.error,
    };
    ComparedFolder { folder: output.join(&name), name, failed }
}

/// Lists the names of all rows with a recorded outcome.
fn recorded_names(output: &Path) -> Result<Vec<String>> {
    let folder = output.join(OUTCOMES);
    let failed = |error: std::io::Error| {
        let shown = folder.display();
        anyhow!("{shown}: cannot list this folder: {error}; specify the output folder of gonio batch")
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|e| e == "json")
            && let Some(stem) = path.file_stem()
        {
            names.push(stem.to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

fn record(output: &Path, name: &str, status: &str, note: Option<&RowOutcome>) -> Vec<String> {
    let read = note.filter(|note| note.error.is_none()).map(|_| document_in(&output.join(name)));
    let (result, damage) = match read {
        Some(Ok(result)) => (result, None),
        Some(Err(error)) => (None, Some(error.to_string())),
        None => (None, None),
    };
    let posterior = result.as_ref().and_then(|result| result.posterior.as_ref());
    let residual = result.as_ref().and_then(|result| result.residual);
    let number = |value: Option<f64>| value.map(|v| format!("{v:.4}")).unwrap_or_default();
    let roughness = posterior.and_then(|posterior| posterior.highlight.roughness);
    let peak = posterior.map(|posterior| posterior.highlight.peak_height.quantiles);
    let nearest = posterior.and_then(|posterior| posterior.materials.first());
    vec![
        name.to_owned(),
        status.to_owned(),
        note.map(|n| format!("{:.1}", n.seconds)).unwrap_or_default(),
        nearest.map(|material| material.name.clone()).unwrap_or_default(),
        number(nearest.map(|material| material.weight)),
        number(roughness.map(|quantiles| quantiles.low)),
        number(roughness.map(|quantiles| quantiles.median)),
        number(roughness.map(|quantiles| quantiles.high)),
        number(peak.map(|quantiles| quantiles.low)),
        number(peak.map(|quantiles| quantiles.median)),
        number(peak.map(|quantiles| quantiles.high)),
        number(posterior.map(|posterior| posterior.undetermined)),
        number(posterior.and_then(|posterior| posterior.out_of_distribution)),
        number(residual.and_then(|residual| residual.misfit)),
        note.map(|n| n.warnings.join("; ")).unwrap_or_default(),
        note.and_then(|n| n.error.clone()).or(damage).unwrap_or_default(),
    ]
}
