//! `gonio infer`: what the options ask for, and the folder of results.

mod shape;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use gonio::inference::Solver;
use gonio::scene::Circle;
use gonio_app::regions::{Inferred, Regions, Several, infer_all};
use gonio_app::{Alignment, Colours, Journal, KnownLight, Method, Scene, Search, Settings, Shots, Source};
use gonio_io::atomic::StagedFolder;
use serde_json::json;

use crate::input;
use crate::outcome::Outcome;
use crate::progress::Stages;
use crate::reading::ReadingOptions;
use crate::remedy::{self, plain};
use crate::surface::SurfaceOptions;
use shape::{NormalOptions, ShapeName};

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
    #[arg(long, value_enum, default_value_t = ShapeName::Sphere, conflicts_with_all = ["normals", "mesh"])]
    shape: ShapeName,
    /// Semi-axis of an ellipsoid towards the camera, in pixels
    #[arg(long, value_name = "PIXELS", value_parser = parse_positive, allow_negative_numbers = true)]
    depth_axis: Option<f64>,
    #[command(flatten)]
    surface: SurfaceOptions,
    /// Picture of the object's normals instead (EXR, NPY, PNG): camera space, x right, y up, z
    /// towards the camera
    #[arg(long, value_name = "FILE", conflicts_with = "mesh")]
    normals: Option<PathBuf>,
    #[command(flatten)]
    normal_options: NormalOptions,
    /// Take all light above a point's horizon to arrive there, whatever the object keeps from
    /// itself
    #[arg(long)]
    no_shadows: bool,
    /// Where the object is: a picture that is bright on it; without one, the alpha channel or a
    /// constant background tells
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// The sphere's outline in pixels, centre from the top left corner, if it is not to be found;
    /// several times for several balls
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, conflicts_with_all = ["normals", "mesh", "camera"])]
    circle: Vec<Circle>,
    /// Picture of regions of different materials, one index or colour for each, black where there
    /// is none: a BRDF for each, all under one light
    #[arg(long, value_name = "LABELS", conflicts_with = "paper")]
    materials: Option<PathBuf>,
    /// Model file instead of the one that travels with the program
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// How the posterior is found; known-light if --light is given, else learnt
    #[arg(long, value_enum)]
    method: Option<MethodName>,
    /// The paper's own version on a sphere: its map of light at one azimuth, 8,600 normals away
    /// from its poles, 10 basis functions, random starts, Algorithm 1 to the letter
    #[arg(long, conflicts_with_all = ["method", "solver", "grid", "model", "light", "normals", "mesh", "full_rows"])]
    paper: bool,
    /// Solver of --method variational
    #[arg(long, value_enum, default_value_t = SolverName::Blocks)]
    solver: SolverName,
    /// The light, if it is known: a lat-long map in camera space (-z at its centre, +y up), such as
    /// gonio light makes of a mirror ball, or a text file of directional lights
    #[arg(long, value_name = "MAP")]
    light: Option<PathBuf>,
    /// How far the light may be turned from where its map has it: by a few degrees, by any angle
    /// about the vertical, or not at all
    #[arg(long, value_enum, value_name = "HOW", requires = "light", num_args = 0..=1, default_missing_value = "around")]
    align_light: Option<AlignmentName>,
    /// Photograph and light map are on one scale (exposure, white balance): the BRDF is absolute,
    /// not of albedo one half
    #[arg(long, requires = "light")]
    absolute: bool,
    /// Seed of the random starts of --method variational, map and known-light-basis
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
    #[arg(long, value_enum, default_value_t = ColourName::Estimate)]
    color: ColourName,
    /// Linear colour of a white matte ball, or of a grey card towards the camera, in the object's
    /// place, where it is known; its brightness does not matter
    #[arg(long, value_name = "R,G,B", value_parser = parse_light, conflicts_with = "light")]
    light_color: Option<Colours>,
    /// Write no report.html, which takes a few seconds
    #[arg(long, env = "GONIO_NO_REPORT")]
    no_report: bool,
    /// Observe regions of another colour (paint, stickers) as well, which are left out where they
    /// are told safely from reflections
    #[arg(long)]
    keep_colors: bool,
    #[command(flatten)]
    reading: ReadingOptions,
    /// Radiance at which the camera clips; found by itself where many pixels share the maximum
    #[arg(long, value_name = "VALUE")]
    clip: Option<f32>,
}

