//! `gonio-eval recover`: what the estimators make of rendered spheres, judged by relighting and in the BRDF domain.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use gonio::inference::{Hyper, JointMapSettings, Method, Problem, Solver, VariationalSettings, infer};
use gonio::lighting::{LightGrid, LightPrior, PriorSettings};
use gonio::picture::luminance;
use gonio::reflectance::{BivariateTable, MerlTable, ReflectanceBasis};
use gonio::render::{IntegratorSettings, LightTree, SphereSettings, radiance, render_sphere};
use gonio::sphere::fibonacci_hemisphere;
use gonio::transfer::{Bilinear, Plan, PlanSettings, Projected, SurfacePoint};
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
            for (a, c) in mean.iter_mut().zip(&m.coefficients) {
                *a += c / basis.materials.len() as f64;
            }
        }
        basis.combine(&mean)?
    };
    let fast = SphereSettings { size: 96, ..Default::default() };
    let names: Vec<String> = gonio_io::merl::list(&options.merl)?.into_iter().map(|x| x.0).collect();
    println!("| material | light | method | relight | log | brdf log | seconds | iterations | cost |");
    for name in names {
        if options.only.as_ref().is_some_and(|o| !name.contains(o.as_str())) {
            continue;
        }
        let full: MerlTable = gonio_io::merl::read(options.merl.join(format!("{name}.binary")))?;
        let truth = data::luminance_table(data::material(&all, &name)?);
        use gonio::render::Brdf;
        let envelope = full.envelope();
        let reference = metrics::sphere_pixels(&render_sphere(&full, &novel, &fast, &|_| ()), fast.radius());
        for light in ["debevec_stpeters", "debevec_grace"] {
            let map = data::test_light(folder, light)?;
            let tree = LightTree::of_map(&map);
            let start = Instant::now();
            let image: Vec<Option<f64>> = points
                .par_iter()
                .map(|p| {
                    let r = radiance(p, &full, &envelope, &tree, &IntegratorSettings::default());
                    Some(f64::from(luminance(r.as_vec3())))
                })
                .collect();
            eprintln!("rendered {name} {light} in {:.2}", start.elapsed().as_secs_f64());
            let projected = plan.project(&image, 1e-5)?;
            eprintln!("rank {} left over {:.2e}", projected.bilinear.rows(), projected.left_over());
            let problem = Problem::blind(&projected, &prior, &basis.rates, Hyper::default())?
                .starting_from(basis.materials.iter().map(|m| m.coefficients.clone()).collect());
            // known light
            let known = {
                let envelope = BivariateTable::from_vec(
                    (0..8100).map(|c| basis.functions.iter().map(|f| f.as_slice()[c]).fold(0.0, f32::max)).collect(),
                );
                let rows: Vec<f32> = points
                    .par_iter()
                    .flat_map_iter(|p| {
                        let nodes = gonio::render::nodes(p, &envelope, &tree, &IntegratorSettings::default());
                        basis
                            .functions
                            .iter()
                            .map(|f| f64::from(luminance(nodes.radiance(p, f).as_vec3())) as f32)
                            .collect::<Vec<_>>()
                    })
                    .collect();
                eprintln!("known light rows {:.2}", start.elapsed().as_secs_f64());
                Projected {
                    bilinear: Bilinear::new(points.len(), basis.len(), 1, rows),
                    target: image.iter().map(|x| x.unwrap()).collect(),
                    outside: 0.0,
                    pixels: points.len(),
                }
            };
            let known_problem = Problem::with_known_light(&known, &basis.rates, Hyper::default())?;
            {
                // Oracle light on the grid, best reflectance for it.
                let l = map.to_grid(prior.map, 32).normalised_coefficients().unwrap();
                let a = projected.bilinear.under_light(&l);
                let k = basis.len();
                let rows: Vec<f32> = a.iter().map(|x| *x as f32).collect();
                let grid_known = Projected { bilinear: Bilinear::new(projected.target.len(), k, 1, rows), target: projected.target.clone(), outside: projected.outside, pixels: projected.pixels };
                let problem = Problem::with_known_light(&grid_known, &basis.rates, Hyper::default())?;
                let posterior = infer(&problem, &Method::KnownLight(VariationalSettings { solver: Solver::Blocks, starts: 1, ..Default::default() }), &|_| ());
                let rms = (projected.energy() / projected.pixels as f64).sqrt();
                eprintln!("ORACLE grid light: noise {:.3} cost {:?}", posterior.noise / rms, posterior.trace.last());
                let logp: f64 = (1..1024).map(|m| prior.of_index(m).unwrap().log_density(l[m])).sum();
                eprintln!("log prior of the true light {logp:.0}");
                for (i, c) in ["posterior"].iter().enumerate() { let _ = (i, c); }
                let direct = gonio::lighting::LightGrid::from_coefficients(prior.map, &l);
                let t = gonio::render::images_of_basis(&points, &basis.functions, &LightTree::of_grid(&direct), &IntegratorSettings::default(), &|_| ());
                let back: Vec<Option<f64>> = (0..points.len()).map(|i| Some((0..k).map(|j| f64::from(t[i*k+j]) * posterior.reflectance[j]).sum())).collect();
                let p = plan.project(&back, 0.0)?;
                let y: Vec<f64> = a.chunks(k).map(|r| r.iter().zip(&posterior.reflectance).map(|(a,f)| a*f).sum()).collect();
                let d: f64 = y.iter().zip(&p.target).map(|(a,b)| (a-b).powi(2)).sum::<f64>() + p.outside;
                eprintln!("renderer against operator, same grid light: relative difference {:.2e}, outside {:.2e}", (d / p.energy()).sqrt(), (p.outside/p.energy()).sqrt());
            }
            let v = VariationalSettings {
                starts: options.starts,
                max_iterations: options.iterations,
                ..Default::default()
            };
            let methods = [
                (
                    "known light",
                    &known_problem,
                    Method::KnownLight(VariationalSettings { solver: Solver::Blocks, starts: 1, ..v }),
                ),
                ("blocks", &problem, Method::Variational(VariationalSettings { solver: Solver::Blocks, ..v })),
                ("parallel 0.9", &problem, Method::Variational(v)),
                ("parallel 0.5", &problem, Method::Variational(VariationalSettings { momentum: 0.5, ..v })),
                ("parallel 0", &problem, Method::Variational(VariationalSettings { momentum: 0.0, ..v })),
                (
                    "joint map",
                    &problem,
                    Method::JointMap(JointMapSettings { starts: options.starts, ..Default::default() }),
                ),
            ];
            let report = |method: &str, table: &BivariateTable, seconds: f64, extra: String| {
                let image = metrics::sphere_pixels(&render_sphere(table, &novel, &fast, &|_| ()), fast.radius());
                let r = metrics::relight(&image, &reference);
                println!(
                    "| {name} | {light} | {method} | {:.3} | {:.3} | {:.3} | {seconds:.1} | {extra}",
                    r.relative,
                    r.log,
                    metrics::brdf_error(table, &truth)
                );
            };
            report("training mean", &training_mean, 0.0, String::new());
            report("lambert", &BivariateTable::from_fn(|_, _| 1.0), 0.0, String::new());
            report("basis itself", &basis.combine(&basis.project(&truth)?)?, 0.0, String::new());
            for (label, problem, method) in methods {
                let start = Instant::now();
                let posterior = infer(problem, &method, &|_| ());
                let seconds = start.elapsed().as_secs_f64();
                let table = basis.combine(&posterior.reflectance)?;
                let costs: Vec<String> = posterior
                    .starts
                    .iter()
                    .map(|s| format!("{:.0}/{}{}", s.cost, s.iterations, if s.converged { "" } else { "!" }))
                    .collect();
                let rms = (projected.energy() / projected.pixels as f64).sqrt();
                report(label, &table, seconds, format!("{} noise {:.2e}", costs.join(" "), posterior.noise / rms));
            }
        }
    }
    ensure!(true, "");
    let _ = Context::context(Some(()), "")?;
    Ok(())
}
