//! Merges the results of all rows into one table and one HTML page.

use std::path::Path;

use anyhow::{Result, anyhow, bail};
use gonio_app::compare::{self, Given, PAGE};
use gonio_io::atomic::write_file;
use gonio_io::notes;
use gonio_io::table::Table;
use serde_json::{Value, json};

use super::manifest::Row;
use super::{NOTES, Note, TABLE, read_note};
use crate::outcome::Outcome;

const COLUMNS: [&str; 13] = [
    "name",
    "status",
    "seconds",
    "material",
    "weight",
    "gloss_5",
    "gloss_50",
    "gloss_95",
    "undetermined",
    "strangeness",
    "misfit",
    "warnings",
    "error",
];

/// Writes `batch.csv` from the outcomes of all rows, and `compare.html` if `page`. If `rows` is
/// given, the table also lists missing rows.
pub(super) fn merge(output: &Path, rows: Option<&[Row]>, page: bool) -> Result<Outcome> {
    let names: Vec<String> = match rows {
        Some(rows) => rows.iter().map(|row| row.name.clone()).collect(),
        None => noted(output)?,
    };
    if names.is_empty() {
        bail!("{}: contains no results of gonio batch", output.display());
    }
    let mut table = Table { columns: COLUMNS.map(str::to_owned).to_vec(), rows: Vec::new() };
    let mut counts = [0_usize; 3];
    let mut all = Vec::new();
    for name in names {
        let note = read_note(output, &name);
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
fn write_page(page: &Path, all: &[Given]) -> Result<Vec<String>> {
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
pub(crate) fn given_of(output: &Path) -> Result<Vec<Given>> {
    let of = |name: String| {
        let note = read_note(output, &name);
        given(output, name, note)
    };
    Ok(noted(output)?.into_iter().map(of).collect())
}

fn given(output: &Path, name: String, note: Option<Note>) -> Given {
    let failed = match note {
        None => Some("not yet inferred".to_owned()),
        Some(note) => note.error,
    };
    Given { folder: output.join(&name), name, failed }
}

/// Lists the names of all rows with a recorded outcome.
fn noted(output: &Path) -> Result<Vec<String>> {
    let notes = output.join(NOTES);
    let failed = |error: std::io::Error| {
        let shown = notes.display();
        anyhow!("{shown}: cannot list this folder: {error}; specify the output folder of gonio batch")
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&notes).map_err(failed)? {
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

fn record(output: &Path, name: &str, status: &str, note: Option<&Note>) -> Vec<String> {
    let result: Value = match note {
        Some(note) if note.error.is_none() => notes::read(&output.join(name).join("result.json")).unwrap_or_default(),
        _ => Value::Null,
    };
    let number =
        |pointer: &str| result.pointer(pointer).and_then(Value::as_f64).map(|v| format!("{v:.4}")).unwrap_or_default();
    let nearest = result.pointer("/posterior/materials/0/name").and_then(Value::as_str).unwrap_or_default();
    vec![
        name.to_owned(),
        status.to_owned(),
        note.map(|n| format!("{:.1}", n.seconds)).unwrap_or_default(),
        nearest.to_owned(),
        number("/posterior/materials/0/weight"),
        number("/posterior/gloss/5"),
        number("/posterior/gloss/50"),
        number("/posterior/gloss/95"),
        number("/posterior/undetermined"),
        number("/posterior/strangeness"),
        number("/noise/misfit"),
        note.map(|n| n.warnings.join("; ")).unwrap_or_default(),
        note.and_then(|n| n.error.clone()).unwrap_or_default(),
    ]
}
