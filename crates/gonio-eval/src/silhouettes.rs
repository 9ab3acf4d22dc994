//! `gonio-eval silhouettes`: measures errors of estimates whose shape is inflated from the outline
//! of the object, next to those with the exact shape.
//!
//! Photographs show materials from outside of the database in test lights, with self-shadowing and
//! noise of half a percent. The references are the same photographs with the exact mesh, and a
//! Lambertian surface.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::{DMat4, DVec3, Vec3};
use gonio::estimate::{Estimate, EstimateSettings, NORMAL_REFINEMENT_MISFIT, estimate, without_misleading_spots};
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;
use gonio::render::{LightTree, SurfaceSettings, render_surfaces};
use gonio::scene::{Detection, NormalMap, ObjectShape, ObservationSettings};
use gonio::shape::{BuiltInShape, GeometryBuffer, Mesh, MeshParts, PosedSurface};
use gonio::simulation::generator;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

use crate::bench::{Progress, TestSphere};
use crate::data::{Lights, ModelOption};
use crate::materials::Materials;
use crate::metrics::{coverage, mean, median};

/// Options of `gonio-eval silhouettes`.
#[derive(clap::Args)]
pub(crate) struct SilhouettesOptions {
    /// Folder for `silhouettes.csv`, one line for each estimate
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    model: ModelOption,
    /// Lights of the photographs
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace,debevec_rnl")]
    lights: Vec<String>,
    /// Use training lights and materials of the database instead of test lights and other materials
    #[arg(long)]
    training: bool,
    /// Lights that estimates are relit in, from the test lights
    #[arg(long, value_delimiter = ',', default_value = "debevec_galileo,debevec_uffizi")]
    relit: Vec<String>,
    /// Shapes: ball, egg, pear, vase, blob, bunny
    #[arg(long, value_delimiter = ',', default_value = "ball,egg,pear,vase,blob,bunny")]
    shapes: Vec<String>,
    /// Error of normals in degrees, for estimates from wrong normals; none by default
    #[arg(long, value_name = "DEGREES")]
    wrong: Option<f64>,
    /// Stated error in degrees of the wrong normals [default: the actual error]
    #[arg(long, value_name = "DEGREES", requires = "wrong")]
    stated: Option<f64>,
    /// Use every N-th material
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..))]
    every: u16,
    /// Width and height of the photographs in pixels
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u16).range(64..))]
    size: u16,
}

/// Standard deviation of the noise of photographs relative to their mean.
const NOISE: f64 = 0.005;
/// Cells along a side of the grid that the built-in shapes are made from.
const CELLS: usize = 100;
/// Angle in degrees by which the camera looks down on bodies of revolution.
const TILT: f64 = 15.0;

/// Source of the shape of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    Mesh,
    Outline,
    /// The normals of the mesh with errors, which `--normals-error` states.
    Wrong,
    /// No estimate: a Lambertian surface.
    Lambert,
}

/// Errors of one estimate.
struct Record {
    shape: String,
    known: Known,
    light: String,
    material: String,
    relative: f64,
    log: f64,
    /// Shares of the cells inside the 50 and 90 % intervals.
    held: [f64; 2],
    misfit: f64,
    scatter: f64,
    warnings: usize,
}

/// Returns a body of revolution about the y axis. Its radius is a function of the height in 0..=1.
fn turned(radius: impl Fn(f64) -> f64, height: f64) -> Result<Mesh> {
    const ROWS: usize = 120;
    const COLUMNS: usize = 160;
    let mut parts = MeshParts::default();
    for row in 0..=ROWS {
        let at = row as f64 / ROWS as f64;
        for column in 0..COLUMNS {
            let (sin, cos) = (TAU * column as f64 / COLUMNS as f64).sin_cos();
            let r = radius(at).max(1e-4);
            parts.positions.push(DVec3::new(r * sin, height * (at - 0.5), r * cos));
        }
    }
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let at = |row: usize, column: usize| (row * COLUMNS + column % COLUMNS) as u32;
            let [a, b] = [at(row, column), at(row, column + 1)];
            let [c, d] = [at(row + 1, column), at(row + 1, column + 1)];
            parts.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    let mesh = Mesh::new(parts)?.0;
    Ok(mesh.transformed(&DMat4::from_rotation_x(TILT.to_radians()))?)
}

