//! `gonio render` renders a sphere or a mesh with a BRDF under an environment map.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;
use gonio::render::{
    Accuracy, Brdf, Exposure, IntegratorSettings, LightTree, SphereSettings, SurfaceSettings, render_spheres,
    render_surfaces,
};
use gonio_app::draws;
use gonio_app::results::brdf_in;
use gonio_io::atomic::write_file;
use gonio_io::colour_space::ColourSpace;
use rayon::prelude::*;
use serde_json::json;

use crate::input;
use crate::outcome::Outcome;
use crate::progress::ProgressLine;
use crate::space::SpaceName;
use crate::suggestion::{self, plain};
use crate::surface::SurfaceOptions;

/// Options of `gonio render`.
#[derive(clap::Args)]
pub(crate) struct RenderOptions {
    /// BRDF: a result folder, or a file: .npz, MERL (.binary), RGL (.bsdf), MDL (.mbsdf) or .csv
    #[arg(long, value_name = "DIR|FILE.npz|FILE.binary|FILE.bsdf|FILE.mbsdf|FILE.csv")]
    brdf: PathBuf,
    /// Render N materials drawn from the posterior, to show the uncertainty (5 to 500)
    ///
    /// --brdf is a result folder, or the file brdf.npz in it. An .exr contains the median of the
    /// renderings, and as layers `low` and `high` the ends of the 90 % interval of each pixel. A
    /// .png shows five of the draws, from dull to glossy. All draws have the albedo and the chroma
    /// of the estimate.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(5..=500))]
    draws: Option<u32>,
    /// Seed of the draws
    #[arg(long, default_value_t = 0, requires = "draws")]
    seed: u64,
    /// Model file with which the results were inferred, with --draws [default: the embedded model]
    #[arg(long, value_name = "FILE", requires = "draws")]
    model: Option<PathBuf>,
    /// Lat-long environment map in camera coordinates: HDR, EXR or PFM
    ///
    /// MAP can also be a text file of directional lights (docs/known-light.md), or a built-in
    /// light: studio, sky or lamp.
    #[arg(long, value_name = "MAP")]
    light: PathBuf,
    /// Colour space of an environment map that does not state one [default: rec709]
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
    /// the resolution of the environment map, with an error of about 0.5 % but no bound.
    #[arg(long)]
    tolerance: Option<f64>,
}

pub(crate) fn run(options: &RenderOptions) -> Result<Outcome> {
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
    let size = (options.size as usize, options.height.unwrap_or(options.size) as usize);
    let pictures = options.draws.map_or(1, |count| if png { STRIP_QUANTILES.len() } else { count as usize });
    let gigabytes = (pictures * size.0 * size.1 * size_of::<Vec3>()) as f64 / 1e9;
    if gigabytes > MAX_GIGABYTES {
        bail!(
            "--draws: the renderings take {gigabytes:.0} GB of memory (limit {MAX_GIGABYTES:.0}); use fewer draws or a \
             smaller --size"
        );
    }
    let materials: Vec<Box<dyn Brdf>> = match options.draws {
        None => vec![Box::new(input::brdf(&options.brdf)?)],
        Some(count) => {
            let drawn = options.drawn(count as usize)?;
            let shown = if png {
                STRIP_QUANTILES.map(|share| (share * (drawn.len() - 1) as f64).round() as usize).to_vec()
            } else {
                (0..drawn.len()).collect()
            };
            shown.into_iter().map(|at| Box::new(drawn[at].clone()) as Box<dyn Brdf>).collect()
        }
    };
    let light = LightTree::of_map(&input::light(&options.light, options.colorspace.map(|name| name.0))?);
    let bound = |tolerance| Accuracy::Bound(IntegratorSettings { tolerance, ..IntegratorSettings::default() });
    let accuracy = options.tolerance.map_or_else(Accuracy::default, bound);
    let samples = options.samples as usize;
    let mut warnings = Vec::new();
    let placed = match options.surface.mesh() {
        Some(shape) => shape.surface(size, &mut warnings).map_err(plain)?,
        None => None,
    };
    let line = ProgressLine::new("rendering");
    let brdfs: Vec<&dyn Brdf> = materials.iter().map(AsRef::as_ref).collect();
    let render = |(at, brdfs): (usize, &[&dyn Brdf])| {
        let progress = |x| line.report("rendering", (at as f64 + x) / materials.len().div_ceil(DRAWS_PER_PASS) as f64);
        match &placed {
            Some(placed) => {
                let settings = SurfaceSettings { samples, accuracy, shadows: !options.no_shadows };
                render_surfaces(brdfs, &light, placed.surface.as_ref(), &placed.camera, &settings, &progress)
            }
            None => {
                let settings = SphereSettings { size: size.0, samples, accuracy };
                render_spheres(brdfs, &light, &settings, &progress)
            }
        }
    };
    let pictures: Vec<Picture> = brdfs.chunks(DRAWS_PER_PASS).enumerate().flat_map(render).collect();
    line.finish();
    let bytes = match (png, options.draws) {
        (true, _) => gonio_io::picture::encode_png(&strip(&pictures)),
        (false, None) => {
            let Picture { rgb, alpha } = &pictures[0];
            gonio_io::picture::encode_exr_in(rgb, alpha.as_ref(), ColourSpace::Rec709)
        }
        (false, Some(_)) => {
            let [low, median, high] = quantiles(&pictures);
            let layers = [("low", &low), ("high", &high)];
            gonio_io::picture::encode_exr_layers(&median, pictures[0].alpha.as_ref(), &layers)
        }
    };
    write_file(&options.output, &bytes)?;
    let output = options.output.display().to_string();
    Ok(Outcome::new(output.clone(), json!({ "output": output, "width": size.0, "height": size.1 }))
        .warning(suggestion::worded(&warnings)))
}

