//! Trains the parts of a model on measurements, for `gonio train`.
//!
//! Measurements are folders of files or data in memory. Each function returns the trained part and
//! a note on its origin, which is stored in the file.

mod posterior;

use std::path::{Path, PathBuf};

use gonio::colour::ColourModel;
use gonio::inference::learnt::LearntPosterior;
use gonio::lighting::{EnvironmentMap, LightGrid, LightPrior, PriorSettings};
use gonio::model::{Model, ModelError};
use gonio::reflectance::{BivariateTable, ReflectanceBasis};
use gonio::simulation::ColourPool;
use gonio::sphere::OctahedralMap;
use gonio_paper::nmf::NmfSettings;
use gonio_paper::training::{TrainReport, TrainSettings, train};
use gonio_train::TrainError;
pub use gonio_train::TrainingLosses;
pub use posterior::{PosteriorSettings, Resumption, initial, posterior};
use rayon::prelude::*;
use thiserror::Error;

use gonio_io::folder::files;
use gonio_io::model::embedded;
use gonio_io::picture::ReadOptions;
use gonio_io::{Error, bivariate, brdf};

use crate::AppError;

/// Error of a training run.
#[derive(Debug, Error)]
pub enum TrainingError {
    /// A file or folder cannot be read.
    #[error(transparent)]
    File(#[from] Error),
    /// The measurements are unsuitable.
    #[error("{0}: {1}")]
    Data(String, String),
    /// A setting is out of range.
    #[error("{0}")]
    Setting(String),
    /// The training failed.
    #[error(transparent)]
    Training(#[from] TrainError),
    /// The parts do not form a model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl From<TrainingError> for AppError {
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
    /// Folder of `.binary` (MERL), `_rgb.bsdf` (RGL) and `.mbsdf` (MDL) files, or of
    /// `bivariate_rgb_f32.npy` and `materials.txt`.
    Folder(PathBuf),
    /// Names and tables in memory.
    Tables(Vec<(String, [BivariateTable; 3])>),
}

/// Callback that receives the current stage and its fraction in 0..=1.
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
    /// Luminance (Rec. 709 weights).
    Luminance,
}

impl Channel {
    /// Selects the channel of a material.
    fn of(self, rgb: &[BivariateTable; 3]) -> BivariateTable {
        match self {
            Self::Red | Self::Green | Self::Blue => rgb[self as usize].clone(),
            Self::Luminance => BivariateTable::luminance(rgb),
        }
    }
}

/// Settings for training the prior of light.
#[derive(Clone, Debug)]
pub struct LightingSettings {
    /// Texels along a side of the finest grid of the prior, a power of two from 8 to 512.
    pub grid: usize,
    /// Mapping of the sphere to the square.
    pub map: OctahedralMap,
    /// Number of equally spaced rotations about the vertical axis at which each map is used. An
    /// even number includes 180 degrees, which gives the horizontal and vertical wavelets of a
    /// scale equal statistics.
    pub rotations: usize,
    /// Radiance at which each map is clipped, in units of its mean; `None` does not clip.
    pub cap: Option<f64>,
    /// Seed of the random starts of the fits.
    pub seed: u64,
}

impl Default for LightingSettings {
    fn default() -> Self {
        Self { grid: 128, map: OctahedralMap::EqualArea, rotations: 1, cap: None, seed: 1 }
    }
}

/// Settings for training the basis of reflectance.
#[derive(Clone, Debug)]
pub struct ReflectanceSettings {
    /// Number of basis functions.
    pub rank: usize,
    /// Channel to factorise.
    pub channel: Channel,
    /// Number of random starts of the factorisation.
    pub starts: usize,
    /// Seed of the random starts.
    pub seed: u64,
}

impl Default for ReflectanceSettings {
    fn default() -> Self {
        Self { rank: 10, channel: Channel::Green, starts: NmfSettings::default().starts, seed: 0 }
    }
}

/// Trains the prior of light.
///
/// # Errors
/// If there are no environment maps, one cannot be read or is not an environment map, or they have
/// no structure.
pub fn lighting(
    lights: &Lights,
    settings: &LightingSettings,
    progress: Progress<'_>,
) -> Result<(LightPrior, String), TrainingError> {
    let LightingSettings { grid, map, rotations, cap, seed } = *settings;
    if !grid.is_power_of_two() || !(8..=512).contains(&grid) {
        return Err(TrainingError::Setting(format!("grid {grid}: must be a power of two from 8 to 512")));
    }
    if cap.is_some_and(|cap| !(cap > 1.0 && cap.is_finite())) {
        return Err(TrainingError::Setting("cap: must be above 1".to_owned()));
    }
    let mut grids: Vec<LightGrid> = Vec::new();
    let count = lights.each(&mut |share, light| {
        let light = &cap.map_or_else(|| light.clone(), |cap| light.capped(cap));
        let width = light.radiance().width();
        grids.par_extend(
            (0..rotations).into_par_iter().map(|t| light.shifted_columns(t * width / rotations).to_grid(map, grid)),
        );
        progress("reading lights", share);
    })?;
    let settings = PriorSettings { seed, ..PriorSettings::default() };
    let prior = LightPrior::learn(&grids, count, &settings)
        .map_err(|error| TrainingError::Data(lights.name(), error.to_string()))?;
    let provenance = format!(
        "{LIGHT_PRIOR} by gonio {} from {count} maps at {rotations} azimuths each, {}grid {grid}, seed {seed}",
        env!("CARGO_PKG_VERSION"),
        cap.map_or_else(String::new, |cap| format!("cut off at {cap} times their mean, ")),
    );
    Ok((prior, provenance))
}

/// Trains the basis of reflectance.
///
/// # Errors
/// If there are fewer materials than the rank, or one cannot be read or is unsuitable.
pub fn reflectance(
    materials: &Materials,
    settings: &ReflectanceSettings,
    progress: Progress<'_>,
) -> Result<(ReflectanceBasis, TrainReport, String), TrainingError> {
    let ReflectanceSettings { rank, channel, starts, seed } = *settings;
    if starts == 0 {
        return Err(TrainingError::Setting("starts 0: must be at least 1".into()));
    }
    let tables = materials.channel(channel, progress)?;
    let count = tables.len();
    if !(1..=count).contains(&rank) {
        let name = materials.name();
        let problem = format!("rank {rank}: must be from 1 to {count}, the number of materials in {name}");
        return Err(TrainingError::Setting(problem));
    }
    let nmf = NmfSettings { rank, starts, seed, ..NmfSettings::default() };
    progress("factorising", 0.0);
    let (basis, report) = train(&tables, &TrainSettings { nmf, ..TrainSettings::default() })
        .map_err(|error| TrainingError::Data(materials.name(), error.to_string()))?;
    progress("factorising", 1.0);
    let provenance = format!(
        "{REFLECTANCE_BASIS} by gonio {} from the {channel:?} channel of {count} materials, rank {rank}, {starts} starts, seed {seed}",
        env!("CARGO_PKG_VERSION"),
    );
    Ok((basis, report, provenance))
}

/// Trains the colour model on a simulated photograph of each material in each light, evaluated with
/// the posterior of the luminance. Also returns the numbers of materials and of lights.
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
        return Err(TrainingError::Setting(
            "materials: there are no materials to train the colour model on".to_owned(),
        ));
    }
    let count = tables.len();
    let mut pool = ColourPool::new(learnt, tables);
    let lights = lights.each(&mut |share, light| {
        pool.add_light(light);
        progress("learning colours", share);
    })?;
    Ok((pool.learn(), [count, lights]))
}

