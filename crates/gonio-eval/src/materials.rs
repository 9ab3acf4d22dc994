//! Measured materials: the full tables that inputs are rendered from and the bivariate ones that everything else uses.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::reflectance::{BivariateTable, MerlTable};
use rayon::prelude::*;

use crate::data::luminance_table;

/// A database of materials in alphabetical order: a folder of `.binary` files of the MERL database, or of bivariate tables, or both.
pub(crate) struct Materials {
    /// Names, sorted.
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
        let (names, rgb) = rgb.into_iter().unzip();
        Ok(Self { names, rgb, files })
    }

    /// Place of a name in the list.
    pub(crate) fn index(&self, name: &str) -> Result<usize> {
        match self.names.binary_search_by(|n| n.as_str().cmp(name)) {
            Ok(at) => Ok(at),
            Err(_) => bail!("there is no material {name}"),
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
        luminance_table(&self.rgb[at])
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
