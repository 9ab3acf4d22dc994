//! `gonio-eval lights`: measures the error of the light estimated from a photograph, given its true
//! BRDF and given the BRDF estimated by the embedded model.
//!
//! Lights and materials come from the training data of the model, without the materials that the
//! benchmark holds out. The figures compare methods of estimating the light; errors on unseen
//! lights and materials may be different.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::{DQuat, Vec3};
use gonio::appearance::Lattice;
use gonio::estimate::{EstimateSettings, Light, LightEstimator};
use gonio::inference::learnt::peak_height;
use gonio::inference::light::{LightProblem, cut_off_at_zero};
use gonio::lighting::{LightGrid, LightPrior};
use gonio::picture::luminance;
use gonio::reflectance::BivariateTable;
use gonio::render::{LightTree, Relighter};
use gonio::scene::Observations;
use gonio::shape::SurfacePoint;
use gonio::sphere::OctahedralMap;
use gonio::transfer::TransferSettings;

use crate::bench::{ACCURACY, Progress};
use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::{mean, median};
use crate::posteriors::{ball, on_disk};

/// Options of `gonio-eval lights`.
#[derive(clap::Args)]
pub(crate) struct LightsOptions {
    /// Folder for `lights.csv`, one line for each estimated light
    #[arg(short, long)]
    out: PathBuf,
    /// Folder of the MERL database [default: DATA/merl]
    #[arg(long)]
    merl: Option<PathBuf>,
    /// Number of materials, spread from the most matte to the sharpest
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..))]
    materials: u16,
    /// Number of lights
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..))]
    lights: u16,
}

/// Methods of estimating a light: the mean of the posterior, that mean clipped at zero, and the
/// mean of the posterior without negative texels. [`Light::of`] refines the last one for narrow
/// lobes, from a photograph with more points.
const METHODS: [&str; 4] = ["mean", "clipped mean", "non-negative mean", "refined"];

/// BRDFs from which the light is estimated.
const GIVEN: [&str; 2] = ["true", "estimated"];

/// One estimated light, and its errors.
struct Record {
    light: String,
    material: String,
    given: &'static str,
    method: &'static str,
    error: Distance,
    /// Relative residual of the photograph.
    misfit: f64,
    /// Seconds in addition to those of the posterior mean.
    seconds: f64,
    converged: bool,
}

/// Distance of a light from the true one, texel by texel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Distance {
    /// `min_s |s L^ - L| / |L|`, dominated by the brightest lamps.
    relative: f64,
    /// The same distance between the cube roots.
    cube_root: f64,
    /// Correlation of `ln(max(L, 0) + e)`, `e` one percent of the mean of `L`.
    log_correlation: f64,
}

pub(crate) fn run(data: &Path, options: &LightsOptions) -> Result<()> {
    let all = Materials::open(data, options.merl.as_deref())?;
    let materials = evenly(training(&all), usize::from(options.materials))?;
    let lights = Lights::training(data)?;
    let names = evenly(lights.names(), usize::from(options.lights))?;
    let model = gonio_io::model::embedded()?;
    let learnt = model.learnt.as_ref().context("the embedded model has no posterior of materials")?;
    // A few points suffice to estimate the light, but not the material.
    let (points, dense) = (Lattice::new().points(DQuat::IDENTITY), ball(DQuat::IDENTITY));
    let tables: Vec<BivariateTable> = materials.iter().map(|(_, table)| table.clone()).collect();
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let progress = Progress::new("photographs", names.len() * materials.len());
    let mut records = Vec::new();
    for light in &names {
        let map = lights.map(light)?;
        let grid = map.to_grid(model.light.map, TransferSettings::default().side);
        let truth: Vec<f64> = grid.texels().iter().map(|t| f64::from(luminance(*t))).collect();
        let tree = LightTree::of_map(&map);
        let [relighter, photographer] = [&points, &dense].map(|p| Relighter::new(p, &tables, &tree, &ACCURACY));
        for (material, table) in &materials {
            let image = relighter.render(table);
            let pixels = photographer.render(table);
            let rgb: Vec<Vec3> = pixels.iter().map(|y| Vec3::splat(*y as f32)).collect();
            let observations = Observations::of_points(dense.clone(), &rgb);
            let photograph = on_disk(&dense, pixels.into_iter().map(Some))?;
            let estimate = learnt.posterior(&photograph).mean;
            for (given, brdf) in GIVEN.into_iter().zip([table, &estimate]) {
                let found = find(&points, &image, brdf, &model.light)
                    .with_context(|| format!("{material} in {light}, {given} BRDF"))?;
                let refined = refined(&observations, brdf, &model.light)?;
                records.extend(found.into_iter().chain([refined]).zip(METHODS).map(|(found, method)| Record {
                    light: light.clone(),
                    material: material.clone(),
                    given,
                    method,
                    error: error(&found.texels, &truth),
                    misfit: found.misfit,
                    seconds: found.seconds,
                    converged: found.converged,
                }));
            }
            progress.step();
        }
    }
    progress.finish();
    gonio_io::atomic::write_file(options.out.join("lights.csv"), csv(&records).as_bytes())?;
    print!("{}", summary(&records));
    Ok(())
}

