//! `gonio export`: a BRDF in the files and parameters of renderers.

use std::path::PathBuf;
use std::sync::LazyLock;

use anyhow::{Result, bail};
use clap::ValueEnum;
use clap::builder::PossibleValue;
use gonio_app::Spaces;
use gonio_app::export::{Export, Target, light_of_results};
use gonio_app::folder::{EXPORT, for_exports};
use serde_json::{Value, json};

use crate::input;
use crate::outcome::Outcome;
use crate::progress::Stage;
use crate::remedy::{plain, words};
use crate::space::OutputSpace;

/// Options of `gonio export`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Folder of results of `gonio infer`, or a BRDF (.binary, .bsdf)
    input: PathBuf,
    /// What to write; everything if not given
    #[arg(long, value_enum, value_delimiter = ',')]
    to: Vec<TargetName>,
    /// Folder to write to; `export` within the folder of results if not given
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Name of the material
    #[arg(long)]
    name: Option<String>,
    /// Scale the BRDF to this albedo of its luminance along the normal: a photograph under unknown
    /// light does not tell it
    #[arg(long, value_name = "ALBEDO", value_parser = parse_albedo, allow_negative_numbers = true)]
    albedo: Option<f64>,
    /// Write the table of each fitted model too (.binary), to be rendered beside the BRDF
    #[arg(long)]
    tables: bool,
    #[command(flatten)]
    space: OutputSpace,
}

/// The targets as the command line takes them.
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

fn parse_albedo(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|a: &f64| *a > 0.0 && *a <= 1.0).ok_or_else(|| "give a number above 0, at most 1".into())
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    if !options.input.exists() {
        bail!(
            "{}: there is no such file or folder; give a folder of results of gonio infer, or a BRDF (.binary, .bsdf)",
            options.input.display()
        );
    }
    let is_folder = options.input.is_dir();
    let file = if is_folder { options.input.join("brdf.binary") } else { options.input.clone() };
    if is_folder && !file.is_file() {
        bail!("{}: holds no brdf.binary; give a folder of results of gonio infer, or a BRDF", options.input.display());
    }
    let output = match &options.output {
        Some(output) => output.clone(),
        None if is_folder => options.input.join(EXPORT),
        None => bail!("give -o DIR: a single file has no folder of results to write to"),
    };
    let named = options.name.clone().or_else(|| {
        let of = if is_folder { options.input.file_name() } else { file.file_stem() };
        of.map(|name| name.to_string_lossy().into_owned())
    });
    let name = named.filter(|n| !n.is_empty()).unwrap_or_else(|| "gonio".to_owned());
    let table = input::brdf(&file)?;
    let light = if is_folder { light_of_results(&options.input).map_err(plain)? } else { None };
    let folder = for_exports(&output)?;
    let targets: Vec<Target> =
        if options.to.is_empty() { Target::ALL.to_vec() } else { options.to.iter().map(|name| name.0).collect() };
    let colours = [0, 1, 2].map(|c| table.bivariate(c));
    let export = Export {
        name,
        tables: colours.clone(),
        whole: Some(table),
        light,
        space: options.space.space(),
        albedo: options.albedo,
        with_tables: options.tables,
    };
    let stage = Stage::new("fitting models");
    let written = export.write(&folder, &targets, &options.input.display().to_string(), &|x| stage.at(x))?;
    stage.finish();
    let Some(summary) = written else { bail!("{}: reflects nothing along the normal", file.display()) };
    let warnings: Vec<String> = Spaces { input: None, output: options.space.space() }
        .warning(&colours)
        .iter()
        .map(|w| w.worded(&words))
        .collect();
    folder.commit()?;
    let line = |(target, entry): (&String, &Value)| {
        let files: Vec<&str> = entry["files"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let percent = 100.0 * entry["relight"].as_f64().unwrap_or(0.0);
        format!("{target:15} {:40} off by {percent:.1} %\n", files.join(", "))
    };
    let lines: String = summary["exports"].as_object().into_iter().flatten().map(line).collect();
    let output = output.display().to_string();
    let mut outcome = Outcome::new(format!("{lines}{output}"), summary).warning(warnings);
    outcome.fields.insert("output".into(), json!(output));
    Ok(outcome)
}
