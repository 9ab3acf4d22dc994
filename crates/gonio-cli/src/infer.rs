//! `gonio infer`: what the options ask for, and the folder of results.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use clap::ValueEnum;
use gonio::inference::Solver;
use gonio_app::folder::{beside, for_results, holds_results, would_replace};
use gonio_app::regions::{Inferred, Several, infer_all};
use gonio_app::{Alignment, Colours, Journal, KnownLight, Method, Search, Settings, Source, Spaces};
use gonio_io::atomic::StagedFolder;
use serde_json::{Value, json};

use crate::input;
use crate::outcome::{Outcome, sharpness};
use crate::progress::Stages;
use crate::remedy::{self, plain};
use crate::scene::SceneOptions;
use crate::space::OutputSpace;

/// Options of `gonio infer`.
#[derive(clap::Args)]
#[command(after_help = SHORT_EXAMPLES, after_long_help = EXAMPLES)]
pub(crate) struct Options {
    #[command(flatten)]
    pub(crate) scene: SceneOptions,
    /// The light, if it is known: a lat-long map
    ///
    /// In camera space (-z at its centre, +y up), such as gonio light makes of a mirror ball, or a
    /// text file of directional lights (docs/known-light.md).
    #[arg(long, value_name = "MAP", help_heading = LIGHT)]
    light: Option<PathBuf>,
    /// How far the light may be turned from where its map has it
    #[arg(long, value_enum, value_name = "HOW", requires = "light", num_args = 0..=1, default_missing_value = "around",
          help_heading = LIGHT)]
    align_light: Option<AlignmentName>,
    /// Photograph and light map are on one scale: the BRDF is absolute
    ///
    /// That is one exposure and white balance for both. Otherwise its albedo is one half.
    #[arg(long, requires = "light", help_heading = LIGHT)]
    absolute: bool,
    /// Take all light above a point's horizon to arrive there
    ///
    /// Whatever the object keeps from itself.
    #[arg(long, help_heading = LIGHT)]
    no_shadows: bool,
    /// How the material is found
    ///
    /// known-light if --light is given, else learnt.
    #[arg(long, value_enum, help_heading = METHOD)]
    method: Option<MethodName>,
    /// Model file instead of the one that travels with the program
    #[arg(long, value_name = "FILE", help_heading = METHOD)]
    model: Option<PathBuf>,
    /// Texels along a side of the light grid [default: 32]
    ///
    /// A power of two from 4 to what the model's prior of light covers, which is 128 for the model
    /// that travels with the program.
    #[arg(long, value_name = "N", help_heading = METHOD)]
    grid: Option<usize>,
    /// The paper's own version, on a sphere
    ///
    /// Its map of light at one azimuth, 8,600 normals away from its poles, 10 basis functions,
    /// random starts, Algorithm 1 to the letter.
    #[arg(long, help_heading = METHOD, conflicts_with_all = [
        "method", "solver", "grid", "model", "light", "normals", "mesh", "materials", "full_rows",
    ])]
    paper: bool,
    /// Random starts of the paper's methods [default: 4]
    ///
    /// For --method variational, map and known-light-basis, and --paper.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = METHOD)]
    starts: Option<u32>,
    /// Seed of these starts [default: 1]
    #[arg(long, value_name = "N", help_heading = METHOD)]
    seed: Option<u64>,
    /// Solver of --method variational [default: blocks]
    #[arg(long, value_enum, help_heading = METHOD)]
    solver: Option<SolverName>,
    /// Run --method variational or map on all observations
    ///
    /// Instead of their projection: slower, with more memory.
    #[arg(long, help_heading = METHOD)]
    full_rows: bool,
    /// Colour of the light, where it is known
    ///
    /// The linear colour of a white matte ball, or of a grey card towards the camera, in the
    /// object's place; its brightness does not matter.
    #[arg(long, value_name = "R,G,B", value_parser = parse_light, conflicts_with = "light", help_heading = COLOUR)]
    light_color: Option<Colours>,
    /// How the BRDF, which is found from luminance, is coloured
    #[arg(long, value_enum, default_value_t = ColourName::Estimate, help_heading = COLOUR)]
    color: ColourName,
    /// Folder for the results; IMAGE-gonio beside the photograph if not given
    ///
    /// Results of an earlier run that it holds are replaced; files of others stay. The folder
    /// beside the photograph is used again only if it holds results.
    #[arg(short, long, value_name = "DIR", help_heading = OUTPUT)]
    pub(crate) output: Option<PathBuf>,
    /// Write no report.html
    ///
    /// In the variable 1, yes, true or on write none; 0, no, false, off or nothing write it.
    #[arg(long, env = "GONIO_NO_REPORT", hide_env_values = true, value_parser = parse_yes, help_heading = OUTPUT)]
    no_report: bool,
    #[command(flatten)]
    space: OutputSpace,
}

