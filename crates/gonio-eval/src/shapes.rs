//! `gonio-eval shapes`: measures errors on the same materials in the same lights on a sphere, a
//! blob, an animal and a bowl, with and without modelling self-shadowing.
//!
//! Materials are those that the benchmark holds out, and lights are the test lights. The posterior
//! is that of the benchmark, learnt from neither. Photographs have exact shadows (rays for all but
//! half a percent of the light), no interreflections, and noise of half a percent of the mean.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::{DVec3, Vec3};
use gonio::inference::learnt::{LearntPosterior, to_sphere_equivalent};
use gonio::lighting::LightPrior;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;
use gonio::render::{LightTree, Relighter};
use gonio::scene::{ObservationSettings, Observations, SurfaceView};
use gonio::shape::{BuiltInShape, Camera, Ellipsoid, GeometryBuffer, Surface, Tracer, hit_at};
use gonio::transfer::TransferSettings;

use crate::bench::{ACCURACY, Progress, Protocol, TestSphere, add_noise};
use crate::cache::Cache;
use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::{brdf_error, median};
use crate::posteriors::{Learning, load_or_train};

/// Options of `gonio-eval shapes`.
#[derive(clap::Args)]
pub(crate) struct ShapesOptions {
    /// Folder for `shapes.csv`, one line for each estimate
    #[arg(short, long)]
    out: PathBuf,
    /// Folder of the MERL database [default: DATA/merl]
    #[arg(long)]
    merl: Option<PathBuf>,
    /// Lights of the photographs
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace,debevec_rnl")]
    lights: Vec<String>,
    /// Lights that estimates are relit in
    #[arg(long, value_delimiter = ',', default_value = "debevec_galileo,debevec_uffizi")]
    relit: Vec<String>,
    /// Shapes
    #[arg(long, value_delimiter = ',', default_value = "sphere,blob,bunny,bowl")]
    shapes: Vec<String>,
    /// Test every N-th of the held-out materials
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    every: u16,
    /// Width and height of the photographs in pixels
    #[arg(long, default_value_t = 320, value_parser = clap::value_parser!(u16).range(64..))]
    size: u16,
}

/// Standard deviation of the noise of photographs relative to their mean.
const NOISE: f64 = 0.005;
/// Share of the picture left free around the object.
const MARGIN: f64 = 0.03;
/// Cells along a side of the grid that the shapes are made from.
const CELLS: usize = 140;

/// Errors of one estimate.
struct Record {
    shape: String,
    hidden: bool,
    light: String,
    material: String,
    relative: f64,
    log: f64,
    brdf: f64,
    /// Share of the disk of normals that was observed.
    observed: f32,
    seconds: f64,
}

/// A shape in front of the camera.
struct Posed {
    surface: Box<dyn Surface>,
    camera: Camera,
}

fn pose(name: &str, size: usize) -> Result<Posed> {
    let form = match name {
        "sphere" => {
            let camera = Camera::framing(DVec3::ZERO, 1.0, (size, size), MARGIN)?;
            let centre = camera.to_world.inverse().transform_point3(DVec3::ZERO);
            return Ok(Posed { surface: Box::new(Ellipsoid::sphere(centre, 1.0)?), camera });
        }
        "blob" => BuiltInShape::Blob,
        "bunny" => BuiltInShape::Bunny,
        "bowl" => BuiltInShape::Bowl,
        other => bail!("{other}: unknown shape; choose sphere, blob, bunny or bowl"),
    };
    let mesh = form.mesh(CELLS)?;
    let (centre, radius) = mesh.bounds();
    let camera = Camera::framing(centre, radius, (size, size), MARGIN)?;
    Ok(Posed { surface: Box::new(Tracer::new(mesh.transformed(&camera.to_world.inverse())?)), camera })
}

pub(crate) fn run(data: &Path, options: &ShapesOptions) -> Result<()> {
    let materials = Materials::open(data, options.merl.as_deref())?;
    let cache = Cache::open();
    let learnt = Protocol::LeaveOut.training(&materials);
    let training: Vec<(String, BivariateTable)> =
        learnt.into_iter().map(|at| (materials.names[at].clone(), materials.luminance(at))).collect();
    let lit = Lights::training(data)?;
    let learnt = load_or_train(&cache, &training, &lit, &lit.names(), &Learning::default())?;
    let prior = gonio_io::model::embedded()?.light;
    let lights = Lights::open(data)?;
    let wanted = materials.held_out().into_iter().step_by(usize::from(options.every));
    let subjects = materials.extrapolated(wanted);
    let tables: Vec<BivariateTable> = subjects.iter().map(|(_, table)| table.clone()).collect();
    let stage = TestSphere::new(64);
    let relit = lights.relighters(&options.relit, &stage.points, &tables)?;
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let study = Study { learnt: &learnt, prior: &prior, stage: &stage, relit: &relit, subjects: &subjects };
    let progress = Progress::new("photographs", options.shapes.len() * options.lights.len() * subjects.len());
    let mut records = Vec::new();
    for shape in &options.shapes {
        let posed = pose(shape, usize::from(options.size))?;
        for light in &options.lights {
            let name = (shape.as_str(), light.as_str());
            study.photograph(&posed, &lights.tree(light)?, name, &mut records, &progress)?;
        }
    }
    progress.finish();
    gonio_io::atomic::write_file(options.out.join("shapes.csv"), csv(&records).as_bytes())?;
    print!("{}", summary(&records, &options.shapes));
    Ok(())
}

