//! Posteriors of materials learnt from the training lights, trained once and then kept in the user's cache.

use std::path::Path;

use anyhow::Result;
use gonio::inference::amortised::{Amortised, Simulation, SimulationSettings, TrainingSettings};
use gonio::reflectance::{BivariateTable, Dictionary, DictionarySettings, LogBasis};
use gonio_io::cache::Cache;
use gonio_io::model::{decode_posterior, encode_posterior};

use crate::bases::key;
use crate::bench::Progress;
use crate::data::Lights;

/// Enters every key: to be raised whenever simulation or training gives other results for the same input.
const VERSION: u32 = 2;

/// Trains on materials in all lights, or finds the result of having done so.
pub(crate) fn load_or_train(
    cache: &Cache,
    materials: &[(String, BivariateTable)],
    lights: &Lights,
    settings: &SimulationSettings,
) -> Result<Amortised> {
    let (training, prior) = (TrainingSettings::default(), DictionarySettings::default());
    let seen = lights.names().iter().map(|name| lights.fingerprint(name)).collect::<Result<Vec<String>>>()?;
    let conditions = (settings, &training, &prior, seen);
    let key = key(&format!("gonio posterior {VERSION}"), &conditions, materials)?;
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