/// Retrains the colour model of a model.
///
/// # Errors
/// If the model has no posterior of materials, there are no lights or no materials, or one cannot
/// be read.
pub fn recolour(
    model: &mut Model,
    lights: &Lights,
    materials: &[Materials],
    progress: Progress<'_>,
) -> Result<(), TrainingError> {
    let Some(learnt) = model.learnt.as_mut() else {
        return Err(TrainingError::Setting(
            "model: has no posterior of materials, which the colour model requires".to_owned(),
        ));
    };
    let (found, [count, maps]) = colours(learnt, lights, materials, progress)?;
    learnt.colours = Some(found);
    // Replace the note on the earlier colour model.
    let others = model.provenance.split("; ").filter(|part| !part.starts_with(COLOURS)).collect::<Vec<_>>();
    model.provenance =
        format!("{}; {COLOURS} {} from {count} materials in {maps} maps", others.join("; "), env!("CARGO_PKG_VERSION"));
    model.check()?;
    Ok(())
}

/// Start of the note on the origin of the colour model.
const COLOURS: &str = "colours by gonio";

/// Start of the note on the origin of a light prior.
const LIGHT_PRIOR: &str = "light prior";

/// Start of the note on the origin of a reflectance basis.
const REFLECTANCE_BASIS: &str = "reflectance basis";

/// Start of the note on the origin of a posterior of materials.
const POSTERIOR: &str = "posterior of materials";

/// Returns the note of a model on the origin of the part whose note has this start.
fn provenance_of(model: &Model, start: &str) -> String {
    model.provenance.split("; ").find(|part| part.starts_with(start)).unwrap_or_default().to_owned()
}

/// Joins the parts, each with the note on its origin, into a model. Without a light prior or a
/// reflectance basis, it uses that of the embedded model.
///
/// # Errors
/// If the parts do not match.
pub fn join(
    light: Option<(LightPrior, String)>,
    reflectance: Option<(ReflectanceBasis, String)>,
    posterior: Option<(LearntPosterior, String)>,
) -> Result<Model, TrainingError> {
    let (light, reflectance) = match (light, reflectance) {
        (Some(light), Some(reflectance)) => (light, reflectance),
        (light, reflectance) => {
            let base = embedded()?;
            let [of_light, of_reflectance] = [LIGHT_PRIOR, REFLECTANCE_BASIS].map(|part| provenance_of(&base, part));
            (light.unwrap_or((base.light, of_light)), reflectance.unwrap_or((base.reflectance, of_reflectance)))
        }
    };
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
            let problem = "contains no .hdr, .exr or .pfm files; specify a folder of environment maps";
            return Err(TrainingError::Data(dir.display().to_string(), problem.into()));
        }
        Ok(paths)
    }

    /// Returns the number of environment maps; zero is an error.
    fn count(&self) -> Result<usize, TrainingError> {
        match self {
            Self::Folder(dir) => Ok(Self::paths(dir)?.len()),
            Self::Maps(maps) if maps.is_empty() => {
                Err(TrainingError::Data(self.name(), "there are no environment maps".into()))
            }
            Self::Maps(maps) => Ok(maps.len()),
        }
    }

    /// Visits each environment map with the completed fraction; returns their number.
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

    /// Returns one channel of each material.
    fn channel(&self, channel: Channel, progress: Progress<'_>) -> Result<Vec<(String, BivariateTable)>, Error> {
        let all = self.rgb(progress)?;
        Ok(all.into_iter().map(|(name, rgb)| (name, channel.of(&rgb))).collect())
    }

    /// Returns red, green and blue of each material.
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
            out.push((name.clone(), table.to_bivariate()));
            progress("reading materials", (i + 1) as f64 / list.len() as f64);
        }
        Ok(out)
    }
}
