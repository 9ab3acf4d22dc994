//! `gonio infer` estimates the BRDF of a photographed object and writes a folder of results.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use clap::ValueEnum;
use gonio::scene::Circle;
use gonio_app::folder::{default_output, for_results, holds_results, would_replace};
use gonio_app::names::{ALIGNMENTS, COLOURS, SOLVERS};
use gonio_app::regions::{InferenceOutcome, RegionsResult, infer_all};
use gonio_app::{
    Alignment, ColourMode, EnvironmentSource, KnownLight, Method, MirrorBall, ProgressLog, Settings, Source, Spaces,
};
use gonio_io::atomic::StagedFolder;
use gonio_io::result::Reference;
use gonio_paper::{PaperMethod, PaperSettings, Solver};
use serde_json::json;

use crate::input::{self, numbers};
use crate::light::{Reflectance, parse_reflectance};
use crate::names;
use crate::outcome::Outcome;
use crate::progress::ProgressLine;
use crate::scene::{SceneOptions, parse_circle};
use crate::space::OutputSpace;
use crate::suggestion::{self, plain};

/// Options of `gonio infer`.
#[derive(clap::Args)]
#[command(after_help = SHORT_EXAMPLES, after_long_help = EXAMPLES)]
pub(crate) struct InferOptions {
    #[command(flatten)]
    pub(crate) scene: SceneOptions,
    /// Known light: a lat-long map in camera coordinates
    ///
    /// The centre of the map is the direction -z, its top is +y. gonio light creates such a map
    /// from a photograph of a mirror ball. MAP can also be a text file of directional lights
    /// (docs/known-light.md).
    #[arg(long, value_name = "MAP", help_heading = LIGHT)]
    light: Option<PathBuf>,
    /// Outline of a mirror ball in the photograph, from which gonio measures the light
    ///
    /// X,Y,RADIUS are in pixels from the top left corner. The mirror ball must be beside the
    /// object, in the same light. If the object is a ball, gonio detects it; for any other object,
    /// specify --mask (docs/light-probe.md).
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, conflicts_with_all = ["light", "light_color"],
          help_heading = LIGHT)]
    mirror_ball: Option<Circle>,
    /// Reflectance of the mirror ball at normal incidence: one number, or one per channel
    ///
    /// Chrome has about 0.55 and polished silver 0.95. With this option, the BRDF is absolute.
    /// Without it, gonio assumes a grey ball and scales the BRDF to an albedo of 0.5.
    #[arg(long, value_name = "R|R,G,B", value_parser = parse_reflectance, requires = "mirror_ball", help_heading = LIGHT)]
    mirror_reflectance: Option<Reflectance>,
    /// Rotations of the environment map to try [default: small; --align-light without a value:
    /// vertical]
    #[arg(long, value_parser = names::parser(ALIGNMENTS), value_name = "HOW", requires = "light", num_args = 0..=1,
          default_missing_value = "vertical", help_heading = LIGHT)]
    align_light: Option<Alignment>,
    /// Estimate the absolute BRDF from a photograph and an environment map of the same scale
    ///
    /// Both must have the same exposure and white balance. Without this option, gonio scales the
    /// BRDF to an albedo of 0.5 at normal incidence.
    #[arg(long, requires = "light", help_heading = LIGHT)]
    absolute: bool,
    /// Ignore self-shadowing
    ///
    /// Each point receives all light above its horizon, even if other parts of the object block it.
    #[arg(long, help_heading = LIGHT)]
    no_shadows: bool,
    /// Estimation method [default: learnt, or known-light if the light is known]
    ///
    /// "The paper" is Romeiro and Zickler, Blind Reflectometry, ECCV 2010 (docs/paper.md).
    #[arg(long, value_enum, help_heading = METHOD)]
    method: Option<MethodName>,
    /// Model file to use instead of the embedded model
    #[arg(long, value_name = "FILE", help_heading = METHOD)]
    model: Option<PathBuf>,
    /// Texels along a side of the light grid [default: 32]
    ///
    /// A power of two from 4 up to the largest grid of the model's light prior, which is 128 for
    /// the embedded model.
    #[arg(long, value_name = "N", help_heading = METHOD)]
    grid: Option<usize>,
    /// Use the settings of the paper for a sphere
    ///
    /// These are the paper's octahedral map of the light, a prior of light without rotated maps,
    /// 8,600 normals, 10 basis functions, random starts, and Algorithm 1 as printed, which often
    /// does not converge.
    #[arg(long, help_heading = METHOD, conflicts_with_all = [
        "method", "solver", "grid", "model", "light", "mirror_ball", "normals", "mesh", "regions", "all_observations",
    ])]
    paper: bool,
    /// Number of random starts of the paper's methods [default: 4]
    ///
    /// Applies to --method variational, joint-map and known-light-basis, and to --paper.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = METHOD)]
    starts: Option<u32>,
    /// Seed of the random starts [default: 1]
    #[arg(long, value_name = "N", help_heading = METHOD)]
    seed: Option<u64>,
    /// Solver of --method variational [default: blocks]
    #[arg(long, value_parser = names::parser(SOLVERS), help_heading = METHOD)]
    solver: Option<Solver>,
    /// Run --method variational or joint-map on all observations
    ///
    /// By default, gonio projects the observations to fewer values, which saves time and memory.
    #[arg(long, help_heading = METHOD)]
    all_observations: bool,
    /// Known colour of the light
    ///
    /// This is the linear colour of a white matte ball, or of a grey card that faces the camera, at
    /// the position of the object. Only the ratios of the channels matter.
    #[arg(long, value_name = "R,G,B", value_parser = parse_light, conflicts_with = "light", help_heading = COLOUR)]
    light_color: Option<ColourMode>,
    /// Colour of the BRDF
    #[arg(long, value_parser = names::parser(COLOURS), default_value = "estimate", help_heading = COLOUR)]
    color: ColourMode,
    /// Folder for the results [default: IMAGE-gonio beside the photograph]
    ///
    /// gonio replaces the results of an earlier run and keeps all other files in the folder. If the
    /// default folder exists and does not contain results, gonio stops with an error.
    #[arg(short, long, value_name = "DIR", help_heading = OUTPUT)]
    pub(crate) output: Option<PathBuf>,
    /// Do not write report.html
    ///
    /// Setting GONIO_NO_REPORT=1 has the same effect.
    #[arg(long, env = "GONIO_NO_REPORT", hide_env_values = true, value_parser = parse_yes, help_heading = OUTPUT)]
    no_report: bool,
    /// Do not write pictures or report.html
    ///
    /// Pictures and report take about half of the time.
    /// Setting GONIO_NO_PICTURES=1 has the same effect.
    #[arg(long, env = "GONIO_NO_PICTURES", hide_env_values = true, value_parser = parse_yes, help_heading = OUTPUT)]
    no_pictures: bool,
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
  gonio infer ball.exr                            writes ball-gonio/; open report.html
  gonio infer photo.exr --mask mask.png -o out
  gonio infer photo.exr --circle 612,400,310
  gonio infer a.jpg b.jpg c.jpg -o out            exposures of one scene
  gonio infer photo.exr --light probe.hdr         the light is known
  gonio infer photo.exr --mesh statue.glb --pose pose.json --camera camera.json --mask mask.png
  gonio infer photo.exr --normals normals.exr --depth depth.exr --mask mask.png
  curl -s https://example.org/ball.exr | gonio infer - -o out

