//! Measured materials: the full tables from which inputs are rendered, and the bivariate tables for
//! everything else.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::reflectance::parametric::full_table;
use gonio::reflectance::{BivariateTable, MerlTable};
use rayon::prelude::*;

use crate::out_of_domain::{self, Formula};

/// A database of materials in the order of their file names: a folder of `.binary` files of the
/// MERL database, or of bivariate tables, or both. [Materials of other kinds](out_of_domain) follow
/// the database on request.
pub(crate) struct Materials {
    /// Names in the order of the files `NAME.binary` in a listing of the database (`chrome-steel`
    /// before `chrome`), then those outside of the database.
    pub(crate) names: Vec<String>,
    rgb: Vec<[BivariateTable; 3]>,
    origins: Vec<Origin>,
    /// Number of materials in the database.
    database: usize,
}

/// Origin of the table over all three angles.
enum Origin {
    /// A file of the MERL database.
    Merl(PathBuf),
    /// No full table, only the bivariate one.
    Bivariate,
    /// A file of the RGL database.
    Rgl(PathBuf),
    /// A formula.
    Formula(Box<dyn Formula>),
}

impl Origin {
    fn full(&self, rgb: &[BivariateTable; 3]) -> Result<MerlTable> {
        Ok(match self {
            Self::Merl(path) => gonio_io::merl::read(path)?,
            Self::Bivariate => MerlTable::from_bivariate(rgb.each_ref()),
            Self::Rgl(path) => gonio_io::rgl::read(path)?.to_merl(),
            Self::Formula(formula) => full_table(|wi, wo| [formula.eval(wi, wo); 3]),
        })
    }
}

/// Table that a picture of a material was rendered from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// The table over all three angles.
    Full,
    /// The bivariate table, because no full table exists.
    Bivariate,
}

impl Materials {
    /// Opens the folder `full`, by default `DATA/merl`. Materials without a full table are taken
    /// from the bivariate set of `DATA/merl`. Full tables without a bivariate table are reduced to
    /// one.
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
                Ok(((*name).clone(), table.to_bivariate()))
            })
            .collect::<Result<_>>()?;
        rgb.extend(reduced);
        if rgb.is_empty() {
            bail!(
                "{}: no materials here; specify the data folder (with merl/) with --data, or a folder of .binary files \
                 with --merl",
                folder.display()
            );
        }
        let mut all: Vec<(String, [BivariateTable; 3])> = rgb.into_iter().collect();
        all.sort_by_cached_key(|(name, _)| file_name(name));
        let (names, rgb): (Vec<String>, _) = all.into_iter().unzip();
        let origin = |name| files.get(name).map_or(Origin::Bivariate, |path| Origin::Merl(path.clone()));
        let origins = names.iter().map(origin).collect();
        Ok(Self { database: names.len(), names, rgb, origins })
    }

    /// Adds the materials outside of the database: the files of `DATA/rgl`, if there are any, and
    /// the formulas.
    pub(crate) fn with_out_of_domain(mut self, data: &Path) -> Result<Self> {
        for (name, path) in out_of_domain::rgl_files(&data.join("rgl"))? {
            let table = gonio_io::rgl::read(&path)?.to_merl();
            self.add(name, table.to_bivariate(), Origin::Rgl(path))?;
        }
        for (name, formula) in out_of_domain::formulas() {
            let table = formula.to_bivariate();
            self.add(name.to_owned(), [table.clone(), table.clone(), table], Origin::Formula(formula))?;
        }
        Ok(self)
    }

    fn add(&mut self, name: String, rgb: [BivariateTable; 3], origin: Origin) -> Result<()> {
        if self.names.contains(&name) {
            bail!("there are two materials {name}");
        }
        self.names.push(name);
        self.rgb.push(rgb);
        self.origins.push(origin);
        Ok(())
    }

    /// Index of the material of this name.
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

    /// Green channel over half and difference angle, from which bases are learnt.
    pub(crate) fn green(&self, at: usize) -> &BivariateTable {
        &self.rgb[at][1]
    }

    /// Luminance over half and difference angle, with which estimates are compared.
    pub(crate) fn luminance(&self, at: usize) -> BivariateTable {
        BivariateTable::luminance(&self.rgb[at])
    }

    /// Name and luminance of materials, extrapolated beyond the trusted cells as in the training.
    pub(crate) fn extrapolated(&self, materials: impl IntoIterator<Item = usize>) -> Vec<(String, BivariateTable)> {
        let named = |at: usize| {
            let mut table = self.luminance(at);
            table.extend_from_trusted();
            (self.names[at].clone(), table)
        };
        materials.into_iter().map(named).collect()
    }

    /// Kind of the table that [`Self::full`] returns for a material.
    pub(crate) fn source(&self, at: usize) -> Source {
        if matches!(self.origins[at], Origin::Bivariate) { Source::Bivariate } else { Source::Full }
    }

    /// The table to render: the full one, or else the bivariate one spread over `phi_d`.
    pub(crate) fn full(&self, at: usize) -> Result<MerlTable> {
        self.origins[at].full(&self.rgb[at])
    }

    /// Hash that changes whenever the table of [`Self::full`] does.
    pub(crate) fn fingerprint(&self, at: usize) -> Result<String> {
        let mut hasher = blake3::Hasher::new();
        match &self.origins[at] {
            Origin::Merl(path) => hash_file(&mut hasher, path)?,
            Origin::Bivariate => {
                for value in self.rgb[at].iter().flat_map(BivariateTable::as_slice) {
                    hasher.update(&value.to_le_bytes());
                }
            }
            Origin::Rgl(path) => {
                hasher.update(format!("rgl {}", out_of_domain::VERSION).as_bytes());
                hash_file(&mut hasher, path)?;
            }
            // Hashes the parameters, not the values: processors round differently.
            Origin::Formula(formula) => {
                hasher.update(format!("formula {} {formula:?}", out_of_domain::VERSION).as_bytes());
            }
        }
        Ok(hasher.finalize().to_hex().to_string())
    }

    /// The materials of the database.
    pub(crate) fn database(&self) -> Range<usize> {
        0..self.database
    }

    /// The materials outside of the database.
    pub(crate) fn out_of_domain(&self) -> Range<usize> {
        self.database..self.names.len()
    }

    /// Every fifth material of the database, starting with the third: those that the leave-out
    /// protocol does not learn from.
    pub(crate) fn held_out(&self) -> Vec<usize> {
        self.database().filter(|i| i % 5 == 2).collect()
    }
}