/// Ways to colour the BRDF.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum ColourName {
    /// A colour of the body and one of the highlight, each with the light's colour taken off as far
    /// as the photograph tells it
    Estimate,
    /// The median colour of the photograph for all, light and reflectance together: how the paper
    /// displays its results
    Median,
    /// Three equal channels
    None,
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
    /// Posterior of the material under the light that --light gives
    KnownLight,
    /// Coefficients in ten functions under that light: the paper's estimate
    KnownLightBasis,
}

/// How far a light may be turned.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum AlignmentName {
    /// By a few degrees about any axis
    Near,
    /// By any angle about the vertical, and a few degrees about any axis
    Around,
    /// Not at all
    Fixed,
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

pub(crate) fn parse_circle(text: &str) -> Result<Circle, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, radius]) if radius > 0.0 => Ok(Circle { x, y, radius }),
        _ => Err("give three numbers, X,Y,RADIUS, in pixels".into()),
    }
}

/// `R,G,B`, linear, positive.
fn parse_light(text: &str) -> Result<Colours, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    let light: Option<[f64; 3]> = numbers.ok().and_then(|numbers| numbers.try_into().ok());
    light.and_then(Colours::under).ok_or_else(|| "give three positive numbers, R,G,B, on a linear scale".into())
}

impl Options {
    fn method(&self) -> Result<Method> {
        let solver = match self.solver {
            SolverName::Blocks => Solver::Blocks,
            SolverName::Parallel => Solver::Parallel,
            SolverName::Printed => Solver::Printed,
        };
        let (starts, seed) = (self.starts as usize, self.seed);
        let search = Search { solver, starts, seed, paper: self.paper, full_rows: self.full_rows };
        let usual = if self.light.is_some() { MethodName::KnownLight } else { MethodName::Learnt };
        let name = if self.paper { MethodName::Variational } else { self.method.unwrap_or(usual) };
        let light = self.light.clone().map(Source::File);
        if (self.absolute || self.align_light.is_some()) && name != MethodName::KnownLight {
            bail!("--absolute and --align-light are for --method known-light");
        }
        Ok(match (name, light) {
            (MethodName::KnownLight, Some(map)) => {
                let alignment = match self.align_light {
                    None | Some(AlignmentName::Near) => Alignment::Near,
                    Some(AlignmentName::Around) => Alignment::Around,
                    Some(AlignmentName::Fixed) => Alignment::Fixed,
                };
                Method::KnownLight(KnownLight { map, alignment, absolute: self.absolute })
            }
            (MethodName::KnownLightBasis, Some(map)) => Method::KnownLightBasis(search, map),
            (MethodName::KnownLight | MethodName::KnownLightBasis, None) => {
                bail!("this --method needs the light: give it with --light MAP")
            }
            (_, Some(_)) => {
                bail!("--light MAP is for --method known-light and known-light-basis: the other methods find it")
            }
            (MethodName::Learnt, None) => Method::Learnt,
            (MethodName::Variational, None) => Method::Variational(search),
            (MethodName::Map, None) => Method::JointMaximum(search),
        })
    }

    fn colours(&self) -> Result<Colours> {
        Ok(match (self.color, self.light_color) {
            (ColourName::Estimate, None) => Colours::Estimate,
            (ColourName::Estimate, Some(under)) => under,
            (_, Some(_)) => bail!("--light-color serves --color estimate alone"),
            (ColourName::Median, None) => Colours::Median,
            (ColourName::None, None) => Colours::Grey,
        })
    }

