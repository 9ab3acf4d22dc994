//! `gonio-eval patterns`: measures estimates of balls that are painted in two paints.
//!
//! Each photograph shows a material outside of the database in a test light, or a material of the
//! database in a training light, with noise of one percent. The second paint has 15 to 50 % of the
//! diffuse reflectance of the first, and the same highlights. The references are the photograph of
//! the ball without paint, and the estimate that uses all pixels.

use std::f32::consts::TAU;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use glam::Vec3;
use gonio::estimate::{EstimateSettings, MAX_MISFIT, estimate};
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::{BivariateTable, angles_of};
use gonio::render::{SphereSettings, render_spheres};
use gonio::scene::{Circle, Detection, ObjectShape, ObservationSettings};
use gonio::simulation::generator;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

use crate::bench::Progress;
use crate::data::{Lights, ModelOption};
use crate::metrics::{mean, median};

/// Options of `gonio-eval patterns`.
#[derive(clap::Args)]
pub(crate) struct PatternsOptions {
    /// Folder for `patterns.csv`, one line for each photograph
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    model: ModelOption,
    /// Use training lights and materials of the database instead of test lights and other materials
    #[arg(long)]
    training: bool,
    /// Use every N-th material
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    every: u16,
    /// Lights of each material
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..))]
    lights: u16,
    /// Width and height of the photographs in pixels
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u16).range(64..))]
    size: u16,
}

/// Standard deviation of the noise of a pixel of mean brightness, relative to the mean.
const NOISE: f32 = 0.01;
/// Limit in degrees of both angles of the cells that are compared.
const COMPARED: f64 = 60.0;
/// Value to which smaller ones are raised before their logarithms are compared, for BRDFs of albedo
/// one half.
const FLOOR: f64 = 1e-3;

/// Where an object has its second paint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pattern {
    Checkers,
    Stripes,
    Spots,
    Halves,
    Label,
}

impl Pattern {
    const ALL: [Self; 5] = [Self::Checkers, Self::Stripes, Self::Spots, Self::Halves, Self::Label];

    fn name(self) -> &'static str {
        match self {
            Self::Checkers => "checkers",
            Self::Stripes => "stripes",
            Self::Spots => "spots",
            Self::Halves => "halves",
            Self::Label => "label",
        }
    }

    /// Draws a function that is true at the normals of the second paint.
    fn draw<R: Rng>(self, random: &mut R) -> impl Fn(Vec3) -> bool + use<R> {
        let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
        let mut spot = |_| {
            let [x, y, z]: [f32; 3] = std::array::from_fn(|_| StandardNormal.sample(random));
            (Vec3::new(x, y, z.abs()).normalize_or(Vec3::Z), random.random_range(0.12_f32..0.3).cos())
        };
        let spots: Vec<(Vec3, f32)> = (0..14).map(&mut spot).collect();
        move |n: Vec3| {
            // The pattern is rotated about the view.
            let n = Vec3::new(cos * n.x - sin * n.y, sin * n.x + cos * n.y, n.z);
            let (azimuth, elevation) = (n.x.atan2(n.z), n.y.clamp(-1.0, 1.0).asin());
            let is_odd = |x: f32| x.floor().rem_euclid(2.0) == 1.0;
            match self {
                Self::Checkers => is_odd((3.0 * azimuth + 0.3).floor() + (3.0 * elevation + 0.1).floor()),
                Self::Stripes => is_odd(5.0 * n.y + 0.3),
                Self::Spots => spots.iter().any(|(at, cosine)| n.dot(*at) > *cosine),
                Self::Halves => n.x + 0.3 * (3.0 * n.y).sin() > 0.1,
                Self::Label => azimuth.abs() < 0.5 && (elevation - 0.1).abs() < 0.35,
            }
        }
    }
}

/// Result of one photograph.
struct Record {
    material: String,
    light: String,
    pattern: Pattern,
    /// Whether two paints are detected on the painted ball, and on the one without paint.
    found: [bool; 2],
    /// Errors without the other paint, with this paint converted or ignored, and with all pixels
    /// as they are; `None` for an estimate that the photograph contradicts.
    errors: [Option<f64>; 3],
}

/// Returns a paint with other diffuse reflectance, and the same highlights, as a material.
fn second_paint(rgb: &[BivariateTable; 3], random: &mut impl Rng) -> [BivariateTable; 3] {
    let share = [0.15, 0.3, 0.5][random.random_range(0..3)];
    let is_grey = random.random_bool(0.4);
    rgb.each_ref().map(|table| {
        let share = if is_grey { share } else { share * random.random_range(0.2..1.0) };
        let body = (0..table.as_slice().len()).filter(|cell| {
            let (half, difference) = angles_of(*cell);
            (35.0..60.0).contains(&half.to_degrees()) && difference.to_degrees() < 40.0
        });
        let body = median(body.map(|cell| f64::from(table.as_slice()[cell])).collect());
        let value = |v: &f32| (f64::from(*v) - (1.0 - share) * body).max(1e-4) as f32;
        BivariateTable::from_vec(table.as_slice().iter().map(value).collect())
    })
}

