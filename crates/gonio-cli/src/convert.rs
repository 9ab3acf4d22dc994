//! `gonio convert` converts a BRDF between file formats.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use gonio::reflectance::MerlTable;
use gonio_app::export::grey;
use gonio_io::atomic::write_file;
use gonio_io::result_brdf::{self, ResultBrdf};
use gonio_io::rgl::{self, Channels};
use serde_json::json;

use crate::input;
use crate::outcome::Outcome;

/// Options of `gonio convert`.
#[derive(clap::Args)]
pub(crate) struct ConvertOptions {
    /// BRDF to read: a folder of results, an array (.npz), a MERL table (.binary), or an RGB file
    /// of RGL (.bsdf)
    input: PathBuf,
    /// File to write: X.binary, X_spec.bsdf, X.bsdf or X.npz
    ///
    /// The name determines the format. X.binary is a MERL table, X.npz has numpy arrays as in a
    /// result. X_spec.bsdf has spectra, for pbrt-v4 and the spectral variants of Mitsuba 3. Any
    /// other .bsdf is RGB, for Mitsuba 3.
    output: PathBuf,
    /// Write the luminance to all three channels
    #[arg(long)]
    grey: bool,
}

pub(crate) fn run(options: &ConvertOptions) -> Result<Outcome> {
    let format = Format::of(&options.output)?;
    let table = input::brdf(&options.input)?;
    let tables = || {
        let tables = [0, 1, 2].map(|c| table.bivariate(c));
        if options.grey { grey(&tables) } else { tables }
    };
    let bytes = match format {
        Format::Merl if options.grey => gonio_io::merl::encode(&MerlTable::from_bivariate(tables().each_ref())),
        Format::Merl => gonio_io::merl::encode(&table),
        Format::Npz => result_brdf::encode(&ResultBrdf { tables: tables(), quantiles: None }),
        Format::Rgl(channels) => {
            let name = options.input.file_stem().unwrap_or_default().to_string_lossy();
            rgl::encode(&tables(), &name, channels)
        }
    };
    write_file(&options.output, &bytes)?;
    let output = options.output.display().to_string();
    Ok(Outcome::new(output.clone(), json!({ "output": output })))
}

enum Format {
    Merl,
    Npz,
    Rgl(Channels),
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        Ok(if name.ends_with(".binary") {
            Self::Merl
        } else if name.ends_with(".npz") {
            Self::Npz
        } else if name.ends_with("_spec.bsdf") {
            Self::Rgl(Channels::Spectral)
        } else if name.ends_with(".bsdf") {
            Self::Rgl(Channels::Rgb)
        } else {
            bail!("{}: the output must be a .binary, .bsdf or .npz file", path.display())
        })
    }
}
