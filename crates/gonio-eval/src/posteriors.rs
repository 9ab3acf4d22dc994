//! Posteriors of materials learnt from the training lights, trained once and then kept in the user's cache.

use std::path::Path;

use anyhow::{Context, Result};
use gonio::inference::amortised::{Amortised, Simulation, SimulationSettings, TrainingSettings};
use gonio::reflectance::{BivariateTable, Dictionary, DictionarySettings, LogBasis};
use gonio_io::cache::Cache;
use gonio_io::model::{decode_posterior, encode_posterior};

use crate::bench::Progress;
use crate::data::Lights;

/// Enters every key: to be raised whenever simulation or training gives other results for the same input.
const VERSION: u32 = 1;

/// Trains on materials in all lights, or finds the result of having done so.
pub(crate) fn load_or_train(
    cache: &Cache,
    materials: &[(String, BivariateTable)],
    lights: &Lights,
    settings: &SimulationSettings,
) -> Result<Amortised> {
    let (training, prior) = (TrainingSettings::default(), DictionarySettings::default());
    let key = key(materials, lights, &(settings, &training, prior.draws, prior.dimensions, prior.seed))?;
    let stored =
        cache.load(&key).and_then(|bytes| decode_posterior(Path::new("a posterior of the cache"), &bytes).ok());
    if let Some((found, _)) = stored {
        return Ok(found);
    }
    let dictionary = Dictionary::new(LogBasis::fit(materials, LogBasis::RANK), &prior);
    let mut simulation = Simulation::new(dictionary, *settings);
    let names = lights.names();
    let progress = Progress::new("simulating", names.len());
    for name in &names {
        simulation.add_light(&lights.tree(name)?);
        progress.step();
    }
    progress.finish();
    eprintln!("learning the posterior from {} simulated photographs", simulation.count());
    let amortised = simulation.train(&training, &|_| ());
    if let Err(error) = cache.store(&key, &encode_posterior(&amortised, "of the benchmark")) {
        eprintln!("the posterior could not be kept for next time: {error}");
    }
    Ok(amortised)
}

/// BLAKE3, in hexadecimal, of all that the result depends on.
fn key(materials: &[(String, BivariateTable)], lights: &Lights, settings: &impl serde::Serialize) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
    };
    part(format!("gonio posterior {VERSION}").as_bytes());
    part(&serde_json::to_vec(settings).context("settings of the simulation")?);
    for name in lights.names() {
        part(lights.fingerprint(&name)?.as_bytes());
    }
    for (name, table) in materials {
        part(name.as_bytes());
        part(&table.as_slice().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    }
    Ok(format!("posterior-{}", hasher.finalize().to_hex()))
}
