//! Measured materials: the full tables that inputs are rendered from and the bivariate ones that everything else uses.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::reflectance::{BivariateTable, MerlTable};
use rayon::prelude::*;

/// A database of materials in the order of their file names: a folder of `.binary` files of the MERL database, or of bivariate tables, or both.
pub(crate) struct Materials {
    /// Names, in the order of `NAME.binary`: that of a listing of the database, `chrome-steel` before `chrome`.
    pub(crate) names: Vec<String>,
    rgb: Vec<[BivariateTable; 3]>,
    files: BTreeMap<String, PathBuf>,
}

/// What a picture of a material was rendered from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// The table over all three angles.
    Full,
    /// Only the bivariate table is there.
    Bivariate,
}

impl Materials {
    /// Of the folder `full`, or `DATA/merl` without one. Materials whose full table is missing are taken from the
    /// bivariate set of `DATA/merl`; full tables without a bivariate one are reduced.
    pub(crate) fn open(data: &Path, full: Option<&Path>) -> Result<Self> {
        let default = data.join("merl");
        let folder = full.unwrap_or(&default);
        let files: BTreeMap<String, PathBuf> =
            gonio_io::merl::list(folder).map_or_else(|_| BTreeMap::new(), |list| list.into_iter().collect());
        if full.is_some() && files.is_empty() {
            bail!("{}: no .binary files of the MERL database here", folder.display());
        }
        let mut rgb: BTreeMap<String, [BivariateTable; 3]> = BTreeMap::new();
        if default.join("bivariate_rgb_f32.npy").is_file() {
            rgb.extend(gonio_io::bivariate::read_bivariate_set(&default)?);
        }
        let missing: Vec<(&String, &PathBuf)> = files.iter().filter(|(name, _)| !rgb.contains_key(*name)).collect();
        let reduced: Vec<(String, [BivariateTable; 3])> = missing
            .par_iter()
            .map(|(name, path)| {
                let table = gonio_io::merl::read(path)?;
                Ok(((*name).clone(), [0, 1, 2].map(|c| table.bivariate(c))))
            })
            .collect::<Result<_>>()?;
        rgb.extend(reduced);
        if rgb.is_empty() {
            bail!(
                "{}: no materials here; --data names the folder of the data (with merl/), --merl one of .binary files",
                folder.display()
            );
        }
        let mut all: Vec<(String, [BivariateTable; 3])> = rgb.into_iter().collect();
        all.sort_by_cached_key(|(name, _)| file_name(name));
        let (names, rgb) = all.into_iter().unzip();
        Ok(Self { names, rgb, files })
    }

    /// Place of a name in the list.
    pub(crate) fn index(&self, name: &str) -> Result<usize> {
        match self.names.iter().position(|n| n == name) {
            Some(at) => Ok(at),
            None => bail!("there is no material {name}"),
        }
    }

    /// Bivariate tables of the channels.
    pub(crate) fn rgb(&self, at: usize) -> &[BivariateTable; 3] {
        &self.rgb[at]
    }

    /// Green channel over half and difference angle: what bases are learnt from.
    pub(crate) fn green(&self, at: usize) -> &BivariateTable {
        &self.rgb[at][1]
    }

    /// Luminance over half and difference angle: what estimates are compared with.
    pub(crate) fn luminance(&self, at: usize) -> BivariateTable {
        BivariateTable::luminance(&self.rgb[at])
    }

    /// What [`Self::full`] has for a material.
    pub(crate) fn source(&self, at: usize) -> Source {
        if self.files.contains_key(&self.names[at]) { Source::Full } else { Source::Bivariate }
    }

    /// The table to render, spread over `phi_d` where there is no other.
    pub(crate) fn full(&self, at: usize) -> Result<MerlTable> {
        match self.files.get(&self.names[at]) {
            Some(path) => Ok(gonio_io::merl::read(path)?),
            None => Ok(MerlTable::from_bivariate(self.rgb[at].each_ref())),
        }
    }

    /// Changes when the table that [`Self::full`] reads does.
    pub(crate) fn fingerprint(&self, at: usize) -> Result<String> {
        let mut hasher = blake3::Hasher::new();
        match self.files.get(&self.names[at]) {
            Some(path) => {
                let file = std::fs::File::open(path).with_context(|| format!("{}: cannot open", path.display()))?;
                hasher.update_reader(file).with_context(|| format!("{}: cannot read", path.display()))?;
            }
            None => {
                for value in self.rgb[at].iter().flat_map(BivariateTable::as_slice) {
                    hasher.update(&value.to_le_bytes());
                }
            }
        }
        Ok(hasher.finalize().to_hex().to_string())
    }

    /// Every fifth material, starting with the third: what a leave-out basis never sees.
    pub(crate) fn held_out(&self) -> Vec<usize> {
        (0..self.names.len()).filter(|i| i % 5 == 2).collect()
    }
}

/// Name of the file of a material in the database.
fn file_name(material: &str) -> String {
    format!("{material}.binary")
}

#[cfg(test)]
mod tests {
    use gonio::reflectance::{CELLS, THETA_D, THETA_H};

    use super::*;

    #[test]
    fn the_order_is_that_of_the_files() {
        let dir = tempfile::tempdir().unwrap();
        let merl = dir.path().join("merl");
        std::fs::create_dir(&merl).unwrap();
        let names = ["chrome", "brass", "chrome-steel"];
        std::fs::write(merl.join("materials.txt"), names.join("\n")).unwrap();
        let array = gonio_io::npy::Array { shape: vec![3, THETA_H, THETA_D, 3], values: vec![0.5; 9 * CELLS] };
        std::fs::write(merl.join("bivariate_rgb_f32.npy"), gonio_io::npy::encode(&array)).unwrap();
        let materials = Materials::open(dir.path(), None).unwrap();
        assert_eq!(materials.names, ["brass", "chrome-steel", "chrome"]);
        assert_eq!(materials.index("chrome").unwrap(), 2);
        // The third of five.
        assert_eq!(materials.held_out(), [2]);
        assert!(materials.index("kryptonite").is_err());
    }
}
