//! `gonio-eval colour`: compares rules that colour a BRDF, on materials and lights unseen in
//! training. The model of colours is learnt from the training materials in the training lights.
//!
//! Photographs show bivariate RGB tables on a ball in full-resolution RGB light. All rules but the
//! true table colour the same luminance estimate. No dictionary entries are left out by hand: the
//! posterior is used as learnt from the training materials alone.

mod rules;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use glam::{DQuat, Vec3};
use gonio::appearance::Lattice;
use gonio::colour::{Chroma, ClueFinder, ColourModel, LeftOut, TwoColours, white_chroma};
use gonio::inference::learnt::LearntPosterior;
use gonio::lighting::EnvironmentMap;
use gonio::picture::luminance;
use gonio::reflectance::BivariateTable;
use gonio::render::{LightTree, Relighter};
use gonio::shape::SurfacePoint;
use gonio::simulation::ColourStock;
use gonio::sphere::OctahedralMap;
use gonio_io::cache::Cache;

use crate::bench::{ACCURACY, Progress};
use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::{mean, median, relight};
use crate::posteriors::{self, Effort};
use rules::{RULES, Rule, View};

/// Options of `gonio-eval colour`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Folder for `colour.csv`, one line for each estimate
    #[arg(short, long)]
    out: PathBuf,
    /// Test lights of the photographs
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace,debevec_rnl,noon_grass")]
    lights: Vec<String>,
    /// Test lights that estimates are relit in
    #[arg(long, value_delimiter = ',', default_value = "debevec_galileo,hotel_room,usc_pisa")]
    relight: Vec<String>,
    #[command(flatten)]
    effort: Effort,
}

/// Distance of the body's chroma from grey beyond which a material counts as coloured.
const COLOURED: f64 = 0.3;

/// Errors of one estimate.
struct Record {
    light: String,
    material: String,
    coloured: bool,
    rule: Rule,
    /// RGB relight error and its log version, means over the lights.
    relative: f64,
    log: f64,
    /// Root mean square distance in u'v' over relit pixels.
    chroma: f64,
    /// Distance of the chroma of body and highlight from the true ones.
    body: f64,
    highlight: f64,
    /// Number of the four chroma coordinates (body, highlight) that lie in their 90 % intervals.
    covered: Option<usize>,
}

