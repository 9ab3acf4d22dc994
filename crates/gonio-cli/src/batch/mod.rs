//! `gonio batch`: `gonio infer` for every row of a table.
//!
//! A row becomes the arguments of `gonio infer`. Its outcome is written to a file of its own below
//! `rows/`, so that shards can run at the same time and a run that was killed resumes.

mod manifest;
mod merge;
mod shard;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, ScopedJoinHandle};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use gonio_io::atomic::write_file;
use gonio_io::notes;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::outcome::Outcome;
use crate::progress::{self, is_quiet};
use crate::{Command, help, infer};
use manifest::Row;
pub(crate) use merge::given_of;
use shard::Shard;

/// Folder of what became of each row, within that of the results.
pub(crate) const NOTES: &str = "rows";

/// Table of all rows, in that folder.
const TABLE: &str = "batch.csv";

/// Options of `gonio batch`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Photographs, each by itself; or a table (CSV) of photographs and options
    ///
    /// Results of a photograph go to a folder of its name. A table has a column `image`, a column
    /// `name` for the folder of each row's results, and a column for any option of gonio infer
    /// (`mask`, `normals`, `light-color`, …); files are relative to the table, cells may be empty.
    #[arg(required_unless_present = "merge", value_name = "IMAGE|TABLE")]
    input: Vec<PathBuf>,
    /// Folder for a folder of results of each photograph, for batch.csv and compare.html
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Only each N-th row, beginning with the I-th; in a Slurm array its variables say this
    #[arg(long, value_name = "I/N", value_parser = shard::parse, conflicts_with = "merge")]
    shard: Option<Shard>,
    /// Infer nothing: put what all shards have found into batch.csv and compare.html
    #[arg(long)]
    merge: bool,
    /// Write no compare.html
    ///
    /// In the variable 1, yes, true or on write none, and no report.html of any row; 0, no, false,
    /// off or nothing write them.
    #[arg(long, env = "GONIO_NO_REPORT", hide_env_values = true, value_parser = infer::parse_yes)]
    no_report: bool,
}

/// Outcome of a row.
#[derive(Debug, Serialize, Deserialize)]
struct Note {
    name: String,
    /// Arguments of `gonio infer`; if they change, the row is inferred again.
    arguments: Vec<String>,
    seconds: f64,
    /// Error of a row that failed.
    error: Option<String>,
    warnings: Vec<String>,
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let rows = match &options.input[..] {
        [] => None,
        [table] if !help::is_picture(table) => Some(manifest::read(table, &options.output)?),
        images => Some(manifest::of_images(images, &options.output)?),
    };
    if options.merge {
        return merge::merge(&options.output, rows.as_deref(), !options.no_report);
    }
    let rows = rows.context("without a table")?;
    let shard = options.shard.map_or_else(shard::of_slurm, |shard| Ok(Some(shard)))?;
    let own: Vec<&Row> =
        rows.iter().enumerate().filter(|(i, _)| shard.is_none_or(|s| s.has(*i))).map(|(_, r)| r).collect();
    let noted = options.output.join(NOTES);
    std::fs::create_dir_all(&noted).with_context(|| format!("{}: cannot make this folder", noted.display()))?;
    let is_open = |(_, row): &(usize, &Row)| {
        read_note(&options.output, &row.name).is_none_or(|note| {
            note.error.is_some() || note.arguments != row.arguments || !row.folder.join("result.json").is_file()
        })
    };
    let open: Vec<(usize, &Row)> = own.iter().copied().enumerate().filter(is_open).collect();
    let skipped = own.len() - open.len();
    let failed = infer_rows(&open, own.len(), &options.output)?;
    // Shards leave this to the one that merges.
    let warnings = match shard {
        None => merge::merge(&options.output, Some(&rows), !options.no_report)?.warnings,
        Some(_) => Vec::new(),
    };
    let output = options.output.display().to_string();
    if !failed.is_empty() {
        bail!("{output}: {} of {} rows failed ({}); the others are done", failed.len(), own.len(), failed.join(", "));
    }
    let count = own.len() - skipped;
    let text = format!("{output}: {count} rows inferred, {skipped} were done before");
    let fields = json!({ "output": output, "rows": own.len(), "inferred": count, "skipped": skipped });
    Ok(Outcome::new(text, fields).warning(warnings))
}

/// Infers rows, of which each comes with its place among `count`, as many at a time as there are
/// threads; returns the names of those that failed, in order. A row that has a thread for itself
/// leaves none idle.
fn infer_rows(rows: &[(usize, &Row)], count: usize, output: &Path) -> Result<Vec<String>> {
    let threads = rayon::current_num_threads();
    let workers = threads.min(rows.len()).max(1);
    progress::share_terminal(workers > 1);
    let next = AtomicUsize::new(0);
    let work = || -> Result<Vec<usize>> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads / workers).build()?;
        let mut failed = Vec::new();
        loop {
            let Some((place, row)) = rows.get(next.fetch_add(1, Ordering::Relaxed)) else { return Ok(failed) };
            let note = pool.install(|| infer_row(row));
            let text = serde_json::to_string_pretty(&note).context("a note that is no JSON")?;
            write_file(note_path(output, &row.name), text.as_bytes())?;
            let end = note.error.as_ref().map_or_else(|| format!("{:.1} s", note.seconds), |e| format!("failed: {e}"));
            if note.error.is_some() || !is_quiet() {
                eprintln!("[{}/{count}] {}: {end}", place + 1, row.name);
            }
            failed.extend(note.error.is_some().then_some(*place));
        }
    };
    let all = thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        // A row that panics is noted as failed: no worker does.
        let ended = |worker: ScopedJoinHandle<'_, Result<Vec<usize>>>| {
            worker.join().unwrap_or_else(|_| bail!("a worker of the batch ended"))
        };
        workers.into_iter().map(ended).collect::<Result<Vec<_>>>()
    })?;
    let failed = all.concat();
    Ok(rows.iter().filter(|(place, _)| failed.contains(place)).map(|(_, row)| row.name.clone()).collect())
}

/// Infers a row; whatever happens is noted.
fn infer_row(row: &Row) -> Note {
    let start = Instant::now();
    let whole = || -> Result<Vec<String>> {
        let words = ["gonio", "infer"].into_iter().map(str::to_owned).chain(row.arguments.iter().cloned());
        let parsed = help::parse(words).map_err(|e| anyhow::anyhow!("{}", crate::problem(&e)))?;
        let Command::Infer(options) = parsed.command else { bail!("not a row") };
        Ok(infer::run(&options)?.warnings)
    };
    let ended = catch_unwind(AssertUnwindSafe(whole));
    let (error, warnings) = match ended {
        Ok(Ok(warnings)) => (None, warnings),
        Ok(Err(error)) => (Some(crate::one_line(&format!("{error:#}"))), Vec::new()),
        Err(_) => (Some("a fault of gonio itself; please report it".to_owned()), Vec::new()),
    };
    Note {
        name: row.name.clone(),
        arguments: row.arguments.clone(),
        seconds: start.elapsed().as_secs_f64(),
        error,
        warnings,
    }
}

fn note_path(output: &Path, name: &str) -> PathBuf {
    output.join(NOTES).join(format!("{name}.json"))
}

/// Reads the outcome of an earlier run; `None` also if it cannot be read, so that the row is
/// inferred again.
fn read_note(output: &Path, name: &str) -> Option<Note> {
    serde_json::from_value(notes::read(&note_path(output, name)).ok()?).ok()
}
