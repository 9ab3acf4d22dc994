//! `gonio-eval recover`: what the estimators make of rendered spheres, judged by relighting and in the BRDF domain.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use gonio::inference::{Hyper, JointMapSettings, Method, Problem, VariationalSettings, Solver, infer};
use gonio::lighting::{LightGrid, LightPrior, PriorSettings};
use gonio::picture::luminance;
use gonio::reflectance::{BivariateTable, MerlTable, ReflectanceBasis};
use gonio::render::{IntegratorSettings, LightTree, SphereSettings, radiance, render_sphere};
use gonio::transfer::{Bilinear, Plan, PlanSettings, Projected, SurfacePoint};
use gonio::sphere::fibonacci_hemisphere;
use rayon::prelude::*;

use crate::{data, metrics};

#[derive(clap::Args)]
pub(crate) struct Options {
    #[arg(long)]
    merl: PathBuf,
    #[arg(long, default_value = "800")]
    rank: usize,
    #[arg(long, default_value = "400")]
    iterations: usize,
    #[arg(long, default_value = "3")]
    starts: usize,
    #[arg(long, default_value = "0")]
    noise: f64,
    #[arg(long)]
    only: Option<String>,
}

fn model(data: &Path) -> Result<(LightPrior, ReflectanceBasis)> {
    let cached = Path::new("/tmp/model.json");
    if let Ok(text) = std::fs::read_to_string(cached) {
        return Ok(serde_json::from_str(&text)?);
    }
    let start = Instant::now();
    let mut names: Vec<_> = std::fs::read_dir(data.join("lighting/train"))?.map(|e| e.unwrap().path()).collect();
    names.sort();
    let lights: Vec<LightGrid> = names
        .par_iter()
        .flat_map_iter(|p| {
            let map = data::read_map(p).unwrap();
            let w = map.radiance().width();
            (0..8).map(move |r| map.turned(r * w / 8).to_grid(Default::default(), 128)).collect::<Vec<_>>()
        })
        .collect();
    eprintln!("grids {:.1}", start.elapsed().as_secs_f64());
    let prior = LightPrior::learn(&lights, names.len(), &PriorSettings::default())?;
    eprintln!("prior {:.1}", start.elapsed().as_secs_f64());
    let materials: Vec<(String, BivariateTable)> =
        data::materials(data)?.into_iter().map(|(n, t)| (n, t[1].clone())).collect();
    let (basis, report) = gonio::reflectance::train(&materials, &Default::default())?;
    eprintln!("basis {:.1} {}", start.elapsed().as_secs_f64(), report.mean_rms());
    std::fs::write(cached, serde_json::to_string(&(&prior, &basis))?)?;
    Ok((prior, basis))
}