fn mesh(name: &str) -> Result<Mesh> {
    // The square root closes the ends with a horizontal tangent plane.
    let closed = |at: f64| (4.0 * at * (1.0 - at)).max(0.0).sqrt();
    Ok(match name {
        "ball" => turned(closed, 2.0)?,
        "egg" => turned(|at| closed(at) * (1.1 - 0.35 * at), 2.6)?,
        "pear" => turned(|at| closed(at) * (0.75 - 0.4 * ((at - 0.4) / 0.3).tanh()), 2.4)?,
        "vase" => turned(|at| closed(at).min(1.0) * (0.5 + 0.22 * (TAU * at - 0.6).sin()), 2.4)?,
        "blob" => BuiltInShape::Blob.mesh(CELLS)?,
        "bunny" => BuiltInShape::Bunny.mesh(CELLS)?,
        other => bail!("{other}: unknown shape; choose ball, egg, pear, vase, blob or bunny"),
    })
}

/// Turns normals by smooth random angles with a root mean square of `error` radians.
fn with_errors(normals: &Plane<Vec3>, error: f64, seed: &str) -> Plane<Vec3> {
    // Waves of random directions, with two to six periods across the picture.
    const WAVES: usize = 24;
    let mut random = generator_of(seed);
    let mut draw = |from: f64, to: f64| random.random_range(from..to);
    let waves: [Vec<[f64; 3]>; 2] = [0, 1].map(|_| {
        let wave = |_| {
            let (periods, turn) = (draw(2.0, 6.0), draw(0.0, TAU));
            [periods * turn.cos(), periods * turn.sin(), draw(0.0, TAU)]
        };
        (0..WAVES).map(wave).collect()
    });
    let (width, height) = normals.size();
    Plane::from_fn(width, height, |x, y| {
        let normal = normals[(x, y)].as_dvec3();
        if normal == DVec3::ZERO {
            return Vec3::ZERO;
        }
        let (u, v) = (x as f64 / width as f64, y as f64 / height as f64);
        // The mean square of a sine is one half, and the error has two components.
        let angle = |waves: &[[f64; 3]]| {
            let sum: f64 = waves.iter().map(|[a, b, phase]| (TAU * (a * u + b * v) + phase).sin()).sum();
            error * sum / (WAVES as f64).sqrt()
        };
        let (right, up) = normal.any_orthonormal_pair();
        let turned = (normal + angle(&waves[0]) * right + angle(&waves[1]) * up).normalize();
        DVec3::new(turned.x, turned.y, turned.z.max(0.05)).normalize().as_vec3()
    })
}

fn generator_of(seed: &str) -> impl Rng {
    generator(seed.bytes().fold(7, |hash: u64, byte| hash.wrapping_mul(31).wrapping_add(byte.into())))
}

/// Adds noise to a rendered picture.
fn photograph(rendered: Picture, seed: &str) -> Picture {
    let mut random = generator_of(seed);
    let alpha = rendered.alpha.clone();
    let total: f32 = rendered.rgb.as_slice().iter().map(|v| v.y).sum();
    let pixels = rendered.rgb.as_slice().len() as f32;
    let covered: f32 = alpha.as_ref().map_or(pixels, |alpha| alpha.as_slice().iter().sum());
    let noise = NOISE as f32 * total / covered.max(1.0);
    let rgb = rendered.rgb.map(|v| {
        let z: f32 = StandardNormal.sample(&mut random);
        Vec3::splat((v.y + noise * z).max(0.0))
    });
    Picture { rgb, alpha }
}

/// Estimates as the program does: without misleading spots, and with refined normals if the
/// photograph contradicts inaccurate ones and the misfit becomes smaller. Updates the detection.
pub(crate) fn estimate_detected(model: &Model, picture: &Picture, detection: &mut Detection) -> Result<Estimate> {
    let settings = EstimateSettings::default();
    if let Some(cleaned) = without_misleading_spots(model, detection, picture, settings.side)? {
        *detection = cleaned;
    }
    let found = estimate(model, &detection.observations, &settings, &|_| ())?;
    if found.light.misfit > NORMAL_REFINEMENT_MISFIT
        && let Some(refined) = detection.refined(picture)
    {
        let other = estimate(model, &refined.observations, &settings, &|_| ())?;
        if other.light.misfit < found.light.misfit {
            *detection = refined;
            return Ok(other);
        }
    }
    Ok(found)
}