/// Shares of the ranks of the draws that a strip shows.
const STRIP_QUANTILES: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// Number of draws that are rendered together. Their tables fit into the cache.
const DRAWS_PER_PASS: usize = 20;

/// Largest memory of all renderings, in gigabytes.
const MAX_GIGABYTES: f64 = 4.0;

impl RenderOptions {
    /// Draws from the posterior in the folder of --brdf, from dull to glossy.
    fn drawn(&self, count: usize) -> Result<Vec<[BivariateTable; 3]>> {
        let is_empty = |path: &&Path| path.as_os_str().is_empty();
        let parent = self.brdf.parent().filter(|path| !is_empty(path)).unwrap_or(Path::new("."));
        let inside = brdf_in(parent).filter(|inside| inside.file_name() == self.brdf.file_name());
        let folder = if inside.is_some() { parent } else { &self.brdf };
        let (model, name) = input::model(self.model.as_deref())?;
        draws::of_result(folder, (&model, &name), count, self.seed).map_err(|error| plain(error.into_inner()))
    }
}

/// Places pictures side by side for display, at the exposure of the middle one.
fn strip(pictures: &[Picture]) -> Plane<Vec3> {
    let middle = &pictures[pictures.len() / 2];
    let covered = |i: usize| middle.alpha.as_ref().is_some_and(|a| a.as_slice()[i] > 0.99);
    let exposure = Exposure::by_quantile(&middle.rgb, covered, 0.9, 0.6);
    let (width, height) = middle.rgb.size();
    Plane::from_fn(width * pictures.len(), height, |x, y| exposure.apply(pictures[x / width].rgb[(x % width, y)]))
}

/// Returns the 5 %, 50 % and 95 % quantiles of each channel of each pixel, linear between ranks.
fn quantiles(pictures: &[Picture]) -> [Plane<Vec3>; 3] {
    let (width, height) = pictures[0].rgb.size();
    let pixel = |i: usize| {
        let mut found = [Vec3::ZERO; 3];
        for c in 0..3 {
            let mut values: Vec<f32> = pictures.iter().map(|picture| picture.rgb.as_slice()[i][c]).collect();
            values.sort_unstable_by(f32::total_cmp);
            for (quantile, share) in found.iter_mut().zip([0.05, 0.5, 0.95]) {
                let at = share * (values.len() - 1) as f32;
                let (below, above) = (values[at.floor() as usize], values[at.ceil() as usize]);
                quantile[c] = below + at.fract() * (above - below);
            }
        }
        found
    };
    let all: Vec<[Vec3; 3]> = (0..width * height).into_par_iter().map(pixel).collect();
    [0, 1, 2].map(|k| Plane::from_vec(width, height, all.iter().map(|found| found[k]).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_linear_between_ranks() {
        let picture = |v: f32| Picture { rgb: Plane::from_vec(1, 1, vec![Vec3::new(v, 10.0 * v, 1.0)]), alpha: None };
        let pictures: Vec<Picture> = [3.0, 1.0, 2.0, 5.0, 4.0].map(picture).into();
        let [low, median, high] = quantiles(&pictures).map(|plane| plane[(0, 0)]);
        assert!((low - Vec3::new(1.2, 12.0, 1.0)).length() < 1e-5, "{low}");
        assert_eq!(median, Vec3::new(3.0, 30.0, 1.0));
        assert!((high - Vec3::new(4.8, 48.0, 1.0)).length() < 1e-5, "{high}");
    }
}
