//! Reading what the user names, and telling what is wrong with it in the user's terms.

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Result, bail};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::MerlTable;
use gonio_app::Shots;
use gonio_app::results::BRDF;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::ReadOptions;

use crate::remedy::plain;

/// Reads a lat-long light map; `space` is that of files that state none.
pub(crate) fn light(path: &Path, space: Option<ColourSpace>) -> Result<EnvironmentMap> {
    gonio_app::read_light(path, space).map_err(plain)
}

/// Stands for standard input.
const STDIN: &str = "-";

/// How messages call standard input.
const STDIN_NAME: &str = "standard input";

/// Whether standard input is meant.
pub(crate) fn is_stdin(path: &Path) -> bool {
    path == Path::new(STDIN)
}

/// How messages call a photograph: by its first file.
pub(crate) fn name(files: &[PathBuf]) -> String {
    match files {
        [first, ..] if is_stdin(first) => STDIN_NAME.to_owned(),
        [first, ..] => first.display().to_string(),
        [] => String::new(),
    }
}

/// A photograph from files, or from standard input.
pub(crate) fn shots(files: &[PathBuf]) -> Result<Shots> {
    if !files.iter().any(|file| is_stdin(file)) {
        return Ok(Shots::Files(files.to_vec()));
    }
    if files.len() > 1 {
        bail!("- is standard input, which is one whole picture: give exposures as files");
    }
    let stdin = std::io::stdin();
    if stdin.is_terminal() {
        bail!("- is standard input, which is a terminal here: pipe a picture into it");
    }
    let bytes = gonio_io::picture::read_stream(Path::new(STDIN_NAME), stdin.lock(), &ReadOptions::default())?;
    Ok(Shots::Bytes(STDIN_NAME.to_owned(), bytes))
}

/// Reads a BRDF.
pub(crate) fn brdf(path: &Path) -> Result<MerlTable> {
    if path.is_dir() {
        let inside = path.join(BRDF);
        if inside.is_file() {
            bail!("{}: is a folder of results; give {}", path.display(), inside.display());
        }
        bail!("{}: is a folder that holds no {BRDF}; give a BRDF (.binary, .bsdf)", path.display());
    }
    Ok(gonio_app::read_brdf(path)?)
}

/// The model of a file, or the one that travels with the program, and how messages call it. Each is
/// read once in a run: the rows of a batch share it.
pub(crate) fn model(path: Option<&Path>) -> Result<(Arc<Model>, String)> {
    static READ: Mutex<BTreeMap<Option<PathBuf>, Arc<Model>>> = Mutex::new(BTreeMap::new());
    let name = path.map_or_else(|| "the embedded model".to_owned(), |path| path.display().to_string());
    // A panic leaves what had been read before.
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
