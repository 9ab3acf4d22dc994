//! `gonio train` trains the parts of a model on measured data.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, anyhow};
use gonio::sphere::OctahedralMap;
use gonio_app::names::{CHANNELS, MAPPINGS};
use gonio_app::training::{
    self, Channel, LightingSettings, Lights, Materials, PosteriorSettings, ReflectanceSettings, Resumption,
    TrainingError, TrainingLosses,
};
use gonio_io::atomic::write_file;
use gonio_io::model::{
    embedded, encode_lighting, encode_model, encode_posterior, encode_reflectance, read_lighting, read_model,
    read_posterior, read_reflectance,
};
use gonio_paper::nmf::NmfSettings;
use serde_json::{Value, json};

use crate::input;
use crate::names;
use crate::outcome::Outcome;
use crate::progress::{ProgressLine, is_verbose};

/// Part of a model to train.
#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Train the prior of light on a folder of lat-long HDR maps
    Lighting(TrainLightingOptions),
    /// Train the basis and prior of reflectance on a folder of measured BRDFs
    Reflectance(TrainReflectanceOptions),
    /// Train the posterior of materials for gonio infer --method learnt
    Posterior(TrainPosteriorOptions),
    /// Retrain the colour model on RGB lights and materials
    Colours(TrainColoursOptions),
    /// Join the trained parts into a model for gonio infer --model
    Model(TrainModelOptions),
}

