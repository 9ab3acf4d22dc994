//! The folder of a run: its conditions and one file for every finished cell.
//!
//! The file of a cell is written completely and then renamed. A killed run therefore leaves no
//! partial cells, and several processes can fill one folder.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio_paper::PlanSettings;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::errors::{Record, Records, file};
use super::estimators::Estimator;
use super::grid::Protocol;
use super::options::Separable;
use crate::posteriors::Learning;

/// Conditions common to all cells of a folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Conditions {
    /// Version of the records.
    pub(crate) version: u32,
    /// Version of gonio.
    pub(crate) gonio: String,
    /// Grid and rows of the operator.
    pub(crate) plan: PlanSettings,
    /// Number of basis functions.
    pub(crate) rank: usize,
    /// Normals on the visible hemisphere.
    pub(crate) normals: usize,
    /// Starts of each method.
    pub(crate) starts: usize,
    /// Settings of the separable posterior and of the joint maximum.
    pub(crate) separable: Separable,
    /// Origin of the prior of light, if it is not that of the embedded model.
    pub(crate) prior: Option<String>,
    /// Settings for learning the posterior of materials.
    pub(crate) learning: Learning,
    /// Noise added to each channel of the photographs, relative to its mean.
    pub(crate) noise: f64,
    /// Lights that estimates are relit in.
    pub(crate) relight: Vec<String>,
    /// Lights that replace the photograph's own when relighting.
    pub(crate) spare: Vec<String>,
    /// Pixels along a side of the relit picture.
    pub(crate) size: usize,
}

/// Version of [`Record`] and of the meaning of its numbers.
pub(crate) const VERSION: u32 = 6;
const CONDITIONS: &str = "conditions.json";
const CELLS: &str = "cells";

/// A folder of results.
pub(crate) struct Store {
    dir: PathBuf,
}

impl Store {
    /// Opens a folder, or creates it.
    ///
    /// # Errors
    /// If the folder holds the results of other conditions. They are neither mixed nor overwritten.
    pub(crate) fn open(dir: &Path, conditions: &Conditions) -> Result<Self> {
        let path = dir.join(CONDITIONS);
        if path.exists() {
            // Convert to text and back, like the stored conditions, because numbers of single
            // precision have fewer digits in text.
            let here = serde_json::from_slice(&serde_json::to_vec(conditions)?)?;
            let differences = differences(&read_value(&path)?, &here, "");
            if !differences.is_empty() {
                bail!(
                    "{}: holds results of other conditions ({}); specify another folder with -o",
                    dir.display(),
                    differences.join(", ")
                );
            }
        } else {
            let occupied = std::fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_some());
            if occupied {
                bail!(
                    "{}: is not empty and holds no results of a benchmark; specify another folder with -o",
                    dir.display()
                );
            }
            std::fs::create_dir_all(dir).with_context(|| format!("{}: cannot create the folder", dir.display()))?;
            gonio_io::atomic::write_file(&path, &serde_json::to_vec_pretty(conditions)?)?;
        }
        Ok(Self { dir: dir.to_owned() })
    }

    /// Whether the cell is finished under this key.
    pub(crate) fn has(&self, protocol: Protocol, material: &str, light: &str, estimator: Estimator, key: &str) -> bool {
        let path = self.dir.join(CELLS).join(file(protocol, material, light, estimator));
        read_record(&path).is_some_and(|r| r.key == key)
    }

    /// Stores a finished cell.
    pub(crate) fn put(&self, record: &Record) -> Result<()> {
        let path = self.dir.join(CELLS).join(record.file());
        let folder = path.parent().expect("a file in a folder");
        std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot create the folder", folder.display()))?;
        Ok(gonio_io::atomic::write_file(&path, &serde_json::to_vec(record)?)?)
    }

    /// Reads all finished cells.
    pub(crate) fn records(&self) -> Result<Records> {
        let mut files = Vec::new();
        collect(&self.dir.join(CELLS), &mut files)?;
        let mut records = Records::new();
        for path in files {
            // A damaged file counts as absent; the next run computes its cell again.
            if let Some(r) = read_record(&path) {
                records.insert((r.protocol, r.material.clone(), r.light.clone(), r.estimator), r);
            }
        }
        Ok(records)
    }
}

