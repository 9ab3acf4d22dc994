//! Trains a posterior of materials on a pool of scenes.

use gonio::appearance::disk::{CHANNELS, DISK_SIDE};
use gonio::inference::learnt::{Candidates, LearntPosterior, interval_widths};
use gonio::reflectance::BivariateTable;
use gonio::simulation::ScenePool;
use rayon::prelude::*;

use crate::importance::log_importance;
use crate::{Checkpoint, InitialPosterior, Monitor, Photographs, TrainError, Trained, TrainingSettings, train};

/// Number of photographs that determine the ranges of features, at most as many as in the training.
const RANGED: usize = 2000;

/// Index of the first of these photographs, beyond those of the training.
const FIRST: u64 = 1 << 40;

/// Number of photographs over which a loss is averaged.
const TESTED: usize = 1024;

/// Losses of the trained encoder in nats: the negative logarithm of an image's likelihood under its
/// own material over its likelihood under any material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingLosses {
    /// Mean over the photographs of the last steps of the training.
    pub training: f64,
    /// Mean over photographs of new scenes in the same lights.
    pub new_scenes: f64,
    /// Mean over photographs in lights left out of the training, if there are any. The difference
    /// from `new_scenes` measures overfitting to the training lights.
    pub new_lights: Option<f64>,
}

/// Learns the posterior from photographs of a pool. `left_out` is a pool of lights for testing
/// only. `initial` and `start` are those of [`train`].
///
/// # Errors
/// If [`train`] fails.
pub fn learn(
    pool: &mut ScenePool,
    left_out: Option<ScenePool>,
    settings: &TrainingSettings,
    initial: Option<&LearntPosterior>,
    start: Option<Checkpoint>,
    monitor: &Monitor<'_>,
) -> Result<(LearntPosterior, TrainingLosses), TrainError> {
    let latent_space = pool.dictionary().latent_space.clone();
    let initial = initial.map(|posterior| InitialPosterior { posterior, latent_space: &latent_space });
    let (trained, losses) = train(&mut Photographs(pool), settings, initial.as_ref(), start, monitor)?;
    let recent = TESTED.div_ceil(settings.batch).min(settings.steps.div_ceil(10));
    let last = &losses[losses.len().saturating_sub(recent)..];
    let training = last.iter().map(|l| f64::from(*l)).sum::<f64>() / last.len().max(1) as f64;
    let test = |pool: &mut ScenePool| {
        pool.load_groups(Photographs::unused(settings.steps));
        trained.loss(&Photographs(pool), FIRST, TESTED.min(settings.steps * settings.batch))
    };
    let new_lights = left_out.map(|mut pool| test(&mut pool));
    let losses = TrainingLosses { training, new_scenes: test(pool), new_lights };
    Ok((posterior(pool, &trained, settings), losses))
}

/// Builds the posterior from the trained encoder, the measured materials and draws from the prior.
/// Also computes the usual ranges of features, and the widths of the prior's intervals.
fn posterior(pool: &ScenePool, trained: &Trained, settings: &TrainingSettings) -> LearntPosterior {
    let ranged = RANGED.min(settings.steps * settings.batch);
    let dictionary = pool.dictionary();
    let features: Vec<Vec<f32>> = (FIRST..FIRST + ranged as u64)
        .into_par_iter()
        .map(|number| {
            let image = pool.photograph(number).image;
            let mut channels = vec![0.0; DISK_SIDE * DISK_SIDE * CHANNELS];
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
    let candidates = |materials: Vec<Vec<f64>>| {
        let materials: Vec<Vec<f32>> = materials.iter().map(|p| p.iter().map(|z| *z as f32).collect()).collect();
        let embeddings = materials.par_iter().map(|coordinates| trained.embed(coordinates)).collect();
        Candidates::of_prior(materials, embeddings)
    };
    let drawn: Vec<Vec<f64>> = (FIRST..FIRST + settings.candidates as u64)
        .into_par_iter()
        .map(|number| pool.draw_coordinates(number))
        .collect();
    let log_importance = dictionary.latent_space.tables(&drawn).par_iter().map(log_importance).collect();
    let tables: Vec<BivariateTable> = dictionary.entries.par_iter().map(|entry| dictionary.table(entry)).collect();
    LearntPosterior {
        names: dictionary.measured.names.clone(),
        measured: candidates(dictionary.coordinates[..dictionary.measured.len()].to_vec()),
        prior: Candidates { log_importance, ..candidates(drawn) },
        latent_space: dictionary.latent_space.clone(),
        widths: interval_widths(&tables),
        ranges: (0..features[0].len()).map(range).collect(),
        encoder: trained.encoder.clone(),
        colours: None,
    }
}
