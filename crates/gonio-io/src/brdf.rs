//! Measured BRDFs in any supported format.

use std::io::{BufReader, Cursor, Read};
use std::path::{Path, PathBuf};

use gonio::reflectance::MerlTable;

use crate::folder::{self, has_extension};
use crate::result_brdf::{self, ResultBrdf};
use crate::rgl::{self, Channels};
use crate::{Error, brdf_csv, guard, mbsdf, merl};

/// Reads a BRDF: a result of gonio (`brdf.npz`), or a file in the format of MERL (`.binary`), RGL
/// (`_rgb.bsdf`), MDL (`.mbsdf`) or [`brdf_csv`] (`.csv`).
///
/// The first bytes or the extension determine the format. RGL and MDL measurements are resampled to
/// the angles of MERL ([`rgl::Rgl::to_merl`], [`mbsdf::MeasuredBsdf::to_merl`]).
///
/// # Errors
/// See [`merl::read`], [`rgl::read`], [`mbsdf::read`], [`brdf_csv::read`] and
/// [`result_brdf::read`]; or if the file has another format.
pub fn read(path: impl AsRef<Path>) -> Result<MerlTable, Error> {
    let path = path.as_ref();
    let (mut file, length) = guard::open(path)?;
    let mut begin = Vec::new();
    file.by_ref().take(mbsdf::MAGIC.len() as u64).read_to_end(&mut begin).map_err(|e| Error::io(path, "read", e))?;
    if begin.starts_with(rgl::MAGIC) || has_extension(path, &["bsdf"]) {
        Ok(rgl::read(path)?.to_merl())
    } else if begin == mbsdf::MAGIC || has_extension(path, &["mbsdf"]) {
        Ok(mbsdf::read(path)?.to_merl())
    } else if begin.starts_with(result_brdf::MAGIC) || has_extension(path, &["npz"]) {
        Ok(MerlTable::from_bivariate(result_brdf::read(path)?.each_ref()))
    } else if has_extension(path, &["csv"]) {
        Ok(MerlTable::from_bivariate(brdf_csv::read(path)?.each_ref()))
    } else if !begin.starts_with(&merl::DIMENSIONS[0].to_le_bytes())
        && !begin.starts_with(merl::ANALYTIC)
        && !has_extension(path, &["binary"])
    {
        let advice = "convert it to a CSV table (docs/exports.md#file-formats)";
        Err(Error::unsupported(path, "is not in a format of BRDFs that gonio reads", advice))
    } else {
        merl::decode(path, BufReader::with_capacity(1 << 18, Cursor::new(begin).chain(file)), length)
    }
}

/// Encodes a BRDF in the format that the name of the file determines: `.binary` (MERL), `.npz`,
/// `.csv`, `.mbsdf` (MDL), `_spec.bsdf` (spectral RGL) or any other `.bsdf` (RGL in RGB).
///
/// `.binary` and `.mbsdf` preserve the dependence on `phi_d`; the other formats contain the mean
/// over it. `name` is the description in RGL files.
///
/// # Errors
/// If the name has another extension.
pub fn encode(path: &Path, table: &MerlTable, name: &str) -> Result<Vec<u8>, Error> {
    let file = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let tables = || table.to_bivariate();
    Ok(match file.rsplit_once('.').map(|(_, extension)| extension) {
        Some("binary") => merl::encode(table),
        Some("mbsdf") => mbsdf::encode(table),
        Some("npz") => result_brdf::encode(&ResultBrdf { tables: tables(), quantiles: None }),
        Some("csv") => brdf_csv::encode(&tables()),
        Some("bsdf") => {
            let channels = if file.ends_with("_spec.bsdf") { Channels::Spectral } else { Channels::Rgb };
            rgl::encode(&tables(), name, channels)
        }
        _ => {
            let problem = "is not the name of a BRDF file that gonio writes";
            return Err(Error::invalid(path, problem, "specify a .binary, .bsdf, .mbsdf, .npz or .csv file"));
        }
    })
}

/// Lists the `.binary`, `.bsdf` and `.mbsdf` files of a folder with material names, sorted by name.
///
/// # Errors
/// If the folder cannot be read or contains no such file.
pub fn list(dir: impl AsRef<Path>) -> Result<Vec<(String, PathBuf)>, Error> {
    folder::materials(dir.as_ref(), &["binary", "bsdf", "mbsdf"])
}
