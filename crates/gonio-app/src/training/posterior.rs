//! Training of the posterior of materials, with checkpoints.

use std::cell::Cell;
use std::path::Path;
use std::time::{Duration, Instant};

use gonio::inference::learnt::LearntPosterior;
use gonio::model::Model;
use gonio::reflectance::{Dictionary, DictionarySettings, LogBasis};
use gonio::simulation::{ScenePool, ScenePoolSettings};
use gonio_io::model::{decode_arrays, encode_arrays};
use gonio_train::{Checkpoint, Monitor, TrainingLosses, TrainingSettings, learn};

use super::{Channel, Lights, Materials, POSTERIOR, Progress, TrainingError, colours, provenance_of};

/// Settings for training the posterior of materials.
#[derive(Clone, Debug)]
pub struct PosteriorSettings {
    /// Channel of the measured BRDFs.
    pub channel: Channel,
    /// Number of views of lights in each group of simulated scenes.
    pub views: usize,
    /// Number of materials in each group.
    pub group_materials: usize,
    /// Number of training steps, each on 128 simulated photographs.
    pub steps: usize,
    /// Interval `n` of the lights that are left out: every n-th light is only tested with. `None`
    /// trains on all lights.
    pub leave_out: Option<usize>,
    /// Posterior whose network initialises the training, and the note on its origin; `None` begins
    /// with random weights.
    pub initial: Option<(LearntPosterior, String)>,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for PosteriorSettings {
    fn default() -> Self {
        let (pool, training) = (ScenePoolSettings::default(), TrainingSettings::default());
        let (views, group_materials, steps) = (pool.views, pool.group_materials, training.steps);
        Self { channel: Channel::Luminance, views, group_materials, steps, leave_out: None, initial: None, seed: 1 }
    }
}

/// Checkpoint to resume from, and the callback that stores new checkpoints.
pub struct Resumption<'a> {
    /// Checkpoint to continue from: the file's bytes, and its path for messages.
    pub start: Option<(&'a Path, Vec<u8>)>,
    /// Called every few minutes with the bytes of a checkpoint.
    pub keep: &'a dyn Fn(Vec<u8>),
}

/// Interval between checkpoints.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(300);

/// Factor of the learning rate in a training that begins with a trained network: larger steps undo
/// the earlier training (`docs/trials.md`).
const INITIAL_RATE_FACTOR: f64 = 0.1;

/// Rows to which larger environment maps are reduced: finer than any cell of the disk of normals.
const LIGHT_ROWS: usize = 512;

/// Trains the posterior of materials on lights and materials.
///
/// # Errors
/// If there are no lights or no materials, one cannot be read, or the checkpoint is damaged or from
/// other settings.
pub fn posterior(
    lights: &Lights,
    materials: &[Materials],
    settings: &PosteriorSettings,
    resumption: Resumption<'_>,
    progress: Progress<'_>,
) -> Result<(LearntPosterior, TrainingLosses, String), TrainingError> {
    let PosteriorSettings { channel, views, group_materials, steps, leave_out, ref initial, seed } = *settings;
    for (name, value) in [("views", views), ("group_materials", group_materials), ("steps", steps)] {
        if value == 0 {
            return Err(TrainingError::Setting(format!("{name} 0: must be at least 1")));
        }
    }
    if leave_out.is_some_and(|every| every < 2) {
        return Err(TrainingError::Setting("leave-out: must be at least 2".into()));
    }
    let mut tables = Vec::new();
    for some in materials {
        tables.extend(some.channel(channel, progress)?);
    }
    if tables.is_empty() {
        let names: Vec<String> = materials.iter().map(Materials::name).collect();
        return Err(TrainingError::Data(names.join(", "), "contains no materials".into()));
    }
    let (mut maps, mut tested) = (Vec::new(), Vec::new());
    lights.each(&mut |share, light| {
        let index = maps.len() + tested.len();
        let out = leave_out.is_some_and(|every| index % every == every - 1);
        let map = light.reduced(LIGHT_ROWS);
        if out { &mut tested } else { &mut maps }.push(map);
        progress("reading lights", share);
    })?;
    progress("learning materials", 0.0);
    let basis = LogBasis::fit(&tables, LogBasis::RANK);
    let dictionary_settings = DictionarySettings { seed, ..DictionarySettings::default() };
    let dictionary = Dictionary::new(basis, &dictionary_settings);
    let pool_settings = ScenePoolSettings {
        groups: ScenePoolSettings::groups_for(steps),
        views,
        group_materials,
        seed,
        ..ScenePoolSettings::default()
    };
    let count = maps.len();
    let left_out = (!tested.is_empty()).then(|| ScenePool::new(dictionary.clone(), tested, pool_settings));
    let mut pool = ScenePool::new(dictionary, maps, pool_settings);
    let mut training = TrainingSettings { steps, seed, ..TrainingSettings::default() };
    if initial.is_some() {
        training.learning_rate *= INITIAL_RATE_FACTOR;
    }
    let origin = initial.as_ref().map_or_else(String::new, |(_, note)| format!(", from the network of: {note}"));
    let note = format!(
        "{channel:?} of {} materials, {count} lights, {dictionary_settings:?}, {pool_settings:?}, {training:?}{}",
        tables.len(),
        origin,
    );
    let start = match &resumption.start {
        Some((path, bytes)) => {
            let (made_with, checkpoint) = decode_checkpoint(path, bytes)?;
            if made_with != note {
                let problem = "belongs to a training run with other settings; use the same settings or start a new run";
                return Err(TrainingError::Data(path.display().to_string(), problem.into()));
            }
            Some(checkpoint)
        }
        None => None,
    };
    let last = Cell::new(Instant::now());
    let keep = |checkpoint: &dyn Fn() -> Checkpoint| {
        if last.get().elapsed() >= CHECKPOINT_INTERVAL {
            (resumption.keep)(encode_checkpoint(&checkpoint(), &note));
            last.set(Instant::now());
        }
    };
    let monitor = Monitor { progress: &|share, _| progress("learning the posterior", share), keep: &keep };
    let (mut learnt, losses) =
        learn(&mut pool, left_out, &training, initial.as_ref().map(|(learnt, _)| learnt), start, &monitor)?;
    drop(pool);
    learnt.colours = Some(colours(&learnt, lights, materials, progress)?.0);
    let provenance = format!(
        "{POSTERIOR} by gonio {} from the {channel:?} channel of {} materials in {count} maps, {} photographs, seed {seed}{origin}",
        env!("CARGO_PKG_VERSION"),
        tables.len(),
        training.steps * training.batch,
    );
    Ok((learnt, losses, provenance))
}

/// Encodes a checkpoint with a note on the settings of its training.
fn encode_checkpoint(checkpoint: &Checkpoint, note: &str) -> Vec<u8> {
    let Checkpoint { values, moments: [mean, square, average], negatives, losses } = checkpoint;
    encode_arrays(note, &[values, mean, square, average, negatives, losses].map(Vec::as_slice))
}

/// Decodes a checkpoint and the note on its settings.
fn decode_checkpoint(path: &Path, bytes: &[u8]) -> Result<(String, Checkpoint), TrainingError> {
    let (note, arrays) = decode_arrays(path, bytes)?;
    let Ok([values, mean, square, average, negatives, losses]) = <[Vec<f32>; 6]>::try_from(arrays) else {
        return Err(TrainingError::Data(path.display().to_string(), "is not a training checkpoint".into()));
    };
    let checkpoint = Checkpoint { values, moments: [mean, square, average], negatives, losses };
    Ok((note, checkpoint))
}

/// Returns the posterior of a model, and the note on its origin, as the start of a training. `name`
/// is the name of the model in messages.
///
/// # Errors
/// If the model has no posterior.
pub fn initial(model: &Model, name: &str) -> Result<(LearntPosterior, String), TrainingError> {
    let missing = "has no posterior of materials; use a model with one (gonio train posterior)";
    let learnt = model.learnt.clone().ok_or_else(|| TrainingError::Data(name.to_owned(), missing.into()))?;
    Ok((learnt, provenance_of(model, POSTERIOR)))
}
