//! `gonio-eval recover`: what the estimators make of rendered spheres, judged by relighting and in the BRDF domain.
//!
//! Inputs are rendered from the full tables under full-resolution lights that the prior never saw; the basis holds all
//! materials (the paper's protocol). References: the mean of the training materials, a Lambertian answer, the known light.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use gonio::inference::{Hyper, JointMapSettings, Method, Posterior, Problem, Solver, VariationalSettings, infer};
use gonio::picture::luminance;
use gonio::reflectance::BivariateTable;
use gonio::render::{Brdf, IntegratorSettings, LightTree, SphereSettings, images_of_basis, radiance, render_sphere};
use gonio::scene::{ObservationSettings, sphere_points};
use gonio::transfer::{PlanSettings, Projected};
use gonio_io::cache::Cache;
use gonio_io::plan::load_or_build;
use rayon::prelude::*;

use crate::{data, metrics};

/// Options of `gonio-eval recover`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Folder of full MERL `.binary` files; all of them are tried
    #[arg(long)]
    merl: PathBuf,
    /// Only materials whose name contains this
    #[arg(long)]
    only: Option<String>,
    /// Test lights for the inputs
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace")]
    lights: Vec<String>,
    /// Test light for relighting
    #[arg(long, default_value = "debevec_galileo")]
    novel: String,
    /// Random starts of each estimator
    #[arg(long, default_value_t = 3)]
    starts: usize,
    /// Also run Algorithm 1 with the parallel update as printed (slow)
    #[arg(long)]
    parallel: bool,
    /// Texels along a side of the light grid
    #[arg(long, default_value_t = 32)]
    grid: usize,
}

/// One line of the table.
struct Row {
    method: &'static str,
    relight: metrics::Relight,
    brdf: f64,
}

pub(crate) fn run(folder: &Path, options: &Options) -> Result<()> {
    let model = gonio_io::model::embedded()?;
    let basis = &model.reflectance;
    let points = sphere_points(&ObservationSettings::default());
    let settings = PlanSettings { side: options.grid, ..PlanSettings::default() };
    let start = Instant::now();
    let cache = Cache::user();
    let (plan, ..) = load_or_build(cache.as_ref(), &points, &basis.functions, &model.light, &settings, &|_| ())?;
    eprintln!("plan in {:.1} s, leaves out {:.1e}", start.elapsed().as_secs_f64(), plan.left_out());
    let novel = LightTree::of_map(&data::test_light(folder, &options.novel)?);
    let all = data::materials(folder)?;
    let examples: Vec<Vec<f64>> = basis.materials.iter().map(|m| m.coefficients.clone()).collect();
    let mean: Vec<f64> =
        (0..basis.len()).map(|k| examples.iter().map(|e| e[k]).sum::<f64>() / examples.len() as f64).collect();
    let training_mean = basis.combine(&mean)?;
    let small = SphereSettings { size: 96, ..SphereSettings::default() };
    let show =
        |table: &dyn Brdf| metrics::sphere_pixels(&render_sphere(table, &novel, &small, &|_| ()), small.radius());
    let mut rows = Vec::new();
    println!(
        "| material | light | left over | estimator | relight | log | BRDF log | noise | starts: cost/iterations | s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (name, path) in gonio_io::merl::list(&options.merl)? {
        if options.only.as_ref().is_some_and(|only| !name.contains(only.as_str())) {
            continue;
        }
        let full = gonio_io::merl::read(&path)?;
        let truth = data::luminance_table(data::material(&all, &name)?);
        let envelope = full.envelope();
        let reference = show(&full);
        for light in &options.lights {
            let tree = LightTree::of_map(&data::test_light(folder, light)?);
            let accuracy = IntegratorSettings::default();
            let image: Vec<Option<f64>> = points
                .par_iter()
                .map(|p| Some(f64::from(luminance(radiance(p, &full, &envelope, &tree, &accuracy).as_vec3()))))
                .collect();
            let projected = plan.project(&image, 1e-5)?;
            let under_light = images_of_basis(&points, &basis.functions, &tree, &accuracy, &|_| ());
            let known = Projected::under_known_light(&under_light, basis.len(), &image);
            let rms = (projected.energy() / projected.pixels as f64).sqrt();
            let hyper = Hyper::with_model_error(projected.pixels);
            let blind = Problem::blind(&projected, &model.light, &basis.rates, hyper)?.starting_from(examples.clone());
            let known = Problem::with_known_light(&known, &basis.rates, hyper)?;
            let blocks = VariationalSettings { starts: options.starts, ..VariationalSettings::default() };
            let mut report = |method, table: &BivariateTable, posterior: Option<(Posterior, f64)>| {
                let row = Row {
                    method,
                    relight: metrics::relight(&show(table), &reference),
                    brdf: metrics::brdf_error(table, &truth),
                };
                let (noise, starts, seconds) = match posterior {
                    Some((p, seconds)) => {
                        let starts = p
                            .starts
                            .iter()
                            .map(|s| format!("{:.0}/{}{}", s.cost, s.iterations, if s.converged { "" } else { "!" }));
                        let starts = starts.collect::<Vec<String>>().join(" ");
                        (format!("{:.3}", p.noise / rms), starts, format!("{seconds:.1}"))
                    }
                    None => Default::default(),
                };
                println!(
                    "| {name} | {light} | {:.1e} | {method} | {:.3} | {:.3} | {:.2} | {noise} | {starts} | {seconds} |",
                    projected.left_over(),
                    row.relight.relative,
                    row.relight.log,
                    row.brdf
                );
                rows.push(row);
            };
            report("training mean", &training_mean, None);
            report("Lambertian", &BivariateTable::from_fn(|_, _| 1.0), None);
            let joint = JointMapSettings { starts: options.starts, ..JointMapSettings::default() };
            let mut methods = vec![
                ("known light", &known, Method::KnownLight(blocks)),
                ("C_KL, block solver", &blind, Method::Variational(blocks)),
                ("joint MAP", &blind, Method::JointMap(joint)),
            ];
            if options.parallel {
                let printed = VariationalSettings { solver: Solver::Parallel, ..blocks };
                methods.push(("Algorithm 1 as printed", &blind, Method::Variational(printed)));
            }
            for (label, problem, method) in methods {
                let start = Instant::now();
                let posterior = infer(problem, &method, &|_| ());
                let seconds = start.elapsed().as_secs_f64();
                report(label, &basis.combine(&posterior.reflectance)?, Some((posterior, seconds)));
            }
        }
    }
    println!("\n| estimator | cells | median relight | median log | median BRDF log |\n|---|---|---|---|---|");
    let mut labels: Vec<&str> = Vec::new();
    for row in &rows {
        if !labels.contains(&row.method) {
            labels.push(row.method);
        }
    }
    for label in labels {
        let of = |f: &dyn Fn(&Row) -> f64| metrics::median(rows.iter().filter(|r| r.method == label).map(f).collect());
        let count = rows.iter().filter(|r| r.method == label).count();
        let (relight, log) = (of(&|r| r.relight.relative), of(&|r| r.relight.log));
        println!("| {label} | {count} | {relight:.3} | {log:.3} | {:.2} |", of(&|r| r.brdf));
    }
    Ok(())
}
