//! Reading what the user names, and telling what is wrong with it in the user's terms.

use std::path::Path;

use anyhow::{Context, Result};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::MerlTable;
use gonio_io::picture::{Decoded, Encoding, ReadOptions};

/// Reads a photograph. Integer pictures are taken as sRGB-coded, with a warning, unless
/// `options.linear`.
pub(crate) fn photograph(path: &Path, options: &ReadOptions, warnings: &mut Vec<String>) -> Result<Decoded> {
    let decoded = gonio_io::picture::read(path, options)?;
    if let Encoding::Srgb { bits } = decoded.encoding {
        warnings.push(format!(
            "{}: {bits}-bit sRGB-coded picture, decoded as such; its highlights are probably clipped and its tone curve \
             unknown: prefer an HDR picture, or pass --linear if its values are linear radiance",
            path.display()
        ));
    }
    if let (Some(layer), None) = (&decoded.layer, &options.layer) {
        warnings.push(format!(
            "{}: holds several pictures, {} was taken; --layer NAME takes another: {}",
            path.display(),
            layer.name,
            layer.others.join(", ")
        ));
    }
    Ok(decoded)
}

/// Reads a lat-long light map.
pub(crate) fn light(path: &Path) -> Result<EnvironmentMap> {
    let decoded = gonio_io::picture::read(path, &ReadOptions::default())?;
    EnvironmentMap::new(decoded.picture.rgb).with_context(|| path.display().to_string())
}

/// Reads a BRDF.
pub(crate) fn brdf(path: &Path) -> Result<MerlTable> {
    Ok(gonio_io::brdf::read(path)?)
}

/// The model of a file, or the one that travels with the program.
pub(crate) fn model(path: Option<&Path>) -> Result<Model> {
    Ok(match path {
        Some(path) => gonio_io::model::read_model(path)?,
        None => gonio_io::model::embedded()?,
    })
}