To check the detection of the object first, use gonio check. For many photographs, use gonio batch.";

/// Names of the methods.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum MethodName {
    /// Learnt posterior of the material, marginalised over captured lights
    Learnt,
    /// Separable posterior of light and reflectance (Algorithm 1 of the paper)
    Variational,
    /// Joint MAP estimate of light and reflectance; inaccurate, for comparison with the paper
    JointMap,
    /// Posterior of the material under the light of --light or --mirror-ball
    KnownLight,
    /// Coefficients of ten basis functions under the light of --light, as in the paper
    KnownLightBasis,
}

/// Parses a Boolean value.
pub(crate) fn parse_yes(text: &str) -> Result<bool, String> {
    match text.trim().to_ascii_lowercase().as_str() {
        "1" | "y" | "yes" | "t" | "true" | "on" => Ok(true),
        "" | "0" | "n" | "no" | "f" | "false" | "off" => Ok(false),
        _ => Err("expected 1 or 0, yes or no".into()),
    }
}

/// Parses `R,G,B`: three positive linear numbers.
fn parse_light(text: &str) -> Result<ColourMode, String> {
    let light: Option<[f64; 3]> = numbers(text).and_then(|numbers| numbers.try_into().ok());
    light.and_then(ColourMode::under).ok_or_else(|| "expected three positive linear numbers, R,G,B".into())
}

