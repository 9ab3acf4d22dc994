//! `gonio combine` combines the results of several photographs of one material.

use std::path::PathBuf;

use anyhow::Result;
use gonio_app::folder::for_results;
use gonio_app::{ProgressLog, combine};
use serde_json::json;

use crate::input;
use crate::outcome::Outcome;
use crate::progress::Stages;
use crate::suggestion::plain;

/// Options of `gonio combine`.
#[derive(clap::Args)]
pub(crate) struct Options {
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

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let line = Stages::new("reading");
    let listener = |stage, fraction| line.at(stage, fraction);
    let progress_log = ProgressLog::new("reading", &listener);
    let given = combine::read_posteriors(&options.folders).map_err(plain)?;
    let (model, name) = input::model(options.model.as_deref())?;
    let folder = for_results(&options.output)?;
    let answer = combine::combine((&model, &name), &given, &progress_log).map_err(plain)?;
    progress_log.at("writing", 0.0);
    folder.fill(&answer.files().map_err(plain)?.encode())?;
    line.finish();
    let output = options.output.display().to_string();
    let text = format!(
        "{output}: BRDF, pictures and result.json from {} photographs\n{}",
        given.len(),
        answer.material.verdict()
    );
    let mut outcome = Outcome::new(text, json!({ "output": output }));
    let mut notes = answer.notes;
    let fields = ["method", "photographs", "posterior", "colour"].map(|key| (key.to_owned(), notes[key].take()));
    outcome.fields.extend(fields);
    Ok(outcome)
}
