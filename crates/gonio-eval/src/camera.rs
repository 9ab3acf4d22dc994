//! `gonio-eval camera`: measures the error that each camera effect adds. The learnt posterior of
//! the leave-out protocol estimates test materials in test lights from clean photographs, and from
//! photographs with one effect at a time.
//!
//! The same renderer and the same models of the effects simulate these photographs and those of the
//! training. The figures therefore apply to effects that match their models. `gonio-eval captured`
//! measures errors on real photographs. Errors are measured with the exact renderer.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use glam::DQuat;
use gonio::appearance::DiskImage;
use gonio::inference::learnt::LearntPosterior;
use gonio::reflectance::BivariateTable;
use gonio::render::Relighter;
use gonio::simulation::{LightKind, PhotographEffects, SceneRenderer, generator};
use rayon::prelude::*;

use crate::bench::{ACCURACY, Progress, Protocol, TestSphere};
use crate::cache::Cache;
use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::{Gloss, coverage, mean, median, relight};
use crate::posteriors::{Effort, load_or_train};

/// Options of `gonio-eval camera`.
#[derive(clap::Args)]
pub(crate) struct CameraOptions {
    /// Folder of the MERL database [default: DATA/merl]
    #[arg(long)]
    merl: Option<PathBuf>,
    /// Test lights of the photographs
    #[arg(long, value_delimiter = ',', default_value = "debevec_stpeters,debevec_grace,debevec_rnl,noon_grass")]
    lights: Vec<String>,
    /// Test lights that estimates are relit in, except the light of the photograph
    #[arg(long, value_delimiter = ',', default_value = "debevec_galileo,hotel_room,usc_pisa")]
    relight: Vec<String>,
    #[command(flatten)]
    effort: Effort,
}

/// The effects, one at a time, on an otherwise clean photograph of a ball of 128 pixels.
const EFFECTS: [(&str, PhotographEffects); 14] = [
    ("none", PhotographEffects::CLEAN),
    ("speckle 10 %", PhotographEffects { speckle: 0.10, ..PhotographEffects::CLEAN }),
    ("speckle 25 %", PhotographEffects { speckle: 0.25, ..PhotographEffects::CLEAN }),
    ("stains 15 %", PhotographEffects { stains: 0.15, ..PhotographEffects::CLEAN }),
    ("blur of one cell", PhotographEffects { blur: 1.0, ..PhotographEffects::CLEAN }),
    ("glare 3 %", PhotographEffects { glare: 0.03, ..PhotographEffects::CLEAN }),
    ("8 bits", PhotographEffects { levels: 256.0, ..PhotographEffects::CLEAN }),
    ("clipping 1 %", PhotographEffects { clipped: 0.01, ..PhotographEffects::CLEAN }),
    ("rough normals 0.03", PhotographEffects { rough_normals: 0.03, ..PhotographEffects::CLEAN }),
    ("wrong normals 0.02", PhotographEffects { wrong_normals: 0.02, ..PhotographEffects::CLEAN }),
    ("outline 1 %", PhotographEffects { outline: 0.01, ..PhotographEffects::CLEAN }),
    ("missing 20 %", PhotographEffects { missing: 0.20, ..PhotographEffects::CLEAN }),
    ("shadow 0.4", PhotographEffects { shadow: 0.4, ..PhotographEffects::CLEAN }),
    ("foreign 5 %", PhotographEffects { other_material: 0.05, ..PhotographEffects::CLEAN }),
];

/// Errors of one estimate.
struct Errors {
    /// Relight error and its log version, means over the lights.
    relative: f64,
    log: f64,
    /// Gloss index minus that of the reference, a natural logarithm.
    gloss: f64,
    /// Shares of the cells inside the 50 and 90 % intervals, if the estimate has intervals.
    coverage: Option<[f64; 2]>,
}

pub(crate) fn run(data: &Path, options: &CameraOptions) -> Result<()> {
    let materials = Materials::open(data, options.merl.as_deref())?;
    let cache = Cache::open();
    let luminance = |at: usize| (materials.names[at].clone(), materials.luminance(at));
    let training: Vec<(String, BivariateTable)> =
        Protocol::LeaveOut.training(&materials).into_iter().map(luminance).collect();
    let lit = Lights::training(data)?;
    let learnt = load_or_train(&cache, &training, &lit, &lit.names(), &options.effort.learning())?;
    let subjects: Vec<BivariateTable> =
        materials.extrapolated(materials.held_out()).into_iter().map(|(_, table)| table).collect();
    let lights = Lights::open(data)?;
    let renderer = SceneRenderer::new();
    let judge = Judge::new(options, &lights, &subjects)?;
    let flat = BivariateTable::from_fn(|_, _| 1.0);
    let (mut answers, mut lambertian) = (EFFECTS.map(|_| Vec::new()), Vec::new());
    let progress = Progress::new("photographs", options.lights.len() * EFFECTS.len() * subjects.len());
    for (at, name) in options.lights.iter().enumerate() {
        if judge.relit_besides(name) == 0 {
            bail!("--relight: specify a light other than that of the photograph, {name}");
        }
        let light = LightKind::Captured.light(&lights.map(name)?, DQuat::IDENTITY, &mut generator(0));
        let scenes = renderer.render(&subjects, &light);
        for ((_, camera), answers) in EFFECTS.iter().zip(&mut answers) {
            answers.par_extend((0..subjects.len()).into_par_iter().map(|m| {
                // Foreign pixels show another test material, which is also outside the training
                // data.
                let other = &scenes[(m + scenes.len() / 2) % scenes.len()];
                let mut rng = generator((at * subjects.len() + m) as u64);
                let photograph = camera.photograph(&scenes[m], other, &mut rng);
                progress.step();
                judge.posterior(&learnt, &photograph, m, name)
            }));
        }
        lambertian.extend((0..subjects.len()).map(|m| judge.errors(&flat, m, name)));
    }
    progress.finish();
    let titles = EFFECTS.iter().map(|(title, _)| *title);
    let rows = titles.zip(&answers).chain([("Lambertian answer to any", &lambertian)]);
    print!("{}", report(rows));
    Ok(())
}