pub(crate) fn run(data: &Path, options: &Options) -> Result<()> {
    let materials = Materials::open(data, None)?;
    let held_out = materials.held_out();
    let training: Vec<usize> = materials.database().filter(|at| !held_out.contains(at)).collect();
    let tables: Vec<(String, BivariateTable)> =
        training.iter().map(|&at| (materials.names[at].clone(), materials.luminance(at))).collect();
    let cache = Cache::user().context("no cache folder; GONIO_CACHE_DIR names one")?;
    let lights = Lights::training(data)?;
    let posterior = posteriors::load_or_train(&cache, &tables, &lights, &lights.names(), &options.effort.learning())?;
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let mut stock = ColourStock::new(&posterior, training.iter().map(|&at| materials.rgb(at).clone()).collect());
    let progress = Progress::new("learning colours", lights.names().len());
    for name in lights.names() {
        stock.add_light(&lights.map(&name)?);
        progress.step();
    }
    progress.finish();
    let model = stock.learn();
    let LeftOut { median: display, estimate, given, inside } = stock.left_out();
    println!("left-out quarters of training materials and lights, median errors of body / highlight:");
    for (name, [body, highlight]) in [("median colour", display), ("estimate", estimate), ("light given", given)] {
        println!("{name}: {body:.3} / {highlight:.3}");
    }
    println!("in 90 % intervals: {:.0} %", 100.0 * inside);
    let bench = Bench { finder: ClueFinder::new(), lattice: Lattice::new(), posterior, model };
    let lights = Lights::open(data)?;
    let subjects: Vec<[BivariateTable; 3]> = held_out.iter().map(|&at| trusted(materials.rgb(at))).collect();
    let luminances: Vec<BivariateTable> = subjects.iter().map(BivariateTable::luminance).collect();
    let names: Vec<&str> = held_out.iter().map(|&at| materials.names[at].as_str()).collect();
    let others: Vec<[Relighter; 3]> = options
        .relight
        .iter()
        .map(|name| Ok(bench.operator(&lights.map(name)?, &luminances)))
        .collect::<Result<_>>()?;
    let truths: Vec<Vec<Vec<Vec3>>> =
        subjects.iter().map(|rgb| others.iter().map(|o| picture(o, rgb)).collect()).collect();
    let mut records = Vec::new();
    let progress = Progress::new("photographs", options.lights.len() * names.len());
    for light in &options.lights {
        let map = lights.map(light)?;
        let camera = posteriors::ball(DQuat::IDENTITY);
        let operator = Relighter::of_channels(&camera, &luminances, &LightTree::of_map(&map), &ACCURACY);
        let chroma = white_chroma(&map.to_grid(OctahedralMap::EqualArea, 32), DQuat::IDENTITY);
        for ((name, rgb), truth) in names.iter().zip(&subjects).zip(&truths) {
            let seen = bench.view(&camera, picture(&operator, rgb), chroma, rgb)?;
            for rule in RULES {
                let (estimate, colours, covered) = rule.apply(&seen, &bench.model, rgb);
                let mut errors = [Vec::new(), Vec::new(), Vec::new()];
                for (operator, want) in others.iter().zip(truth) {
                    let got = picture(operator, &estimate);
                    let flat = |p: &[Vec3]| p.iter().flat_map(|c| c.to_array().map(f64::from)).collect::<Vec<f64>>();
                    let error = relight(&flat(&got), &flat(want));
                    errors[0].push(error.relative);
                    errors[1].push(error.log);
                    errors[2].push(uv_distance(&got, want));
                }
                let true_colours = seen.truth;
                records.push(Record {
                    light: light.clone(),
                    material: (*name).to_owned(),
                    coloured: true_colours.body.distance(Chroma::default()) > COLOURED,
                    rule,
                    relative: mean(&errors[0]),
                    log: mean(&errors[1]),
                    chroma: mean(&errors[2]),
                    body: colours.body.distance(true_colours.body),
                    highlight: colours.highlight.distance(true_colours.highlight),
                    covered,
                });
            }
            progress.step();
        }
    }
    progress.finish();
    gonio_io::atomic::write_file(options.out.join("colour.csv"), csv(&records).as_bytes())?;
    print!("{}", summary(&records));
    Ok(())
}

/// Replaces the extrapolated cells of the tables by the nearest trusted ones.
fn trusted(rgb: &[BivariateTable; 3]) -> [BivariateTable; 3] {
    rgb.clone().map(|mut table| {
        table.extend_from_trusted();
        table
    })
}

/// The models that read a photograph.
struct Bench {
    posterior: LearntPosterior,
    model: ColourModel,
    lattice: Lattice,
    finder: ClueFinder,
}

impl Bench {
    /// Operator that relights estimates in a map.
    fn operator(&self, map: &EnvironmentMap, examples: &[BivariateTable]) -> [Relighter; 3] {
        Relighter::of_channels(&self.lattice.points(DQuat::IDENTITY), examples, &LightTree::of_map(map), &ACCURACY)
    }

    fn view(
        &self,
        points: &[SurfacePoint],
        image: Vec<Vec3>,
        light: Chroma,
        rgb: &[BivariateTable; 3],
    ) -> Result<View> {
        let values = image.iter().map(|c| Some(f64::from(luminance(*c))));
        let table = self.posterior.posterior(&posteriors::on_disk(points, values)?).mean;
        let colours: Vec<Option<Vec3>> = image.iter().copied().map(Some).collect();
        let clues = self.finder.read(points, &colours, &table);
        Ok(View { image, table, clues, light, truth: TwoColours::of(rgb) })
    }
}

