//! Renders and trained models, stored between runs.

use std::env;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A folder with one file per entry. The readers of entries reject damaged ones, which are then
/// computed again.
pub(crate) struct Cache(PathBuf);

impl Cache {
    /// Returns the cache in the folder in `GONIO_CACHE_DIR`, or else in `gonio-eval` in the folder
    /// of temporary files.
    pub(crate) fn open() -> Self {
        let folder = env::var_os("GONIO_CACHE_DIR").filter(|folder| !folder.is_empty());
        Self(folder.map_or_else(|| env::temp_dir().join("gonio-eval"), PathBuf::from))
    }

    /// Returns the cache in a folder, which is created when something is first stored.
    #[cfg(test)]
    pub(crate) fn at(folder: &std::path::Path) -> Self {
        Self(folder.to_owned())
    }

    /// Returns the content stored under a key, which is a hash with letters, digits and hyphens.
    pub(crate) fn load(&self, key: &str) -> Option<Vec<u8>> {
        fs::read(self.0.join(key)).ok()
    }

    /// Stores the content under a key, replacing an existing entry.
    pub(crate) fn store(&self, key: &str, content: &[u8]) -> Result<()> {
        fs::create_dir_all(&self.0).with_context(|| format!("{}: cannot create the cache", self.0.display()))?;
        Ok(gonio_io::atomic::write_file(self.0.join(key), content)?)
    }

    /// Returns the value stored under a key as JSON.
    pub(crate) fn load_json<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        serde_json::from_slice(&self.load(key)?).ok()
    }

    /// Stores a value under a key as JSON.
    pub(crate) fn store_json(&self, key: &str, value: &impl Serialize) -> Result<()> {
        self.store(key, &serde_json::to_vec(value)?)
    }
}