/// Adds noise whose variance rises with the brightness, and scales the mean to one.
fn photograph(rgb: Plane<Vec3>, alpha: Option<Plane<f32>>, random: &mut impl Rng) -> Picture {
    let total: f32 = rgb.as_slice().iter().map(|v| v.y).sum();
    let covered: f32 = alpha.as_ref().map_or(rgb.as_slice().len() as f32, |alpha| alpha.as_slice().iter().sum());
    let scale = covered / total.max(f32::MIN_POSITIVE);
    let rgb = rgb.map(|v| {
        let v = *v * scale;
        let mut channel = |x: f32| -> f32 {
            let z: f32 = StandardNormal.sample(&mut *random);
            x + NOISE * z * (x.max(0.0) + 0.01).sqrt()
        };
        Vec3::new(channel(v.x), channel(v.y), channel(v.z))
    });
    Picture { rgb, alpha }
}

/// Returns the root mean square difference of the logarithms of two BRDFs, less its median.
fn log_error(found: &BivariateTable, truth: &BivariateTable) -> f64 {
    let scaled = |table: &BivariateTable| table.scaled(0.5 / table.normal_albedo());
    let (found, truth) = (scaled(found), scaled(truth));
    let differences: Vec<f64> = (0..truth.as_slice().len())
        .filter(|cell| {
            let (half, difference) = angles_of(*cell);
            half.to_degrees() < COMPARED && difference.to_degrees() < COMPARED
        })
        .map(|cell| {
            let log = |table: &BivariateTable| f64::from(table.as_slice()[cell]).max(FLOOR).ln();
            log(&found) - log(&truth)
        })
        .collect();
    let middle = median(differences.clone());
    mean(&differences.iter().map(|d| (d - middle).powi(2)).collect::<Vec<_>>()).sqrt()
}

/// Estimate of a ball.
struct Inferred {
    /// Ratio of two detected paints.
    ratio: Option<f64>,
    /// Luminance of the BRDF, unless the photograph contradicts the estimate.
    table: Option<BivariateTable>,
}

/// Estimates a ball.
fn infer(model: &Model, picture: &Picture, circle: Circle, one_material: bool) -> Result<Inferred> {
    let settings = ObservationSettings { one_material, ..ObservationSettings::default() };
    let detection = Detection::of(picture, None, ObjectShape::Sphere(Some(circle)), &settings)?;
    let found = estimate(model, &detection.observations, &EstimateSettings::default(), &|_| ())?;
    let table = (found.light.misfit <= MAX_MISFIT).then_some(found.material.table);
    Ok(Inferred { ratio: detection.observations.report.pattern_ratio, table })
}

pub(crate) fn run(data: &Path, options: &PatternsOptions) -> Result<()> {
    let folder = data.join(if options.training { "merl" } else { "measured_extra" });
    let materials = gonio_io::bivariate::read_bivariate_set(&folder)?;
    let lights = if options.training { Lights::training(data)? } else { Lights::open(data)? };
    let model = options.model.read()?;
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let materials: Vec<_> = materials.into_iter().step_by(usize::from(options.every)).collect();
    let names = lights.names();
    let per_material = usize::from(options.lights);
    let progress = Progress::new("photographs", materials.len() * per_material);
    let sphere = SphereSettings { size: usize::from(options.size), ..SphereSettings::default() };
    let middle = 0.5 * f64::from(options.size);
    let circle = Circle { x: middle, y: middle, radius: sphere.radius() };
    let mut records = Vec::new();
    for (number, (name, rgb)) in materials.iter().enumerate() {
        for turn in 0..per_material {
            let serial = number * per_material + turn;
            // Steps of five lights visit all of them, unless their number is a multiple of five.
            let light = &names[5 * serial % names.len()];
            let pattern = Pattern::ALL[(number + turn) % Pattern::ALL.len()];
            let mut random = generator(serial as u64);
            let second = second_paint(rgb, &mut random);
            let is_second = pattern.draw(&mut random);
            let pictures = render_spheres(&[rgb, &second], &lights.tree(light)?, &sphere, &|_| ());
            let [first, other] = pictures.as_slice() else { bail!("two materials have two pictures") };
            let painted = Plane::from_fn(sphere.size, sphere.size, |x, y| {
                let at = |i: usize, middle: f64| ((i as f64 + 0.5 - middle) / circle.radius) as f32;
                let (nx, ny) = (at(x, circle.x), -at(y, circle.y));
                let normal = Vec3::new(nx, ny, (1.0 - nx * nx - ny * ny).max(0.0).sqrt());
                if is_second(normal) { other.rgb[(x, y)] } else { first.rgb[(x, y)] }
            });
            let painted = photograph(painted, first.alpha.clone(), &mut random);
            let kept = infer(&model, &painted, circle, true)?;
            let ignored = infer(&model, &painted, circle, false)?;
            // The ratio is above one if the estimated paint is the darker one, `second`.
            let (picture, tables) =
                if ignored.ratio.is_some_and(|ratio| ratio > 1.0) { (other, &second) } else { (first, rgb) };
            let truth = BivariateTable::luminance(tables);
            let plain = photograph(picture.rgb.clone(), picture.alpha.clone(), &mut random);
            let plain = infer(&model, &plain, circle, false)?;
            let error = |inferred: &Inferred| inferred.table.as_ref().map(|table| log_error(table, &truth));
            records.push(Record {
                material: name.clone(),
                light: light.clone(),
                pattern,
                found: [&ignored, &plain].map(|inferred| inferred.ratio.is_some()),
                errors: [&plain, &ignored, &kept].map(error),
            });
            progress.step();
        }
    }
    drop(progress);
    let file = options.out.join("patterns.csv");
    std::fs::write(&file, csv(&records)).with_context(|| file.display().to_string())?;
    print!("{}", table(&records));
    Ok(())
}

