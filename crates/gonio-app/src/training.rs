//! Learning the parts of a model from measurements: what `gonio train` does.
//!
//! Measurements are folders of files or already in memory. Each function gives what it has learnt
//! and a note of its origin, which goes into the file.

use std::path::{Path, PathBuf};

use gonio::colour::ColourModel;
use gonio::inference::learnt::LearntPosterior;
use gonio::lighting::{EnvironmentMap, LightGrid, LightPrior, PriorSettings};
use gonio::model::{Model, ModelError};
use gonio::reflectance::nmf::NmfSettings;
use gonio::reflectance::{
    BivariateTable, Dictionary, DictionarySettings, LogBasis, ReflectanceBasis, TrainReport, TrainSettings, train,
};
use gonio::simulation::{ColourStock, Stock, StockSettings};
use gonio::sphere::OctahedralMap;
use gonio_train::{TrainError, TrainingSettings, learn};
use rayon::prelude::*;
use thiserror::Error;

use gonio_io::folder::files;
use gonio_io::picture::ReadOptions;
use gonio_io::{Error, bivariate, brdf};

use crate::Problem;

/// Why nothing was learnt.
#[derive(Debug, Error)]
pub enum TrainingError {
    /// A file or folder cannot be read.
    #[error(transparent)]
    File(#[from] Error),
    /// Measurements cannot be learnt from.
    #[error("{0}: {1}")]
    Data(String, String),
    /// A setting is out of range.
    #[error("{0}")]
    Setting(String),
    /// The training has no result.
    #[error(transparent)]
    Training(#[from] TrainError),
    /// Parts do not make a model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl From<TrainingError> for Problem {
    fn from(error: TrainingError) -> Self {
        match error {
            TrainingError::File(error) => error.into(),
            error => Self::new(error.to_string()),
        }
    }
}

/// Captured lights.
#[derive(Clone, Debug)]
pub enum Lights {
    /// A folder of lat-long maps (.hdr, .exr, .pfm).
    Folder(PathBuf),
    /// Maps in memory.
    Maps(Vec<EnvironmentMap>),
}

/// Measured materials.
#[derive(Clone, Debug)]
pub enum Materials {
    /// A folder of `.binary` (MERL) and `_rgb.bsdf` (RGL) files, or of `bivariate_rgb_f32.npy` with
    /// `materials.txt`.
    Folder(PathBuf),
    /// Names and tables in memory.
    Tables(Vec<(String, [BivariateTable; 3])>),
}

/// Is told what is being done and a fraction of it in 0..=1.
pub type Progress<'a> = &'a (dyn Fn(&'static str, f64) + Sync);

/// Channels of measured materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Red.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
    /// Their sum, weighted as the eye does.
    Luminance,
}

impl Channel {
    /// Selects from red, green and blue of a material.
    fn of(self, rgb: &[BivariateTable; 3]) -> BivariateTable {
        match self {
            Self::Red | Self::Green | Self::Blue => rgb[self as usize].clone(),
            Self::Luminance => BivariateTable::luminance(rgb),
        }
    }
}

/// How the prior of light is learnt.
#[derive(Clone, Debug)]
pub struct LightingSettings {
    /// Texels along a side of the finest grid that the prior shall serve, a power of two from 8 to
    /// 512.
    pub grid: usize,
    /// Layout of the sphere on the square.
    pub map: OctahedralMap,
    /// Azimuths at which each map is seen. With an even number the horizontal and vertical groups
    /// are the same: a turn by 180 degrees swaps the wavelets of front and back.
    pub turns: usize,
    /// Radiance at which each map is cut off, in units of its mean; `None` leaves the maps as they
    /// are.
    pub cap: Option<f64>,
    /// Seed of the fits' starts.
    pub seed: u64,
}

impl Default for LightingSettings {
    fn default() -> Self {
        Self { grid: 128, map: OctahedralMap::EqualArea, turns: 1, cap: None, seed: 1 }
    }
}

/// How the basis of reflectance is learnt.
#[derive(Clone, Debug)]
pub struct ReflectanceSettings {
    /// Number of basis functions.
    pub rank: usize,
    /// Channel that is factorised.
    pub channel: Channel,
    /// Starts of the factorisation.
    pub restarts: usize,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for ReflectanceSettings {
    fn default() -> Self {
        Self { rank: 10, channel: Channel::Green, restarts: NmfSettings::default().restarts, seed: 0 }
    }
}

/// How the posterior of materials is learnt.
#[derive(Clone, Debug)]
pub struct PosteriorSettings {
    /// Channel of the materials.
    pub channel: Channel,
    /// Cameras in each light.
    pub cameras: usize,
    /// Materials before each camera.
    pub draws: usize,
    /// Steps of the training, each on 128 photographs.
    pub steps: usize,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for PosteriorSettings {
    fn default() -> Self {
        let (stock, training) = (StockSettings::default(), TrainingSettings::default());
        Self { channel: Channel::Luminance, cameras: stock.cameras, draws: stock.draws, steps: training.steps, seed: 1 }
    }
}

/// The prior of light.
///
/// # Errors
/// If there are no lights, one cannot be read or is none, or they have no structure.
pub fn lighting(
    lights: &Lights,
    settings: &LightingSettings,
    progress: Progress<'_>,
) -> Result<(LightPrior, String), TrainingError> {
    let LightingSettings { grid, map, turns, cap, seed } = *settings;
    if !grid.is_power_of_two() || !(8..=512).contains(&grid) {
        return Err(TrainingError::Setting(format!("grid {grid}: give a power of two from 8 to 512")));
    }
    if cap.is_some_and(|cap| !(cap > 1.0 && cap.is_finite())) {
        return Err(TrainingError::Setting("cap: give a number above 1".to_owned()));
    }
    let mut grids: Vec<LightGrid> = Vec::new();
    let count = lights.each(&mut |share, light| {
        let light = &cap.map_or_else(|| light.clone(), |cap| light.capped(cap));
        let width = light.radiance().width();
        grids.par_extend((0..turns).into_par_iter().map(|t| light.turned(t * width / turns).to_grid(map, grid)));
        progress("reading lights", share);
    })?;
    let settings = PriorSettings { seed, ..PriorSettings::default() };
    let prior = LightPrior::learn(&grids, count, &settings)
        .map_err(|error| TrainingError::Data(lights.name(), error.to_string()))?;
    let provenance = format!(
        "light prior by gonio {} from {count} maps at {turns} azimuths each, {}grid {grid}, seed {seed}",
        env!("CARGO_PKG_VERSION"),
        cap.map_or_else(String::new, |cap| format!("cut off at {cap} times their mean, ")),
    );
    Ok((prior, provenance))
}

/// The basis of reflectance.
///
/// # Errors
/// If there are no materials or fewer than the rank, or one cannot be read or learnt from.
pub fn reflectance(
    materials: &Materials,
    settings: &ReflectanceSettings,
    progress: Progress<'_>,
) -> Result<(ReflectanceBasis, TrainReport, String), TrainingError> {
    let ReflectanceSettings { rank, channel, restarts, seed } = *settings;
    if restarts == 0 {
        return Err(TrainingError::Setting("restarts 0: give at least 1".into()));
    }
    let tables = materials.channel(channel, progress)?;
    let count = tables.len();
    if !(1..=count).contains(&rank) {
        let name = materials.name();
        let problem = format!("rank {rank}: {name} holds {count} materials; give a rank from 1 to {count}");
        return Err(TrainingError::Setting(problem));
    }
    let nmf = NmfSettings { rank, restarts, seed, ..NmfSettings::default() };
    progress("factorising", 0.0);
    let (basis, report) = train(&tables, &TrainSettings { nmf, ..TrainSettings::default() })
        .map_err(|error| TrainingError::Data(materials.name(), error.to_string()))?;
    progress("factorising", 1.0);
    let provenance = format!(
        "reflectance basis by gonio {} from the {channel:?} channel of {count} materials, rank {rank}, {restarts} starts, seed {seed}",
        env!("CARGO_PKG_VERSION"),
    );
    Ok((basis, report, provenance))
}

/// The posterior of materials, from both.
///
/// # Errors
/// If there are no lights or no materials, or one cannot be read.
pub fn posterior(
    lights: &Lights,
    materials: &Materials,
    settings: &PosteriorSettings,
    progress: Progress<'_>,
) -> Result<(LearntPosterior, String), TrainingError> {
    let PosteriorSettings { channel, cameras, draws, steps, seed } = *settings;
    if cameras == 0 || draws == 0 || steps == 0 {
        return Err(TrainingError::Setting("cameras, draws and steps must be at least 1".into()));
    }
    lights.count()?;
    let tables = materials.channel(channel, progress)?;
    if tables.is_empty() {
        return Err(TrainingError::Data(materials.name(), "no materials here".into()));
    }
    progress("learning materials", 0.0);
    let basis = LogBasis::fit(&tables, LogBasis::RANK);
    let dictionary = Dictionary::new(basis, &DictionarySettings { seed, ..DictionarySettings::default() });
    let mut stock = Stock::new(dictionary, StockSettings { cameras, draws, seed, ..StockSettings::default() });
    let count = lights.each(&mut |share, light| {
        stock.add_light(light);
        progress("simulating scenes", share);
    })?;
    let training = TrainingSettings { steps, seed, ..TrainingSettings::default() };
    let mut learnt = learn(&stock, &training, &|share, _| progress("learning the posterior", share))?;
    learnt.colours = Some(colours(&learnt, lights, std::slice::from_ref(materials), progress)?.0);
    let provenance = format!(
        "posterior of materials by gonio {} from the {channel:?} channel of {} materials in {count} maps, {} scenes, {} photographs, seed {seed}",
        env!("CARGO_PKG_VERSION"),
        tables.len(),
        stock.scenes(),
        training.steps * training.batch,
    );
    Ok((learnt, provenance))
}

/// Learns the model of colours from a photograph of each material in each light, read by the
/// posterior of their luminance. Returns the numbers of materials and of lights, too.
fn colours(
    learnt: &LearntPosterior,
    lights: &Lights,
    materials: &[Materials],
    progress: Progress<'_>,
) -> Result<(ColourModel, [usize; 2]), TrainingError> {
    let mut tables = Vec::new();
    for some in materials {
        tables.extend(some.rgb(progress)?.into_iter().map(|(_, rgb)| rgb));
    }
    if tables.is_empty() {
        return Err(TrainingError::Setting("materials: no materials to learn colours from".to_owned()));
    }
    let count = tables.len();
    let mut stock = ColourStock::new(learnt, tables);
    let lights = lights.each(&mut |share, light| {
        stock.add_light(light);
        progress("learning colours", share);
    })?;
    Ok((stock.learn(), [count, lights]))
}

/// Learns the model of colours of a model anew.
///
/// # Errors
/// If the model has no posterior of materials, or as [`posterior`].
pub fn recolour(
    model: &mut Model,
    lights: &Lights,
    materials: &[Materials],
    progress: Progress<'_>,
) -> Result<(), TrainingError> {
    let Some(learnt) = model.learnt.as_mut() else {
        return Err(TrainingError::Setting("model: has no posterior of materials to read colours with".to_owned()));
    };
    let (found, [count, maps]) = colours(learnt, lights, materials, progress)?;
    learnt.colours = Some(found);
    // The note on earlier colours, if any, is replaced.
    let others = model.provenance.split("; ").filter(|part| !part.starts_with(COLOURS)).collect::<Vec<_>>();
    model.provenance =
        format!("{}; {COLOURS} {} from {count} materials in {maps} maps", others.join("; "), env!("CARGO_PKG_VERSION"));
    model.check()?;
    Ok(())
}

/// Start of the note on the origin of colours.
const COLOURS: &str = "colours by gonio";

/// All parts as a model, each with the note of its origin.
///
/// # Errors
/// If they do not go together.
pub fn join(
    light: (LightPrior, String),
    reflectance: (ReflectanceBasis, String),
    posterior: Option<(LearntPosterior, String)>,
) -> Result<Model, TrainingError> {
    let mut provenance = format!("{}; {}", light.1, reflectance.1);
    let posterior = posterior.map(|(learnt, more)| {
        provenance = format!("{provenance}; {more}");
        learnt
    });
    let model = Model { light: light.0, reflectance: reflectance.0, learnt: posterior, provenance };
    model.check()?;
    Ok(model)
}

impl Lights {
    fn name(&self) -> String {
        match self {
            Self::Folder(dir) => dir.display().to_string(),
            Self::Maps(_) => "the lights".into(),
        }
    }

    fn paths(dir: &Path) -> Result<Vec<PathBuf>, TrainingError> {
        let paths = files(dir, &["hdr", "exr", "pfm"])?;
        if paths.is_empty() {
            let problem = "no .hdr, .exr or .pfm files here";
            return Err(TrainingError::Data(dir.display().to_string(), problem.into()));
        }
        Ok(paths)
    }

    /// How many there are; none is an error.
    fn count(&self) -> Result<usize, TrainingError> {
        match self {
            Self::Folder(dir) => Ok(Self::paths(dir)?.len()),
            Self::Maps(maps) if maps.is_empty() => Err(TrainingError::Data(self.name(), "there are none".into())),
            Self::Maps(maps) => Ok(maps.len()),
        }
    }

    /// Hands out one after the other with the share that is then done; says how many there are.
    fn each(&self, visit: &mut dyn FnMut(f64, &EnvironmentMap)) -> Result<usize, TrainingError> {
        let count = self.count()?;
        let mut tell = |i: usize, map: &EnvironmentMap| visit((i + 1) as f64 / count as f64, map);
        match self {
            Self::Maps(maps) => maps.iter().enumerate().for_each(|(i, map)| tell(i, map)),
            Self::Folder(dir) => {
                for (i, path) in Self::paths(dir)?.iter().enumerate() {
                    let decoded = gonio_io::picture::read(path, &ReadOptions::default())?;
                    let map = EnvironmentMap::new(decoded.picture.rgb)
                        .map_err(|error| TrainingError::Data(path.display().to_string(), error.to_string()))?;
                    tell(i, &map);
                }
            }
        }
        Ok(count)
    }
}

impl Materials {
    fn name(&self) -> String {
        match self {
            Self::Folder(dir) => dir.display().to_string(),
            Self::Tables(_) => "the list".into(),
        }
    }

    /// One channel of every material.
    fn channel(&self, channel: Channel, progress: Progress<'_>) -> Result<Vec<(String, BivariateTable)>, Error> {
        let all = self.rgb(progress)?;
        Ok(all.into_iter().map(|(name, rgb)| (name, channel.of(&rgb))).collect())
    }

    /// Red, green and blue of every material.
    fn rgb(&self, progress: Progress<'_>) -> Result<Vec<(String, [BivariateTable; 3])>, Error> {
        let dir = match self {
            Self::Tables(tables) => return Ok(tables.clone()),
            Self::Folder(dir) => dir,
        };
        if dir.join("bivariate_rgb_f32.npy").is_file() {
            return bivariate::read_bivariate_set(dir);
        }
        let list = brdf::list(dir)?;
        let mut out = Vec::with_capacity(list.len());
        for (i, (name, path)) in list.iter().enumerate() {
            let table = brdf::read(path)?;
            out.push((name.clone(), [0, 1, 2].map(|c| table.bivariate(c))));
            progress("reading materials", (i + 1) as f64 / list.len() as f64);
        }
        Ok(out)
    }
}