/// Luminance tables of the materials that the benchmark does not hold out, from the most matte to
/// the sharpest.
fn training(all: &Materials) -> Vec<(String, BivariateTable)> {
    let held_out = all.held_out();
    let mut materials = all.extrapolated(all.database().filter(|at| !held_out.contains(at)));
    materials.sort_by(|a, b| peak_height(&a.1).total_cmp(&peak_height(&b.1)));
    materials
}

/// Selects `count` elements of a list: the middles of as many equal parts.
fn evenly<T>(list: Vec<T>, count: usize) -> Result<Vec<T>> {
    let all = list.len();
    if count > all {
        bail!("cannot select {count} of {all}");
    }
    let mut wanted = (0..count).map(|i| (2 * i + 1) * all / (2 * count)).peekable();
    Ok(list.into_iter().enumerate().filter(|(at, _)| wanted.next_if_eq(at).is_some()).map(|(_, x)| x).collect())
}

/// A light estimated by one of the [`METHODS`].
struct Found {
    texels: Vec<f64>,
    misfit: f64,
    seconds: f64,
    converged: bool,
}

/// Estimates the light of an image at points by all methods.
fn find(points: &[SurfacePoint], image: &[f64], brdf: &BivariateTable, prior: &LightPrior) -> Result<[Found; 3]> {
    let values: Vec<Option<f64>> = image.iter().map(|v| Some(*v)).collect();
    let problem = LightProblem::new(points, &values, None, brdf, prior, &TransferSettings::default())?;
    let posterior = problem.posterior()?;
    let found = |light: &[f64], exposure: f64, start: Option<Instant>, converged| {
        let radiance: Vec<f64> = light.iter().map(|l| l * exposure).collect();
        let seconds = start.map_or(0.0, |start| start.elapsed().as_secs_f64());
        Found { texels: texels(prior.map, &radiance), misfit: problem.misfit(&radiance), seconds, converged }
    };
    let mean = found(&posterior.light, posterior.exposure, None, posterior.converged);
    let clipped = found(&cut_off_at_zero(&posterior.light), posterior.exposure, None, posterior.converged);
    let start = Some(Instant::now());
    let positive = problem.non_negative(&posterior)?;
    let positive = found(&positive.light, positive.exposure, start, positive.converged);
    Ok([mean, clipped, positive])
}

/// Estimates the light of a photograph, and reduces it to the grid of the other methods. The
/// seconds are those of all steps.
fn refined(observations: &Observations, brdf: &BivariateTable, prior: &LightPrior) -> Result<Found> {
    let (settings, start) = (EstimateSettings::default(), Instant::now());
    let light = Light::of(prior, observations, brdf, &settings, &|_| ())?;
    let texels = light.grid.reduced(settings.side).texels().iter().map(|t| f64::from(t.x)).collect();
    let converged = matches!(light.estimator, LightEstimator::NonNegative { converged: true, .. });
    Ok(Found { texels, misfit: light.misfit, seconds: start.elapsed().as_secs_f64(), converged })
}

fn texels(map: OctahedralMap, coefficients: &[f64]) -> Vec<f64> {
    LightGrid::from_coefficients(map, coefficients).texels().iter().map(|t| f64::from(t.x)).collect()
}

/// Distance over texels of equal solid angle, so that sums over them are integrals over the sphere.
fn error(estimate: &[f64], truth: &[f64]) -> Distance {
    let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let relative = |a: &[f64], b: &[f64]| {
        let s = inner(a, b) / inner(a, a).max(1e-300);
        let residual: f64 = a.iter().zip(b).map(|(a, b)| (s * a - b).powi(2)).sum();
        (residual / inner(b, b)).sqrt()
    };
    let cube_root = |x: &[f64]| x.iter().map(|x| x.cbrt()).collect::<Vec<f64>>();
    let log = |x: &[f64]| {
        let floor = (0.01 * mean(x)).max(1e-300);
        let log: Vec<f64> = x.iter().map(|x| (x.max(0.0) + floor).ln()).collect();
        let centre = mean(&log);
        log.into_iter().map(|x| x - centre).collect::<Vec<f64>>()
    };
    let (a, b) = (log(estimate), log(truth));
    Distance {
        relative: relative(estimate, truth),
        cube_root: relative(&cube_root(estimate), &cube_root(truth)),
        // A light that is constant up to round-off has no correlation.
        log_correlation: if inner(&a, &a).min(inner(&b, &b)) < 1e-18 {
            0.0
        } else {
            inner(&a, &b) / (inner(&a, &a) * inner(&b, &b)).sqrt()
        },
    }
}

