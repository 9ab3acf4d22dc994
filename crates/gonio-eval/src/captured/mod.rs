//! `gonio-eval captured`: evaluates the default method on photographs of real objects, against
//! their measured BRDF and their photographs in other lights.
//!
//! [`object`] and [`slice`](mod@slice) hold the captured data, and [`errors`] compares a BRDF with
//! them. [`study`] estimates from each photograph, [`multi_view`] from several
//! photographs together. [`report`] writes the tables and [`page`] the pictures.
//!
//! Each estimate is compared with three references. The first is a Lambertian surface. The second
//! is the measured slice itself, whose only errors come from shadows, texture and registration. The
//! third is the profile of that slice, the best function of `theta_h` alone.

mod colour;
mod errors;
mod multi_view;
mod object;
mod page;
#[cfg(test)]
mod planted;
mod report;
mod slice;
mod study;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

pub(crate) use object::{Captured, reflected};
pub(crate) use slice::Cell;

use crate::data::ModelOption;

/// Options of `gonio-eval captured`.
#[derive(clap::Args)]
pub(crate) struct CapturedOptions {
    #[command(flatten)]
    model: ModelOption,
    /// Objects: names of folders in DATA/captured [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    objects: Vec<String>,
    /// Use the known lights of each photograph, like `gonio infer --light`
    #[arg(long)]
    lit: bool,
    /// Inflate the shape from the mask, like `gonio infer --shape outline`
    #[arg(long)]
    outline: bool,
    /// Folder for `captured.csv`, `captured.json` and pictures in `captured.html`
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(data: &Path, options: &CapturedOptions) -> Result<()> {
    let folders = if options.objects.is_empty() {
        object::folders(data)?
    } else {
        options.objects.iter().map(|name| data.join("captured").join(name)).collect()
    };
    let model = options.model.read()?;
    if let Some(out) = &options.out {
        std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    }
    let (mut records, mut together, mut sections, mut refused) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for folder in folders {
        if !folder.is_dir() {
            bail!("{}: there is no such object", folder.display());
        }
        let object = Captured::read(&folder)?;
        let study = study::ObjectEvaluation::new(&object).with_context(|| folder.display().to_string())?;
        let (estimates, without) =
            study.estimates(&model, study::EstimateInputs { normals: !options.outline, light: options.lit });
        refused.extend(without);
        if options.out.is_some() {
            sections.push(page::section(&object, &estimates));
        }
        together.push(study.several(&model, &estimates)?);
        records.extend(estimates.into_iter().map(|estimate| estimate.record));
    }
    if let Some(out) = &options.out {
        gonio_io::atomic::write_file(out.join("captured.csv"), report::csv(&records).as_bytes())?;
        gonio_io::atomic::write_file(out.join("captured.json"), &serde_json::to_vec_pretty(&records)?)?;
        gonio_io::atomic::write_file(out.join("captured.html"), page::page(&sections).as_bytes())?;
    }
    print!("{}\n{}", report::markdown(&records), multi_view::markdown(&together));
    if !refused.is_empty() {
        bail!("no estimate from {} of the photographs:\n{}", refused.len(), refused.join("\n"));
    }
    Ok(())
}
