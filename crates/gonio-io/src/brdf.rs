//! Measured BRDFs in any supported format.

use std::io::{BufReader, Cursor, Read};
use std::path::{Path, PathBuf};

use gonio::reflectance::MerlTable;

use crate::folder::{self, has_extension};
use crate::{Error, guard, merl, result_brdf, rgl};

/// Reads a material from a file of the MERL (`.binary`) or RGL database (`_rgb.bsdf`), or from a
/// result of gonio (`brdf.npz`).
///
/// The first bytes or the extension determine the format. RGL measurements are resampled to the
/// angles of MERL ([`rgl::Rgl::to_merl`]).
///
/// # Errors
/// See [`merl::read`], [`rgl::read`] and [`result_brdf::read`]; or if the file has another format.
pub fn read(path: impl AsRef<Path>) -> Result<MerlTable, Error> {
    let path = path.as_ref();
    let (mut file, length) = guard::open(path)?;
    let mut begin = Vec::new();
    file.by_ref().take(rgl::MAGIC.len() as u64).read_to_end(&mut begin).map_err(|e| Error::io(path, "read", e))?;
    if begin == rgl::MAGIC || has_extension(path, &["bsdf"]) {
        Ok(rgl::read(path)?.to_merl())
    } else if begin.starts_with(result_brdf::MAGIC) || has_extension(path, &["npz"]) {
        Ok(MerlTable::from_bivariate(result_brdf::read(path)?.each_ref()))
    } else if !begin.starts_with(&merl::DIMENSIONS[0].to_le_bytes())
        && !begin.starts_with(merl::ANALYTIC)
        && !has_extension(path, &["binary"])
    {
        let advice = "convert it to a MERL table (.binary), an RGL tensor (.bsdf), or, with numpy, an array like that in brdf.npz (docs/options.md#brdfnpz)";
        Err(Error::unsupported(path, "is not in a format of BRDFs that gonio reads", advice))
    } else {
        merl::decode(path, BufReader::with_capacity(1 << 18, Cursor::new(begin).chain(file)), length)
    }
}

/// Lists the `.binary` and `.bsdf` files of a folder with material names, sorted by name.
///
/// # Errors
/// If the folder cannot be read or contains no such file.
pub fn list(dir: impl AsRef<Path>) -> Result<Vec<(String, PathBuf)>, Error> {
    folder::materials(dir.as_ref(), &["binary", "bsdf"])
}
