//! Where the data are, and how they are read.

use std::path::Path;

use anyhow::{Context, Result, bail};
use gonio::lighting::EnvironmentMap;
use gonio::reflectance::BivariateTable;

/// Reads an environment map.
pub(crate) fn read_map(path: &Path) -> Result<EnvironmentMap> {
    let decoded = gonio_io::picture::read(path, &gonio_io::picture::ReadOptions::default())?;
    EnvironmentMap::new(decoded.picture.rgb).with_context(|| path.display().to_string())
}

/// A test light of the data by its name.
pub(crate) fn test_light(data: &Path, name: &str) -> Result<EnvironmentMap> {
    read_map(&data.join("lighting/test").join(format!("{name}.hdr")))
}

/// The bivariate tables of all materials, one per channel.
pub(crate) fn materials(data: &Path) -> Result<Vec<(String, [BivariateTable; 3])>> {
    Ok(gonio_io::bivariate::read_bivariate_set(data.join("merl"))?)
}

/// One of them.
pub(crate) fn material<'a>(all: &'a [(String, [BivariateTable; 3])], name: &str) -> Result<&'a [BivariateTable; 3]> {
    match all.iter().find(|(n, _)| n == name) {
        Some((_, tables)) => Ok(tables),
        None => bail!("there is no material {name}"),
    }
}

/// Luminance of an RGB reflectance.
pub(crate) fn luminance_table(rgb: &[BivariateTable; 3]) -> BivariateTable {
    let [r, g, b] = rgb;
    let channels = r.as_slice().iter().zip(g.as_slice()).zip(b.as_slice());
    BivariateTable::from_vec(
        channels.map(|((r, g), b)| gonio::picture::luminance(glam::Vec3::new(*r, *g, *b))).collect(),
    )
}
