//! `gonio render` renders a sphere or a mesh with a BRDF under a light map.

use std::path::PathBuf;

use anyhow::{Result, bail};
use gonio::picture::Plane;
use gonio::render::{
    Accuracy, Exposure, IntegratorSettings, LightTree, SphereSettings, SurfaceSettings, render_sphere, render_surface,
};
use gonio_io::atomic::write_file;
use gonio_io::colour_space::ColourSpace;
use serde_json::json;

use crate::input;
use crate::outcome::Outcome;
use crate::progress::Stage;
use crate::space::SpaceName;
use crate::suggestion::{self, plain};
use crate::surface::SurfaceOptions;

/// Options of `gonio render`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// BRDF: a MERL table or an RGB file of the RGL database
    #[arg(long, value_name = "FILE.npz|FILE.binary|FILE.bsdf")]
    brdf: PathBuf,
    /// Lat-long light map in camera coordinates: HDR, EXR or PFM
    ///
    /// MAP can also be a text file of directional lights (docs/known-light.md), or a built-in
    /// light: studio, sky or lamp.
    #[arg(long, value_name = "MAP")]
    light: PathBuf,
    /// Colour space of a light map that does not state one [default: rec709]
    #[arg(long, value_enum, value_name = "SPACE")]
    colorspace: Option<SpaceName>,
    /// Image to write: .exr contains radiance and coverage, .png is tone-mapped for display
    #[arg(short, long, value_name = "X.exr|X.png")]
    output: PathBuf,
    #[command(flatten)]
    surface: SurfaceOptions,
    /// Ignore self-shadowing of the mesh
    #[arg(long, requires = "mesh")]
    no_shadows: bool,
    /// Width and height in pixels
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=8192))]
    size: u32,
    /// Height in pixels, with --mesh [default: the width]
    #[arg(long, value_parser = clap::value_parser!(u32).range(8..=8192), requires = "mesh")]
    height: Option<u32>,
    /// Samples per pixel along each axis
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: u32,
    /// Upper bound of the relative error of the radiance
    ///
    /// gonio subdivides the light until the sum of all error bounds is below this share of the
    /// radiance. Actual errors are much smaller: a bound of 0.2 gives an error of about 0.5 %, and
    /// takes five to ten times as long as the default. By default, gonio samples half vectors at
    /// the resolution of the light map, with an error of about 0.5 % but no bound.
    #[arg(long)]
    tolerance: Option<f64>,
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let extension = options.output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let png = match extension.as_deref() {
        Some("png") => true,
        Some("exr") => false,
        _ => bail!("{}: the output must be an .exr or .png file", options.output.display()),
    };
    if let Some(tolerance) = options.tolerance.filter(|t| t.is_nan() || *t <= 0.0) {
        bail!("--tolerance {tolerance}: must be a positive number");
    }
    if options.surface.mesh.is_none() && options.surface.camera.is_some() {
        bail!("--camera requires --mesh; spheres are rendered orthographically");
    }
    let brdf = input::brdf(&options.brdf)?;
    let light = LightTree::of_map(&input::light(&options.light, options.colorspace.map(|name| name.0))?);
    let bound = |tolerance| Accuracy::Bound(IntegratorSettings { tolerance, ..IntegratorSettings::default() });
    let accuracy = options.tolerance.map_or_else(Accuracy::default, bound);
    let samples = options.samples as usize;
    let size = (options.size as usize, options.height.unwrap_or(options.size) as usize);
    let mut warnings = Vec::new();
    let placed = match options.surface.mesh() {
        Some(shape) => shape.surface(size, &mut warnings).map_err(plain)?,
        None => None,
    };
    let stage = Stage::new("rendering");
    let picture = match &placed {
        Some(placed) => {
            let settings = SurfaceSettings { samples, accuracy, shadows: !options.no_shadows };
            render_surface(&brdf, &light, placed.surface.as_ref(), &placed.camera, &settings, &|x| stage.at(x))
        }
        None => {
            let settings = SphereSettings { size: size.0, samples, accuracy, ..SphereSettings::default() };
            render_sphere(&brdf, &light, &settings, &|x| stage.at(x))
        }
    };
    stage.finish();
    let bytes = if png {
        let covered = |i: usize| picture.alpha.as_ref().is_some_and(|a| a.as_slice()[i] > 0.99);
        let exposure = Exposure::by_quantile(&picture.rgb, covered, 0.9, 0.6);
        let shown: Plane<_> = picture.rgb.map(|p| exposure.apply(*p));
        gonio_io::picture::encode_png(&shown)
    } else {
        gonio_io::picture::encode_exr_in(&picture.rgb, picture.alpha.as_ref(), ColourSpace::Rec709)
    };
    write_file(&options.output, &bytes)?;
    let output = options.output.display().to_string();
    Ok(Outcome::new(output.clone(), json!({ "output": output, "width": size.0, "height": size.1 }))
        .warning(suggestion::worded(&warnings)))
}
