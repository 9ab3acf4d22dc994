//! `gonio-eval together`: what several photographs of one material tell beyond one, and several
//! materials under one light.
//!
//! Materials are those outside of the MERL database (`DATA/rgl` and formulas), with a model that
//! was not learnt from them; lights are the test lights. Photographs are rendered balls, which are
//! looked at as any others.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gonio::estimate::{
    Alignment, ColouringRule, EstimateSettings, Material, combine, estimate_together, estimate_under,
};
use gonio::inference::Likelihood;
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::render::{Accuracy, IntegratorSettings, LightTree, SphereSettings, render_sphere};
use gonio::scene::{Object, ObservationSettings, Observations, Sighting};

use crate::data::Lights;
use crate::metrics::{brdf_error, coverage, mean, median};

/// Options of `gonio-eval together`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Model that was not learnt from the materials
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Test lights of the photographs; each material is seen in all of them
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace,debevec_rnl,noon_grass")]
    lights: Vec<String>,
    /// Measure one of the two alone
    #[arg(long, value_enum)]
    only: Option<Study>,
}

#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum Study {
    /// Several photographs of one material
    Photographs,
    /// Several materials under one light
    Regions,
}

/// Errors of an answer.
struct Errors {
    /// BRDF error over trusted cells ([`brdf_error`]).
    error: f64,
    /// Mean width of the 90 % interval, in the logarithm.
    width: f64,
    /// Shares of the cells inside the 50 and 90 % intervals.
    coverage: [f64; 2],
}

impl Errors {
    fn of(material: &Material, truth: &BivariateTable) -> Result<Self> {
        let quantiles: [Vec<f32>; 4] = material.quantiles.clone().try_into().ok().context("four quantiles")?;
        let widths = quantiles[0].iter().zip(&quantiles[3]).map(|(low, high)| f64::from((high / low).ln()));
        Ok(Self {
            error: brdf_error(&material.table, truth),
            width: mean(&widths.collect::<Vec<f64>>()),
            coverage: coverage(&material.table, &quantiles, truth),
        })
    }
}

/// Row of a table: medians over answers.
fn row(name: &str, all: &[Errors]) -> String {
    let of = |f: fn(&Errors) -> f64| median(all.iter().map(f).collect());
    let inside = |at: usize| 100.0 * mean(&all.iter().map(|e| e.coverage[at]).collect::<Vec<f64>>());
    format!(
        "| {name} | {} | {:.3} | {:.2} | {:.0} % / {:.0} % |",
        all.len(),
        of(|e| e.error),
        of(|e| e.width),
        inside(0),
        inside(1)
    )
}

const HEADER: &str =
    "| answer | number | BRDF error | width of the 90 % interval | 50 % / 90 % covered |\n|---|---|---|---|---|\n";

/// A material and its photographs.
struct Seen {
    name: String,
    truth: BivariateTable,
    photographs: Vec<Observations>,
}

pub(crate) fn run(data: &Path, options: &Options) -> Result<()> {
    let model = gonio_io::model::read_model(&options.model)?;
    let lights = Lights::open(data)?;
    let maps: Vec<EnvironmentMap> = options.lights.iter().map(|name| lights.map(name)).collect::<Result<_>>()?;
    let mut materials = Vec::new();
    for (name, path) in crate::outside::rgl_files(&data.join("rgl"))? {
        let table = gonio_io::brdf::read(&path)?;
        materials.push((name, BivariateTable::luminance(&[0, 1, 2].map(|c| table.bivariate(c)))));
    }
    let formulas = crate::outside::formulas();
    materials.extend(formulas.into_iter().map(|(name, formula)| (name.to_owned(), formula.to_bivariate())));
    let mut all = Vec::new();
    for (name, truth) in materials {
        let photographs = maps.iter().map(|map| photograph(&truth, map)).collect::<Result<_>>()?;
        all.push(Seen { name, truth, photographs });
    }
    if options.only != Some(Study::Regions) {
        println!("{}\n", photographs(&model, &all, &maps)?);
    }
    if options.only != Some(Study::Photographs) {
        println!("{}", regions(&model, &all, &options.lights)?);
    }
    Ok(())
}

