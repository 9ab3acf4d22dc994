//! Bases of reflectance of several ranks, trained once and then kept in the cache.

use anyhow::{Context, Result};
use gonio::reflectance::{BivariateTable, ReflectanceBasis};
use gonio_paper::training::{TrainReport, TrainSettings, train};
use serde::{Deserialize, Serialize};

use crate::cache::Cache;

/// Version of the training, part of every cache key. Raise it when training gives different results
/// for the same input.
const VERSION: u32 = 1;

/// A basis and the report of its training.
#[derive(Serialize, Deserialize)]
pub(crate) struct Trained {
    pub(crate) basis: ReflectanceBasis,
    pub(crate) report: TrainReport,
}

impl Trained {
    /// Trains on the materials, or loads the basis from the cache if it was trained before.
    pub(crate) fn load_or_train(
        cache: &Cache,
        materials: &[(String, BivariateTable)],
        settings: &TrainSettings,
    ) -> Result<Self> {
        let key = key(&what(), settings, materials)?;
        let rank = settings.nmf.rank;
        let stored: Option<Self> = cache.load_json(&key);
        // Guards against bytes that were stored under a wrong name by hand.
        if let Some(found) = stored.filter(|t| t.basis.len() == rank && t.report.fits.len() == materials.len()) {
            return Ok(found);
        }
        let (basis, report) = train(materials, settings).with_context(|| format!("basis of rank {rank}"))?;
        let trained = Self { basis, report };
        cache.store_json(&key, &trained)?;
        Ok(trained)
    }
}

fn what() -> String {
    format!("gonio basis {VERSION}")
}

/// Returns the BLAKE3 hash, in hexadecimal, of everything that determines a result learnt from
/// materials: `what` (its kind and version), the settings of the training, and the materials.
pub(crate) fn key(what: &str, settings: &impl Serialize, materials: &[(String, BivariateTable)]) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    // Each part follows its length, so that bytes cannot move from one part to the next.
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
    };
    part(what.as_bytes());
    part(&serde_json::to_vec(settings).context("settings of the training")?);
    for (name, table) in materials {
        part(name.as_bytes());
        part(&table.as_slice().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    }
    Ok(hasher.finalize().to_hex().to_string())
}

#[cfg(test)]
mod tests {
    use gonio_paper::nmf::NmfSettings;

    use super::*;

    #[test]
    fn trained_bases_load_from_the_cache() {
        let lobe = |s: f64| BivariateTable::from_fn(move |h, d| 0.1 + s * (-(h / 0.2).powi(2)).exp() + 0.1 * s * s * d);
        let materials: Vec<(String, BivariateTable)> = (1..6).map(|i| (format!("m{i}"), lobe(f64::from(i)))).collect();
        let nmf = NmfSettings { rank: 2, starts: 2, max_iterations: 50, ..NmfSettings::default() };
        let settings = TrainSettings { nmf, ..TrainSettings::default() };
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::at(dir.path());
        let first = Trained::load_or_train(&cache, &materials, &settings).unwrap();
        let stored = cache.load(&key(&what(), &settings, &materials).unwrap()).unwrap();
        let again = Trained::load_or_train(&cache, &materials, &settings).unwrap();
        assert_eq!((first.basis, first.report), (again.basis, again.report));
        assert!(!stored.is_empty());
        // A different margin or different materials give a different key.
        let other = TrainSettings { cost_margin: 0.0, ..settings.clone() };
        assert_ne!(key(&what(), &settings, &materials).unwrap(), key(&what(), &other, &materials).unwrap());
        assert_ne!(key(&what(), &settings, &materials).unwrap(), key(&what(), &settings, &materials[..4]).unwrap());
    }
}