impl InferOptions {
    fn method(&self) -> Result<Method> {
        let usual = PaperSettings::default();
        let search = PaperSettings {
            solver: self.solver.unwrap_or_default(),
            starts: self.starts.map_or(usual.starts, |starts| starts as usize),
            seed: self.seed.unwrap_or(usual.seed),
            as_printed: self.paper,
            all_observations: self.all_observations,
            ..usual
        };
        let usual = if self.light.is_some() || self.mirror_ball.is_some() {
            MethodName::KnownLight
        } else {
            MethodName::Learnt
        };
        let name = if self.paper { MethodName::Variational } else { self.method.unwrap_or(usual) };
        if let Some(circle) = self.mirror_ball {
            if name != MethodName::KnownLight {
                bail!("--mirror-ball is for --method known-light; the other methods do not use it");
            }
            self.refuse_unused(name)?;
            let reflectance = self.mirror_reflectance.map_or([1.0; 3], |reflectance| reflectance.0);
            // Ball and object are in one picture, so there is no rotation to search.
            return Ok(Method::KnownLight(KnownLight {
                map: EnvironmentSource::MirrorBall(MirrorBall { circle, reflectance }),
                alignment: Alignment::Fixed,
                absolute: self.mirror_reflectance.is_some(),
            }));
        }
        let light = self.light.clone().map(Source::File);
        let method = match (name, light) {
            (MethodName::KnownLight, Some(map)) => {
                let alignment = self.align_light.unwrap_or_default();
                Method::KnownLight(KnownLight { map: EnvironmentSource::Map(map), alignment, absolute: self.absolute })
            }
            (MethodName::KnownLightBasis, Some(map)) => Method::KnownLightBasis(search, map),
            (MethodName::KnownLight, None) => {
                bail!("--method known-light requires --light MAP or --mirror-ball X,Y,RADIUS")
            }
            (MethodName::KnownLightBasis, None) => bail!("--method known-light-basis requires --light MAP"),
            (_, Some(_)) => {
                bail!(
                    "--light MAP is for --method known-light and known-light-basis; the other methods estimate the light"
                )
            }
            (MethodName::Learnt, None) => Method::Learnt,
            (MethodName::Variational, None) => Method::Paper(search),
            (MethodName::JointMap, None) => Method::Paper(PaperSettings { method: PaperMethod::JointMap, ..search }),
        };
        self.refuse_unused(name)?;
        Ok(method)
    }

    /// Rejects options that the method does not use.
    fn refuse_unused(&self, method: MethodName) -> Result<()> {
        use MethodName as M;
        let searches: &[M] = &[M::Variational, M::JointMap, M::KnownLightBasis];
        let blind: &[M] = &[M::Learnt, M::Variational, M::JointMap];
        for (given, option, of) in [
            (self.absolute, "--absolute", &[M::KnownLight][..]),
            (self.align_light.is_some(), "--align-light", &[M::KnownLight]),
            (self.solver.is_some(), "--solver", &[M::Variational]),
            (self.starts.is_some(), "--starts", searches),
            (self.seed.is_some(), "--seed", searches),
            (self.all_observations, "--all-observations", &[M::Variational, M::JointMap]),
            // Every method computes shadows on the grid.
            (self.grid.is_some() && !self.scene.has_shadows(), "--grid", blind),
        ] {
            if given && !of.contains(&method) {
                let names: Vec<String> =
                    of.iter().filter_map(|m| Some(m.to_possible_value()?.get_name().to_owned())).collect();
                let own = method.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
                bail!("{option} is for --method {}; method {own} does not use it", names.join(", "));
            }
        }
        Ok(())
    }

    fn colours(&self) -> Result<ColourMode> {
        match (self.color, self.light_color) {
            (color, None) => Ok(color),
            (ColourMode::Estimate, Some(under)) => Ok(under),
            (_, Some(_)) => bail!("--light-color requires --color estimate"),
        }
    }

    /// Returns the folder of results: the specified one, or the default beside the photograph.
    fn folder(&self) -> Result<PathBuf> {
        let image = self.scene.image();
        let output = match &self.output {
            Some(output) => output.clone(),
            None if input::is_stdin(&image) => {
                bail!("standard input has no default folder for the results; specify one with -o DIR");
            }
            None => {
                let problem = "does not contain results of gonio infer; specify another folder with -o DIR";
                input::check_default(default_output(&image), holds_results, problem)?
            }
        };
        let mut inputs = self.scene.input_files();
        inputs.extend(self.light.iter().chain(&self.model));
        if let Some(input) = inputs.into_iter().find(|input| would_replace(&output, input)) {
            bail!(
                "{}: results in {} would overwrite this input; specify another folder",
                input.display(),
                output.display()
            );
        }
        Ok(output)
    }
}