fn read_value(path: &Path) -> Result<Value> {
    let bytes = std::fs::read(path).with_context(|| format!("{}: cannot read", path.display()))?;
    serde_json::from_slice(&bytes).with_context(|| format!("{}: is damaged", path.display()))
}

fn read_record(path: &Path) -> Option<Record> {
    serde_json::from_slice(&std::fs::read(path).ok()?).ok()
}

/// Collects the JSON files under a folder, which may be absent.
fn collect(dir: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    if !dir.is_dir() {
        return Ok(());
    }
    for entry in std::fs::read_dir(dir).with_context(|| format!("{}: cannot list", dir.display()))? {
        let path = entry.with_context(|| format!("{}: cannot list", dir.display()))?.path();
        if path.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "json") {
            files.push(path);
        }
    }
    Ok(())
}

/// Lists the leaves in which the JSON values of a folder (`there`) and of this run (`here`) differ.
fn differences(there: &Value, here: &Value, path: &str) -> Vec<String> {
    match (there, here) {
        (Value::Object(a), Value::Object(b)) => {
            let keys: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            let at = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
            let missing = Value::Null;
            let pairs = keys.into_iter().map(|k| (at(k), a.get(k).unwrap_or(&missing), b.get(k).unwrap_or(&missing)));
            pairs.flat_map(|(path, a, b)| differences(a, b, &path)).collect()
        }
        (a, b) if a == b => Vec::new(),
        (a, b) => vec![format!("{path} is {a} in the folder and {b} in this run")],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn conditions() -> Conditions {
        Conditions {
            version: VERSION,
            gonio: "0".into(),
            plan: PlanSettings::default(),
            rank: 10,
            normals: 100,
            starts: 1,
            separable: Separable::default(),
            prior: None,
            learning: Learning::default(),
            noise: 0.0,
            relight: vec!["a".into()],
            spare: vec![],
            size: 32,
        }
    }

    fn record(key: &str) -> Record {
        Record {
            key: key.into(),
            protocol: Protocol::LeaveOut,
            material: "chrome".into(),
            light: "grace".into(),
            estimator: Estimator::Lambertian,
            full_table: true,
            relight: Vec::new(),
            brdf: None,
            gloss: None,
            coverage: None,
            left_over: 0.0,
            seconds: 0.5,
            report: Default::default(),
            failure: Some("none".into()),
            photograph: String::new(),
            picture: String::new(),
        }
    }

    #[test]
    fn cells_are_found_only_under_their_key() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path(), &conditions()).unwrap();
        let has = |store: &Store, key| store.has(Protocol::LeaveOut, "chrome", "grace", Estimator::Lambertian, key);
        assert!(!has(&store, "k"));
        store.put(&record("k")).unwrap();
        let again = Store::open(dir.path(), &conditions()).unwrap();
        assert!(has(&again, "k") && !has(&again, "other"));
        assert_eq!(again.records().unwrap().len(), 1);
    }

    #[test]
    fn truncated_records_are_ignored() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path(), &conditions()).unwrap();
        store.put(&record("k")).unwrap();
        let path = dir.path().join(CELLS).join(record("k").file());
        let bytes = std::fs::read(&path).unwrap();
        for cut in 0..bytes.len() {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            assert!(!store.has(Protocol::LeaveOut, "chrome", "grace", Estimator::Lambertian, "k"), "{cut}");
        }
        assert!(store.records().unwrap().is_empty());
    }

    #[test]
    fn rejects_other_conditions_and_names_them() {
        let dir = tempfile::tempdir().unwrap();
        Store::open(dir.path(), &conditions()).unwrap();
        let mut other = conditions();
        other.plan.transfer.side = 64;
        other.noise = 0.01;
        let message = Store::open(dir.path(), &other).err().unwrap().to_string();
        assert!(
            message.contains("plan.transfer.side is 32 in the folder and 64 in this run") && message.contains("noise"),
            "{message}"
        );
        let foreign = tempfile::tempdir().unwrap();
        std::fs::write(foreign.path().join("letter.txt"), "dear").unwrap();
        assert!(Store::open(foreign.path(), &conditions()).is_err());
    }
}