/// Models and ground truth common to all photographs.
struct Study<'a> {
    learnt: &'a LearntPosterior,
    prior: &'a LightPrior,
    stage: &'a TestSphere,
    relit: &'a [Relighter],
    subjects: &'a [(String, BivariateTable)],
}

impl Study<'_> {
    /// Photographs and estimates all materials on one shape in one light.
    fn photograph(
        &self,
        posed: &Posed,
        light: &LightTree,
        (shape, name): (&str, &str),
        records: &mut Vec<Record>,
        progress: &Progress,
    ) -> Result<()> {
        let Posed { surface, camera } = posed;
        let buffer = GeometryBuffer::of(surface.as_ref(), camera);
        let view = SurfaceView { normals: &buffer.normals, camera: Some(camera), distances: Some(&buffer.distances) };
        // The points do not depend on the values of the picture, so a uniform picture gives them.
        let blank = Picture { rgb: Plane::from_fn(camera.size.0, camera.size.1, |_, _| Vec3::ONE), alpha: None };
        let settings = ObservationSettings { clip: Some(f32::MAX), ..ObservationSettings::default() };
        let transfer = TransferSettings::default();
        let open = Observations::of_view(&blank, &view, None, &settings)?;
        let clear: Vec<DVec3> = open
            .pixels
            .iter()
            .filter_map(|&(x, y)| hit_at(surface.as_ref(), camera, x as usize, y as usize))
            .map(|hit| hit.ray_origin)
            .collect();
        let tables: Vec<BivariateTable> = self.subjects.iter().map(|(_, table)| table.clone()).collect();
        let photographs = Relighter::of_surface(&open.points, (surface.as_ref(), &clear), &tables, light, &ACCURACY);
        let mut shadowed = open.clone();
        shadowed.shadowed_by(surface.as_ref(), camera, (self.prior.map, transfer.side), &|_| ())?;
        for (material, table) in self.subjects {
            let mut values = photographs.render(table);
            add_noise(&mut values, NOISE, &format!("{shape} {name} {material}"));
            for (hidden, scene) in [(false, &open), (true, &shadowed)] {
                if hidden && scene.visibility.is_none() {
                    continue;
                }
                let seen = scene.values.iter().zip(&values).map(|(kept, v)| kept.map(|_| v.max(0.0)));
                // Values are rendered only at the points, not in every pixel.
                let observations = Observations { values: seen.collect(), dense: Vec::new(), ..scene.clone() };
                let start = Instant::now();
                let found = to_sphere_equivalent(&observations, self.learnt, self.prior, &transfer)?;
                let estimate = self.learnt.posterior(&found.image).mean;
                let (relative, log) = self.stage.mean_errors(self.relit, &estimate, table);
                records.push(Record {
                    shape: shape.to_owned(),
                    hidden,
                    light: name.to_owned(),
                    material: material.clone(),
                    relative,
                    log,
                    brdf: brdf_error(&estimate, table),
                    observed: found.image.observed(),
                    seconds: start.elapsed().as_secs_f64(),
                });
            }
            progress.step();
        }
        Ok(())
    }
}

fn csv(records: &[Record]) -> String {
    let mut text = "shape,visibility,light,material,relight,log,brdf_log,observed,seconds\n".to_owned();
    for r in records {
        let Record { shape, hidden, light, material, relative, log, brdf, observed, seconds } = r;
        let _ = writeln!(
            text,
            "{shape},{hidden},{light},{material},{relative:.4},{log:.4},{brdf:.4},{observed:.3},{seconds:.2}"
        );
    }
    text
}

/// Tabulates medians by shape, with and without visibility, and how often modelling visibility
/// reduces the error.
fn summary(records: &[Record], shapes: &[String]) -> String {
    let mut text = "shape    V_i   relight   log  BRDF log  observed  seconds  better with V_i\n".to_owned();
    for shape in shapes {
        for hidden in [false, true] {
            let of: Vec<&Record> = records.iter().filter(|r| r.shape == *shape && r.hidden == hidden).collect();
            if of.is_empty() {
                continue;
            }
            let typical = |f: fn(&Record) -> f64| median(of.iter().map(|r| f(r)).collect());
            let other = |r: &Record| {
                let same = |o: &&Record| (&o.shape, &o.light, &o.material) == (&r.shape, &r.light, &r.material);
                records.iter().filter(|o| !o.hidden).find(same).map_or(f64::NAN, |o| o.log)
            };
            let better = of.iter().filter(|r| r.log < other(r)).count();
            let better =
                if hidden { format!("{:.0} %", 100.0 * better as f64 / of.len() as f64) } else { String::new() };
            let _ = writeln!(
                text,
                "{shape:8} {:4}  {:7.3} {:6.3}  {:7.2}  {:8.2}  {:7.2}  {better:>12}",
                if hidden { "yes" } else { "no" },
                typical(|r| r.relative),
                typical(|r| r.log),
                typical(|r| r.brdf),
                typical(|r| f64::from(r.observed)),
                typical(|r| r.seconds),
            );
        }
    }
    text
}
