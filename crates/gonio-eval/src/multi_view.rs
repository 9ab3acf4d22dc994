//! `gonio-eval multi-view`: measures errors of estimates from several photographs of one material,
//! and from a photograph of several materials under one light.
//!
//! Materials are those outside of the MERL database (`DATA/rgl` and formulas), and the model was
//! not learnt from them. Lights are the test lights. Photographs are rendered balls in RGB,
//! detected and sampled like any other photographs. Estimates are relit in other test lights, in
//! luminance and in RGB.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use glam::Vec3;
use gonio::colour::{ChromaField, SavedChroma};
use gonio::estimate::{
    Alignment, Colouring, ColouringRule, EstimateSettings, MaterialEstimate, combine, estimate_known_light,
    estimate_regions,
};
use gonio::inference::Likelihood;
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::render::{Accuracy, Brdf, IntegratorSettings, LightTree, Relighter, SphereSettings, render_sphere};
use gonio::scene::{Detection, ObjectShape, ObservationSettings, Observations};

use crate::bench::DRAFT;
use crate::colour::{RELIT_NORMALS, picture, points};
use crate::data::{Lights, ModelOption};
use crate::metrics::{brdf_error, coverage, luminances, mean, median, relight, relight_rgb};

/// Options of `gonio-eval multi-view`.
#[derive(clap::Args)]
pub(crate) struct MultiViewOptions {
    #[command(flatten)]
    model: ModelOption,
    /// Test lights of the photographs; each material is photographed in all of them
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace,debevec_rnl,noon_grass")]
    lights: Vec<String>,
    /// Test lights that estimates are relit in
    #[arg(long, value_delimiter = ',', default_value = "debevec_galileo,hotel_room,usc_pisa")]
    relight: Vec<String>,
    /// Run only one of the two studies
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

/// Errors of an estimate.
struct Errors {
    relit: Relit,
    /// BRDF error over trusted cells ([`brdf_error`]).
    error: f64,
    /// Mean width of the 90 % interval, in the logarithm.
    width: f64,
    /// Shares of the cells inside the 50 and 90 % intervals.
    coverage: [f64; 2],
}

/// Relight errors, means over the lights.
#[derive(Clone, Copy, Debug)]
struct Relit {
    luminance: f64,
    /// With one scale for all channels.
    rgb: f64,
    /// Distance of the mean chroma from the true one.
    mean_chroma: f64,
}

impl Relit {
    /// Relights pairs of estimated and true materials, with one scale for all of them. `operators`
    /// holds the relighting operators of the channels of each light.
    fn of(materials: &[[&[BivariateTable; 3]; 2]], operators: &[[Relighter; 3]]) -> Self {
        let mut errors = [const { Vec::new() }; 3];
        for operator in operators {
            let all = |which: usize| materials.iter().flat_map(|both| picture(operator, both[which])).collect();
            let [found, truth]: [Vec<Vec3>; 2] = [all(0), all(1)];
            let rgb = relight_rgb(&found, &truth);
            errors[0].push(relight(&luminances(&found), &luminances(&truth)).relative);
            errors[1].push(rgb.relative);
            errors[2].push(rgb.mean_chroma);
        }
        Self { luminance: mean(&errors[0]), rgb: mean(&errors[1]), mean_chroma: mean(&errors[2]) }
    }
}

impl Errors {
    fn of(
        material: &MaterialEstimate,
        field: &ChromaField,
        subject: &PhotographedMaterial,
        operators: &[[Relighter; 3]],
    ) -> Result<Self> {
        let quantiles: [Vec<f32>; 4] = material.quantiles.clone().try_into().ok().context("four quantiles")?;
        let widths = quantiles[0].iter().zip(&quantiles[3]).map(|(low, high)| f64::from((high / low).ln()));
        Ok(Self {
            relit: Relit::of(&[[&field.tables(&material.table), &subject.rgb]], operators),
            error: brdf_error(&material.table, &subject.truth),
            width: mean(&widths.collect::<Vec<f64>>()),
            coverage: coverage(&material.table, &quantiles, &subject.truth),
        })
    }
}

/// Row of a table: medians over estimates.
fn row(name: &str, all: &[Errors]) -> String {
    let of = |f: fn(&Errors) -> f64| median(all.iter().map(f).collect());
    let inside = |at: usize| 100.0 * mean(&all.iter().map(|e| e.coverage[at]).collect::<Vec<f64>>());
    format!(
        "| {name} | {} | {:.3} | {:.3} | {:.2} | {:.3} | {:.2} | {:.0} % / {:.0} % |",
        all.len(),
        of(|e| e.relit.luminance),
        of(|e| e.relit.rgb),
        of(|e| e.relit.mean_chroma),
        of(|e| e.error),
        of(|e| e.width),
        inside(0),
        inside(1)
    )
}

const HEADER: &str = "| answer | number | relight | RGB relight | mean chroma | BRDF error | width of the 90 % interval \
                      | 50 % / 90 % covered |\n|---|---|---|---|---|---|---|---|\n";

/// A material and its photographs.
struct PhotographedMaterial {
    name: String,
    rgb: [BivariateTable; 3],
    /// Luminance of `rgb`.
    truth: BivariateTable,
    photographs: Vec<Observations>,
}

/// The estimate from one photograph.
struct One {
    material: MaterialEstimate,
    colouring: Colouring,
}

impl One {
    fn saved(&self) -> Option<SavedChroma> {
        match &self.colouring {
            Colouring::Estimate(found) => Some(found.saved()),
            _ => None,
        }
    }
}

pub(crate) fn run(data: &Path, options: &MultiViewOptions) -> Result<()> {
    let model = options.model.read()?;
    let lights = Lights::open(data)?;
    let maps: Vec<EnvironmentMap> = options.lights.iter().map(|name| lights.map(name)).collect::<Result<_>>()?;
    let mut all = Vec::new();
    for (name, rgb) in crate::out_of_domain::tables(data)? {
        let photographs = maps.iter().map(|map| photograph(&rgb, map)).collect::<Result<_>>()?;
        all.push(PhotographedMaterial { name, truth: BivariateTable::luminance(&rgb), rgb, photographs });
    }
    let (balls, tables) = (points(RELIT_NORMALS), all.iter().map(|subject| subject.truth.clone()).collect::<Vec<_>>());
    let operator = |name: &String| Ok(Relighter::of_channels(&balls, &tables, &lights.tree(name)?, &DRAFT));
    let operators: Vec<[Relighter; 3]> = options.relight.iter().map(operator).collect::<Result<_>>()?;
    if options.only != Some(Study::Regions) {
        println!("{}\n", photographs(&model, &all, &maps, &operators)?);
    }
    if options.only != Some(Study::Photographs) {
        println!("{}", regions(&model, &all, &options.lights, &operators)?);
    }
    Ok(())
}

/// Measures estimates from several photographs of each material, under unknown illumination and
/// under known lights.
fn photographs(
    model: &Model,
    all: &[PhotographedMaterial],
    maps: &[EnvironmentMap],
    operators: &[[Relighter; 3]],
) -> Result<String> {
    let none = || maps.iter().map(|_| Vec::new()).collect::<Vec<Vec<Errors>>>();
    let (mut blind, mut lit, mut refused) = (none(), none(), 0);
    let mut likelihoods: Vec<[Vec<Likelihood>; 2]> = Vec::new();
    let rule = ColouringRule::default();
    for subject in all {
        let of_blind = |one: &Observations| -> Result<One> {
            let material = MaterialEstimate::of(model, one, 32)?;
            let colouring = Colouring::of(model, one, &material.table, &rule);
            Ok(One { material, colouring })
        };
        let blind_ones: Vec<One> = subject.photographs.iter().map(of_blind).collect::<Result<_>>()?;
        let under = |(one, map): (&Observations, &EnvironmentMap)| -> Result<One> {
            let found = estimate_known_light(model, one, (map, Alignment::Small), &rule, &|_| ())?;
            Ok(One { material: found.material, colouring: found.colouring })
        };
        let lit_ones: Vec<One> = subject.photographs.iter().zip(maps).map(under).collect::<Result<_>>()?;
        refused += collect(model, &blind_ones, subject, operators, &mut blind)?;
        refused += collect(model, &lit_ones, subject, operators, &mut lit)?;
        let of = |ones: Vec<One>| ones.into_iter().map(|one| one.material.posterior.likelihood).collect();
        likelihoods.push([of(blind_ones), of(lit_ones)]);
        eprintln!("{}", subject.name);
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
        "\nOne material: {refused} combinations are refused. Two materials: {blind} of {} pairs are refused under \
         unknown illumination, and {lit} under known lights.",
        pairs.count()
    )?;
    Ok(out)
}

/// Measures the albedo ratio of each pair of neighbouring materials under one light, and the errors
/// of both relit with one scale.
fn regions(
    model: &Model,
    all: &[PhotographedMaterial],
    lights: &[String],
    operators: &[[Relighter; 3]],
) -> Result<String> {
    let settings = EstimateSettings::default();
    let (mut errors, mut relit) = (Vec::new(), Vec::new());
    for pair in all.windows(2) {
        for (at, light) in lights.iter().enumerate() {
            let subject = [&pair[0].photographs[at], &pair[1].photographs[at]];
            let found = estimate_regions(model, &subject, &settings, &|_| ()).map_err(|(_, error)| error)?;
            let ratio = (found[0].relative_albedo / found[1].relative_albedo).ln();
            let truth = (pair[0].truth.normal_albedo() / pair[1].truth.normal_albedo()).ln();
            eprintln!(
                "{} and {}, {light}: albedo ratio {:.2}, truth {:.2}",
                pair[0].name,
                pair[1].name,
                ratio.exp(),
                truth.exp()
            );
            errors.push((ratio - truth).abs());
            let tables: Vec<[BivariateTable; 3]> = found
                .iter()
                .map(|one| {
                    one.estimate.colouring.field().tables(&one.estimate.material.table.scaled(one.relative_albedo))
                })
                .collect();
            let both: Vec<_> = tables.iter().zip(pair).map(|(found, subject)| [found, &subject.rgb]).collect();
            relit.push(Relit::of(&both, operators));
        }
    }
    let count = errors.len();
    let within = errors.iter().filter(|error| **error < 0.25).count();
    let typical = |f: fn(&Relit) -> f64| median(relit.iter().map(f).collect());
    Ok(format!(
        "Two materials under one unknown light\n\nRatio of their albedos: off by {:.0} % in the median of {count} photographs, by less \
         than 28 % in {within}. Both relit with one scale: relight error {:.3}, in RGB {:.3}, mean chroma off by {:.2} (medians).",
        100.0 * (median(errors).exp() - 1.0),
        typical(|r| r.luminance),
        typical(|r| r.rgb),
        typical(|r| r.mean_chroma),
    ))
}

/// Adds the errors of estimates from one, two, three and more photographs, and counts the refused
/// combinations.
fn collect(
    model: &Model,
    ones: &[One],
    subject: &PhotographedMaterial,
    operators: &[[Relighter; 3]],
    out: &mut [Vec<Errors>],
) -> Result<usize> {
    let materials: Vec<&MaterialEstimate> = ones.iter().map(|one| &one.material).collect();
    let saved: Vec<Option<SavedChroma>> = ones.iter().map(One::saved).collect();
    let mut refused = 0;
    for (count, out) in out.iter_mut().enumerate().map(|(at, out)| (at + 1, out)) {
        for (start, found) in joined(model, &materials, count).enumerate() {
            let Some(found) = found else {
                refused += 1;
                continue;
            };
            let field = if count == 1 {
                ones[start].colouring.field()
            } else {
                let some: Vec<_> = (0..count).filter_map(|at| saved[(start + at) % saved.len()].clone()).collect();
                SavedChroma::mean(&some).map_or(ChromaField::GREY, |chroma| chroma.field())
            };
            out.push(Errors::of(&found, &field, subject, operators)?);
        }
    }
    Ok(refused)
}

/// Returns the estimates from each cyclic run of `count` consecutive photographs; `None` if the
/// combination is refused.
pub(crate) fn joined<'a>(
    model: &Model,
    ones: &[&'a MaterialEstimate],
    count: usize,
) -> impl Iterator<Item = Option<Cow<'a, MaterialEstimate>>> {
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

/// Renders a ball of a material in a light, and samples it.
pub(crate) fn photograph(brdf: &dyn Brdf, map: &EnvironmentMap) -> Result<Observations> {
    let settings = SphereSettings {
        size: 128,
        accuracy: Accuracy::Bound(IntegratorSettings { tolerance: 0.3, max_cells: 8000 }),
        ..SphereSettings::default()
    };
    let picture = render_sphere(brdf, &LightTree::of_map(map), &settings, &|_| ());
    let detection = Detection::of(&picture, None, ObjectShape::Sphere(None), &ObservationSettings::default())?;
    Ok(detection.observations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::white;

    /// Two materials share one scale, and so do their channels.
    #[test]
    fn relight_errors_match_colours_and_albedos() {
        let table = BivariateTable::from_fn(|h, _| 0.1 + (-(h / 0.3).powi(2)).exp());
        let tables = |rgb: [f64; 3]| rgb.map(|x| table.scaled(x));
        let operators = [Relighter::of_channels(&points(200), std::slice::from_ref(&table), &white(), &DRAFT)];
        let (red, blue, grey) = (tables([0.6, 0.2, 0.1]), tables([0.1, 0.2, 0.6]), tables([0.5, 0.5, 0.5]));
        let right = Relit::of(&[[&tables([1.2, 0.4, 0.2]), &red]], &operators);
        assert!(right.rgb < 1e-6 && right.luminance < 1e-6 && right.mean_chroma < 1e-6, "{right:?}");
        let wrong = Relit::of(&[[&blue, &red]], &operators);
        let cosine = (0.6 * 0.1 + 0.2 * 0.2 + 0.1 * 0.6) / (0.36 + 0.04 + 0.01_f64);
        assert!((wrong.rgb - (1.0 - cosine * cosine).sqrt()).abs() < 1e-4, "{wrong:?}");
        assert!(wrong.luminance < 1e-6 && (wrong.mean_chroma - (2.0_f64).sqrt() * 6.0_f64.ln()).abs() < 1e-4);
        // The estimated albedos are 1 and 1, the true albedos 1 and 3.
        let pair = Relit::of(&[[&grey, &grey], [&grey, &tables([1.5; 3])]], &operators);
        assert!((pair.rgb - 0.2_f64.sqrt()).abs() < 1e-4 && (pair.luminance - 0.2_f64.sqrt()).abs() < 1e-4, "{pair:?}");
    }
}
