//! `gonio infer`: photograph -> observations -> transfer -> inference -> posterior -> outputs.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::Vec3;
use gonio::inference::{
    Hyper, JointMapSettings, MODEL_ERROR, Method, Posterior, Problem, Solver, VariationalSettings,
    infer as find_posterior,
};
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::{IntegratorSettings, LightTree, images_of_basis};
use gonio::scene::{Circle, ObservationSettings, Observations, background_coverage, find_sphere};
use gonio::transfer::{PlanSettings, Projected};
use gonio_io::atomic::StagedFolder;
use gonio_io::cache::Cache;
use gonio_io::plan::{PlanOrigin, load_or_build};
use serde_json::json;

use crate::progress::Stage;
use crate::{input, summary};

/// Options of `gonio infer`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// HDR photograph (EXR, Radiance HDR, PFM; PNG, TIFF, JPEG with a warning)
    image: PathBuf,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Shape of the object, seen orthographically
    #[arg(long, value_enum, default_value_t = Shape::Sphere, conflicts_with = "normals")]
    shape: Shape,
    /// Picture of the object's normals instead (EXR, NPY, PNG): camera space, x right, y up, z towards the camera
    #[arg(long, value_name = "FILE")]
    normals: Option<PathBuf>,
    /// Where the object is: a picture that is bright on it; without one, the alpha channel or a constant background tells
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// The sphere's outline in pixels, centre from the top left corner, if it is not to be found
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, conflicts_with = "normals")]
    circle: Option<Circle>,
    /// Model file instead of the one that travels with the program
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// How the posterior is found
    #[arg(long, value_enum, default_value_t = MethodName::Variational)]
    method: MethodName,
    /// Solver of the variational method
    #[arg(long, value_enum, default_value_t = SolverName::Blocks)]
    solver: SolverName,
    /// The light, a lat-long map in camera space, for --method known-light
    #[arg(long, value_name = "MAP")]
    light: Option<PathBuf>,
    /// Seed of the random starts
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Random starts
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1000))]
    starts: u32,
    /// Texels along a side of the light grid, a power of two
    #[arg(long, default_value_t = 32)]
    grid: usize,
    /// Run on all observations instead of their projection (slower, more memory)
    #[arg(long)]
    full_rows: bool,
    /// Values of an integer picture are linear radiance, not sRGB-coded
    #[arg(long)]
    linear: bool,
    /// Radiance at which the camera clips; found by itself where many pixels share the maximum
    #[arg(long, value_name = "VALUE")]
    clip: Option<f32>,
}

/// Shapes known by name.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Shape {
    Sphere,
}

/// Names of the methods.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum MethodName {
    /// Separable posterior (Algorithm 1 of the paper)
    Variational,
    /// Joint maximum of light and reflectance: falls for the mirror in a blurry world
    Map,
    /// The light is given by --light
    KnownLight,
}

/// Names of the solvers.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SolverName {
    /// Exact minimisation of C_KL block by block: faster, lower C_KL
    Blocks,
    /// Algorithm 1 as printed: parallel update and line search
    Parallel,
}

fn parse_circle(text: &str) -> Result<Circle, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, radius]) if radius > 0.0 => Ok(Circle { x, y, radius }),
        _ => Err("give three numbers, X,Y,RADIUS, in pixels".into()),
    }
}

/// What the picture shows, and where.
struct Scene {
    observations: Observations,
    coverage: Option<Plane<f32>>,
    circle: Option<Circle>,
    normals: Option<Plane<Vec3>>,
    notes: serde_json::Value,
}