/// Ground truth that estimates are compared with.
struct Judge<'a> {
    subjects: &'a [BivariateTable],
    stage: TestSphere,
    /// Name, relighting operator and true pictures of the subjects for each light that estimates
    /// are relit in.
    relit: Vec<(String, Relighter, Vec<Vec<f64>>)>,
}

impl<'a> Judge<'a> {
    fn new(options: &CameraOptions, lights: &Lights, subjects: &'a [BivariateTable]) -> Result<Self> {
        let stage = TestSphere::new(64);
        let relit = |name: &String| {
            let relighter = Relighter::new(&stage.points, subjects, &lights.tree(name)?, &ACCURACY);
            let truths = subjects.iter().map(|table| stage.counted(&relighter.render(table))).collect();
            Ok((name.clone(), relighter, truths))
        };
        let relit = options.relight.iter().map(relit).collect::<Result<_>>()?;
        Ok(Self { subjects, stage, relit })
    }

    /// Number of relighting lights other than that of the photograph.
    fn relit_besides(&self, light: &str) -> usize {
        self.relit.iter().filter(|(name, ..)| name != light).count()
    }

    fn errors(&self, table: &BivariateTable, material: usize, light: &str) -> Errors {
        let others = self.relit.iter().filter(|(name, ..)| name != light);
        let errors: Vec<_> = others
            .map(|(_, operator, truths)| relight(&self.stage.counted(&operator.render(table)), &truths[material]))
            .collect();
        Errors {
            relative: mean(&errors.iter().map(|e| e.relative).collect::<Vec<f64>>()),
            log: mean(&errors.iter().map(|e| e.log).collect::<Vec<f64>>()),
            gloss: Gloss::of(table).peak - Gloss::of(&self.subjects[material]).peak,
            coverage: None,
        }
    }

    fn posterior(&self, learnt: &LearntPosterior, photograph: &DiskImage, material: usize, light: &str) -> Errors {
        let posterior = learnt.posterior(photograph);
        let quantiles = posterior.quantiles(&[0.05, 0.25, 0.75, 0.95]).try_into().expect("four shares");
        let covered = coverage(&posterior.mean, &quantiles, &self.subjects[material]);
        Errors { coverage: Some(covered), ..self.errors(&posterior.mean, material, light) }
    }
}

/// Tabulates the medians of the errors, the share of highlights with an error of more than a factor
/// of four, and the mean share of cells in their intervals.
fn report<'a>(rows: impl Iterator<Item = (&'a str, &'a Vec<Errors>)>) -> String {
    let mut out = String::from(
        "| photographs with | number | relight | log relight | gloss off by more than 4x | in 50 / 90 % intervals |\n\
         |---|---|---|---|---|---|\n",
    );
    for (title, list) in rows {
        let middle = |f: fn(&Errors) -> f64| median(list.iter().map(f).collect());
        let off = list.iter().filter(|e| e.gloss.abs() > 4_f64.ln()).count();
        let covered: Vec<[f64; 2]> = list.iter().filter_map(|e| e.coverage).collect();
        let share = |k: usize| 100.0 * mean(&covered.iter().map(|c| c[k]).collect::<Vec<f64>>());
        let covered = if covered.is_empty() { "-".to_owned() } else { format!("{:.0} / {:.0}", share(0), share(1)) };
        let _ = writeln!(
            out,
            "| {title} | {} | {:.3} | {:.3} | {:.0} % | {covered} |",
            list.len(),
            middle(|e| e.relative),
            middle(|e| e.log),
            100.0 * off as f64 / list.len().max(1) as f64,
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn effect_names_are_unique_and_none_is_the_clean_camera() {
        let names: BTreeSet<&str> = EFFECTS.iter().map(|(name, _)| *name).collect();
        assert_eq!(names.len(), EFFECTS.len());
        for (name, camera) in &EFFECTS {
            assert_eq!(*name == "none", *camera == PhotographEffects::CLEAN, "{name}");
        }
    }

    #[test]
    fn the_table_has_medians_and_shares() {
        let one = |relative: f64, gloss: f64, coverage| Errors { relative, log: 2.0 * relative, gloss, coverage };
        let observed = vec![one(0.1, 0.0, Some([0.4, 0.8])), one(0.3, -2.0, Some([0.6, 1.0])), one(0.2, 1.0, None)];
        let table = report([("some", &observed), ("flat", &vec![one(0.5, 3.0, None)])].into_iter());
        assert!(table.contains("| some | 3 | 0.200 | 0.400 | 33 % | 50 / 90 |"), "{table}");
        assert!(table.contains("| flat | 1 | 0.500 | 1.000 | 100 % | - |"), "{table}");
    }
}