fn csv(records: &[Record]) -> String {
    let mut out =
        String::from("light,material,given,method,relative,cube_root,log_correlation,misfit,seconds,converged\n");
    for r in records {
        let e = &r.error;
        let _ = writeln!(
            out,
            "{},{},{},{},{:.4},{:.4},{:.4},{:.4},{:.3},{}",
            r.light,
            r.material,
            r.given,
            r.method,
            e.relative,
            e.cube_root,
            e.log_correlation,
            r.misfit,
            r.seconds,
            r.converged
        );
    }
    out
}

/// Tabulates medians and means over all photographs, and how often each method has a smaller
/// cube-root error than the posterior mean.
fn summary(records: &[Record]) -> String {
    let mut out = String::from(
        "Median (mean) over the photographs:\n\n\
         | BRDF | light | relative | cube root | log correlation | misfit | nearer than the mean | converged | seconds (most) |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for given in GIVEN {
        let of = |method: &str| records.iter().filter(|r| r.given == given && r.method == method).collect::<Vec<_>>();
        let base = of(METHODS[0]);
        for method in METHODS {
            let rows = of(method);
            let both = |value: &dyn Fn(&Record) -> f64| {
                let values: Vec<f64> = rows.iter().map(|r| value(r)).collect();
                format!("{:.3} ({:.3})", median(values.clone()), mean(&values))
            };
            let wins = rows.iter().zip(&base).filter(|(a, b)| a.error.cube_root < b.error.cube_root).count();
            let converged = rows.iter().filter(|r| r.converged).count();
            let slowest = rows.iter().map(|r| r.seconds).fold(0.0, f64::max);
            let seconds: Vec<f64> = rows.iter().map(|r| r.seconds).collect();
            let _ = writeln!(
                out,
                "| {given} | {method} | {} | {} | {} | {} | {wins} of {} | {converged} | {:.2} ({slowest:.2}) |",
                both(&|r| r.error.relative),
                both(&|r| r.error.cube_root),
                both(&|r| r.error.log_correlation),
                both(&|r| r.misfit),
                rows.len(),
                median(seconds),
            );
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use gonio::sphere::fibonacci_hemisphere;

    use super::*;

    #[test]
    fn errors_ignore_scale_and_detect_other_differences() {
        let truth: Vec<f64> = (0..64).map(|i| f64::from(i % 7) + 0.1).collect();
        let scaled: Vec<f64> = truth.iter().map(|x| 3.0 * x).collect();
        let same = error(&scaled, &truth);
        assert!(same.relative < 1e-12 && same.cube_root < 1e-12 && same.log_correlation > 1.0 - 1e-12, "{same:?}");
        let black = error(&[0.0; 64], &truth);
        assert!((black.relative - 1.0).abs() < 1e-12 && black.log_correlation == 0.0, "{black:?}");
        // Negative texels increase the error of a light.
        let signed: Vec<f64> = truth.iter().enumerate().map(|(i, x)| if i % 2 == 0 { *x } else { -x }).collect();
        assert!(error(&signed, &truth).cube_root > 0.5);
    }

    #[test]
    fn evenly_spreads_the_selection_and_rejects_too_many() {
        assert_eq!(evenly((0..10).collect(), 2).unwrap(), [2, 7]);
        assert_eq!(evenly(vec!['a', 'b'], 2).unwrap(), ['a', 'b']);
        assert!(evenly(vec!['a'], 2).is_err());
    }

    /// A satin ball under a lamp in a dim sky, which requires no data: the non-negative light has
    /// the smallest error.
    #[test]
    fn non_negative_light_recovers_a_lamp_better() {
        let model = gonio_io::model::embedded().unwrap();
        let side = TransferSettings::default().side;
        let mut truth = vec![0.2; side * side];
        truth[10 * side + 17] = 300.0;
        let brdf = BivariateTable::from_fn(|h, _| 0.1 + 2.0 * (-(h / 0.15).powi(2)).exp());
        let points: Vec<SurfacePoint> = fibonacci_hemisphere(1000)
            .filter(|n| n.z > 80.0_f64.to_radians().cos())
            .map(|normal| SurfacePoint { normal, view: glam::DVec3::Z })
            .collect();
        let observed = vec![Some(1.0); points.len()];
        let settings = TransferSettings::default();
        let grey = truth.iter().map(|x| glam::Vec3::splat(*x as f32)).collect();
        let rows = gonio_paper::Projected::unprojected(
            &points,
            &observed,
            std::slice::from_ref(&brdf),
            &model.light,
            &settings,
        );
        let image =
            rows.unwrap().bilinear.apply(&LightGrid::from_texels(model.light.map, side, grey).coefficients(), &[1.0]);
        let found = find(&points, &image, &brdf, &model.light).unwrap();
        let errors: Vec<f64> = found.iter().map(|f| error(&f.texels, &truth).cube_root).collect();
        assert!(found[1..].iter().all(|f| f.texels.iter().all(|x| *x > -1e-6 * 300.0)));
        assert!(found[2].converged && found[2].misfit < 0.05, "{}", found[2].misfit);
        assert!(errors[2] < 0.7 * errors[0] && errors[2] < errors[1], "{errors:?}");
    }
}
