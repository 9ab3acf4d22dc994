//! `gonio convert` converts a BRDF between file formats.

use std::path::PathBuf;

use anyhow::Result;
use gonio::reflectance::MerlTable;
use gonio_app::export::grey;
use gonio_io::atomic::write_file;
use gonio_io::brdf;
use serde_json::json;

use crate::input;
use crate::outcome::Outcome;

/// Options of `gonio convert`.
#[derive(clap::Args)]
pub(crate) struct ConvertOptions {
    /// BRDF to read: a result folder, or a file: .npz, MERL (.binary), RGL (RGB .bsdf), MDL
    /// (.mbsdf) or .csv
    input: PathBuf,
    /// File to write: X.binary, X_spec.bsdf, X.bsdf, X.mbsdf, X.npz or X.csv
    ///
    /// The name determines the format. X.binary is a MERL table, X.mbsdf a measurement for NVIDIA's
    /// MDL, X.npz has NumPy arrays as in a result, and X.csv is a text table. X_spec.bsdf has
    /// spectra, for pbrt-v4 and the spectral variants of Mitsuba 3. Any other .bsdf is RGB, for
    /// Mitsuba 3.
    output: PathBuf,
    /// Write the luminance to all three channels
    #[arg(long)]
    grey: bool,
}

pub(crate) fn run(options: &ConvertOptions) -> Result<Outcome> {
    let mut table = input::brdf(&options.input)?;
    if options.grey {
        let tables = grey(&table.to_bivariate());
        table = MerlTable::from_bivariate(tables.each_ref());
    }
    let name = options.input.file_stem().unwrap_or_default().to_string_lossy();
    write_file(&options.output, &brdf::encode(&options.output, &table, &name)?)?;
    let output = options.output.display().to_string();
    Ok(Outcome::new(output.clone(), json!({ "output": output })))
}
