//! `gonio train`: the priors of light and reflectance from measurements.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::inference::amortised::{Simulation, SimulationSettings, TrainingSettings};
use gonio::lighting::{EnvironmentMap, LightGrid, LightPrior, PriorSettings};
use gonio::model::Model;
use gonio::reflectance::nmf::NmfSettings;
use gonio::reflectance::{BivariateTable, Dictionary, DictionarySettings, LogBasis, MerlTable, TrainSettings, train};
use gonio::render::LightTree;
use gonio::sphere::OctahedralMap;
use gonio_io::atomic::write_file;
use gonio_io::model::{
    encode_lighting, encode_model, encode_posterior, encode_reflectance, read_lighting, read_posterior,
    read_reflectance,
};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::input;
use crate::outcome::Outcome;
use crate::progress::Stage;

/// What to learn.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// The prior of light, from a folder of lat-long HDR maps
    Lighting(Lighting),
    /// The basis and prior of reflectance, from a folder of MERL `.binary` files
    Reflectance(Reflectance),
    /// The posterior of materials for `gonio infer --method marginal`, from both
    Posterior(Posterior),
    /// Join all into a model for `gonio infer --model`
    Model(Join),
}

/// Options of `gonio train lighting`.
#[derive(clap::Args)]
pub(crate) struct Lighting {
    /// Folder of lat-long maps (.hdr, .exr, .pfm)
    dir: PathBuf,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
    /// Texels along a side of the finest grid that the prior shall serve, a power of two
    #[arg(long, default_value_t = 128)]
    grid: usize,
    /// Layout of the sphere on the square
    #[arg(long, value_enum, default_value_t = MapName::EqualArea)]
    map: MapName,
    /// Azimuths at which each map is seen: the camera may look in any direction
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    turns: u32,
    /// Seed of the fits' starts
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Names of [`OctahedralMap`].
#[derive(Clone, Copy, clap::ValueEnum)]
pub(crate) enum MapName {
    /// Clarberg's equal-area map
    EqualArea,
    /// The map of Praun and Hoppe, as in the paper
    PraunHoppe,
}

/// Options of `gonio train reflectance`.
#[derive(clap::Args)]
pub(crate) struct Reflectance {
    /// Folder of `.binary` (MERL) and `_rgb.bsdf` (RGL) files, or of `bivariate_rgb_f32.npy` with `materials.txt`
    dir: PathBuf,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
    /// Number of basis functions
    #[arg(long, default_value_t = 10)]
    rank: usize,
    /// Channel that is factorised
    #[arg(long, value_enum, default_value_t = Channel::Green)]
    channel: Channel,
    /// Starts of the factorisation
    #[arg(long, default_value_t = NmfSettings::default().restarts)]
    restarts: usize,
    /// Seed of the starts
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print the error of every material
    #[arg(long)]
    verbose: bool,
}

/// Channels of a MERL table.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Channel {
    Red,
    Green,
    Blue,
    /// Their sum, weighted as the eye does
    Luminance,
}

impl Channel {
    /// Of a material whose channels (red, green, blue) are `table(0)` to `table(2)`.
    fn of(self, table: impl Fn(usize) -> BivariateTable) -> BivariateTable {
        match self {
            Self::Red | Self::Green | Self::Blue => table(self as usize),
            Self::Luminance => BivariateTable::luminance(&[0, 1, 2].map(table)),
        }
    }
}

