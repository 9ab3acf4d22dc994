//! Measured BRDFs in any of the formats read here.

use std::fs;
use std::io::{BufReader, Cursor, Read};
use std::path::{Path, PathBuf};

use gonio::reflectance::MerlTable;

use crate::rgl::{self, MAGIC};
use crate::{Error, guard, merl};

/// Reads a material from a file of the MERL database (`.binary`) or of the RGL database
/// (`_rgb.bsdf`), told apart by how they begin. Measurements of the latter are put on the angles of
/// the former ([`rgl::Rgl::to_merl`]).
///
/// # Errors
/// As [`merl::read`] and [`rgl::read`].
pub fn read(path: impl AsRef<Path>) -> Result<MerlTable, Error> {
    let path = path.as_ref();
    let (mut file, length) = guard::open(path)?;
    let mut begin = Vec::new();
    file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut begin).map_err(|e| Error::io(path, "read", e))?;
    if begin == MAGIC || has_extension(path, &["bsdf"]) {
        Ok(rgl::read(path)?.to_merl())
    } else {
        merl::decode(path, BufReader::with_capacity(1 << 18, Cursor::new(begin).chain(file)), length)
    }
}

/// The `.binary` and `.bsdf` files of a folder with the names of their materials, sorted by name.
///
/// # Errors
/// If the folder cannot be read or holds no such file.
pub fn list(dir: impl AsRef<Path>) -> Result<Vec<(String, PathBuf)>, Error> {
    files(dir.as_ref(), &["binary", "bsdf"])
}

/// The files of a folder with one of some extensions, and their names without it, sorted.
pub(crate) fn files(dir: &Path, extensions: &[&str]) -> Result<Vec<(String, PathBuf)>, Error> {
    let failed = |e| Error::io(dir, "read the folder", e);
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if has_extension(&path, extensions)
            && path.is_file()
            && let Some(name) = path.file_stem()
        {
            found.push((name.to_string_lossy().into_owned(), path));
        }
    }
    if found.is_empty() {
        let problem = format!("holds no .{} file", extensions.join(" or ."));
        return Err(Error::invalid(dir, problem, "give the folder with the measured materials"));
    }
    found.sort();
    Ok(found)
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|e| extensions.contains(&e.to_string_lossy().to_ascii_lowercase().as_str()))
}
