//! `gonio export` writes a BRDF as files and parameters for renderers.

use std::path::PathBuf;
use std::sync::LazyLock;

use anyhow::{Result, bail};
use clap::ValueEnum;
use clap::builder::PossibleValue;
use gonio::reflectance::BivariateTable;
use gonio_app::Spaces;
use gonio_app::draws::{self, DrawsError};
use gonio_app::export::{DRAWS, Export, ResultProperties, Target};
use gonio_app::folder::{EXPORT, for_exports};
use gonio_app::results::{BRDF, brdf_in, regions_in};
use gonio_io::posterior::FILE;
use gonio_io::result::ExportEntry;
use serde_json::json;

use crate::input::{self, parse_share};
use crate::outcome::Outcome;
use crate::progress::ProgressLine;
use crate::space::OutputSpace;
use crate::suggestion::{plain, words};

/// Options of `gonio export`.
#[derive(Clone, clap::Args)]
pub(crate) struct ExportOptions {
    /// Result folder of gonio infer, or a BRDF file (.npz, .binary, .bsdf, .mbsdf, .csv)
    input: PathBuf,
    /// Renderers and models to export to, separated by commas [default: all but merl and merl-grey]
    #[arg(long, value_enum, value_delimiter = ',')]
    to: Vec<TargetName>,
    /// Folder to write to [default: export in the result folder]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Name of the material [default: the name of the input]
    #[arg(long)]
    name: Option<String>,
    /// Scale the BRDF to this luminance albedo at normal incidence
    ///
    /// A photograph under unknown light does not determine the albedo. If a target is the model of
    /// a renderer, gonio scales such a BRDF to the albedo at which these models fit best.
    #[arg(long, value_name = "ALBEDO", value_parser = parse_share, allow_negative_numbers = true)]
    albedo: Option<f64>,
    /// Also write each fitted model as a MERL table (.binary), to compare it with the BRDF
    #[arg(long)]
    tables: bool,
    /// Compute intervals of fitted parameters from N draws from the posterior; 0 disables intervals
    /// [default: 16]
    ///
    /// Only result folders of the learnt and known-light methods have a posterior.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=500))]
    draws: Option<u32>,
    /// Model file with which the results were inferred [default: the embedded model]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    #[command(flatten)]
    space: OutputSpace,
}

/// Export target as a command-line value.
#[derive(Clone, Copy, Debug)]
struct TargetName(Target);

impl ValueEnum for TargetName {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: LazyLock<[TargetName; 9]> = LazyLock::new(|| Target::ALL.map(TargetName));
        &*ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (name, help) = self.0.names();
        Some(PossibleValue::new(name).help(help))
    }
}

pub(crate) fn run(options: &ExportOptions) -> Result<Outcome> {
    if !options.input.exists() {
        bail!(
            "{}: file or folder not found; specify a result folder of gonio infer or a BRDF file (.npz, .binary, .bsdf, .mbsdf, .csv)",
            options.input.display()
        );
    }
    let regions = regions_in(&options.input)?;
    if !regions.is_empty() {
        return each_region(options, &regions);
    }
    let is_folder = options.input.is_dir();
    let file = if is_folder { brdf_in(&options.input) } else { Some(options.input.clone()) };
    let Some(file) = file else {
        bail!(
            "{}: does not contain {BRDF}; specify a result folder of gonio infer or a BRDF file",
            options.input.display()
        );
    };
    let output = match &options.output {
        Some(output) => output.clone(),
        None if is_folder => options.input.join(EXPORT),
        None => bail!("a BRDF file has no default output folder; specify one with -o DIR"),
    };
    let named = options.name.clone().or_else(|| {
        let of = if is_folder { options.input.file_name() } else { file.file_stem() };
        of.map(|name| name.to_string_lossy().into_owned())
    });
    let name = named.filter(|n| !n.is_empty()).unwrap_or_else(|| "gonio".to_owned());
    let table = input::brdf(&file)?;
    // A BRDF file has an absolute scale.
    let of_file = ResultProperties { light: None, absolute: true, roughness: None };
    let properties = if is_folder { ResultProperties::of(&options.input).map_err(plain)? } else { of_file };
    let folder = for_exports(&output).map_err(plain)?;
    let targets = wanted(options);
    let colours = table.to_bivariate();
    let (draws, undrawn) = drawn(options, is_folder)?;
    let export = Export {
        name,
        tables: colours.clone(),
        full_table: Some(table),
        light: properties.light,
        space: options.space.space(),
        albedo: options.albedo,
        absolute: properties.absolute,
        roughness: properties.roughness,
        with_tables: options.tables,
        draws,
    };
    let line = ProgressLine::new("fitting models");
    let input = options.input.display().to_string();
    let summary = export.write(&folder, &targets, &input, &|x| line.report("fitting models", x)).map_err(plain)?;
    line.finish();
    let warnings: Vec<String> = Spaces { input: None, output: options.space.space() }
        .warning(&file.display().to_string(), &colours)
        .iter()
        .map(|w| w.worded(&words))
        .chain(summary.warnings.iter().cloned())
        .chain(undrawn)
        .collect();
    folder.commit()?;
    let line = |(target, entry): (&String, &ExportEntry)| {
        let (found, ends) = (&entry.parameters["roughness"], &entry.intervals["roughness"]);
        let roughness = match (found.as_f64(), ends[0].as_f64(), ends[1].as_f64()) {
            (Some(found), Some(low), Some(high)) => {
                // Neither is the square root that the other models call roughness.
                let name = match target.as_str() {
                    "cook-torrance" => "slope m",
                    "ward" => "alpha",
                    _ => "roughness",
                };
                format!(", {name} {found:.2} ({low:.2} to {high:.2})")
            }
            _ => String::new(),
        };
        let is_coated = ["coat_weight", "clearcoat"].iter().any(|name| entry.parameters[name].as_f64() > Some(0.0));
        let coat = if is_coated { " under a coat" } else { "" };
        let files = entry.files.join(", ");
        format!("{target:15} fit error {:4.1} %{roughness}{coat}: {files}\n", 100.0 * entry.relight)
    };
    let lines: String = summary.exports.iter().map(line).collect();
    let output = output.display().to_string();
    let albedo = match summary.albedo_source.as_str() {
        "fit" => format!(
            "albedo at normal incidence {:.2}: the photograph does not determine it; gonio chose the largest albedo at which the models fit nearly best (change it with --albedo)\n",
            summary.albedo
        ),
        _ => String::new(),
    };
    let mut outcome = Outcome::new(format!("{lines}{albedo}{output}"), json!(summary)).warning(warnings);
    outcome.fields.insert("output".into(), json!(output));
    Ok(outcome)
}

