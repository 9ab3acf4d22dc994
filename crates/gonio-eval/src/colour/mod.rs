//! `gonio-eval colour`: measures errors in RGB on materials and lights outside all training data.
//!
//! Photographs show bivariate RGB tables on a ball in full-resolution RGB light. The materials are
//! those of `DATA/measured_extra` and `DATA/rgl`, and formulas in colour: saturated bodies,
//! coloured metals, coats. The posterior of materials is that of the embedded model, whose training
//! data contain none of them. The model of colours is learnt from the MERL materials in the
//! training lights.

mod estimators;
mod formulas;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use glam::{DQuat, Vec3};
use gonio::colour::{Chroma, ChromaField, white_chroma};
use gonio::model::Model;
use gonio::reflectance::{BivariateTable, brdf_scale, trusted_cells};
use gonio::render::{LightTree, Relighter};
use gonio::scene::{ObservationSettings, Observations, sphere_points};
use gonio::shape::SurfacePoint;
use gonio::sphere::OctahedralMap;

use crate::bench::{DRAFT, Progress, id};
use crate::cache::Cache;
use crate::data::{Lights, ModelOption};
use crate::metrics::{luminances, mean, median, relight, relight_rgb};
use crate::out_of_domain;
use crate::posteriors;
use estimators::Found;
pub(crate) use estimators::{ColourEstimator, Photograph};

/// Options of `gonio-eval colour`.
#[derive(clap::Args)]
pub(crate) struct ColourOptions {
    #[command(flatten)]
    model: ModelOption,
    /// Folder for `colour.csv`, one line for each estimate
    #[arg(short, long)]
    out: PathBuf,
    /// Test lights of the photographs
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace,debevec_rnl,noon_grass")]
    lights: Vec<String>,
    /// Test lights that estimates are relit in
    #[arg(long, value_delimiter = ',', default_value = "debevec_galileo,hotel_room,usc_pisa")]
    relight: Vec<String>,
    /// Use only every N-th material
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Estimators to compare
    #[arg(long, value_enum, value_delimiter = ',')]
    estimators: Vec<ColourEstimator>,
    /// Use only materials whose names contain this text
    #[arg(long, default_value = "")]
    only: String,
    /// Learn the model of colours from every N-th training light only
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..))]
    stride: u32,
}

/// Number of normals on the sphere that estimates are relit on.
pub(crate) const RELIT_NORMALS: usize = 1_500;

/// Noise of photographs, relative to each pixel.
const NOISE: f64 = 0.01;

/// A material with its group.
pub(crate) struct Subject {
    pub(crate) group: &'static str,
    pub(crate) name: String,
    pub(crate) rgb: [BivariateTable; 3],
}

/// Errors of one estimate.
struct Record {
    group: &'static str,
    light: String,
    material: String,
    estimator: ColourEstimator,
    /// RGB and luminance relight error, means over the lights.
    rgb: f64,
    luminance: f64,
    /// Distance of the chroma of the relit ball's mean from the true one, mean over the lights.
    mean_chroma: f64,
    /// The same distance after division by the chroma of the photograph's light, which a blind
    /// estimate cannot determine.
    without_light: f64,
    /// Distance of the chroma of the body from the true one.
    body: f64,
    /// Share of the cells of each channel in their 90 % intervals, mean of the channels.
    cells: Option<f64>,
    /// Whether each component of the body's chroma lies in its 90 % interval.
    inside: Option<[bool; 2]>,
    warned: bool,
}

pub(crate) fn run(data: &Path, options: &ColourOptions) -> Result<()> {
    let mut model = options.model.read()?;
    train_colours(&mut model, data, options.stride)?;
    let subjects: Vec<Subject> = subjects(data)?
        .into_iter()
        .filter(|subject| subject.name.contains(&options.only))
        .step_by(options.every as usize)
        .collect();
    let tables: Vec<BivariateTable> = subjects.iter().map(|s| BivariateTable::luminance(&s.rgb)).collect();
    let lights = Lights::open(data)?;
    let relit_points: Vec<SurfacePoint> = points(RELIT_NORMALS);
    let others: Vec<[Relighter; 3]> = options
        .relight
        .iter()
        .map(|name| Ok(Relighter::of_channels(&relit_points, &tables, &lights.tree(name)?, &DRAFT)))
        .collect::<Result<_>>()?;
    let all = ColourEstimator::value_variants();
    let estimators = if options.estimators.is_empty() { all } else { &options.estimators };
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let mut records = Vec::new();
    photographs(&model, &lights, &options.lights, &subjects, |photograph, subject, light| {
        for &estimator in estimators {
            let found = estimator.estimate(photograph)?;
            records.push(judge(subject, light, estimator, &found, &others, photograph.light_chroma));
        }
        Ok(())
    })?;
    gonio_io::atomic::write_file(options.out.join("colour.csv"), csv(&records).as_bytes())?;
    print!("{}", summary(&records, estimators));
    Ok(())
}

