//! Trains a posterior of materials on a stock of scenes.

use gonio::appearance::disk::{CHANNELS, SIDE};
use gonio::inference::learnt::{Candidates, LearntPosterior, interval_widths};
use gonio::reflectance::BivariateTable;
use gonio::simulation::Stock;
use rayon::prelude::*;

use crate::{Photographs, TrainError, Trained, TrainingSettings, train};

/// Number of photographs that the ranges of features are taken from, at most as many as the
/// training saw.
const RANGED: usize = 2000;

/// Index of the first of these photographs, beyond those of the training.
const FIRST: u64 = 1 << 40;

/// Number of materials that represent the prior. A quarter of them would be enough for most
/// photographs, but would leave only a handful to the most certain posteriors (`docs/trials.md`).
const CANDIDATES: u64 = 8192;

/// Learns the posterior from photographs of a stock. `progress` is called with the share done, in
/// 0..=1, and the loss in nats.
///
/// # Errors
/// If a setting is out of range or the training diverges.
///
/// # Panics
/// If the stock has no scenes.
pub fn learn(
    stock: &Stock,
    settings: &TrainingSettings,
    progress: &(dyn Fn(f64, f64) + Sync),
) -> Result<LearntPosterior, TrainError> {
    let trained = train(&Photographs(stock), settings, progress)?;
    Ok(posterior(stock, trained, RANGED.min(settings.steps * settings.batch)))
}

/// Builds the posterior from the trained encoder and what goes with it: the measured materials,
/// draws from the prior, the usual ranges of features over `ranged` photographs, and the widths of
/// the prior's intervals.
fn posterior(stock: &Stock, trained: Trained, ranged: usize) -> LearntPosterior {
    let dictionary = stock.dictionary();
    let features: Vec<Vec<f32>> = (FIRST..FIRST + ranged as u64)
        .into_par_iter()
        .map(|number| {
            let image = stock.photograph(number).image;
            let mut channels = vec![0.0; SIDE * SIDE * CHANNELS];
            let globals = image.write(&mut channels);
            trained.encoder.apply(&channels, &globals).1
        })
        .collect();
    let range = |feature: usize| {
        let mut values: Vec<f32> = features.iter().map(|f| f[feature]).collect();
        values.sort_by(f32::total_cmp);
        let out = values.len() / 1000;
        (values[out], values[values.len() - 1 - out])
    };
    let candidates = |places: Vec<Vec<f64>>| {
        let places: Vec<Vec<f32>> = places.iter().map(|p| p.iter().map(|z| *z as f32).collect()).collect();
        Candidates { embeddings: places.par_iter().map(|place| trained.embed(place)).collect(), places }
    };
    let drawn = (FIRST..FIRST + CANDIDATES).into_par_iter().map(|number| stock.place(number)).collect();
    let tables: Vec<BivariateTable> = dictionary.entries.par_iter().map(|entry| dictionary.table(entry)).collect();
    LearntPosterior {
        names: dictionary.measured.names.clone(),
        measured: candidates(dictionary.places[..dictionary.measured.len()].to_vec()),
        prior: candidates(drawn),
        coordinates: dictionary.coordinates.clone(),
        widths: interval_widths(&tables),
        ranges: (0..features[0].len()).map(range).collect(),
        encoder: trained.encoder,
        colours: None,
    }
}