const LIGHT: &str = "Light";
const METHOD: &str = "Method";
const COLOUR: &str = "Colour";
const OUTPUT: &str = "Output";

const SHORT_EXAMPLES: &str = "\
Example: gonio infer photo.exr --mask mask.png      All options: gonio infer --help";

const EXAMPLES: &str = "\
Examples:
  gonio infer ball.exr                            results in ball-gonio/, report.html first
  gonio infer photo.exr --mask mask.png -o out
  gonio infer photo.exr --circle 612,400,310
  gonio infer a.jpg b.jpg c.jpg -o out            exposures of one scene
  gonio infer photo.exr --light probe.hdr         the light is known
  gonio infer photo.exr --mesh statue.glb --pose pose.json --camera camera.json --mask mask.png
  gonio infer photo.exr --normals normals.exr --depth depth.exr --mask mask.png
  curl -s https://example.org/ball.exr | gonio infer - -o out

See whether the object is found first: gonio check. Many photographs: gonio batch.";

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

/// What people write for yes and no.
pub(crate) fn parse_yes(text: &str) -> Result<bool, String> {
    match text.trim().to_ascii_lowercase().as_str() {
        "1" | "y" | "yes" | "t" | "true" | "on" => Ok(true),
        "" | "0" | "n" | "no" | "f" | "false" | "off" => Ok(false),
        _ => Err("give 1 or 0, yes or no".into()),
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
            None | Some(SolverName::Blocks) => Solver::Blocks,
            Some(SolverName::Parallel) => Solver::Parallel,
            Some(SolverName::Printed) => Solver::Printed,
        };
        let (starts, seed) = (self.starts.unwrap_or(4) as usize, self.seed.unwrap_or(1));
        let search = Search { solver, starts, seed, paper: self.paper, full_rows: self.full_rows };
        let usual = if self.light.is_some() { MethodName::KnownLight } else { MethodName::Learnt };
        let name = if self.paper { MethodName::Variational } else { self.method.unwrap_or(usual) };
        let light = self.light.clone().map(Source::File);
        let method = match (name, light) {
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
        };
        self.refuse_unused(name)?;
        Ok(method)
    }

    /// Refuses options that a method does not use.
    fn refuse_unused(&self, method: MethodName) -> Result<()> {
        use MethodName as M;
        let searches: &[M] = &[M::Variational, M::Map, M::KnownLightBasis];
        let blind: &[M] = &[M::Learnt, M::Variational, M::Map];
        for (given, option, of) in [
            (self.absolute, "--absolute", &[M::KnownLight][..]),
            (self.align_light.is_some(), "--align-light", &[M::KnownLight]),
            (self.solver.is_some(), "--solver", &[M::Variational]),
            (self.starts.is_some(), "--starts", searches),
            (self.seed.is_some(), "--seed", searches),
            (self.full_rows, "--full-rows", &[M::Variational, M::Map]),
            // Shadows are found on the grid, whatever the method.
            (self.grid.is_some() && !self.scene.has_shadows(), "--grid", blind),
        ] {
            if given && !of.contains(&method) {
                let names: Vec<String> =
                    of.iter().filter_map(|m| Some(m.to_possible_value()?.get_name().to_owned())).collect();
                let own = method.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
                bail!("{option} is for --method {}: {own} does not use it", names.join(", "));
            }
        }
        Ok(())
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

    /// The folder of results: the one given, or one beside the photograph.
    fn folder(&self) -> Result<PathBuf> {
        let image = self.scene.image();
        let Some(output) = &self.output else {
            if input::is_stdin(&image) {
                bail!("- is standard input, and has no place for results beside it: give -o DIR");
            }
            let output = beside(&image);
            if output.exists() && !holds_results(&output) {
                bail!(
                    "{}: is there and holds no results of gonio infer; give another folder with -o DIR",
                    output.display()
                );
            }
            return Ok(output);
        };
        if let Some(image) = self.scene.images.iter().find(|image| would_replace(output, image)) {
            bail!("{}: results in {} would replace it; give another folder", image.display(), output.display());
        }
        Ok(output.clone())
    }
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let start = Instant::now();
    let settings = Settings {
        method: options.method()?,
        side: options.grid.unwrap_or(32),
        shadows: !options.no_shadows,
        colours: options.colours()?,
        pictures: true,
        report: !options.no_report,
        spaces: Spaces { input: options.scene.reading.colour_space(), output: options.space.space() },
        words: &remedy::words,
    };
    let line = Stages::new("model");
    let listener = |stage, fraction| line.at(stage, fraction);
    let journal = Journal::new("model", &listener);
    let (model, name) = input::model(options.model.as_deref())?;
    // Made before the long work: a folder that cannot be made is told at once.
    let output = options.folder()?;
    let folder = for_results(&output)?;
    let (scene, regions) = (options.scene.scene()?, options.scene.regions());
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
    let output = output.display().to_string();
    let page = if options.no_report { "result.json" } else { "report.html" };
    let mut text = format!(
        "{output}: BRDF, light, pictures and {page} from {} pixels in {:.1} s",
        answer.seen.sighting.observations.report.used_pixels,
        start.elapsed().as_secs_f64()
    );
    if let Some(sureness) = answer.seen.sighting.sureness {
        text += &format!("\nball {sureness}");
    }
    if let Some(material) = &answer.material {
        text += &format!("\n{}", sharpness(material));
    }
    text += &albedo_by_reference(&answer.notes["reference"]);
    // What fills no screen; the rest is in result.json.
    let mut notes = answer.notes;
    let fields =
        ["method", "posterior", "colour", "colorspace", "noise", "known_light", "exposure", "reference", "seconds"]
            .map(|key| (key.to_owned(), notes[key].take()));
    let mut outcome = Outcome::new(text, json!({ "output": output })).warning(answer.warnings);
    outcome.fields.extend(fields);
    Ok(outcome)
}

/// The line on the albedo that a reference in the picture gives; empty if it gives none.
fn albedo_by_reference(reference: &Value) -> String {
    let scale = &reference["scale"];
    let (albedo, interval) = (scale["normal_albedo"].as_f64(), &scale["normal_albedo_interval_90"]);
    match (albedo, interval[0].as_f64(), interval[1].as_f64()) {
        (Some(albedo), Some(low), Some(high)) => {
            format!("\nalbedo along the normal {albedo:.3} ({low:.3} to {high:.3}), by the reference in the picture")
        }
        _ => String::new(),
    }
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

    #[test]
    fn yes_and_no_are_said_in_several_ways() {
        for (text, yes) in [("1", true), ("yes", true), ("TRUE", true), ("0", false), ("", false), ("no", false)] {
            assert_eq!(parse_yes(text), Ok(yes), "{text:?}");
        }
        assert!(parse_yes("perhaps").is_err());
    }
}