/// Exports the regions of a photograph, each to its own folder.
fn each_region(options: &ExportOptions, regions: &[(String, PathBuf)]) -> Result<Outcome> {
    let (mut texts, mut warnings, mut fields) = (Vec::new(), Vec::new(), serde_json::Map::new());
    for (name, folder) in regions {
        let output = options.output.as_ref().map(|output| output.join(name));
        let outcome = run(&ExportOptions { input: folder.clone(), output, ..options.clone() })?;
        texts.push(format!("region {name}\n{}", outcome.text));
        warnings.extend(outcome.warnings.into_iter().map(|warning| format!("region {name}: {warning}")));
        fields.insert(name.clone(), serde_json::Value::Object(outcome.fields));
    }
    Ok(Outcome::new(texts.join("\n\n"), json!({ "regions": fields })).warning(warnings))
}

/// Seed of the draws.
const SEED: u64 = 0;

/// Returns draws from the posterior of a folder of results, if it has one, or a warning if the
/// posterior belongs to another model.
///
/// # Errors
/// If `--draws` or `--model` is given and intervals cannot be computed.
fn drawn(options: &ExportOptions, is_folder: bool) -> Result<(Vec<[BivariateTable; 3]>, Option<String>)> {
    let count = options.draws.map_or(DRAWS, |draws| draws as usize);
    if count == 0 {
        return Ok((Vec::new(), None));
    }
    let obstacle = if !wanted(options).into_iter().any(Target::is_fitted) {
        Some("--draws and --model apply to fitted models, and --to specifies none; remove these options".into())
    } else if !is_folder || !options.input.join(FILE).is_file() {
        Some(format!(
            "{}: does not contain a posterior, so the parameters have no intervals; specify a result folder of the learnt or known-light method, or remove --draws and --model",
            options.input.display()
        ))
    } else {
        None
    };
    let is_requested = options.draws.is_some() || options.model.is_some();
    match obstacle {
        Some(obstacle) if is_requested => bail!(obstacle),
        Some(_) => return Ok((Vec::new(), None)),
        None => {}
    }
    let (model, name) = input::model(options.model.as_deref())?;
    match draws::of_result(&options.input, (&model, &name), count, SEED) {
        Ok(draws) => Ok((draws, None)),
        Err(DrawsError::OtherModel(error)) if !is_requested => {
            Ok((Vec::new(), Some(format!("{}; the parameters have no intervals", plain(error)))))
        }
        Err(error) => Err(plain(error.into_inner())),
    }
}

/// Returns the targets of the options.
fn wanted(options: &ExportOptions) -> Vec<Target> {
    if options.to.is_empty() { Target::DEFAULT.to_vec() } else { options.to.iter().map(|name| name.0).collect() }
}