/// Options of `gonio train posterior`.
#[derive(clap::Args)]
pub(crate) struct Posterior {
    /// Folder of lat-long maps (.hdr, .exr, .pfm)
    #[arg(long, value_name = "DIR")]
    lights: PathBuf,
    /// Folder of `.binary` (MERL) and `_rgb.bsdf` (RGL) files, or of `bivariate_rgb_f32.npy` with `materials.txt`
    #[arg(long, value_name = "DIR")]
    materials: PathBuf,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
    /// Channel of the materials
    #[arg(long, value_enum, default_value_t = Channel::Luminance)]
    channel: Channel,
    /// Cameras in each light
    #[arg(long, default_value_t = SimulationSettings::default().cameras)]
    cameras: usize,
    /// Materials before each camera
    #[arg(long, default_value_t = SimulationSettings::default().draws)]
    draws: usize,
    /// Passes of the training over all simulated photographs
    #[arg(long, default_value_t = TrainingSettings::default().epochs)]
    epochs: usize,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Options of `gonio train model`.
#[derive(clap::Args)]
pub(crate) struct Join {
    /// Output of `gonio train lighting`
    #[arg(long)]
    lighting: PathBuf,
    /// Output of `gonio train reflectance`
    #[arg(long)]
    reflectance: PathBuf,
    /// Output of `gonio train posterior`; without one the model does not serve `--method marginal`
    #[arg(long)]
    posterior: Option<PathBuf>,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
}

pub(crate) fn run(command: &Command) -> Result<Outcome> {
    match command {
        Command::Lighting(options) => lighting(options),
        Command::Reflectance(options) => reflectance(options),
        Command::Posterior(options) => posterior(options),
        Command::Model(options) => join(options),
    }
}

/// What is said of a file that was learnt.
fn written(output: &Path, provenance: &str) -> Outcome {
    let output = output.display().to_string();
    Outcome::new(format!("{output}: {provenance}"), json!({ "output": output, "provenance": provenance }))
}

/// Files of a folder with one of the extensions, by name.
fn files(dir: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(dir).with_context(|| format!("{}: cannot list this folder", dir.display()))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("{}: cannot list this folder", dir.display()))?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if extensions.contains(&extension.as_str()) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn lighting(options: &Lighting) -> Result<Outcome> {
    if !options.grid.is_power_of_two() || !(8..=512).contains(&options.grid) {
        bail!("--grid {}: give a power of two from 8 to 512", options.grid);
    }
    let paths = files(&options.dir, &["hdr", "exr", "pfm"])?;
    if paths.is_empty() {
        bail!("{}: no .hdr, .exr or .pfm files here", options.dir.display());
    }
    let map = match options.map {
        MapName::EqualArea => OctahedralMap::EqualArea,
        MapName::PraunHoppe => OctahedralMap::PraunHoppe,
    };
    let stage = Stage::new("reading lights");
    let mut lights: Vec<LightGrid> = Vec::new();
    for (i, path) in paths.iter().enumerate() {
        let light: EnvironmentMap = input::light(path)?;
        let width = light.radiance().width();
        let turns = options.turns as usize;
        lights
            .par_extend((0..turns).into_par_iter().map(|t| light.turned(t * width / turns).to_grid(map, options.grid)));
        stage.at((i + 1) as f64 / paths.len() as f64);
    }
    stage.finish();
    let settings = PriorSettings { seed: options.seed, ..PriorSettings::default() };
    let prior =
        LightPrior::learn(&lights, paths.len(), &settings).with_context(|| options.dir.display().to_string())?;
    let provenance = format!(
        "light prior by gonio {} from {} maps at {} azimuths each, grid {}, seed {}",
        env!("CARGO_PKG_VERSION"),
        paths.len(),
        options.turns,
        options.grid,
        options.seed
    );
    write_file(&options.output, &encode_lighting(&prior, &provenance))?;
    Ok(written(&options.output, &provenance))
}

/// One channel of every material of a folder.
fn materials(dir: &Path, channel: Channel) -> Result<Vec<(String, BivariateTable)>> {
    if dir.join("bivariate_rgb_f32.npy").is_file() {
        let set = gonio_io::bivariate::read_bivariate_set(dir)?;
        return Ok(set.into_iter().map(|(name, rgb)| (name, channel.of(|c| rgb[c].clone()))).collect());
    }
    let list = gonio_io::brdf::list(dir)?;
    let stage = Stage::new("reading materials");
    let mut out = Vec::with_capacity(list.len());
    for (i, (name, path)) in list.iter().enumerate() {
        let table: MerlTable = gonio_io::brdf::read(path)?;
        out.push((name.clone(), channel.of(|c| table.bivariate(c))));
        stage.at((i + 1) as f64 / list.len() as f64);
    }
    stage.finish();
    Ok(out)
}

fn reflectance(options: &Reflectance) -> Result<Outcome> {
    if options.restarts == 0 {
        bail!("--restarts 0: give at least 1");
    }
    let materials = materials(&options.dir, options.channel)?;
    if !(1..=materials.len()).contains(&options.rank) {
        let (dir, count) = (options.dir.display(), materials.len());
        bail!("--rank {}: {dir} holds {count} materials; give a rank from 1 to {count}", options.rank);
    }
    let nmf =
        NmfSettings { rank: options.rank, restarts: options.restarts, seed: options.seed, ..NmfSettings::default() };
    let (basis, report) = train(&materials, &TrainSettings { nmf, ..TrainSettings::default() })
        .with_context(|| options.dir.display().to_string())?;
    let provenance = format!(
        "reflectance basis by gonio {} from the {:?} channel of {} materials, rank {}, {} starts, seed {}",
        env!("CARGO_PKG_VERSION"),
        options.channel,
        materials.len(),
        options.rank,
        options.restarts,
        options.seed
    );
    write_file(&options.output, &encode_reflectance(&basis, &provenance))?;
    let fits = report.fits.iter();
    let lines: String = match options.verbose {
        true => fits.clone().map(|fit| format!("{:40} RMS error {:.4} 1/sr\n", fit.name, fit.rms)).collect(),
        false => String::new(),
    };
    let (mean, median) = (report.mean_rms(), report.median_rms());
    let mut outcome = written(&options.output, &provenance);
    outcome.text =
        format!("{lines}RMS error over theta < 80 deg: mean {mean:.3}, median {median:.3} 1/sr\n{}", outcome.text);
    let each: serde_json::Map<String, Value> = fits.map(|fit| (fit.name.clone(), json!(fit.rms))).collect();
    outcome.fields.insert("rms".into(), json!({ "mean": mean, "median": median, "materials": each }));
    Ok(outcome)
}

fn posterior(options: &Posterior) -> Result<Outcome> {
    if options.cameras == 0 || options.draws == 0 || options.epochs == 0 {
        bail!("--cameras, --draws and --epochs must be at least 1");
    }
    let paths = files(&options.lights, &["hdr", "exr", "pfm"])?;
    if paths.is_empty() {
        bail!("{}: no .hdr, .exr or .pfm files here", options.lights.display());
    }
    let materials = materials(&options.materials, options.channel)?;
    if materials.is_empty() {
        bail!("{}: no materials here", options.materials.display());
    }
    let stage = Stage::new("learning materials");
    let basis = LogBasis::fit(&materials, LogBasis::RANK);
    let dictionary =
        Dictionary::new(basis, &DictionarySettings { seed: options.seed, ..DictionarySettings::default() });
    stage.finish();
    let settings = SimulationSettings {
        cameras: options.cameras,
        draws: options.draws,
        seed: options.seed,
        ..SimulationSettings::default()
    };
    let mut simulation = Simulation::new(dictionary, settings);
    let stage = Stage::new("simulating photographs");
    for (i, path) in paths.iter().enumerate() {
        simulation.add_light(&LightTree::of_map(&input::light(path)?));
        stage.at((i + 1) as f64 / paths.len() as f64);
    }
    stage.finish();
    let stage = Stage::new("learning the posterior");
    let training = TrainingSettings { epochs: options.epochs, seed: options.seed, ..TrainingSettings::default() };
    let amortised = simulation.train(&training, &|share| stage.at(share));
    stage.finish();
    let provenance = format!(
        "posterior of materials by gonio {} from the {:?} channel of {} materials in {} maps, {} photographs, seed {}",
        env!("CARGO_PKG_VERSION"),
        options.channel,
        materials.len(),
        paths.len(),
        simulation.count(),
        options.seed
    );
    write_file(&options.output, &encode_posterior(&amortised, &provenance))?;
    Ok(written(&options.output, &provenance))
}

fn join(options: &Join) -> Result<Outcome> {
    let (light, light_provenance) = read_lighting(&options.lighting)?;
    let (reflectance, reflectance_provenance) = read_reflectance(&options.reflectance)?;
    let mut provenance = format!("{light_provenance}; {reflectance_provenance}");
    let mut posterior = None;
    if let Some(path) = &options.posterior {
        let (amortised, more) = read_posterior(path)?;
        provenance = format!("{provenance}; {more}");
        posterior = Some(amortised);
    }
    let model = Model { light, reflectance, posterior, provenance };
    model.check()?;
    write_file(&options.output, &encode_model(&model))?;
    Ok(written(&options.output, &model.provenance))
}
