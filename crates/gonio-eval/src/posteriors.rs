//! Posteriors of materials learnt from the training lights, trained once and then kept in the
//! user's cache.

use std::path::Path;

use anyhow::{Context, Result};
use clap::builder::RangedU64ValueParser;
use glam::{DQuat, DVec3};
use gonio::appearance::{DiskImage, Sample};
use gonio::colour::ColourModel;
use gonio::inference::learnt::LearntPosterior;
use gonio::reflectance::{BivariateTable, Dictionary, DictionarySettings, LogBasis};
use gonio::scene::{ObservationSettings, sphere_points};
use gonio::shape::SurfacePoint;
use gonio::simulation::{ColourPool, ScenePool, ScenePoolSettings};
use gonio_io::model::{decode_posterior, encode_posterior};
use gonio_train::{Monitor, TrainingSettings};
use serde::{Deserialize, Serialize};

use crate::bases::key;
use crate::bench::Progress;
use crate::cache::Cache;
use crate::data::Lights;

/// Version of simulation and training, part of every cache key. Raise it when either gives
/// different results for the same input.
const VERSION: u32 = 9;

/// Number of normals on the visible hemisphere in photographs that only the posterior uses. The
/// smallest training photographs, of balls with a radius of some 40 pixels, have as many.
const NORMALS: usize = 6_000;

/// Settings for learning a posterior.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Learning {
    /// The dictionary of materials.
    pub(crate) dictionary: DictionarySettings,
    /// The pool of their photographs.
    pub(crate) pool: ScenePoolSettings,
    /// The training of the encoder.
    pub(crate) training: TrainingSettings,
}

/// Effort of learning a posterior.
#[derive(clap::Args)]
pub(crate) struct Effort {
    /// Views of the training lights in each group of scenes that the posterior is learnt from
    #[arg(long, default_value_t = ScenePoolSettings::default().views, value_parser = some())]
    views: usize,
    /// Materials in each group of scenes
    #[arg(long, default_value_t = ScenePoolSettings::default().group_materials, value_parser = some())]
    group_materials: usize,
    /// Steps of the training
    #[arg(long, default_value_t = TrainingSettings::default().steps, value_parser = some())]
    steps: usize,
    /// Photographs in each step of the training
    #[arg(long, default_value_t = TrainingSettings::default().batch, value_parser = some())]
    batch: usize,
    /// Materials drawn for the dictionary
    #[arg(long, default_value_t = DictionarySettings::default().draws, value_parser = some())]
    entries: usize,
    /// Coordinates of materials
    #[arg(long, default_value_t = DictionarySettings::default().dimensions, value_parser = some())]
    dimensions: usize,
    /// Materials that represent the prior in the posterior
    #[arg(long, default_value_t = TrainingSettings::default().candidates, value_parser = some())]
    candidates: usize,
}

fn some() -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(1..)
}

impl Effort {
    /// Returns the default settings with this effort.
    pub(crate) fn learning(&self) -> Learning {
        Learning {
            dictionary: DictionarySettings {
                draws: self.entries,
                dimensions: self.dimensions,
                ..DictionarySettings::default()
            },
            pool: ScenePoolSettings {
                groups: ScenePoolSettings::groups_for(self.steps),
                views: self.views,
                group_materials: self.group_materials,
                ..ScenePoolSettings::default()
            },
            training: TrainingSettings {
                steps: self.steps,
                batch: self.batch,
                candidates: self.candidates,
                ..TrainingSettings::default()
            },
        }
    }
}