/// Renders a BRDF in the light of an operator.
fn picture(operator: &[Relighter; 3], rgb: &[BivariateTable; 3]) -> Vec<Vec3> {
    let channels: Vec<Vec<f64>> = operator.iter().zip(rgb).map(|(matrix, table)| matrix.render(table)).collect();
    (0..channels[0].len()).map(|i| Vec3::from_array([0, 1, 2].map(|c| channels[c][i] as f32))).collect()
}

/// CIE 1976 u'v' of linear Rec. 709.
fn uv(rgb: Vec3) -> [f64; 2] {
    let [r, g, b] = rgb.as_dvec3().to_array();
    let x = 0.4124 * r + 0.3576 * g + 0.1805 * b;
    let y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let z = 0.0193 * r + 0.1192 * g + 0.9505 * b;
    let total = (x + 15.0 * y + 3.0 * z).max(1e-30);
    [4.0 * x / total, 9.0 * y / total]
}

/// Root mean square distance in u'v' over pixels.
fn uv_distance(got: &[Vec3], want: &[Vec3]) -> f64 {
    let square = |(a, b): (&Vec3, &Vec3)| {
        let (a, b) = (uv(*a), uv(*b));
        (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
    };
    (got.iter().zip(want).map(square).sum::<f64>() / want.len() as f64).sqrt()
}

fn csv(records: &[Record]) -> String {
    let mut out = String::from("light,material,coloured,rule,relative,log,uv,body,highlight,covered\n");
    for r in records {
        let covered = r.covered.map(|c| c.to_string()).unwrap_or_default();
        let _ = writeln!(
            out,
            "{},{},{},{},{:.4},{:.4},{:.4},{:.4},{:.4},{covered}",
            r.light,
            r.material,
            r.coloured,
            r.rule.id(),
            r.relative,
            r.log,
            r.chroma,
            r.body,
            r.highlight
        );
    }
    out
}

/// Medians over the photographs of all materials and of the coloured ones.
fn summary(records: &[Record]) -> String {
    let mut out = String::new();
    for (title, only) in [("all materials", false), ("coloured materials", true)] {
        let of =
            |rule: Rule| records.iter().filter(move |r| r.rule == rule && (r.coloured || !only)).collect::<Vec<_>>();
        let base = of(Rule::Median);
        let _ = writeln!(
            out,
            "\n{title}: medians of {} photographs\n\n\
             | colours | relight | log relight | u'v' | body | highlight | nearer in u'v' than the display rule | in 90 % |\n\
             |---|---|---|---|---|---|---|---|",
            base.len()
        );
        for rule in RULES {
            let rows = of(rule);
            let middle = |value: fn(&Record) -> f64| median(rows.iter().map(|r| value(r)).collect());
            let wins = rows.iter().zip(&base).filter(|(a, b)| a.chroma < b.chroma).count();
            let covered: Vec<f64> = rows.iter().filter_map(|r| r.covered).map(|c| 25.0 * c as f64).collect();
            let covered = if covered.is_empty() { "-".to_owned() } else { format!("{:.0} %", mean(&covered)) };
            let _ = writeln!(
                out,
                "| {} | {:.3} | {:.3} | {:.4} | {:.2} | {:.2} | {:.0} % | {covered} |",
                rule.title(),
                middle(|r| r.relative),
                middle(|r| r.log),
                middle(|r| r.chroma),
                middle(|r| r.body),
                middle(|r| r.highlight),
                100.0 * wins as f64 / rows.len().max(1) as f64,
            );
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_is_where_it_should_be() {
        let [u, v] = uv(Vec3::ONE);
        assert!((u - 0.1978).abs() < 1e-3 && (v - 0.4683).abs() < 1e-3, "{u} {v}");
        let red = [Vec3::new(1.0, 0.2, 0.1)];
        assert!(uv_distance(&red, &[Vec3::splat(0.5)]) > 0.05);
        assert!(uv_distance(&red, &[3.0 * red[0]]) < 1e-6);
    }
}
