//! Location and reading of the data.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::render::{LightTree, Relighter};
use gonio::shape::SurfacePoint;

use crate::bench::ACCURACY;

/// Option for the model of a measurement.
#[derive(clap::Args)]
pub(crate) struct ModelOption {
    /// Model to use instead of the embedded one
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

impl ModelOption {
    /// Reads the model.
    pub(crate) fn read(&self) -> Result<Model> {
        Ok(match &self.model {
            Some(path) => gonio_io::model::read_model(path)?,
            None => gonio_io::model::embedded()?,
        })
    }
}

/// Reads an environment map.
pub(crate) fn read_map(path: &Path) -> Result<EnvironmentMap> {
    let decoded = gonio_io::picture::read(path, &gonio_io::picture::ReadOptions::default())?;
    EnvironmentMap::new(decoded.picture.rgb).with_context(|| path.display().to_string())
}

/// Captured lights of the data by name.
pub(crate) struct Lights {
    files: BTreeMap<String, PathBuf>,
}

impl Lights {
    /// Opens the test lights of the data.
    pub(crate) fn open(data: &Path) -> Result<Self> {
        Self::of(&data.join("lighting/test"))
    }

    /// Opens the training lights, which priors are learnt from.
    pub(crate) fn training(data: &Path) -> Result<Self> {
        Self::of(&data.join("lighting/train"))
    }

    fn of(folder: &Path) -> Result<Self> {
        let paths = gonio_io::folder::files(folder, &["hdr", "exr", "pfm"])
            .context("cannot list the lights; specify the data folder with --data")?;
        let stem = |path: PathBuf| path.file_stem().and_then(|s| s.to_str()).map(str::to_owned).zip(Some(path.clone()));
        let files: BTreeMap<String, PathBuf> = paths.into_iter().filter_map(stem).collect();
        if files.is_empty() {
            bail!("{}: no .hdr, .exr or .pfm files here", folder.display());
        }
        Ok(Self { files })
    }

    /// All names, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        self.files.keys().cloned().collect()
    }

    fn file(&self, name: &str) -> Result<&Path> {
        match self.files.get(name) {
            Some(path) => Ok(path),
            None => bail!("there is no light {name}"),
        }
    }

    /// Hash of the light's file.
    pub(crate) fn fingerprint(&self, name: &str) -> Result<String> {
        let path = self.file(name)?;
        let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
        Ok(blake3::hash(&bytes).to_hex().to_string())
    }

    /// The light at full resolution.
    pub(crate) fn map(&self, name: &str) -> Result<EnvironmentMap> {
        read_map(self.file(name)?)
    }

    /// The light as a tree, to render in.
    pub(crate) fn tree(&self, name: &str) -> Result<LightTree> {
        Ok(LightTree::of_map(&self.map(name)?))
    }

    /// Operators that relight points of these materials in lights, accurate to [`ACCURACY`].
    pub(crate) fn relighters(
        &self,
        names: &[String],
        points: &[SurfacePoint],
        tables: &[BivariateTable],
    ) -> Result<Vec<Relighter>> {
        names.iter().map(|name| Ok(Relighter::new(points, tables, &self.tree(name)?, &ACCURACY))).collect()
    }
}