    /// The regions that are given, if any are.
    fn regions(&self) -> Option<Regions> {
        let labels = self.materials.clone().map(|labels| Regions::Labels(Source::File(labels)));
        labels.or_else(|| (self.circle.len() > 1).then(|| Regions::Circles(self.circle.clone())))
    }

    fn scene(&self) -> Scene {
        Scene {
            name: self.image.display().to_string(),
            shots: Shots::Files(std::iter::once(&self.image).chain(&self.exposures).cloned().collect()),
            reading: self.reading.reading(),
            clip: self.clip,
            mask: self.mask.clone().map(Source::File),
            keep_colours: self.keep_colors,
            shape: self.shape(),
        }
    }
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let start = Instant::now();
    let settings = Settings {
        method: options.method()?,
        side: options.grid,
        shadows: !options.no_shadows,
        colours: options.colours()?,
        pictures: true,
        report: !options.no_report,
        words: &remedy::words,
    };
    let line = Stages::new("model");
    let listener = |stage, fraction| line.at(stage, fraction);
    let journal = Journal::new("model", &listener);
    let (model, name) = input::model(options.model.as_deref())?;
    // Made before the long work: a folder that cannot be made is told at once.
    let folder = StagedFolder::create(&options.output)?;
    let (scene, regions) = (options.scene(), options.regions());
    let inferred = infer_all((&model, &name), scene, regions.as_ref(), &settings, &journal).map_err(plain)?;
    let answer = match inferred {
        Inferred::One(answer) => answer,
        Inferred::Several(several) => {
            let outcome = write_regions(&several, folder, &journal, start);
            line.finish();
            return outcome;
        }
    };
    journal.at("writing", 0.0);
    folder.fill(&answer.files().map_err(plain)?.encode())?;
    line.finish();
    let output = options.output.display().to_string();
    let page = if options.no_report { "result.json" } else { "report.html" };
    let text = format!(
        "{output}: BRDF, light, pictures and {page} from {} observations in {:.1} s",
        answer.seen.sighting.observations.report.used,
        start.elapsed().as_secs_f64()
    );
    // What fills no screen; the rest is in result.json.
    let mut notes = answer.notes;
    let fields = ["method", "posterior", "colour", "noise", "known_light", "exposure", "seconds"]
        .map(|key| (key.to_owned(), notes[key].take()));
    let mut outcome = Outcome::new(text, json!({ "output": output })).warning(answer.warnings);
    outcome.fields.extend(fields);
    Ok(outcome)
}

/// Writes the results of several regions.
fn write_regions(several: &Several, folder: StagedFolder, journal: &Journal<'_>, start: Instant) -> Result<Outcome> {
    journal.at("writing", 0.0);
    let output = folder.target().display().to_string();
    folder.fill(&several.files().map_err(plain)?)?;
    let names: Vec<&str> = several.regions.iter().map(|region| region.name.as_str()).collect();
    let seconds = start.elapsed().as_secs_f64();
    let text = format!("{output}: BRDFs of {} regions ({}) in {seconds:.1} s", names.len(), names.join(", "));
    let mut warnings: Vec<String> = Vec::new();
    for region in &several.regions {
        warnings.extend(region.answer.warnings.iter().map(|warning| format!("region {}: {warning}", region.name)));
    }
    let mut outcome = Outcome::new(text, json!({ "output": output })).warning(warnings);
    outcome.fields.extend([("regions".to_owned(), several.notes["regions"].clone())]);
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_light_are_three_positive_numbers() {
        assert_eq!(parse_light("1, 0.8,0.5").ok(), Colours::under([1.0, 0.8, 0.5]));
        assert!(parse_light("1, 0.8,0.5").is_ok());
        for wrong in ["", "1,1", "1,1,0", "1,1,nan", "1,1,-1", "1,1,1,1", "red"] {
            assert!(parse_light(wrong).is_err(), "{wrong}");
        }
    }
}
