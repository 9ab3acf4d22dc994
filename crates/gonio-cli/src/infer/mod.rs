//! `gonio infer`: photograph -> observations -> posterior -> outputs.
//!
//! What a method finds is an [`Answer`]: `learnt` and `basis` make one, the rest is common to
//! all.

mod basis;
mod colour;
mod learnt;
mod observe;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use gonio::estimate::{Colouring, EstimateSettings, Material};
use gonio::lighting::LightGrid;
use gonio::reflectance::{BivariateTable, CELLS, MerlTable, THETA_D, THETA_H};
use gonio::scene::Circle;
use gonio_io::atomic::StagedFolder;
use gonio_io::npy;
use gonio_io::picture::encode_png;
use gonio_report::panels::{Panels, Subject};
use gonio_report::report::{Fits, Report};
use gonio_report::{notes, summary, uncertainty};
use serde_json::{Value, json};

use crate::input;
use crate::outcome::Outcome;
use crate::photograph::{self, Photograph};
use crate::progress::Stage;
use crate::shape::MeshOptions;

/// Options of `gonio infer`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// HDR photograph (EXR, Radiance HDR, PFM; PNG, TIFF, JPEG with a warning), or the first
    /// exposure of a bracket
    image: PathBuf,
    /// Further exposures of the same scene (8 or 16-bit JPEG, PNG, TIFF), to be merged with it as
    /// by gonio merge
    exposures: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Shape of the object, fitted to its outline
    #[arg(long, value_enum, default_value_t = Shape::Sphere, conflicts_with_all = ["normals", "mesh"])]
    shape: Shape,
    /// Semi-axis of an ellipsoid towards the camera, in pixels
    #[arg(long, value_name = "PIXELS", value_parser = parse_positive, allow_negative_numbers = true)]
    depth_axis: Option<f64>,
    #[command(flatten)]
    shape_options: MeshOptions,
    /// Picture of the object's normals instead (EXR, NPY, PNG): camera space, x right, y up, z
    /// towards the camera
    #[arg(long, value_name = "FILE", conflicts_with = "mesh")]
    normals: Option<PathBuf>,
    #[command(flatten)]
    normal_options: observe::NormalOptions,
    /// Take all light above a point's horizon to arrive there, whatever the object keeps from
    /// itself
    #[arg(long)]
    no_shadows: bool,
    /// Where the object is: a picture that is bright on it; without one, the alpha channel or a
    /// constant background tells
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// The sphere's outline in pixels, centre from the top left corner, if it is not to be found
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, conflicts_with_all = ["normals", "mesh", "camera"])]
    circle: Option<Circle>,
    /// Model file instead of the one that travels with the program
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// How the posterior is found
    #[arg(long, value_enum, default_value_t = MethodName::Learnt)]
    method: MethodName,
    /// The paper's own version on a sphere: its map of light at one azimuth, 8,600 normals away from
    /// its poles, 10 basis functions, random starts, Algorithm 1 to the letter
    #[arg(long, conflicts_with_all = ["method", "solver", "grid", "model", "light", "normals", "mesh", "full_rows"])]
    paper: bool,
    /// Solver of --method variational
    #[arg(long, value_enum, default_value_t = SolverName::Blocks)]
    solver: SolverName,
    /// The light, a lat-long map in camera space, for --method known-light
    #[arg(long, value_name = "MAP")]
    light: Option<PathBuf>,
    /// Seed of the random starts of --method variational, map and known-light; learnt has none
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Random starts of the same
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    starts: u32,
    /// Texels along a side of the light grid, a power of two
    #[arg(long, default_value_t = 32)]
    grid: usize,
    /// Run --method variational or map on all observations instead of their projection (slower,
    /// more memory)
    #[arg(long)]
    full_rows: bool,
    /// How the BRDF, which is found from luminance, is coloured
    #[arg(long, value_enum, default_value_t = colour::ColourName::Estimate)]
    color: colour::ColourName,
    /// Linear colour of a white matte ball, or of a grey card towards the camera, in the object's
    /// place, where it is known; its brightness does not matter
    #[arg(long, value_name = "R,G,B", value_parser = colour::parse_light, conflicts_with = "light")]
    light_color: Option<[f64; 3]>,
    /// Write no report.html, which takes a few seconds
    #[arg(long, env = "GONIO_NO_REPORT")]
    no_report: bool,
    /// Observe regions of another colour (paint, stickers) as well, which are left out where they
    /// are told safely from reflections
    #[arg(long)]
    keep_colors: bool,
    #[command(flatten)]
    reading: photograph::Reading,
    /// Radiance at which the camera clips; found by itself where many pixels share the maximum
    #[arg(long, value_name = "VALUE")]
    clip: Option<f32>,
}

