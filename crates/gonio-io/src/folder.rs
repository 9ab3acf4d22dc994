//! Listing of folders.

use std::fs;
use std::path::{Path, PathBuf};

use crate::Error;

/// Lists the files of a folder with one of the extensions (in lower case), sorted by name.
///
/// # Errors
/// If the folder cannot be read.
pub fn files(dir: impl AsRef<Path>, extensions: &[&str]) -> Result<Vec<PathBuf>, Error> {
    let dir = dir.as_ref();
    let failed = |e| Error::io(dir, "list this folder", e);
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if has_extension(&path, extensions) && path.is_file() {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

pub(crate) fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|e| extensions.contains(&e.to_string_lossy().to_ascii_lowercase().as_str()))
}

/// Lists the measured materials of a folder. These are files with one of the extensions, with their
/// names without the extension.
pub(crate) fn materials(dir: &Path, extensions: &[&str]) -> Result<Vec<(String, PathBuf)>, Error> {
    let named =
        |path: PathBuf| path.file_stem().map(|name| name.to_string_lossy().into_owned()).zip(Some(path.clone()));
    let found: Vec<(String, PathBuf)> = files(dir, extensions)?.into_iter().filter_map(named).collect();
    if found.is_empty() {
        let problem = format!("contains no .{} file", extensions.join(" or ."));
        return Err(Error::invalid(dir, problem, "specify the folder of measured materials"));
    }
    Ok(found)
}
