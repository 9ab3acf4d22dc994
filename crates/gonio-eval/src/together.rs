//! `gonio-eval together`: how much several photographs of one material, and several materials under
//! one light, tell beyond one.
//!
//! Materials are those outside of the MERL database (`DATA/rgl` and formulas), with the embedded
//! model, which was not learnt from them; lights are the test lights. Photographs are rendered balls, which the
//! program looks at as at any other.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gonio::estimate::{
    Alignment, ColouringRule, EstimateSettings, Material, combine, estimate, estimate_together, estimate_under,
};
use gonio::inference::Likelihood;
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::render::{IntegratorSettings, LightTree, SphereSettings, render_sphere};
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

pub(crate) fn run(data: &Path, options: &Options) -> Result<()> {
    let model = gonio_io::model::read_model(&options.model)?;
    let lights = Lights::open(data)?;
    let maps: Vec<EnvironmentMap> = options.lights.iter().map(|name| lights.map(name)).collect::<Result<_>>()?;
    let mut materials = Vec::new();
    for (name, path) in crate::outside::rgl_files(&data.join("rgl"))? {
        let table = gonio_io::brdf::read(&path)?;
        materials.push((name, BivariateTable::luminance(&[0, 1, 2].map(|c| table.bivariate(c)))));
    }
    let formulas =
        crate::outside::formulas().into_iter().map(|(name, formula)| (name.to_owned(), formula.to_bivariate()));
    materials.extend(formulas);
    // A sharp highlight on a dark body, unlike any material of the training.
    let mirror = BivariateTable::from_fn(|h, d| 0.02 + 60.0 * (-(h / 0.03).powi(2)).exp() * (0.6 + 0.4 * d.powi(4)));
    let photographs = |table: &BivariateTable| -> Result<Vec<Observations>> {
        maps.iter().map(|map| photograph(table, map)).collect()
    };
    let none = || maps.iter().map(|_| Vec::new()).collect::<Vec<Vec<Errors>>>();
    let (mut blind, mut lit) = (none(), none());
    let (mut alone, mut shared) = (Vec::new(), Vec::new());
    let (mut refused, mut crossed) = (0, (0, 0));
    let of_mirror = photographs(&mirror)?;
    let mut seen: Vec<(Vec<Likelihood>, Vec<Likelihood>)> = Vec::new();
    for (name, truth) in &materials {
        let all = photographs(truth)?;
        let blind_ones: Vec<Material> =
            all.iter().map(|one| Ok(Material::of(&model, one, 32)?)).collect::<Result<_>>()?;
        let under = |(one, map): (&Observations, &EnvironmentMap)| {
            let found = estimate_under(&model, one, (map, Alignment::Near), &ColouringRule::Grey, &|_| ())?;
            Ok(found.material)
        };
        let lit_ones: Vec<Material> = all.iter().zip(&maps).map(under).collect::<Result<_>>()?;
        for (out, ones) in [(&mut blind, &blind_ones), (&mut lit, &lit_ones)] {
            refused += collect(&model, ones, truth, out)?;
        }
        let likelihoods = |ones: &[Material]| ones.iter().map(|m| m.posterior.likelihood.clone()).collect();
        seen.push((likelihoods(&blind_ones), likelihoods(&lit_ones)));
        let settings = EstimateSettings { colouring: ColouringRule::Grey, ..EstimateSettings::default() };
        for (one, other) in all.iter().zip(&of_mirror) {
            let by_itself = estimate(&model, one, &settings, &|_| ())?;
            alone.push(Errors::of(&by_itself.material, truth)?);
            let together = estimate_together(&model, &[one, other], &settings, &|_| ());
            let together = together.map_err(|(_, error)| error)?;
            shared.push((together[0].light_of == 1, Errors::of(&together[0].estimate.material, truth)?));
        }
        eprintln!("{name}");
    }
    // Photographs of two materials: how many are refused.
    for a in 0..seen.len() {
        for b in (0..seen.len()).filter(|b| *b != a) {
            let pair = |of: fn(&(Vec<Likelihood>, Vec<Likelihood>)) -> &Vec<Likelihood>| {
                [of(&seen[a])[0].clone(), of(&seen[b])[1].clone()]
            };
            crossed.0 += usize::from(combine(&model, &pair(|s| &s.0)).is_err());
            crossed.1 += usize::from(combine(&model, &pair(|s| &s.1)).is_err());
        }
    }
    println!("{}", report(&blind, &lit, &alone, &shared));
    let pairs = materials.len() * (materials.len() - 1);
    println!(
        "\nOf one material, {refused} combinations are refused. Of two materials, {} of {pairs} pairs are refused under unknown \
         illumination, and {} under known lights.",
        crossed.0, crossed.1
    );
    Ok(())
}

/// Adds the errors of one photograph, and of two, three and more together, and counts the
/// combinations that are refused.
fn collect(model: &Model, ones: &[Material], truth: &BivariateTable, out: &mut [Vec<Errors>]) -> Result<usize> {
    let mut refused = 0;
    for (count, out) in out.iter_mut().enumerate().map(|(at, out)| (at + 1, out)) {
        // Neighbours in the list, around its end.
        let starts = if count == ones.len() { 1 } else { ones.len() };
        for start in 0..starts {
            if count == 1 {
                out.push(Errors::of(&ones[start], truth)?);
                continue;
            }
            let some: Vec<Likelihood> =
                (0..count).map(|at| ones[(start + at) % ones.len()].posterior.likelihood.clone()).collect();
            match combine(model, &some) {
                Ok(found) => out.push(Errors::of(&found.material, truth)?),
                Err(_) => refused += 1,
            }
        }
    }
    Ok(refused)
}

fn photograph(table: &BivariateTable, map: &EnvironmentMap) -> Result<Observations> {
    let settings = SphereSettings {
        size: 128,
        integrator: IntegratorSettings { tolerance: 0.3, max_cells: 8000 },
        ..SphereSettings::default()
    };
    let picture = render_sphere(table, &LightTree::of_map(map), &settings, &|_| ());
    let sighting = Sighting::of(&picture, None, Object::Sphere(None), &ObservationSettings::default())?;
    Ok(sighting.observations)
}

fn report(blind: &[Vec<Errors>], lit: &[Vec<Errors>], alone: &[Errors], shared: &[(bool, Errors)]) -> String {
    let mut out = format!("Several photographs of one material\n\n{HEADER}");
    for (name, all) in [("unknown illumination", blind), ("known light", lit)] {
        for (at, errors) in all.iter().enumerate() {
            let _ = writeln!(out, "{}", row(&format!("{name}, {} photographs", at + 1), errors));
        }
    }
    let _ = write!(out, "\nBeside a mirror-like object under the same unknown light\n\n{HEADER}");
    let _ = writeln!(out, "{}", row("alone", alone));
    let used = shared.iter().filter(|(used, _)| *used).count();
    let errors: Vec<f64> = shared.iter().map(|(_, e)| e.error).collect();
    let better = errors.iter().zip(alone).filter(|(a, b)| **a < b.error).count();
    let inside = |at: usize| 100.0 * mean(&shared.iter().map(|(_, e)| e.coverage[at]).collect::<Vec<f64>>());
    let _ = writeln!(
        out,
        "| together | {} | {:.3} | {:.2} | {:.0} % / {:.0} % |",
        shared.len(),
        median(errors),
        median(shared.iter().map(|(_, e)| e.width).collect()),
        inside(0),
        inside(1)
    );
    let _ = write!(out, "\nThe light of the mirror-like object was used {used} times; {better} answers became better.");
    out
}