/// Shapes known by name.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Shape {
    /// A ball: orthographic, or in perspective with --camera
    Sphere,
    /// An ellipsoid seen orthographically, one of its axes towards the camera
    Ellipsoid,
}

/// Names of the methods.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum MethodName {
    /// Posterior of the material with the light integrated out over captured lights, learnt
    /// beforehand
    #[value(alias = "marginal")]
    Learnt,
    /// Separable posterior of light and reflectance (Algorithm 1 of the paper)
    Variational,
    /// Joint maximum of light and reflectance: falls for the mirror in a blurry world
    Map,
    /// The light is given by --light
    KnownLight,
}

/// Names of the solvers.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SolverName {
    /// Exact minimisation of C_KL block by block: faster, lower C_KL
    Blocks,
    /// Parallel updates and line searches, with what makes them converge
    Parallel,
    /// Algorithm 1 to the letter
    Printed,
}

fn parse_positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0).ok_or_else(|| "give a positive number".into())
}

fn parse_circle(text: &str) -> Result<Circle, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, radius]) if radius > 0.0 => Ok(Circle { x, y, radius }),
        _ => Err("give three numbers, X,Y,RADIUS, in pixels".into()),
    }
}

/// What a method found.
struct Answer {
    /// Reflectance, of albedo [`ALBEDO`].
    table: BivariateTable,
    /// The light on the scale that goes with it, for a blind method.
    light: Option<LightGrid>,
    /// What the pictures say of the fit.
    caption: String,
    /// Sections of result.json.
    sections: Value,
    /// Seconds of the stages.
    seconds: Vec<(&'static str, f64)>,
    /// How sure the reflectance is, for the method that tells.
    material: Option<Material>,
}

/// The name of a value as the command line takes it.
fn name_of(value: MethodName) -> String {
    value.to_possible_value().map(|v| v.get_name().to_owned()).unwrap_or_default()
}

impl Options {
    /// How the posterior is found.
    fn method(&self) -> MethodName {
        if self.paper { MethodName::Variational } else { self.method }
    }
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let start = Instant::now();
    let mut warnings = Vec::new();
    if (options.method() == MethodName::KnownLight) != options.light.is_some() {
        bail!("--method known-light and --light MAP go together: give both or neither");
    }
    if !options.grid.is_power_of_two() || !(4..=512).contains(&options.grid) {
        bail!("--grid {}: give a power of two from 4 to 512", options.grid);
    }
    if let Some(clip) = options.clip.filter(|clip| clip.is_nan() || *clip <= 0.0) {
        bail!("--clip {clip}: give a positive radiance");
    }
    if options.light_color.is_some() && options.color != colour::ColourName::Estimate {
        bail!("--light-color serves --color estimate alone");
    }
    let mut model = input::model(options.model.as_deref())?;
    if options.paper {
        model.light = gonio_io::model::lighting_of_paper()?;
    }
    let covered = 1 << model.light.scales;
    if options.light.is_none() && options.grid > covered {
        bail!("--grid {}: the model's prior of light covers grids of up to {covered} texels a side", options.grid);
    }
    if options.method() == MethodName::Learnt {
        learnt::check(options, &model)?;
    }
    let model_seconds = start.elapsed().as_secs_f64();
    // Read before the long work, used again for the pictures.
    let known = options.light.as_deref().map(input::light).transpose()?;
    let Photograph { picture, clip, notes: bracket } =
        photograph::read(&options.image, &options.exposures, &options.reading, options.clip, &mut warnings)?;
    let (sighting, observations_notes) = observe::observe(options, &picture, clip, model.light.map, &mut warnings)?;
    // Made before the long work: a folder that cannot be made is told at once.
    let folder = StagedFolder::create(&options.output)?;
    let read_seconds = start.elapsed().as_secs_f64() - model_seconds;
    let (rule, assumption) = colour::rule(options, known.as_ref());
    let (answer, colouring) = match options.method() {
        MethodName::Learnt => {
            let settings = EstimateSettings { side: options.grid, colouring: rule, ..EstimateSettings::default() };
            learnt::answer(options, &model, &sighting.observations, &settings, &mut warnings)?
        }
        _ => {
            let answer = basis::answer(options, &model, known.as_ref(), &sighting.observations, &mut warnings)?;
            let colouring = Colouring::of(&sighting.observations, &answer.table, &rule);
            (answer, colouring)
        }
    };
    let stage = Stage::new("drawing");
    let subject = Subject {
        picture: &picture,
        sighting: &sighting,
        shadows: !options.no_shadows,
        colours: colouring.colours(),
        light_colour: colouring.light(),
        table: &answer.table,
        light: answer.light.as_ref(),
        known_light: known.as_ref(),
        material: answer.material.as_ref(),
    };
    let tables = subject.coloured(&answer.table);
    let (panels, fits) =
        rayon::join(|| Panels::draw(&subject, &|x| stage.at(x)), || (!options.no_report).then(|| Fits::of(&tables)));
    let caption = format!(
        "{} | {} observations | {} | {:.0} s",
        name_of(options.method()),
        sighting.observations.report.used,
        answer.caption,
        start.elapsed().as_secs_f64()
    );
    let drawing_seconds = stage.finish();
    let mut result = notes::head(&options.image.display().to_string(), &name_of(options.method()), &model);
    result["observations"] = observations_notes;
    result["colour"] = notes::colouring(&colouring, assumption);
    result["warnings"] = json!(warnings);
    if let Some(bracket) = bracket {
        result["bracket"] = bracket;
    }
    let mut seconds = json!({
        "model": model_seconds, "reading": read_seconds, "drawing": drawing_seconds,
    });
    seconds.as_object_mut().into_iter().for_each(|s| {
        s.extend(answer.seconds.iter().map(|(stage, seconds)| ((*stage).to_owned(), json!(seconds))));
    });
    notes::extend(&mut result, answer.sections);
    let write = |name: &str, bytes: &[u8]| folder.write(name, bytes);
    let writing = Instant::now();
    write("brdf.binary", &gonio_io::merl::encode(&MerlTable::from_bivariate(tables.each_ref())))?;
    if let Some(light) = &answer.light {
        write("light.exr", &gonio_io::picture::encode_exr(&light.to_lat_long(128), None))?;
    } else if let Some(known) = &known {
        write("light.exr", &gonio_io::picture::encode_exr(known.radiance(), None))?;
    }
    if let Some((_, relit)) = panels.spheres.first() {
        write("relit.png", &encode_png(relit))?;
    }
    if let (Some(used), Some(fates)) = (&panels.used, &sighting.observations.fates) {
        write("used.png", &encode_png(&gonio_report::panels::used::with_legend(used, fates)))?;
    }
    write("summary.png", &encode_png(&summary::compose(&subject, &panels, &caption)))?;
    if let Some(material) = &answer.material {
        let values = material.quantiles.concat();
        debug_assert_eq!(values.len(), material.quantiles.len() * CELLS);
        let array = npy::Array { shape: vec![material.quantiles.len(), THETA_H, THETA_D], values };
        write("brdf_quantiles.npy", &npy::encode(&array))?;
        write("uncertainty.png", &encode_png(&uncertainty::draw(material)))?;
    }
    seconds["writing"] = json!(writing.elapsed().as_secs_f64());
    seconds["total"] = json!(start.elapsed().as_secs_f64());
    result["seconds"] = seconds;
    if let Some(fits) = &fits {
        let name = options.image.file_stem().unwrap_or_default().to_string_lossy();
        let page =
            Report { name: &name, subject: &subject, panels: &panels, fits, warnings: &warnings, result: &result };
        write("report.html", page.render().as_bytes())?;
    }
    let text = serde_json::to_string_pretty(&result).context("the result cannot be written as JSON")?;
    write("result.json", text.as_bytes())?;
    folder.commit()?;
    let output = options.output.display().to_string();
    let page = if options.no_report { "result.json" } else { "report.html" };
    let text = format!(
        "{output}: BRDF, light, pictures and {page} from {} observations in {:.1} s",
        sighting.observations.report.used,
        start.elapsed().as_secs_f64()
    );
    // What fills no screen; the rest is in result.json.
    let fields = ["method", "posterior", "colour", "noise", "seconds"].map(|key| (key.to_owned(), result[key].take()));
    let mut outcome = Outcome::new(text, json!({ "output": output })).warning(warnings);
    outcome.fields.extend(fields);
    Ok(outcome)
}