/// Options of `gonio train lighting`.
#[derive(clap::Args)]
pub(crate) struct TrainLightingOptions {
    /// Folder of lat-long environment maps (.hdr, .exr, .pfm)
    dir: PathBuf,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
    /// Texels along a side of the finest grid of the prior, a power of two from 8 to 512
    #[arg(long, default_value_t = 128)]
    grid: usize,
    /// Mapping of the sphere to the square
    #[arg(long, value_parser = names::parser(MAPPINGS), default_value = "equal-area")]
    mapping: OctahedralMap,
    /// Number of rotations about the vertical axis in which each map is used
    ///
    /// With an even number, horizontal and vertical wavelets of a scale have equal statistics.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    rotations: u32,
    /// Clip each map at this multiple of its mean, to simulate the limited range of a camera
    #[arg(long, value_name = "TIMES")]
    cap: Option<f64>,
    /// Seed of the random starts of the fits
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Options of `gonio train reflectance`.
#[derive(clap::Args)]
pub(crate) struct TrainReflectanceOptions {
    /// Folder of measured BRDFs
    ///
    /// The folder contains .binary (MERL), _rgb.bsdf (RGL) and .mbsdf (MDL) files, or
    /// bivariate_rgb_f32.npy and materials.txt.
    dir: PathBuf,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
    /// Number of basis functions
    #[arg(long, default_value_t = 10)]
    rank: usize,
    /// Channel of the BRDFs to factorise
    #[arg(long, value_parser = names::parser(CHANNELS), default_value = "green")]
    channel: Channel,
    /// Number of random starts of the factorisation
    #[arg(long, default_value_t = NmfSettings::default().starts)]
    starts: usize,
    /// Seed of the random starts
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// Options of `gonio train posterior`.
#[derive(clap::Args)]
pub(crate) struct TrainPosteriorOptions {
    /// Folder of lat-long environment maps (.hdr, .exr, .pfm)
    #[arg(long, value_name = "DIR")]
    lights: PathBuf,
    /// Folders of measured BRDFs
    ///
    /// A folder contains .binary (MERL), _rgb.bsdf (RGL) and .mbsdf (MDL) files, or
    /// bivariate_rgb_f32.npy and materials.txt.
    #[arg(long, value_name = "DIR", required = true, num_args = 1..)]
    materials: Vec<PathBuf>,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
    /// Channel of the measured BRDFs to use
    #[arg(long, value_parser = names::parser(CHANNELS), default_value = "luminance")]
    channel: Channel,
    /// Number of views of environment maps in a group of simulated scenes
    ///
    /// A group shows each of its materials in each of its views.
    #[arg(long, default_value_t = PosteriorSettings::default().views)]
    views: usize,
    /// Number of materials in a group of simulated scenes
    #[arg(long, default_value_t = PosteriorSettings::default().group_materials)]
    group_materials: usize,
    /// Number of training steps, each on 128 simulated photographs
    #[arg(long, default_value_t = PosteriorSettings::default().steps)]
    steps: usize,
    /// Leave every N-th light out of the training and report the loss on these lights
    #[arg(long, value_name = "N")]
    leave_out: Option<usize>,
    /// Begin with the network of a model [without FILE: the embedded model]
    ///
    /// The training then needs fewer steps than from random weights.
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    initial: Option<Option<PathBuf>>,
    /// Continue an interrupted training run with the same settings
    ///
    /// gonio saves the state of the training to OUTPUT.checkpoint every five minutes, and removes
    /// this file at the end. A resumed training gives the same result as an uninterrupted one.
    #[arg(long)]
    resume: bool,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Options of `gonio train colours`.
#[derive(clap::Args)]
pub(crate) struct TrainColoursOptions {
    /// Model to retrain [default: the embedded model]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Folder of lat-long environment maps (.hdr, .exr, .pfm)
    #[arg(long, value_name = "DIR")]
    lights: PathBuf,
    /// Folders of measured BRDFs, as for gonio train posterior
    #[arg(long, value_name = "DIR", required = true, num_args = 1..)]
    materials: Vec<PathBuf>,
    /// File to write
    #[arg(short, long)]
    output: PathBuf,
}

/// Options of `gonio train model`.
#[derive(clap::Args)]
pub(crate) struct TrainModelOptions {
    /// Output of gonio train lighting [default: of the embedded model]
    #[arg(long)]
    lighting: Option<PathBuf>,
    /// Output of gonio train reflectance [default: of the embedded model]
    #[arg(long)]
    reflectance: Option<PathBuf>,
    /// Output of gonio train posterior, which gonio infer --method learnt requires
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
        Command::Colours(options) => recolour(options),
        Command::Model(options) => join(options),
    }
}

/// Returns the message about a trained file.
fn written(output: &Path, provenance: &str) -> Outcome {
    let output = output.display().to_string();
    Outcome::new(format!("{output}: {provenance}"), json!({ "output": output, "provenance": provenance }))
}

/// Trains with a progress line; errors in settings name the options.
fn learn<T>(job: impl FnOnce(training::Progress<'_>) -> Result<T, TrainingError>) -> Result<T> {
    let line = ProgressLine::new("reading");
    let learnt = job(&|name, fraction| line.report(name, fraction));
    line.finish();
    learnt.map_err(|error| match error {
        TrainingError::Setting(problem) => anyhow!("--{problem}"),
        error => error.into(),
    })
}

fn lighting(options: &TrainLightingOptions) -> Result<Outcome> {
    let TrainLightingOptions { grid, mapping: map, rotations, cap, seed, .. } = *options;
    let settings = LightingSettings { grid, map, rotations: rotations as usize, cap, seed };
    let lights = Lights::Folder(options.dir.clone());
    let (prior, provenance) = learn(|progress| training::lighting(&lights, &settings, progress))?;
    write_file(&options.output, &encode_lighting(&prior, &provenance))?;
    Ok(written(&options.output, &provenance))
}

fn reflectance(options: &TrainReflectanceOptions) -> Result<Outcome> {
    let settings = ReflectanceSettings {
        rank: options.rank,
        channel: options.channel,
        starts: options.starts,
        seed: options.seed,
    };
    let materials = Materials::Folder(options.dir.clone());
    let (basis, report, provenance) = learn(|progress| training::reflectance(&materials, &settings, progress))?;
    write_file(&options.output, &encode_reflectance(&basis, &provenance))?;
    let fits = report.fits.iter();
    let lines: String = match is_verbose() {
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

fn posterior(options: &TrainPosteriorOptions) -> Result<Outcome> {
    let initial = |path: &Option<PathBuf>| -> Result<_> {
        let (model, name) = input::model(path.as_deref())?;
        Ok(training::initial(&model, &name)?)
    };
    let initial = options.initial.as_ref().map(initial).transpose()?;
    let settings = PosteriorSettings {
        channel: options.channel,
        views: options.views,
        group_materials: options.group_materials,
        steps: options.steps,
        leave_out: options.leave_out,
        initial,
        seed: options.seed,
    };
    let lights = Lights::Folder(options.lights.clone());
    let materials: Vec<Materials> = options.materials.iter().cloned().map(Materials::Folder).collect();
    let mut name = options.output.clone().into_os_string();
    name.push(".checkpoint");
    let path = PathBuf::from(name);
    let start = match options.resume {
        true => {
            let missing = || format!("{}: cannot read the checkpoint; omit --resume to start anew", path.display());
            Some((path.as_path(), std::fs::read(&path).with_context(missing)?))
        }
        false => None,
    };
    // A full disk must not end a training of hours; the next checkpoint may succeed.
    let unwritten = RefCell::new(None);
    let keep = |bytes: Vec<u8>| {
        unwritten.replace(write_file(&path, &bytes).err());
    };
    let resumption = Resumption { start, keep: &keep };
    let (learnt, losses, provenance) =
        learn(|progress| training::posterior(&lights, &materials, &settings, resumption, progress))?;
    write_file(&options.output, &encode_posterior(&learnt, &provenance))?;
    let _ = std::fs::remove_file(&path);
    let mut outcome = written(&options.output, &provenance);
    let TrainingLosses { training, new_scenes, new_lights } = losses;
    let on_lights = new_lights.map_or_else(String::new, |loss| format!(", {loss:.2} in lights left out"));
    let failed = unwritten.into_inner().map_or_else(String::new, |error| format!("last checkpoint: {error}\n"));
    outcome.text = format!(
        "{failed}loss in nats: {training:.2} in training, {new_scenes:.2} on new scenes{on_lights}\n{}",
        outcome.text
    );
    let fields = json!({ "training": training, "new_scenes": new_scenes, "new_lights": new_lights });
    outcome.fields.insert("loss_nats".into(), fields);
    Ok(outcome)
}

fn recolour(options: &TrainColoursOptions) -> Result<Outcome> {
    let mut model = match &options.model {
        Some(path) => read_model(path)?,
        None => embedded()?,
    };
    let (lights, materials) = (
        Lights::Folder(options.lights.clone()),
        options.materials.iter().cloned().map(Materials::Folder).collect::<Vec<_>>(),
    );
    learn(|progress| training::recolour(&mut model, &lights, &materials, progress))?;
    write_file(&options.output, &encode_model(&model))?;
    Ok(written(&options.output, &model.provenance))
}

fn join(options: &TrainModelOptions) -> Result<Outcome> {
    let light = options.lighting.as_ref().map(read_lighting).transpose()?;
    let reflectance = options.reflectance.as_ref().map(read_reflectance).transpose()?;
    let posterior = options.posterior.as_ref().map(read_posterior).transpose()?;
    let model = training::join(light, reflectance, posterior)?;
    write_file(&options.output, &encode_model(&model))?;
    Ok(written(&options.output, &model.provenance))
}