pub(crate) fn run(data: &Path, options: &SilhouettesOptions) -> Result<()> {
    let materials = Materials::open(data, None)?.with_out_of_domain(data)?;
    let lights = if options.training { Lights::training(data)? } else { Lights::open(data)? };
    let relit_lights = Lights::open(data)?;
    let model = options.model.read()?;
    let range = if options.training { materials.database() } else { materials.out_of_domain() };
    let subjects = materials.extrapolated(range.step_by(usize::from(options.every)));
    let tables: Vec<BivariateTable> = subjects.iter().map(|(_, table)| table.clone()).collect();
    let stage = TestSphere::new(64);
    let relit = relit_lights.relighters(&options.relit, &stage.points, &tables)?;
    let errors = |made: &BivariateTable, truth: &BivariateTable| stage.mean_errors(&relit, made, truth);
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let progress = Progress::new("photographs", options.shapes.len() * options.lights.len() * subjects.len());
    let size = (usize::from(options.size), usize::from(options.size));
    let mut records = Vec::new();
    for shape in &options.shapes {
        let mesh = mesh(shape)?;
        for light in &options.lights {
            let tree: LightTree = lights.tree(light)?;
            let posed = || PosedSurface::of_mesh(&mesh, None, size);
            let scene = posed()?;
            let brdfs: Vec<&dyn gonio::render::Brdf> = tables.iter().map(|table| table as _).collect();
            let settings = SurfaceSettings::default();
            let pictures = render_surfaces(&brdfs, &tree, scene.surface.as_ref(), &scene.camera, &settings, &|_| ());
            for ((name, truth), rendered) in subjects.iter().zip(pictures) {
                let picture = photograph(rendered, &format!("{shape} {light} {name}"));
                let mut add = |known, (relative, log), found: Option<&Estimate>| {
                    let held = found.map_or([f64::NAN; 2], |found| {
                        let quantiles: Result<&[Vec<f32>; 4], _> = found.material.quantiles.as_slice().try_into();
                        quantiles.map_or([f64::NAN; 2], |q| coverage(&found.material.table, q, truth))
                    });
                    records.push(Record {
                        shape: shape.clone(),
                        known,
                        light: light.clone(),
                        material: name.clone(),
                        relative,
                        log,
                        held,
                        misfit: found.map_or(f64::NAN, |found| found.light.misfit),
                        scatter: found.map_or(f64::NAN, |found| found.material.scatter),
                        warnings: found.map_or(0, |found| found.diagnostics().len()),
                    });
                };
                add(Known::Lambert, errors(&BivariateTable::from_fn(|_, _| 1.0), truth), None);
                let cases = [Known::Mesh, Known::Outline].into_iter().chain(options.wrong.map(|_| Known::Wrong));
                for known in cases {
                    let object = match known {
                        Known::Mesh => ObjectShape::Surface(posed()?),
                        Known::Wrong => {
                            let wrong = options.wrong.unwrap_or_default();
                            let normals = GeometryBuffer::of(scene.surface.as_ref(), &scene.camera).normals;
                            ObjectShape::Normals(Arc::new(NormalMap {
                                normals: with_errors(&normals, wrong.to_radians(), &format!("{shape} {light} {name}")),
                                camera: Some(scene.camera),
                                positions: None,
                                trusted: true,
                                error: options.stated.unwrap_or(wrong).to_radians(),
                            }))
                        }
                        Known::Outline | Known::Lambert => ObjectShape::Outline,
                    };
                    let mut detection = Detection::of(&picture, None, object, &ObservationSettings::default())?;
                    detection.shadow((model.light.map, EstimateSettings::default().side), &|_| ())?;
                    let found = estimate_detected(&model, &picture, &mut detection)?;
                    add(known, errors(&found.material.table, truth), Some(&found));
                }
                progress.step();
            }
        }
    }
    progress.finish();
    gonio_io::atomic::write_file(options.out.join("silhouettes.csv"), csv(&records).as_bytes())?;
    print!("{}", summary(&records, &options.shapes));
    Ok(())
}

impl Known {
    fn name(self) -> &'static str {
        match self {
            Self::Mesh => "mesh",
            Self::Outline => "outline",
            Self::Wrong => "wrong normals",
            Self::Lambert => "lambert",
        }
    }
}