fn hash_file(hasher: &mut blake3::Hasher, path: &Path) -> Result<()> {
    let file = std::fs::File::open(path).with_context(|| format!("{}: cannot open", path.display()))?;
    hasher.update_reader(file).with_context(|| format!("{}: cannot read", path.display()))?;
    Ok(())
}

/// Name of the file of a material in the database.
fn file_name(material: &str) -> String {
    format!("{material}.binary")
}

#[cfg(test)]
mod tests {
    use gonio::reflectance::{CELLS, THETA_D, THETA_H};

    use super::*;

    /// A database of grey materials of these names.
    fn database(names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        let merl = dir.path().join("merl");
        std::fs::create_dir(&merl).unwrap();
        std::fs::write(merl.join("materials.txt"), names.join("\n")).unwrap();
        let shape = vec![names.len(), THETA_H, THETA_D, 3];
        let array = gonio_io::npy::Array { shape, values: vec![0.5; 3 * names.len() * CELLS] };
        std::fs::write(merl.join("bivariate_rgb_f32.npy"), gonio_io::npy::encode(&array)).unwrap();
        dir
    }

    #[test]
    fn materials_are_in_the_order_of_their_files() {
        let dir = database(&["chrome", "brass", "chrome-steel"]);
        let materials = Materials::open(dir.path(), None).unwrap();
        assert_eq!(materials.names, ["brass", "chrome-steel", "chrome"]);
        assert_eq!(materials.index("chrome").unwrap(), 2);
        // The third of five.
        assert_eq!(materials.held_out(), [2]);
        assert!(materials.index("kryptonite").is_err());
    }

    #[test]
    fn materials_outside_come_after_the_database() {
        let dir = database(&["brass", "zinc"]);
        let materials = Materials::open(dir.path(), None).unwrap();
        assert!(materials.out_of_domain().is_empty());
        let materials = materials.with_out_of_domain(dir.path()).unwrap();
        assert_eq!(materials.database(), 0..2);
        assert_eq!(materials.out_of_domain().len(), out_of_domain::formulas().len());
        let plaster = materials.index("plaster").unwrap();
        assert_eq!(materials.out_of_domain().start, plaster);
        assert_eq!(materials.source(plaster), Source::Full);
        assert_eq!(materials.source(0), Source::Bivariate);
        let reduced = materials.full(plaster).unwrap().bivariate(1);
        let mut cells = reduced.as_slice().iter().zip(materials.green(plaster).as_slice());
        assert!(cells.all(|(a, b)| (a / b - 1.0).abs() < 1e-4));
        assert_ne!(materials.fingerprint(plaster).unwrap(), materials.fingerprint(plaster + 1).unwrap());
        // A file that is not a measurement is an error.
        std::fs::create_dir(dir.path().join("rgl")).unwrap();
        std::fs::write(dir.path().join("rgl/paint_rgb.bsdf"), "paint").unwrap();
        assert!(Materials::open(dir.path(), None).unwrap().with_out_of_domain(dir.path()).is_err());
    }
}
