//! `gonio batch` runs `gonio infer` on every row of a table.
//!
//! Each row becomes the arguments of one `gonio infer` run. Its outcome is stored in its own file
//! below `rows/`, so that shards can run in parallel and an interrupted run can resume.

mod collect;
mod manifest;
mod shard;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, ScopedJoinHandle};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use gonio_io::atomic::write_file;

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::outcome::Outcome;
use crate::progress::{self, is_quiet};
use crate::{Command, help, infer};
pub(crate) use collect::given_of;
use manifest::Row;
use shard::Shard;

/// Folder of the rows' outcomes, within the folder of results.
pub(crate) const OUTCOMES: &str = "rows";

/// Table of all rows, in the folder of results.
const TABLE: &str = "batch.csv";

/// Options of `gonio batch`.
#[derive(clap::Args)]
pub(crate) struct BatchOptions {
    /// Photographs, or a CSV table of photographs and options
    ///
    /// gonio writes the results of each photograph to a folder named after the photograph. A table
    /// has the column "image"; separate exposures of one scene by semicolons. Optional columns are
    /// "name", which is the name of the result folder, and the long options of gonio infer (mask,
    /// normals, light-color, …). Paths are relative to the table; cells may be empty.
    #[arg(required_unless_present = "collect", value_name = "IMAGE|TABLE")]
    input: Vec<PathBuf>,
    /// Folder for the result folders of all photographs, batch.csv and compare.html
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Process every N-th row, starting with row I [default: from the Slurm array task]
    #[arg(long, value_name = "I/N", value_parser = shard::parse, conflicts_with = "collect")]
    shard: Option<Shard>,
    /// Do not infer; collect the results of all shards in batch.csv and compare.html
    #[arg(long)]
    collect: bool,
    /// Do not write compare.html
    ///
    /// Setting GONIO_NO_REPORT=1 has the same effect, and also disables report.html of each row.
    /// GONIO_NO_PICTURES=1 disables the pictures and report.html of each row.
    #[arg(long, env = "GONIO_NO_REPORT", hide_env_values = true, value_parser = infer::parse_yes)]
    no_report: bool,
}

/// Outcome of a row.
#[derive(Debug, Serialize, Deserialize)]
struct RowOutcome {
    name: String,
    /// Arguments of `gonio infer`; the row is inferred again if they change.
    arguments: Vec<String>,
    seconds: f64,
    /// Error of a row that failed.
    error: Option<String>,
    warnings: Vec<String>,
}

pub(crate) fn run(options: &BatchOptions) -> Result<Outcome> {
    let rows = match &options.input[..] {
        [] => None,
        [table] if !help::is_picture(table) => Some(manifest::read(table, &options.output)?),
        images => Some(manifest::of_images(images, &options.output)?),
    };
    if options.collect {
        return collect::collect(&options.output, rows.as_deref(), !options.no_report);
    }
    let rows = rows.context("no photographs or table specified")?;
    let shard = options.shard.map_or_else(shard::of_slurm, |shard| Ok(Some(shard)))?;
    let own: Vec<&Row> =
        rows.iter().enumerate().filter(|(i, _)| shard.is_none_or(|s| s.has(*i))).map(|(_, r)| r).collect();
    let noted = options.output.join(OUTCOMES);
    std::fs::create_dir_all(&noted).with_context(|| format!("{}: cannot create this folder", noted.display()))?;
    let is_open = |(_, row): &(usize, &Row)| {
        read_outcome(&options.output, &row.name).is_none_or(|note| {
            note.error.is_some() || note.arguments != row.arguments || !row.folder.join("result.json").is_file()
        })
    };
    let open: Vec<(usize, &Row)> = own.iter().copied().enumerate().filter(is_open).collect();
    let skipped = own.len() - open.len();
    let failed = infer_rows(&open, own.len(), &options.output)?;
    // `--collect` writes the table of a sharded batch.
    let warnings = match shard {
        None => collect::collect(&options.output, Some(&rows), !options.no_report)?.warnings,
        Some(_) => Vec::new(),
    };
    let output = options.output.display().to_string();
    if !failed.is_empty() {
        bail!(
            "{output}: {} of {} rows failed ({}); all other rows are complete",
            failed.len(),
            own.len(),
            failed.join(", ")
        );
    }
    let count = own.len() - skipped;
    let text = format!("{output}: {count} rows inferred, {skipped} rows skipped (already complete)");
    let fields = json!({ "output": output, "rows": own.len(), "inferred": count, "skipped": skipped });
    Ok(Outcome::new(text, fields).warning(warnings))
}

/// Infers rows in parallel and returns the names of failed rows in order. `rows` pairs each row
/// with its index; `count` is the total that the progress lines print. If there are fewer rows than
/// threads, each row runs on several threads.
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
            let text = serde_json::to_string_pretty(&note).context("the outcome of a row cannot be encoded as JSON")?;
            write_file(outcome_path(output, &row.name), text.as_bytes())?;
            let end = note.error.as_ref().map_or_else(|| format!("{:.1} s", note.seconds), |e| format!("failed: {e}"));
            if note.error.is_some() || !is_quiet() {
                eprintln!("[{}/{count}] {}: {end}", place + 1, row.name);
            }
            failed.extend(note.error.is_some().then_some(*place));
        }
    };
    let all = thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        // A row that panics is recorded as failed, so a worker does not panic.
        let ended = |worker: ScopedJoinHandle<'_, Result<Vec<usize>>>| {
            worker.join().unwrap_or_else(|_| bail!("a worker thread of the batch panicked"))
        };
        workers.into_iter().map(ended).collect::<Result<Vec<_>>>()
    })?;
    let failed = all.concat();
    Ok(rows.iter().filter(|(place, _)| failed.contains(place)).map(|(_, row)| row.name.clone()).collect())
}

/// Infers a row and records its outcome, errors and panics included.
fn infer_row(row: &Row) -> RowOutcome {
    let start = Instant::now();
    let whole = || -> Result<Vec<String>> {
        let words = ["gonio", "infer"].into_iter().map(str::to_owned).chain(row.arguments.iter().cloned());
        let parsed = help::parse(words).map_err(|e| anyhow::anyhow!("{}", crate::problem(&e)))?;
        let Command::Infer(options) = parsed.command else { bail!("the row is not a gonio infer command") };
        Ok(infer::run(&options)?.warnings)
    };
    let ended = catch_unwind(AssertUnwindSafe(whole));
    let (error, warnings) = match ended {
        Ok(Ok(warnings)) => (None, warnings),
        Ok(Err(error)) => (Some(crate::one_line(&format!("{error:#}"))), Vec::new()),
        Err(_) => (Some("internal error; please report this bug".to_owned()), Vec::new()),
    };
    RowOutcome {
        name: row.name.clone(),
        arguments: row.arguments.clone(),
        seconds: start.elapsed().as_secs_f64(),
        error,
        warnings,
    }
}

fn outcome_path(output: &Path, name: &str) -> PathBuf {
    output.join(OUTCOMES).join(format!("{name}.json"))
}

/// Reads the outcome of an earlier run. Returns `None` if the file is missing or damaged; gonio
/// then infers the row again.
fn read_outcome(output: &Path, name: &str) -> Option<RowOutcome> {
    gonio_io::json::read(&outcome_path(output, name)).ok()
}