pub(crate) fn run(options: &InferOptions) -> Result<Outcome> {
    let start = Instant::now();
    let settings = Settings {
        method: options.method()?,
        side: options.grid.unwrap_or(32),
        shadows: !options.no_shadows,
        colours: options.colours()?,
        pictures: !options.no_pictures,
        report: !(options.no_report || options.no_pictures),
        spaces: Spaces { input: options.scene.reading.colour_space(), output: options.space.space() },
        words: &suggestion::words,
    };
    let line = ProgressLine::new("model");
    let listener = |stage, fraction| line.report(stage, fraction);
    let progress_log = ProgressLog::new("model", &listener);
    let (model, name) = input::model(options.model.as_deref())?;
    // Created before the estimation, so that an error in the folder is reported at once.
    let output = options.folder()?;
    let folder = for_results(&output)?;
    let (scene, regions) = (options.scene.scene()?, options.scene.regions());
    let outcome = infer_all((&model, &name), scene, regions.as_ref(), &settings, &progress_log).map_err(plain)?;
    let inferred = match outcome {
        InferenceOutcome::Material(inferred) => inferred,
        InferenceOutcome::Regions(several) => {
            let outcome = write_regions(&several, folder, &progress_log, start);
            line.finish();
            return outcome;
        }
    };
    progress_log.report("writing", 0.0);
    folder.fill(&inferred.files().encode())?;
    line.finish();
    let output = output.display().to_string();
    let files = match (settings.pictures, settings.report) {
        (true, true) => "light, pictures and report.html",
        (true, false) => "light, pictures and result.json",
        _ => "light and result.json",
    };
    let mut text = format!(
        "{output}: BRDF, {files} from {} pixels in {:.1} s",
        inferred.scene.detection.observations.report.used_pixels,
        start.elapsed().as_secs_f64()
    );
    if let Some(reliability) = inferred.scene.detection.reliability {
        text += &format!("\nball {reliability}");
    }
    if let Some(material) = &inferred.material {
        text += &format!("\n{}", material.verdict());
    }
    text += &albedo_by_reference(inferred.document.reference.as_ref());
    Ok(Outcome::of_result(text, &output, &inferred.document).described_warnings(inferred.warnings))
}

/// Returns the line on the albedo from a reference; empty if there is no reference with a scale.
fn albedo_by_reference(reference: Option<&Reference>) -> String {
    reference.and_then(|reference| reference.scale).map_or_else(String::new, |scale| {
        let (albedo, [low, high]) = (scale.normal_albedo, scale.normal_albedo_interval_90);
        format!(
            "\nalbedo at normal incidence {albedo:.3} (90 % interval {low:.3} to {high:.3}), from the reference in the image"
        )
    })
}

/// Writes the results of several regions.
fn write_regions(
    several: &RegionsResult,
    folder: StagedFolder,
    progress_log: &ProgressLog<'_>,
    start: Instant,
) -> Result<Outcome> {
    progress_log.report("writing", 0.0);
    let output = folder.target().display().to_string();
    folder.fill(&several.files())?;
    let names: Vec<&str> = several.regions.iter().map(|region| region.name.as_str()).collect();
    let seconds = start.elapsed().as_secs_f64();
    let mut text = format!("{output}: BRDFs of {} regions ({}) in {seconds:.1} s", names.len(), names.join(", "));
    for region in &several.document.regions {
        let verdict = region.verdict.as_deref().unwrap_or("no interval");
        text += &format!("\nregion {}: {verdict}", region.name);
    }
    let mut warnings = several.document.warnings.clone();
    for region in &several.regions {
        warnings.extend(region.result.warnings.iter().map(|warning| format!("region {}: {warning}", region.name)));
    }
    let mut outcome = Outcome::new(text, json!({ "output": output })).described_warnings(warnings);
    outcome.fields.extend([("regions".to_owned(), json!(several.document.regions))]);
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_colour_requires_three_positive_numbers() {
        assert_eq!(parse_light("1, 0.8,0.5").ok(), ColourMode::under([1.0, 0.8, 0.5]));
        assert!(parse_light("1, 0.8,0.5").is_ok());
        for wrong in ["", "1,1", "1,1,0", "1,1,nan", "1,1,-1", "1,1,1,1", "red"] {
            assert!(parse_light(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn parses_common_words_for_yes_and_no() {
        for (text, yes) in [("1", true), ("yes", true), ("TRUE", true), ("0", false), ("", false), ("no", false)] {
            assert_eq!(parse_yes(text), Ok(yes), "{text:?}");
        }
        assert!(parse_yes("perhaps").is_err());
    }
}
