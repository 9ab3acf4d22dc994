//! `gonio render`: a sphere of a BRDF under a light.

use std::path::PathBuf;

use anyhow::{Result, bail};
use gonio::picture::Plane;
use gonio::render::{Exposure, IntegratorSettings, LightTree, SphereSettings, render_sphere};
use gonio_io::atomic::write_file;

use crate::input;
use crate::progress::Stage;

/// Options of `gonio render`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// BRDF in the MERL format
    #[arg(long, value_name = "FILE.binary")]
    brdf: PathBuf,
    /// Lat-long light map (HDR, EXR, PFM)
    #[arg(long, value_name = "MAP")]
    light: PathBuf,
    /// Picture to write: .exr holds radiance and coverage, .png is tone-mapped for looking at
    #[arg(short, long, value_name = "X.exr|X.png")]
    output: PathBuf,
    /// Width and height in pixels
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=8192))]
    size: u32,
    /// Samples along each side of a pixel
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: u32,
    /// Sum of error bounds relative to the radiance; the true error is some fifty times smaller
    #[arg(long, default_value_t = IntegratorSettings::default().tolerance)]
    tolerance: f64,
}

pub(crate) fn run(options: &Options) -> Result<()> {
    let extension = options.output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let png = match extension.as_deref() {
        Some("png") => true,
        Some("exr") => false,
        _ => bail!("{}: write to a name ending in .exr or .png", options.output.display()),
    };
    if options.tolerance.is_nan() || options.tolerance <= 0.0 {
        bail!("--tolerance {}: give a positive number", options.tolerance);
    }
    let brdf = input::brdf(&options.brdf)?;
    let light = LightTree::of_map(&input::light(&options.light)?);
    let settings = SphereSettings {
        size: options.size as usize,
        samples: options.samples as usize,
        integrator: IntegratorSettings { tolerance: options.tolerance, ..IntegratorSettings::default() },
        ..SphereSettings::default()
    };
    let stage = Stage::new("rendering");
    let picture = render_sphere(&brdf, &light, &settings, &|x| stage.at(x));
    stage.finish();
    let bytes = if png {
        let covered = |i: usize| picture.alpha.as_ref().is_some_and(|a| a.as_slice()[i] > 0.99);
        let exposure = Exposure::by_quantile(&picture.rgb, covered, 0.9, 0.6);
        let shown: Plane<_> = picture.rgb.map(|p| exposure.apply(*p));
        gonio_io::picture::encode_png(&shown)
    } else {
        gonio_io::picture::encode_exr(&picture.rgb, picture.alpha.as_ref())
    };
    write_file(&options.output, &bytes)?;
    println!("{}", options.output.display());
    Ok(())
}