pub(crate) fn run(folder: &Path, options: &Options) -> Result<()> {
    let (prior, basis) = model(folder)?;
    let points: Vec<SurfacePoint> = fibonacci_hemisphere(12000)
        .filter(|n| n.z > 80.0_f64.to_radians().cos())
        .map(|normal| SurfacePoint { normal, view: glam::DVec3::Z })
        .collect();
    let typical: Vec<f64> = basis.rates.iter().map(|r| 1.0 / r).collect();
    let settings = PlanSettings { rank: options.rank, ..Default::default() };
    let start = Instant::now();
    let plan = Plan::build(&points, &basis.functions, &typical, &prior, &settings, &|_| ())?;
    eprintln!("plan {:.2} s, left out {:.2e}", start.elapsed().as_secs_f64(), plan.left_out());
    for r in [100, 200, 400, 800] {
        let kept: f64 = plan.energies.iter().take(r).sum();
        eprintln!("rank {r}: left out {:.2e}", 1.0 - kept / plan.total_energy);
    }
    let novel = LightTree::of_map(&data::test_light(folder, "debevec_galileo")?);
    let all = data::materials(folder)?;
    let training_mean = {
        let mut mean = vec![0.0; basis.len()];
        for m in &basis.materials {
            for (a, c) in mean.iter_mut().zip(&m.coefficients) { *a += c / basis.materials.len() as f64; }
        }
        basis.combine(&mean)?
    };
    let fast = SphereSettings { size: 96, ..Default::default() };
    let names: Vec<String> = gonio_io::merl::list(&options.merl)?.into_iter().map(|x| x.0).collect();
    println!("| material | light | method | relight | log | brdf log | seconds | iterations | cost |");
    for name in names {
        if options.only.as_ref().is_some_and(|o| !name.contains(o.as_str())) { continue; }
        let full: MerlTable = gonio_io::merl::read(options.merl.join(format!("{name}.binary")))?;
        let truth = data::luminance_table(data::material(&all, &name)?);
        use gonio::render::Brdf;
        let envelope = full.envelope();
        let reference = metrics::sphere_pixels(&render_sphere(&full, &novel, &fast, &|_| ()), fast.radius());
        for light in ["debevec_stpeters", "debevec_grace"] {
            let map = data::test_light(folder, light)?;
            let tree = LightTree::of_map(&map);
            for tolerance in [0.1, 0.05, 0.02, 0.01, 0.003] {
                let start = Instant::now();
                let got: Vec<_> = points.iter().step_by(100).map(|p| {
                    let exact = radiance(p, &full, &envelope, &tree, &IntegratorSettings { tolerance: 5e-4, max_cells: 1000000 }).value.x;
                    (exact, 0)}).collect();
                let slow = start.elapsed().as_secs_f64();
                let start = Instant::now();
                let fast: Vec<_> = points.iter().step_by(100).map(|p| radiance(p, &full, &envelope, &tree, &IntegratorSettings { tolerance, max_cells: 20000 })).collect();
                let e: f64 = got.iter().zip(&fast).map(|(a,b)| (b.value.x/a.0-1.0).powi(2)).sum::<f64>()/got.len() as f64;
                let w = got.iter().zip(&fast).map(|(a,b)| (b.value.x/a.0-1.0).abs()).fold(0.0,f64::max);
                eprintln!("tol {tolerance}: rms {:.2e} worst {:.2e} cells {} ms {:.3} (slow {:.1})", e.sqrt(), w, fast.iter().map(|f| f.cells).sum::<usize>()/fast.len(), start.elapsed().as_secs_f64()*1e3/fast.len() as f64, slow*1e3/fast.len() as f64);
            }
            let start = Instant::now();
            let image: Vec<Option<f64>> = points
                .par_iter()
                .map(|p| {
                    let r = radiance(p, &full, &envelope, &tree, &IntegratorSettings::default());
                    Some(f64::from(luminance(r.value.as_vec3())))
                })
                .collect();
            eprintln!("rendered {name} {light} in {:.2}", start.elapsed().as_secs_f64());
            let projected = plan.project(&image, 1e-5)?;
            eprintln!("rank {} left over {:.2e}", projected.bilinear.rows(), projected.left_over());
            let problem = Problem::blind(&projected, &prior, &basis.rates, Hyper::default())?
                .starting_from(basis.materials.iter().map(|m| m.coefficients.clone()).collect());
            // known light
            let known = {
                let columns: Vec<Vec<f32>> = basis.functions.iter().map(|f| {
                    points.par_iter().map(|p| radiance(p, f, f, &tree, &IntegratorSettings::default()).value.x as f32).collect()
                }).collect();
                for (k,c) in columns.iter().enumerate() { eprintln!("col {k}: {} nan, mean {:.3e} max {:.3e} rate {:.2}", c.iter().filter(|x| !x.is_finite()).count(), c.iter().sum::<f32>()/c.len() as f32, c.iter().fold(0f32,|a,b| a.max(*b)), basis.rates[k]); }
                let mean: f64 = columns.iter().flatten().map(|x| f64::from(*x)).sum::<f64>() / (points.len() * basis.len()) as f64;
                let rows: Vec<f32> = (0..points.len()).flat_map(|i| columns.iter().map(move |c| (f64::from(c[i]) / mean) as f32)).collect();
                Projected { bilinear: Bilinear::new(points.len(), basis.len(), 1, rows), target: image.iter().map(|x| x.unwrap()).collect(), outside: 0.0, pixels: points.len() }
            };
            let known_problem = Problem::with_known_light(&known, &basis.rates, Hyper::default())?;
            let v = VariationalSettings { starts: options.starts, max_iterations: options.iterations, ..Default::default() };
            let methods = [
                ("known light", &known_problem, Method::KnownLight(VariationalSettings { solver: Solver::Blocks, starts: 1, ..v })),
                ("blocks", &problem, Method::Variational(VariationalSettings { solver: Solver::Blocks, ..v })),
                ("parallel", &problem, Method::Variational(v)),
                ("joint map", &problem, Method::JointMap(JointMapSettings { starts: options.starts, ..Default::default() })),
            ];
            let report = |method: &str, table: &BivariateTable, seconds: f64, extra: String| {
                let image = metrics::sphere_pixels(&render_sphere(table, &novel, &fast, &|_| ()), fast.radius());
                let r = metrics::relight(&image, &reference);
                println!("| {name} | {light} | {method} | {:.3} | {:.3} | {:.3} | {seconds:.1} | {extra}", r.relative, r.log, metrics::brdf_error(table, &truth));
            };
            report("training mean", &training_mean, 0.0, String::new());
            report("lambert", &BivariateTable::from_fn(|_, _| 1.0), 0.0, String::new());
            report("basis itself", &basis.combine(&basis.project(&truth)?)?, 0.0, String::new());
            for (label, problem, method) in methods {
                let start = Instant::now();
                let posterior = infer(problem, &method, &|_| ());
                let seconds = start.elapsed().as_secs_f64();
                let table = basis.combine(&posterior.reflectance)?;
                let costs: Vec<String> = posterior.starts.iter().map(|s| format!("{:.0}/{}{}", s.cost, s.iterations, if s.converged { "" } else { "!" })).collect();
                let rms = (projected.energy() / projected.pixels as f64).sqrt();
                report(label, &table, seconds, format!("{} noise {:.2e}", costs.join(" "), posterior.noise / rms));
            }
        }
    }
    ensure!(true, "");
    let _ = Context::context(Some(()), "")?;
    Ok(())
}
