//! `gonio combine` combines the results of several photographs of one material.

use std::path::PathBuf;

use anyhow::Result;
use gonio_app::folder::for_results;
use gonio_app::{ProgressLog, combine};

use crate::input;
use crate::outcome::Outcome;
use crate::progress::ProgressLine;
use crate::suggestion::plain;

/// Options of `gonio combine`.
#[derive(clap::Args)]
pub(crate) struct CombineOptions {
    /// Result folders of gonio infer, one per photograph of the same material
    #[arg(required = true, num_args = 2.., value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Model file with which the results were inferred [default: the embedded model]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

pub(crate) fn run(options: &CombineOptions) -> Result<Outcome> {
    let line = ProgressLine::new("reading");
    let listener = |stage, fraction| line.report(stage, fraction);
    let progress_log = ProgressLog::new("reading", &listener);
    let given = combine::read_posteriors(&options.folders).map_err(plain)?;
    let (model, name) = input::model(options.model.as_deref())?;
    let folder = for_results(&options.output)?;
    let combined = combine::combine((&model, &name), &given, &progress_log).map_err(plain)?;
    progress_log.report("writing", 0.0);
    folder.fill(&combined.files().encode())?;
    line.finish();
    let output = options.output.display().to_string();
    let text = format!(
        "{output}: BRDF, pictures and report.html from {} photographs\n{}",
        given.len(),
        combined.material.verdict()
    );
    Ok(Outcome::of_result(text, &output, &combined.document))
}
