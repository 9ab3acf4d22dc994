//! Reads the user's input files and reports errors in the terms of the options.

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Result, bail};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::MerlTable;
use gonio_app::PhotographSource;
use gonio_app::results::{BRDF, brdf_in, regions_in};
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::ReadOptions;

use crate::suggestion::plain;

/// Reads a lat-long environment map; `space` is the colour space of files that state none.
pub(crate) fn light(path: &Path, space: Option<ColourSpace>) -> Result<EnvironmentMap> {
    gonio_app::read_light(path, space).map_err(plain)
}

/// Parses numbers that are separated by commas; `None` if one is not a number.
pub(crate) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}

/// Parses an albedo or a reflectance.
pub(crate) fn parse_share(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|share: &f64| *share > 0.0 && *share <= 1.0);
    number.ok_or_else(|| "expected a number above 0 and at most 1".into())
}

/// Checks that an output file has this extension.
pub(crate) fn require_extension(output: &Path, extension: &str) -> Result<()> {
    if output.extension().is_none_or(|found| !found.eq_ignore_ascii_case(extension)) {
        let article = if extension == "png" { "a" } else { "an" };
        bail!("{}: the output must be {article} .{extension} file", output.display());
    }
    Ok(())
}

/// Checks that a default output does not exist, or is gonio's own, which it may replace. `problem`
/// states what is wrong with another file or folder, and what to do.
pub(crate) fn check_default(output: PathBuf, is_own: impl Fn(&Path) -> bool, problem: &str) -> Result<PathBuf> {
    if output.exists() && !is_own(&output) {
        bail!("{}: exists and {problem}", output.display());
    }
    Ok(output)
}

/// Argument that stands for standard input.
const STDIN: &str = "-";

/// Name of standard input in messages.
const STDIN_NAME: &str = "standard input";

/// Whether a path stands for standard input.
pub(crate) fn is_stdin(path: &Path) -> bool {
    path == Path::new(STDIN)
}

/// Returns the name of a photograph in messages: its first file.
pub(crate) fn name(files: &[PathBuf]) -> String {
    match files {
        [first, ..] if is_stdin(first) => STDIN_NAME.to_owned(),
        [first, ..] => first.display().to_string(),
        [] => String::new(),
    }
}

/// Opens a photograph from files or from standard input.
pub(crate) fn photograph_source(files: &[PathBuf]) -> Result<PhotographSource> {
    if !files.iter().any(|file| is_stdin(file)) {
        return Ok(PhotographSource::Files(files.to_vec()));
    }
    if files.len() > 1 {
        bail!("standard input (-) holds one image; pass exposures as files");
    }
    let stdin = std::io::stdin();
    if stdin.is_terminal() {
        bail!("standard input (-) is a terminal; pipe an image into it");
    }
    let bytes = gonio_io::picture::read_stream(Path::new(STDIN_NAME), stdin.lock(), &ReadOptions::default())?;
    Ok(PhotographSource::Bytes(STDIN_NAME.to_owned(), bytes))
}

/// Reads a BRDF from a file or a folder of results.
pub(crate) fn brdf(path: &Path) -> Result<MerlTable> {
    if path.is_dir() {
        return match (brdf_in(path), regions_in(path)?.first()) {
            (Some(inside), _) => Ok(gonio_app::read_brdf(&inside)?),
            (None, Some((_, region))) => {
                bail!("{}: contains several regions; specify one of them, such as {}", path.display(), region.display())
            }
            (None, None) => {
                bail!(
                    "{}: is a folder without {BRDF}; specify a BRDF file (.npz, .binary, .bsdf, .mbsdf, .csv)",
                    path.display()
                )
            }
        };
    }
    Ok(gonio_app::read_brdf(path)?)
}

/// Returns the model of a file, or the embedded model, and its name in messages. The program reads
/// each model once, so the rows of a batch share it.
pub(crate) fn model(path: Option<&Path>) -> Result<(Arc<Model>, String)> {
    static READ: Mutex<BTreeMap<Option<PathBuf>, Arc<Model>>> = Mutex::new(BTreeMap::new());
    let name = path.map_or_else(|| "the embedded model".to_owned(), |path| path.display().to_string());
    // After a panic, the models read before are still valid.
    let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    let key = path.map(Path::to_owned);
    let model = match read.get(&key) {
        Some(model) => Arc::clone(model),
        None => {
            let model = match path {
                Some(path) => gonio_io::model::read_model(path)?,
                None => gonio_io::model::embedded()?,
            };
            Arc::clone(read.entry(key).or_insert(Arc::new(model)))
        }
    };
    Ok((model, name))
}