/// Photographs every subject in each of the named lights, from a different side in each, and calls
/// `each` with the photograph, the subject and the name of the light.
///
/// # Errors
/// If a light cannot be read; errors of `each`.
pub(crate) fn photographs(
    model: &Model,
    lights: &Lights,
    names: &[String],
    subjects: &[Subject],
    mut each: impl FnMut(&Photograph<'_>, &Subject, &str) -> Result<()>,
) -> Result<()> {
    let tables: Vec<BivariateTable> = subjects.iter().map(|s| BivariateTable::luminance(&s.rgb)).collect();
    let ball = posteriors::ball(DQuat::IDENTITY);
    let progress = Progress::new("photographs", names.len() * subjects.len());
    for (at, light) in names.iter().enumerate() {
        let map = lights.map(light)?.rotated(DQuat::from_rotation_y(137.5_f64.to_radians() * at as f64));
        let operator = Relighter::of_channels(&ball, &tables, &LightTree::of_map(&map), &DRAFT);
        let light_chroma = white_chroma(&map.reduced(128).to_grid(OctahedralMap::EqualArea, 32), DQuat::IDENTITY);
        for subject in subjects {
            let mut image = picture(&operator, &subject.rgb);
            add_noise(&mut image, &format!("{light} {}", subject.name));
            let observations = Observations::of_points(ball.clone(), &image);
            each(&Photograph { model, observations, light: &map, light_chroma, truth: &subject.rgb }, subject, light)?;
            progress.step();
        }
    }
    progress.finish();
    Ok(())
}

/// Replaces the model of colours by one that is learnt from the MERL materials in every `stride`-th
/// training light, or loads it from the cache. That of the embedded model was also learnt from the
/// materials of [`subjects`].
pub(crate) fn train_colours(model: &mut Model, data: &Path, stride: u32) -> Result<()> {
    let learnt = model.learnt.as_mut().context("the embedded model has no posterior of materials")?;
    let cache = Cache::open();
    let merl = gonio_io::bivariate::read_bivariate_set(data.join("merl"))?;
    let materials = merl.into_iter().map(|(_, rgb)| rgb).collect();
    learnt.colours = Some(posteriors::colours(&cache, learnt, materials, &Lights::training(data)?, stride as usize)?);
    Ok(())
}

/// Returns the materials outside all training data.
pub(crate) fn subjects(data: &Path) -> Result<Vec<Subject>> {
    let mut subjects = Vec::new();
    let extra = data.join("measured_extra");
    if extra.is_dir() {
        for (name, rgb) in gonio_io::bivariate::read_bivariate_set(extra)? {
            subjects.push(Subject { group: "measured_extra", name, rgb });
        }
    }
    let real = out_of_domain::rgl_tables(&data.join("rgl"))?;
    subjects.extend(real.into_iter().map(|(name, rgb)| Subject { group: "rgl", name, rgb }));
    for (name, rgb) in formulas::coloured() {
        subjects.push(Subject { group: "formulas", name: name.to_owned(), rgb });
    }
    if subjects.is_empty() {
        bail!("{}: no materials for measuring colour errors", data.display());
    }
    // Cells beyond 80 degrees are extrapolated.
    subjects.iter_mut().flat_map(|s| &mut s.rgb).for_each(BivariateTable::extend_from_trusted);
    Ok(subjects)
}

/// Points of a sphere within 80 degrees of the view.
pub(crate) fn points(normals: usize) -> Vec<SurfacePoint> {
    let settings = ObservationSettings { normals, ..ObservationSettings::default() };
    sphere_points(&settings).into_iter().filter(|p| p.normal.z > 80.0_f64.to_radians().cos()).collect()
}

/// Renders a BRDF in the light of an operator.
pub(crate) fn picture(operator: &[Relighter; 3], rgb: &[BivariateTable; 3]) -> Vec<Vec3> {
    let channels: Vec<Vec<f64>> = operator.iter().zip(rgb).map(|(matrix, table)| matrix.render(table)).collect();
    (0..channels[0].len()).map(|i| Vec3::from_array([0, 1, 2].map(|c| channels[c][i] as f32))).collect()
}

/// Adds independent noise to the channels of every pixel, seeded by a key.
fn add_noise(image: &mut [Vec3], key: &str) {
    for c in 0..3 {
        let mut logs = vec![1.0; image.len()];
        crate::bench::add_noise(&mut logs, NOISE, &format!("{key} {c}"));
        image.iter_mut().zip(logs).for_each(|(rgb, factor)| rgb[c] *= factor as f32);
    }
}

fn judge(
    subject: &Subject,
    light: &str,
    estimator: ColourEstimator,
    found: &Found,
    others: &[[Relighter; 3]],
    light_chroma: Chroma,
) -> Record {
    let mut errors = [const { Vec::new() }; 4];
    let of_light = light_chroma.rgb().as_vec3();
    for operator in others {
        let (got, want) = (picture(operator, &found.tables), picture(operator, &subject.rgb));
        let rgb = relight_rgb(&got, &want);
        errors[0].push(rgb.relative);
        errors[1].push(relight(&luminances(&got), &luminances(&want)).relative);
        errors[2].push(rgb.mean_chroma);
        let without_light: Vec<Vec3> = got.iter().map(|rgb| *rgb / of_light).collect();
        errors[3].push(relight_rgb(&without_light, &want).mean_chroma);
    }
    let tables = [&found.tables, &subject.rgb].map(BivariateTable::luminance);
    let body = |rgb: &[BivariateTable; 3], table| ChromaField::of_tables(rgb).body(table);
    let (got, want) = (body(&found.tables, &tables[0]), body(&subject.rgb, &tables[1]));
    let scale = 1.0 / brdf_scale(&tables[0], &tables[1]);
    let cells = found.quantiles.as_ref().map(|quantiles| {
        let inside = |c: usize| {
            let (low, high) = (&quantiles[c][0], &quantiles[c][3]);
            let value = |cell: usize| (scale * f64::from(subject.rgb[c].as_slice()[cell])) as f32;
            let hits = trusted_cells().filter(|&cell| low[cell] <= value(cell) && value(cell) <= high[cell]);
            hits.count() as f64 / trusted_cells().count() as f64
        };
        mean(&[inside(0), inside(1), inside(2)])
    });
    Record {
        group: subject.group,
        light: light.to_owned(),
        material: subject.name.clone(),
        estimator,
        rgb: mean(&errors[0]),
        luminance: mean(&errors[1]),
        mean_chroma: mean(&errors[2]),
        without_light: mean(&errors[3]),
        body: got.distance(want),
        cells,
        inside: found.body.map(|ends| [0, 1].map(|c| ends[c][0] <= want.0[c] && want.0[c] <= ends[c][1])),
        warned: found.warned,
    }
}

fn csv(records: &[Record]) -> String {
    let mut out = String::from(
        "group,material,light,estimator,rgb,luminance,mean_chroma,without_light,body,cells_in_90,body_in_90,warned\n",
    );
    for r in records {
        let cells = r.cells.map(|share| format!("{share:.3}")).unwrap_or_default();
        let inside = r.inside.map(|inside| inside.iter().filter(|x| **x).count().to_string()).unwrap_or_default();
        let name = id(&r.estimator);
        let _ = writeln!(
            out,
            "{},{},{},{name},{:.4},{:.4},{:.4},{:.4},{:.4},{cells},{inside},{}",
            r.group, r.material, r.light, r.rgb, r.luminance, r.mean_chroma, r.without_light, r.body, r.warned
        );
    }
    out
}

/// Medians over the photographs of each group.
fn summary(records: &[Record], estimators: &[ColourEstimator]) -> String {
    let mut out = String::new();
    for group in ["measured_extra", "rgl", "formulas"] {
        let of = |estimator| records.iter().filter(move |r| r.group == group && r.estimator == estimator);
        if of(estimators[0]).next().is_none() {
            continue;
        }
        let _ = writeln!(
            out,
            "\n{group}: medians of {} photographs\n\n\
             | estimator | RGB relight | luminance relight | mean chroma (90th percentile) | without light | body | cells in 90 % | body in 90 % |\n\
             |---|---|---|---|---|---|---|---|",
            of(estimators[0]).count()
        );
        for &estimator in estimators {
            let rows: Vec<&Record> = of(estimator).collect();
            let all = |value: fn(&Record) -> f64| rows.iter().map(|r| value(r)).collect::<Vec<f64>>();
            let ninetieth = |mut values: Vec<f64>| {
                values.sort_by(f64::total_cmp);
                values[(0.9 * (values.len() - 1) as f64).round() as usize]
            };
            let percent = |values: Vec<f64>| {
                if values.is_empty() { "-".to_owned() } else { format!("{:.0} %", 100.0 * mean(&values)) }
            };
            let cells = percent(rows.iter().filter_map(|r| r.cells).collect());
            let inside = rows.iter().filter_map(|r| r.inside).flatten().map(|x| f64::from(u8::from(x)));
            let name = id(&estimator);
            let _ = writeln!(
                out,
                "| {name} | {:.3} | {:.3} | {:.2} ({:.2}) | {:.2} | {:.2} | {cells} | {} |",
                median(all(|r| r.rgb)),
                median(all(|r| r.luminance)),
                median(all(|r| r.mean_chroma)),
                ninetieth(all(|r| r.mean_chroma)),
                median(all(|r| r.without_light)),
                median(all(|r| r.body)),
                percent(inside.collect()),
            );
        }
    }
    out
}