/// Trains on materials in the lights of these names, or loads the posterior from the cache if it
/// was trained before.
pub(crate) fn load_or_train(
    cache: &Cache,
    materials: &[(String, BivariateTable)],
    lights: &Lights,
    names: &[impl AsRef<str>],
    learning: &Learning,
) -> Result<LearntPosterior> {
    let seen = names.iter().map(|name| lights.fingerprint(name.as_ref())).collect::<Result<Vec<String>>>()?;
    let key = key(&format!("gonio posterior {VERSION}"), &(learning, seen), materials)?;
    let stored =
        cache.load(&key).and_then(|bytes| decode_posterior(Path::new("a posterior of the cache"), &bytes).ok());
    if let Some((found, _)) = stored {
        return Ok(found);
    }
    let learnt = train(materials, lights, names, learning)?;
    cache.store(&key, &encode_posterior(&learnt, "of the benchmark"))?;
    Ok(learnt)
}

fn train(
    materials: &[(String, BivariateTable)],
    lights: &Lights,
    names: &[impl AsRef<str>],
    learning: &Learning,
) -> Result<LearntPosterior> {
    let dictionary = Dictionary::new(LogBasis::fit(materials, LogBasis::RANK), &learning.dictionary);
    let maps = names.iter().map(|name| lights.map(name.as_ref())).collect::<Result<_>>()?;
    let mut pool = ScenePool::new(dictionary, maps, learning.pool);
    let progress = Progress::new("steps", learning.training.steps);
    let step = |_: f64, _: f64| progress.step();
    let (learnt, _) = gonio_train::learn(&mut pool, None, &learning.training, None, None, &Monitor::new(&step))?;
    progress.finish();
    Ok(learnt)
}

/// Version of the learning of colours, part of the key in the cache.
const COLOUR_VERSION: u32 = 1;

/// Learns the model of colours from the channels of materials in every `stride`-th light, or loads
/// it from the cache.
pub(crate) fn colours(
    cache: &Cache,
    learnt: &LearntPosterior,
    mut materials: Vec<[BivariateTable; 3]>,
    lights: &Lights,
    stride: usize,
) -> Result<ColourModel> {
    materials.iter_mut().flatten().for_each(BivariateTable::extend_from_trusted);
    let names: Vec<String> = lights.names().into_iter().step_by(stride).collect();
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("colours {COLOUR_VERSION} {}", learnt.id()).as_bytes());
    for value in materials.iter().flatten().flat_map(BivariateTable::as_slice) {
        hasher.update(&value.to_le_bytes());
    }
    for name in &names {
        hasher.update(lights.fingerprint(name)?.as_bytes());
    }
    let key = format!("colours-{}", hasher.finalize().to_hex());
    if let Some(found) = cache.load_json(&key) {
        return Ok(found);
    }
    let mut pool = ColourPool::new(learnt, materials);
    let progress = Progress::new("learning colours", names.len());
    for name in &names {
        pool.add_light(&lights.map(name)?);
        progress.step();
    }
    progress.finish();
    let found = pool.learn();
    cache.store_json(&key, &found)?;
    Ok(found)
}

/// Returns a dictionary of these materials for drawing, not for learning.
pub(crate) fn kinds_of(materials: &[(String, BivariateTable)]) -> Dictionary {
    let least = DictionarySettings { draws: 1, dimensions: 1, ..DictionarySettings::default() };
    Dictionary::new(LogBasis::fit(materials, LogBasis::RANK), &least)
}

/// Points of a ball at which a photograph for the posterior is rendered, seen from `+z` of the
/// frame that `camera` rotates to.
pub(crate) fn ball(camera: DQuat) -> Vec<SurfacePoint> {
    let points = sphere_points(&ObservationSettings { normals: NORMALS, ..ObservationSettings::default() });
    points.iter().map(|p| SurfacePoint { normal: camera * p.normal, view: camera * DVec3::Z }).collect()
}

/// Gathers the values observed at points into the input image of a posterior.
pub(crate) fn on_disk(points: &[SurfacePoint], values: impl IntoIterator<Item = Option<f64>>) -> Result<DiskImage> {
    let seen = points.iter().zip(values);
    let samples: Vec<Sample> = seen.filter_map(|(p, v)| v.map(|v| Sample::of(p.in_view(), v, 1.0))).collect();
    DiskImage::gather(&samples).context("the photograph has no observed points")
}