fn csv(records: &[Record]) -> String {
    let mut text = "material,light,pattern,found,false,without_paint,ignored,kept\n".to_owned();
    for record in records {
        let Record { material, light, pattern, found, errors } = record;
        let [plain, ignored, kept] = errors.map(|error| error.map_or_else(String::new, |error| format!("{error:.4}")));
        let name = pattern.name();
        text += &format!("{material},{light},{name},{},{},{plain},{ignored},{kept}\n", found[0], found[1]);
    }
    text
}

/// Formats the mean errors of photographs whose paints are detected, by pattern.
fn table(records: &[Record]) -> String {
    let mut text =
        "| pattern | photographs | found | without paint | second paint converted or ignored | all pixels |\n\
                    |---|---|---|---|---|---|\n"
            .to_owned();
    for pattern in Pattern::ALL.map(Some).into_iter().chain([None]) {
        let of: Vec<&Record> = records.iter().filter(|r| pattern.is_none_or(|pattern| r.pattern == pattern)).collect();
        let found: Vec<[f64; 3]> =
            of.iter().filter(|r| r.found[0]).filter_map(|r| Some([r.errors[0]?, r.errors[1]?, r.errors[2]?])).collect();
        let [plain, ignored, kept] = [0, 1, 2].map(|k| mean(&found.iter().map(|errors| errors[k]).collect::<Vec<_>>()));
        text += &format!(
            "| {} | {} | {} | {plain:.2} | {ignored:.2} | {kept:.2} |\n",
            pattern.map_or("all", Pattern::name),
            of.len(),
            of.iter().filter(|r| r.found[0]).count(),
        );
    }
    let wrong = records.iter().filter(|r| r.found[1]).count();
    text + &format!("\n{wrong} of {} balls without paint are mistaken for painted ones.\n", records.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_have_both_paints() {
        for pattern in Pattern::ALL {
            let is_second = pattern.draw(&mut generator(3));
            let normals = gonio::sphere::fibonacci_hemisphere(2000);
            let share = normals.filter(|n| is_second(n.as_vec3())).count() as f64 / 2000.0;
            assert!((0.05..0.7).contains(&share), "{}: {share}", pattern.name());
        }
    }

    #[test]
    fn the_second_paint_keeps_the_highlights() {
        let table = BivariateTable::from_fn(|half, _| 0.2 + 50.0 * (-(half / 0.05).powi(2)).exp());
        let second = second_paint(&[table.clone(), table.clone(), table.clone()], &mut generator(1));
        for channel in &second {
            let (peak, body) = (channel.as_slice()[0], channel.as_slice()[60 * 90]);
            assert!(peak > 50.0 && body < 0.11, "{peak} {body}");
        }
    }

    #[test]
    fn errors_ignore_the_scale() {
        let table = BivariateTable::from_fn(|half, _| 0.2 + (-(half / 0.3).powi(2)).exp());
        assert!(log_error(&table.scaled(3.0), &table) < 1e-6);
        let other = BivariateTable::from_fn(|half, _| 0.2 + 2.0 * (-(half / 0.3).powi(2)).exp());
        assert!(log_error(&other, &table) > 0.1);
    }
}
