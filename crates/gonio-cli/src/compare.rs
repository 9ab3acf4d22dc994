//! `gonio compare` shows several results on one HTML page.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use gonio_app::compare::{self, ComparedFolder, PAGE};
use gonio_app::results::RESULT;
use gonio_io::atomic::write_file;
use gonio_report::compare::Comparison;
use serde_json::json;

use crate::batch;
use crate::input::{check_default, require_extension};
use crate::outcome::Outcome;
use crate::progress::ProgressLine;
use crate::suggestion::plain;

/// Largest number of pairs whose agreement is printed.
const MAX_PRINTED_PAIRS: usize = 10;

/// Options of `gonio compare`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  gonio compare one two three -o compare.html     results of gonio infer
  gonio compare results                           all rows of gonio batch")]
pub(crate) struct CompareOptions {
    /// Result folders of gonio infer or gonio batch
    ///
    /// The page shows all rows of a batch and all regions of a photograph with several materials.
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// HTML page to write [default: compare.html]
    ///
    /// The page is self-contained. It links to a report if the report lies in a folder below that
    /// of the page. gonio replaces an existing compare.html only if gonio wrote it.
    #[arg(short, long, value_name = "X.html")]
    output: Option<PathBuf>,
}

impl CompareOptions {
    /// Returns the path of the page: the specified one, or the default in the current folder.
    fn output(&self) -> Result<PathBuf> {
        let Some(output) = &self.output else {
            let problem = "was not written by gonio; specify another name with -o X.html";
            return check_default(PAGE.into(), compare::is_page, problem);
        };
        require_extension(output, "html")?;
        Ok(output.clone())
    }

    /// Lists the results in all folders.
    fn given(&self) -> Result<Vec<ComparedFolder>> {
        let alone = self.folders.len() == 1;
        let mut all = Vec::new();
        for (name, folder) in compare::names(&self.folders).into_iter().zip(&self.folders) {
            if !is_batch(folder)? {
                compare::check(folder).map_err(plain)?;
                all.push(ComparedFolder { name, folder: folder.clone(), failed: None });
                continue;
            }
            let rows = batch::given_of(folder)?;
            if rows.is_empty() {
                bail!("{}: contains no results of gonio batch", folder.display());
            }
            let named = |row: ComparedFolder| {
                if alone { row } else { ComparedFolder { name: format!("{name}/{}", row.name), ..row } }
            };
            all.extend(rows.into_iter().map(named));
        }
        Ok(all)
    }
}

/// Whether a folder contains a batch, not one result.
fn is_batch(folder: &Path) -> Result<bool> {
    let (shown, give) = (folder.display(), "specify result folders of gonio infer or gonio batch");
    if !folder.exists() {
        bail!("{shown}: folder not found; {give}");
    }
    if !folder.is_dir() {
        bail!("{shown}: is not a folder; {give}");
    }
    match (folder.join(RESULT).exists(), folder.join(batch::OUTCOMES).is_dir()) {
        (true, _) => Ok(false),
        (false, true) => Ok(true),
        (false, false) => bail!("{shown}: does not contain {RESULT}; {give}"),
    }
}

pub(crate) fn run(options: &CompareOptions) -> Result<Outcome> {
    let output = options.output()?;
    let given = options.given()?;
    let line = ProgressLine::new("comparing");
    let comparison = compare::read(&given, &output);
    if comparison.count() < 2 {
        bail!("{}: contains only one result; specify at least two result folders", options.folders[0].display());
    }
    write_file(&output, comparison.render().as_bytes())?;
    line.finish();
    Ok(outcome(&comparison, &output.display().to_string()))
}

fn outcome(comparison: &Comparison, output: &str) -> Outcome {
    let mut text = format!("{output}: compares {} results", comparison.count());
    if comparison.pairs.len() <= MAX_PRINTED_PAIRS {
        comparison.pairs.iter().for_each(|pair| text += &format!("\n{}", pair.sentence));
    }
    let pair = |pair: &gonio_report::compare::Pair| json!({ "of": comparison.names(pair), "agreement": pair.agreement.word(), "distance": pair.distance });
    let pairs: Vec<_> = comparison.pairs.iter().map(pair).collect();
    Outcome::new(text, json!({ "output": output, "results": comparison.count(), "pairs": pairs }))
}