fn csv(records: &[Record]) -> String {
    let mut text = "shape,known,light,material,relight,log,held_50,held_90,misfit,scatter,warnings\n".to_owned();
    for r in records {
        let Record { shape, light, material, relative, log, held, misfit, scatter, warnings, .. } = r;
        let known = r.known.name();
        let [half, ninety] = held;
        let _ = writeln!(
            text,
            "{shape},{known},{light},{material},{relative:.4},{log:.4},{half:.3},{ninety:.3},{misfit:.4},{scatter:.4},{warnings}"
        );
    }
    text
}

/// Tabulates medians of the errors and means of the shares, by shape.
fn summary(records: &[Record], shapes: &[String]) -> String {
    let mut text = "| shape | known | relight | log | 50 % | 90 % | misfit | scatter | warned |\n".to_owned();
    text += "|---|---|---|---|---|---|---|---|---|\n";
    for shape in shapes.iter().map(Some).chain([None]) {
        for known in [Known::Mesh, Known::Outline, Known::Wrong, Known::Lambert] {
            let of = |r: &&Record| r.known == known && shape.is_none_or(|shape| r.shape == *shape);
            let of: Vec<&Record> = records.iter().filter(of).collect();
            if of.is_empty() {
                continue;
            }
            let typical = |f: fn(&Record) -> f64| median(of.iter().map(|r| f(r)).collect());
            let share = |f: fn(&Record) -> f64| 100.0 * mean(&of.iter().map(|r| f(r)).collect::<Vec<_>>());
            let _ = writeln!(
                text,
                "| {} | {} | {:.3} | {:.3} | {:.0} | {:.0} | {:.3} | {:.3} | {:.0} % |",
                shape.map_or("all", String::as_str),
                known.name(),
                typical(|r| r.relative),
                typical(|r| r.log),
                share(|r| r.held[0]),
                share(|r| r.held[1]),
                typical(|r| r.misfit),
                typical(|r| r.scatter),
                share(|r| f64::from(u8::from(r.warnings > 0))),
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_closed_and_face_outwards() {
        for name in ["ball", "egg", "pear", "vase"] {
            let mesh = mesh(name).unwrap();
            let (centre, radius) = mesh.bounds();
            assert!(radius > 0.9 && centre.length() < 0.3, "{name}: {centre} {radius}");
            let outwards = mesh.triangles().iter().zip(mesh.normals()).filter(|(triangle, normals)| {
                let middle: DVec3 = triangle.iter().map(|&at| mesh.positions()[at as usize]).sum::<DVec3>() / 3.0;
                let axis = DMat4::from_rotation_x(TILT.to_radians()).transform_vector3(DVec3::Y);
                let out = middle - axis * middle.dot(axis);
                normals[0].dot(out) > 0.0
            });
            let share = outwards.count() as f64 / mesh.triangles().len() as f64;
            assert!(share > 0.95, "{name}: {share}");
        }
        assert!(mesh("cube").is_err());
    }

    #[test]
    fn errors_of_normals_have_the_stated_size() {
        let normals = Plane::from_fn(128, 128, |_, _| Vec3::new(0.3, -0.2, 0.9).normalize());
        let wrong = with_errors(&normals, 0.2, "seed");
        let squares: Vec<f64> = wrong
            .as_slice()
            .iter()
            .zip(normals.as_slice())
            .map(|(a, b)| f64::from(a.angle_between(*b)).powi(2))
            .collect();
        assert!((mean(&squares).sqrt() / 0.2 - 1.0).abs() < 0.2, "{}", mean(&squares).sqrt());
    }

    #[test]
    fn noise_keeps_the_mean() {
        let rgb = Plane::from_fn(40, 40, |_, _| Vec3::splat(2.0));
        let noisy = photograph(Picture { rgb, alpha: None }, "a");
        let values: Vec<f64> = noisy.rgb.as_slice().iter().map(|v| f64::from(v.x)).collect();
        let deviation = mean(&values.iter().map(|v| (v - 2.0).powi(2)).collect::<Vec<_>>()).sqrt();
        assert!((mean(&values) - 2.0).abs() < 0.002 && (deviation / 0.01 - 1.0).abs() < 0.1, "{deviation}");
    }
}