pub(crate) fn run(options: &Options) -> Result<()> {
    let start = Instant::now();
    let mut warnings = Vec::new();
    if (options.method == MethodName::KnownLight) != options.light.is_some() {
        bail!("--method known-light and --light MAP go together: give both or neither");
    }
    if !options.grid.is_power_of_two() || !(4..=512).contains(&options.grid) {
        bail!("--grid {}: give a power of two from 4 to 512", options.grid);
    }
    if let Some(clip) = options.clip.filter(|clip| clip.is_nan() || *clip <= 0.0) {
        bail!("--clip {clip}: give a positive radiance");
    }
    let model = input::model(options.model.as_deref())?;
    let covered = 1 << model.light.scales;
    if options.light.is_none() && options.grid > covered {
        bail!("--grid {}: the model's prior of light covers grids of up to {covered} texels a side", options.grid);
    }
    // Read before the long work, used again for the pictures.
    let known = options.light.as_deref().map(input::light).transpose()?;
    let decoded = input::photograph(&options.image, options.linear, &mut warnings)?;
    let clip = options.clip.or(decoded.full_scale);
    let picture = decoded.picture;
    let scene = observe(options, &picture, clip, &mut warnings)?;
    // Made before the long work: a folder that cannot be made is told at once.
    let folder = StagedFolder::create(&options.output)?;
    let read_seconds = start.elapsed().as_secs_f64();
    let (projected, plan_notes, plan_seconds) =
        project(options, &model, known.as_ref(), &scene.observations, &mut warnings)?;
    let (posterior, infer_seconds) = posterior(options, &model, &projected)?;
    let table = model.reflectance.combine(&posterior.reflectance)?;
    if table.trusted_max() <= 0.0 {
        bail!("{}: every reflectance coefficient came out zero; is the object lit at all?", options.image.display());
    }
    if posterior.starts.iter().all(|s| !s.converged) {
        warnings.push("no start converged within its iterations; the result may be rough".into());
    }
    // The image fixes the product of light and reflectance: reflectance gets an albedo of a half, light the rest.
    let scale = 0.5 / table.normal_albedo();
    let table = BivariateTable::from_vec(table.as_slice().iter().map(|x| (f64::from(*x) * scale) as f32).collect());
    let light = (options.method != MethodName::KnownLight).then(|| {
        let radiance: Vec<f64> = posterior.light.iter().map(|l| l * posterior.exposure / scale).collect();
        LightGrid::from_coefficients(model.light.map, &radiance)
    });
    let stage = Stage::new("drawing");
    let drawing = Instant::now();
    let pictures = summary::draw(
        &summary::Subject {
            picture: &picture,
            coverage: scene.coverage.as_ref(),
            circle: scene.circle,
            normals: scene.normals.as_ref(),
            colours: &scene.observations.colours,
            table: &table,
            light: light.as_ref(),
            known_light: known.as_ref(),
            caption: format!(
                "{:?} | {} observations | noise {:.1} % | {:.0} s",
                options.method,
                scene.observations.report.used,
                100.0 * posterior.noise / (projected.energy() / projected.pixels as f64).sqrt(),
                start.elapsed().as_secs_f64()
            ),
        },
        &|x| stage.at(x),
    );
    stage.finish();
    let result = json!({
        "format": "gonio-result",
        "version": 1,
        "gonio": env!("CARGO_PKG_VERSION"),
        "image": options.image.display().to_string(),
        "method": format!("{:?}", options.method),
        "settings": {
            "seed": options.seed, "starts": options.starts, "grid": options.grid,
            "solver": format!("{:?}", options.solver), "model_error": MODEL_ERROR,
            "full_rows": options.full_rows, "linear": options.linear,
        },
        "model": { "provenance": model.provenance, "rank": model.reflectance.len(), "map": model.light.map },
        "observations": scene.notes,
        "transfer": plan_notes,
        "reflectance": {
            "coefficients": posterior.reflectance,
            "sd": posterior.reflectance_sd,
            "scale": scale,
            "note": "BRDF = scale * sum_k coefficients[k] * basis[k], in 1/sr with a normal albedo of 0.5; the scale of \
                     reflectance is not determined by a photograph under unknown light",
        },
        "light": { "coefficients": posterior.light, "sd": posterior.light_sd },
        "exposure": { "mean": posterior.exposure, "sd": posterior.exposure_sd },
        "noise": { "sd": posterior.noise, "relative": posterior.noise / (projected.energy() / projected.pixels as f64).sqrt() },
        "cost": {
            "name": if options.method == MethodName::Map { "minus log posterior" } else { "C_KL" },
            "trace": posterior.trace, "starts": posterior.starts, "best_start": posterior.best_start,
        },
        "seconds": {
            "reading": read_seconds, "plan": plan_seconds, "inference": infer_seconds,
            "drawing": drawing.elapsed().as_secs_f64(), "total": start.elapsed().as_secs_f64(),
        },
        "warnings": warnings,
    });
    let write = |name: &str, bytes: &[u8]| folder.write(name, bytes);
    write("brdf.binary", &gonio_io::merl::encode(&MerlTable::from_bivariate([&table, &table, &table])))?;
    let text = serde_json::to_string_pretty(&result).context("the result cannot be written as JSON")?;
    write("result.json", text.as_bytes())?;
    if let Some(light) = &light {
        write("light.exr", &gonio_io::picture::encode_exr(&light.to_lat_long(128), None))?;
    } else if let Some(known) = &known {
        write("light.exr", &gonio_io::picture::encode_exr(known.radiance(), None))?;
    }
    write("relit.png", &gonio_io::picture::encode_png(&pictures.relit))?;
    write("summary.png", &gonio_io::picture::encode_png(&pictures.summary))?;
    folder.commit()?;
    input::warn(&warnings);
    println!(
        "{}: BRDF, light, pictures and result.json from {} observations in {:.1} s",
        options.output.display(),
        scene.observations.report.used,
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Finds the object and samples the picture on it.
fn observe(options: &Options, picture: &Picture, clip: Option<f32>, warnings: &mut Vec<String>) -> Result<Scene> {
    let name = || options.image.display().to_string();
    let mask = options.mask.as_deref().map(gonio_io::picture::read_mask).transpose()?;
    if let (Some(mask), Some(path)) = (&mask, &options.mask)
        && mask.size() != picture.rgb.size()
    {
        let ((w, h), (pw, ph)) = (mask.size(), picture.rgb.size());
        bail!("{}: the mask is {w}x{h}, the photograph {pw}x{ph}; give one of the same size", path.display());
    }
    let coverage = mask.or_else(|| picture.alpha.clone()).or_else(|| background_coverage(&picture.rgb));
    let settings = ObservationSettings { clip, ..ObservationSettings::default() };
    let (observations, circle, normals) = if let Some(path) = &options.normals {
        let normals = gonio_io::normals::read_normals(path)?;
        let found = Observations::of_normals(picture, &normals, coverage.as_ref(), &settings).with_context(|| {
            let mask = options.mask.as_ref().map(|mask| format!(" and {}", mask.display())).unwrap_or_default();
            format!("{} with {}{mask}", name(), path.display())
        })?;
        (found, None, Some(normals))
    } else {
        let Shape::Sphere = options.shape;
        let circle = match (&options.circle, &coverage) {
            (Some(circle), _) => *circle,
            (None, Some(coverage)) => {
                // What is wrong with an outline is wrong with the file it comes from.
                let origin = || options.mask.as_ref().map_or_else(name, |mask| mask.display().to_string());
                find_sphere(coverage).with_context(origin)?.circle
            }
            (None, None) => bail!(
                "{}: no alpha channel and no constant background to tell the ball from; give --mask FILE or --circle X,Y,RADIUS",
                name()
            ),
        };
        let found = Observations::of_sphere(picture, &circle, coverage.as_ref(), &settings).with_context(name)?;
        (found, Some(circle), None)
    };
    let report = &observations.report;
    if report.clipped_pixels > 0 {
        warnings.push(format!(
            "{}: {} of {} pixels on the object are clipped and left out",
            name(),
            report.clipped_pixels,
            report.observed_pixels
        ));
    }
    let notes = json!({ "report": report, "circle": circle });
    Ok(Scene { observations, coverage, circle, normals, notes })
}

/// The rows on which the inference runs.
fn project(
    options: &Options,
    model: &Model,
    known: Option<&EnvironmentMap>,
    observations: &Observations,
    warnings: &mut Vec<String>,
) -> Result<(Projected, serde_json::Value, f64)> {
    let tables = &model.reflectance.functions;
    if let (Some(path), Some(light)) = (&options.light, known) {
        let stage = Stage::new("rendering the basis");
        let tree = LightTree::of_map(light);
        let rows =
            images_of_basis(&observations.points, tables, &tree, &IntegratorSettings::default(), &|x| stage.at(x));
        let projected = Projected::under_known_light(&rows, tables.len(), &observations.values);
        return Ok((projected, json!({ "light": path.display().to_string() }), stage.finish()));
    }
    let settings = PlanSettings { side: options.grid, ..PlanSettings::default() };
    // Few observations: nothing to gain from a plan, which has more directions than there are values.
    if options.full_rows || observations.report.used <= settings.rank {
        let stage = Stage::new("integrating the basis");
        let projected =
            Projected::unprojected(&observations.points, &observations.values, tables, &model.light, &settings)?;
        return Ok((projected, json!({ "rows": observations.report.used, "full_rows": true }), stage.finish()));
    }
    let stage = Stage::new("planning (kept for next time)");
    let cache = Cache::user();
    let (plan, origin, failed) =
        load_or_build(cache.as_ref(), &observations.points, tables, &model.light, &settings, &|x| stage.at(x))?;
    if let Some(error) = failed {
        warnings.push(format!("the plan could not be kept for next time: {error}"));
    }
    let projected = plan.project(&observations.values, 1e-5)?;
    let seconds = stage.finish();
    let left_over = projected.left_over();
    if left_over > 0.02 {
        warnings.push(format!(
            "{:.0} % of the picture's energy is finer than a {} x {} light can make with any of these materials: a sharp \
             material is likely to come out too dull",
            100.0 * left_over,
            options.grid,
            options.grid
        ));
    }
    let notes = json!({
        "plan": if matches!(origin, PlanOrigin::Cache) { "cache" } else { "built" },
        "rank": projected.bilinear.rows(),
        "left_out_a_priori": plan.left_out(),
        "left_over_of_the_image": left_over,
    });
    Ok((projected, notes, seconds))
}

fn posterior(options: &Options, model: &Model, projected: &Projected) -> Result<(Posterior, f64)> {
    let rates = &model.reflectance.rates;
    let hyper = Hyper::with_model_error(projected.pixels);
    let variational = VariationalSettings {
        solver: match options.solver {
            SolverName::Blocks => Solver::Blocks,
            SolverName::Parallel => Solver::Parallel,
        },
        starts: options.starts as usize,
        seed: options.seed,
        ..VariationalSettings::default()
    };
    let (problem, method) = match options.method {
        MethodName::KnownLight => {
            let settings = VariationalSettings { solver: Solver::Blocks, ..variational };
            (Problem::with_known_light(projected, rates, hyper), Method::KnownLight(settings))
        }
        MethodName::Variational => {
            (Problem::blind(projected, &model.light, rates, hyper), Method::Variational(variational))
        }
        MethodName::Map => {
            let settings =
                JointMapSettings { starts: options.starts as usize, seed: options.seed, ..JointMapSettings::default() };
            (Problem::blind(projected, &model.light, rates, hyper), Method::JointMap(settings))
        }
    };
    let problem = problem.with_context(|| options.image.display().to_string())?;
    let problem = problem.starting_from(model.reflectance.materials.iter().map(|m| m.coefficients.clone()).collect());
    let stage = Stage::new("inferring");
    let posterior = find_posterior(&problem, &method, &|x| stage.at(x));
    Ok((posterior, stage.finish()))
}
