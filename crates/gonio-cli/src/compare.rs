//! `gonio compare`: several results on one page.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use gonio_app::compare::{self, Given, PAGE};
use gonio_app::results::RESULT;
use gonio_io::atomic::write_file;
use gonio_report::compare::Comparison;
use serde_json::json;

use crate::batch;
use crate::outcome::Outcome;
use crate::progress::Stage;
use crate::remedy::plain;

/// Pairs of which the last lines say whether they agree, at most.
const SAID: usize = 10;

/// Options of `gonio compare`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  gonio compare one two three -o compare.html     results of gonio infer
  gonio compare results                           all rows of gonio batch")]
pub(crate) struct Options {
    /// Folders that gonio infer or gonio batch wrote
    ///
    /// Of a batch all rows are shown, of a photograph with several materials all regions.
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Page to write; compare.html if not given
    ///
    /// It needs nothing but itself, and links to the reports of results in folders below its own. A
    /// compare.html that is there is replaced only if gonio wrote it.
    #[arg(short, long, value_name = "X.html")]
    output: Option<PathBuf>,
}

impl Options {
    /// The page: the one given, or one in the folder where the program runs.
    fn output(&self) -> Result<PathBuf> {
        let Some(output) = &self.output else {
            let output = PathBuf::from(PAGE);
            if output.exists() && !compare::is_page(&output) {
                bail!("{PAGE}: is there and not of gonio; give another name with -o X.html");
            }
            return Ok(output);
        };
        if output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("html")) {
            bail!("{}: write to a name ending in .html", output.display());
        }
        Ok(output.clone())
    }

    /// The results of all folders.
    fn given(&self) -> Result<Vec<Given>> {
        let alone = self.folders.len() == 1;
        let mut all = Vec::new();
        for (name, folder) in compare::names(&self.folders).into_iter().zip(&self.folders) {
            if !is_batch(folder)? {
                compare::check(folder).map_err(plain)?;
                all.push(Given { name, folder: folder.clone(), failed: None });
                continue;
            }
            let rows = batch::given_of(folder)?;
            if rows.is_empty() {
                bail!("{}: holds no results of gonio batch", folder.display());
            }
            let named = |row: Given| if alone { row } else { Given { name: format!("{name}/{}", row.name), ..row } };
            all.extend(rows.into_iter().map(named));
        }
        Ok(all)
    }
}

/// Whether a folder is that of a batch; it may be that of one result, too.
fn is_batch(folder: &Path) -> Result<bool> {
    let (shown, give) = (folder.display(), "give folders that gonio infer or gonio batch wrote");
    if !folder.exists() {
        bail!("{shown}: there is no such folder; {give}");
    }
    if !folder.is_dir() {
        bail!("{shown}: is no folder; {give}");
    }
    match (folder.join(RESULT).exists(), folder.join(batch::NOTES).is_dir()) {
        (true, _) => Ok(false),
        (false, true) => Ok(true),
        (false, false) => bail!("{shown}: holds no {RESULT}; {give}"),
    }
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let output = options.output()?;
    let given = options.given()?;
    let stage = Stage::new("comparing");
    let comparison = compare::read(&given, &output);
    if comparison.count() < 2 {
        bail!("{}: is one result alone; give two folders or more", options.folders[0].display());
    }
    write_file(&output, comparison.render().as_bytes())?;
    stage.finish();
    Ok(outcome(&comparison, &output.display().to_string()))
}

fn outcome(comparison: &Comparison, output: &str) -> Outcome {
    let mut text = format!("{output}: {} results side by side", comparison.count());
    if comparison.pairs.len() <= SAID {
        comparison.pairs.iter().for_each(|pair| text += &format!("\n{}", pair.sentence));
    }
    let pair = |pair: &gonio_report::compare::Pair| json!({ "of": comparison.names(pair), "agreement": pair.agreement.word(), "distance": pair.distance });
    let pairs: Vec<_> = comparison.pairs.iter().map(pair).collect();
    Outcome::new(text, json!({ "output": output, "results": comparison.count(), "pairs": pairs }))
}
