//! Reading what the user names, and telling what is wrong with it in the user's terms.

use std::path::Path;

use anyhow::Result;
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::MerlTable;

use crate::remedy::plain;

/// Reads a lat-long light map.
pub(crate) fn light(path: &Path) -> Result<EnvironmentMap> {
    gonio_app::read_light(path).map_err(plain)
}

/// Reads a BRDF.
pub(crate) fn brdf(path: &Path) -> Result<MerlTable> {
    Ok(gonio_io::brdf::read(path)?)
}

/// The model of a file, or the one that travels with the program, and how messages call it.
pub(crate) fn model(path: Option<&Path>) -> Result<(Model, String)> {
    Ok(match path {
        Some(path) => (gonio_io::model::read_model(path)?, path.display().to_string()),
        None => (gonio_io::model::embedded()?, "the embedded model".to_owned()),
    })
}