/// Several photographs of each material, under unknown illumination and under known lights.
fn photographs(model: &Model, all: &[Seen], maps: &[EnvironmentMap]) -> Result<String> {
    let none = || maps.iter().map(|_| Vec::new()).collect::<Vec<Vec<Errors>>>();
    let (mut blind, mut lit, mut refused) = (none(), none(), 0);
    let mut likelihoods: Vec<[Vec<Likelihood>; 2]> = Vec::new();
    for Seen { name, truth, photographs } in all {
        let of_blind = |one: &Observations| Ok(Material::of(model, one, 32)?);
        let blind_ones: Vec<Material> = photographs.iter().map(of_blind).collect::<Result<_>>()?;
        let under = |(one, map): (&Observations, &EnvironmentMap)| {
            Ok(estimate_under(model, one, (map, Alignment::Near), &ColouringRule::Grey, &|_| ())?.material)
        };
        let lit_ones: Vec<Material> = photographs.iter().zip(maps).map(under).collect::<Result<_>>()?;
        refused += collect(model, &blind_ones, truth, &mut blind)? + collect(model, &lit_ones, truth, &mut lit)?;
        let of = |ones: Vec<Material>| ones.into_iter().map(|m| m.posterior.likelihood).collect();
        likelihoods.push([of(blind_ones), of(lit_ones)]);
        eprintln!("{name}");
    }
    let mut crossed = [0, 0];
    let pairs = (0..all.len()).flat_map(|a| (0..all.len()).filter(move |b| *b != a).map(move |b| (a, b)));
    for (a, b) in pairs.clone() {
        for (kind, crossed) in crossed.iter_mut().enumerate() {
            let pair = [likelihoods[a][kind][0].clone(), likelihoods[b][kind][1].clone()];
            *crossed += usize::from(combine(model, &pair).is_err());
        }
    }
    let mut out = format!("Several photographs of one material\n\n{HEADER}");
    for (name, errors) in [("unknown illumination", blind), ("known light", lit)] {
        for (at, errors) in errors.iter().enumerate() {
            writeln!(out, "{}", row(&format!("{name}, {}", at + 1), errors))?;
        }
    }
    let [blind, lit] = crossed;
    write!(
        out,
        "\nOf one material, {refused} combinations are refused. Of two materials, {blind} of {} pairs are refused under \
         unknown illumination, and {lit} under known lights.",
        pairs.count()
    )?;
    Ok(out)
}

/// The ratio of the albedos of each pair of neighbouring materials under one light.
fn regions(model: &Model, all: &[Seen], lights: &[String]) -> Result<String> {
    let settings = EstimateSettings { colouring: ColouringRule::Grey, ..EstimateSettings::default() };
    let mut errors = Vec::new();
    for pair in all.windows(2) {
        for (at, light) in lights.iter().enumerate() {
            let seen = [&pair[0].photographs[at], &pair[1].photographs[at]];
            let found = estimate_together(model, &seen, &settings, &|_| ()).map_err(|(_, error)| error)?;
            let ratio = (found[0].relative_albedo / found[1].relative_albedo).ln();
            let truth = (pair[0].truth.normal_albedo() / pair[1].truth.normal_albedo()).ln();
            eprintln!("{} and {}, {light}: {:.2}, is {:.2}", pair[0].name, pair[1].name, ratio.exp(), truth.exp());
            errors.push((ratio - truth).abs());
        }
    }
    let count = errors.len();
    let within = errors.iter().filter(|error| **error < 0.25).count();
    Ok(format!(
        "Two materials under one unknown light\n\nRatio of their albedos: off by {:.0} % in the median of {count} photographs, by less \
         than 28 % in {within}.",
        100.0 * (median(errors).exp() - 1.0)
    ))
}

/// Adds the errors of one photograph, and of two, three and more together, and counts the
/// combinations that are refused.
fn collect(model: &Model, ones: &[Material], truth: &BivariateTable, out: &mut [Vec<Errors>]) -> Result<usize> {
    let ones: Vec<&Material> = ones.iter().collect();
    let mut refused = 0;
    for (count, out) in out.iter_mut().enumerate().map(|(at, out)| (at + 1, out)) {
        for found in joined(model, &ones, count) {
            match found {
                Some(found) => out.push(Errors::of(&found, truth)?),
                None => refused += 1,
            }
        }
    }
    Ok(refused)
}

/// The answers from each `count` photographs that follow one another in the list, around its end;
/// `None` where they are refused.
pub(crate) fn joined<'a>(
    model: &Model,
    ones: &[&'a Material],
    count: usize,
) -> impl Iterator<Item = Option<Cow<'a, Material>>> {
    let starts = if count == ones.len() { 1 } else { ones.len() };
    (0..starts).map(move |start| {
        if count == 1 {
            return Some(Cow::Borrowed(ones[start]));
        }
        let some: Vec<Likelihood> =
            (0..count).map(|at| ones[(start + at) % ones.len()].posterior.likelihood.clone()).collect();
        combine(model, &some).ok().map(|found| Cow::Owned(found.material))
    })
}

pub(crate) fn photograph(table: &BivariateTable, map: &EnvironmentMap) -> Result<Observations> {
    let settings = SphereSettings {
        size: 128,
        accuracy: Accuracy::Bound(IntegratorSettings { tolerance: 0.3, max_cells: 8000 }),
        ..SphereSettings::default()
    };
    let picture = render_sphere(table, &LightTree::of_map(map), &settings, &|_| ());
    let sighting = Sighting::of(&picture, None, Object::Sphere(None), &ObservationSettings::default())?;
    Ok(sighting.observations)
}
