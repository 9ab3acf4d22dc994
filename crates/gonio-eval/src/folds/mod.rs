//! `gonio-eval folds`: cross-validates the learnt posterior on training materials in training
//! lights. These errors determine the choice of its settings (`docs/trials.md`), so that test
//! materials and test lights remain unused. Each left-out material is photographed twice in each
//! left-out light: without camera effects ("clean") and with random ones ("camera").

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, bail};
use clap::Args;
use glam::DQuat;
use gonio::appearance::Lattice;
use gonio::inference::learnt::{LearntPosterior, MaterialPosterior, peak_height};
use gonio::reflectance::{BivariateTable, MaterialKind, Prior};
use gonio::render::Relighter;
use gonio::simulation::{LightKind, PhotographEffects, SceneRenderer, generator};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::bench::DRAFT;
use crate::cache::Cache;
use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::{Gloss, brdf_error, coverage, median, relight};
use crate::posteriors::{Effort, Learning, kinds_of, load_or_train};

/// Draws of each left-out kind in each fold.
const DRAWS: usize = 12;

/// Intervals are computed for one photograph in this many, because they take longer than all other
/// steps.
const WITH_INTERVALS: usize = 5;

/// Number of lights that estimates are relit in.
const RELIT: usize = 3;

/// Camera without effects: a ball of 256 pixels.
const CLEAN: PhotographEffects = PhotographEffects { radius: 128.0, ..PhotographEffects::CLEAN };

/// Cross-validation of the learnt posterior on training materials and lights.
#[derive(Args)]
pub(crate) struct FoldsOptions {
    /// Number of folds that the materials, and likewise the lights, are divided into.
    #[arg(long, default_value_t = 4)]
    folds: usize,
    /// Number of folds to leave out in turn [default: all].
    #[arg(long)]
    first: Option<usize>,
    /// Kinds of materials to leave out of the prior, and to test in addition to the measured ones.
    #[arg(long, value_delimiter = ',', value_parser = kind)]
    without: Vec<MaterialKind>,
    /// Number of training materials to test in addition, to compare their errors with those of new
    /// materials.
    #[arg(long, default_value_t = 0)]
    seen: usize,
    #[command(flatten)]
    effort: Effort,
}

/// Parses a kind by its name in files; the error lists the names.
fn kind(name: &str) -> Result<MaterialKind, String> {
    serde_json::from_value(name.into()).map_err(|e| e.to_string())
}

/// Name of a kind in files: the inverse of [`kind`].
fn title(kind: MaterialKind) -> Result<String> {
    Ok(serde_json::from_value(serde_json::to_value(kind)?)?)
}

/// Errors of one estimate.
struct Outcome {
    group: String,
    material: String,
    relative: f64,
    log: f64,
    brdf: f64,
    /// Gloss index minus that of the reference.
    gloss: f64,
    /// Coverage of the 50 and 90 % intervals.
    coverage: Option<[f64; 2]>,
    /// Whether the 90 % interval of the gloss contains the true gloss.
    held: Option<bool>,
}

pub(crate) fn run(data: &Path, options: &FoldsOptions) -> Result<()> {
    if options.folds < 2 {
        bail!("--folds must be at least 2");
    }
    if options.without.contains(&MaterialKind::Measured) {
        bail!("--without measured: some measured materials are always left out");
    }
    let all = Materials::open(data, None)?;
    let held = all.held_out();
    let materials: Vec<(String, BivariateTable)> = all
        .database()
        .filter(|at| !held.contains(at))
        .map(|at| (all.names[at].clone(), all.green(at).clone()))
        .collect();
    let lights = Lights::training(data)?;
    let names = lights.names();
    if materials.len() < options.folds || names.len() < options.folds {
        bail!("{} materials and {} lights are too few for {} folds", materials.len(), names.len(), options.folds);
    }
    let cache = Cache::open();
    let mut outcomes = Vec::new();
    for fold in 0..options.first.unwrap_or(options.folds).min(options.folds) {
        let inside = |at: usize| at % options.folds != fold;
        let (seen, unseen): (Vec<_>, Vec<_>) = (0..materials.len()).partition(|&m| inside(m));
        let (lit, unlit): (Vec<_>, Vec<_>) = (0..names.len()).partition(|&l| inside(l));
        let seen: Vec<(String, BivariateTable)> = seen.into_iter().map(|m| materials[m].clone()).collect();
        let unseen: Vec<(String, BivariateTable)> = unseen.into_iter().map(|m| materials[m].clone()).collect();
        let lit: Vec<&str> = lit.into_iter().map(|l| names[l].as_str()).collect();
        let unlit: Vec<&str> = unlit.into_iter().map(|l| names[l].as_str()).collect();
        let learnt = load_or_train(&cache, &seen, &lights, &lit, &learning(options))?;
        let every = seen.len().div_ceil(options.seen.max(1));
        let known = seen.into_iter().step_by(every).take(options.seen).collect();
        let test = Test::new(options, fold, unseen, known)?;
        outcomes.extend(test.run(&learnt, &lights, &unlit, &lit[..RELIT.min(lit.len())])?);
        eprintln!("fold {fold}: {} photographs", outcomes.len());
    }
    println!("{}", report(&outcomes));
    Ok(())
}

fn kept(options: &FoldsOptions) -> Prior {
    Prior::of(&MaterialKind::ALL.into_iter().filter(|kind| !options.without.contains(kind)).collect::<Vec<_>>())
}

fn learning(options: &FoldsOptions) -> Learning {
    let mut learning = options.effort.learning();
    let prior = kept(options);
    learning.pool.prior = prior;
    learning.dictionary.prior = prior;
    learning
}

/// Materials and renderer for the test of a fold.
struct Test {
    /// Number of the fold.
    fold: usize,
    /// Group and name of each material.
    names: Vec<(String, String)>,
    tables: Vec<BivariateTable>,
    /// Renderer of the photographs.
    renderer: SceneRenderer,
}

impl Test {
    fn new(
        options: &FoldsOptions,
        fold: usize,
        unseen: Vec<(String, BivariateTable)>,
        known: Vec<(String, BivariateTable)>,
    ) -> Result<Self> {
        let mut rng = Pcg64::seed_from_u64(1000 + fold as u64);
        // Left-out kinds are drawn from a dictionary of the left-out materials.
        let dictionary = kinds_of(&unseen);
        let (mut names, mut tables) = (Vec::new(), Vec::new());
        for &kind in &options.without {
            let group = title(kind)?;
            for at in 0..DRAWS {
                tables.push(dictionary.table(&dictionary.draw(&Prior::of(&[kind]), &mut rng)));
                names.push((group.clone(), format!("{group} {fold}.{at}")));
            }
        }
        for (group, list) in [("measured", unseen), ("seen", known)] {
            for (name, mut table) in list {
                // Extrapolate beyond the trusted cells, as in training.
                table.extend_from_trusted();
                tables.push(table);
                names.push((group.to_owned(), name));
            }
        }
        Ok(Self { fold, names, tables, renderer: SceneRenderer::new() })
    }

    fn run(&self, learnt: &LearntPosterior, lights: &Lights, unlit: &[&str], relit: &[&str]) -> Result<Vec<Outcome>> {
        let points = Lattice::new().points(DQuat::IDENTITY);
        let other = |name: &&str| Ok(Relighter::new(&points, &self.tables, &lights.tree(name)?, &DRAFT));
        let others: Vec<Relighter> = relit.iter().map(other).collect::<Result<_>>()?;
        let mut outcomes = Vec::new();
        for (at, name) in unlit.iter().enumerate() {
            let turn = DQuat::from_rotation_y((137.5 * at as f64).to_radians());
            let light = LightKind::Captured.light(&lights.map(name)?, turn, &mut generator(0));
            let scenes = self.renderer.render(&self.tables, &light);
            let taken = |m: usize| {
                let mut rng = generator(((self.fold * 1000 + at) * 1000 + m) as u64);
                // Foreign pixels show another of the tested materials.
                let (scene, other) = (&scenes[m], &scenes[(m + scenes.len() / 2) % scenes.len()]);
                let any = PhotographEffects::draw(&mut rng);
                [("clean", CLEAN), ("camera", any)].map(|(title, camera)| {
                    let image = camera.photograph(scene, other, &mut rng);
                    let posterior = learnt.posterior(&image);
                    let mut outcome = self.judge(&posterior, &others, (m, title));
                    if (at + m).is_multiple_of(WITH_INTERVALS) {
                        self.add_intervals(&posterior, m, &mut outcome);
                    }
                    Ok(outcome)
                })
            };
            let some: Result<Vec<Outcome>> = (0..self.tables.len()).into_par_iter().flat_map_iter(taken).collect();
            outcomes.extend(some?);
        }
        Ok(outcomes)
    }

    fn judge(&self, posterior: &MaterialPosterior, others: &[Relighter], (material, camera): (usize, &str)) -> Outcome {
        let ((group, name), truth) = (&self.names[material], &self.tables[material]);
        let estimate = &posterior.mean;
        let (mut relative, mut log) = (0.0, 0.0);
        for other in others {
            let error = relight(&other.render(estimate), &other.render(truth));
            relative += error.relative / others.len() as f64;
            log += error.log / others.len() as f64;
        }
        Outcome {
            group: format!("{group} {camera}"),
            material: name.clone(),
            relative,
            log,
            brdf: brdf_error(estimate, truth),
            gloss: Gloss::of(estimate).peak - Gloss::of(truth).peak,
            coverage: None,
            held: None,
        }
    }

    fn add_intervals(&self, posterior: &MaterialPosterior, material: usize, outcome: &mut Outcome) {
        let truth = &self.tables[material];
        let quantiles = posterior.quantiles(&[0.05, 0.25, 0.75, 0.95]).try_into().expect("four shares");
        outcome.coverage = Some(coverage(&posterior.mean, &quantiles, truth));
        let ends = posterior.number_quantiles(peak_height, &[0.05, 0.95]);
        outcome.held = Some((ends[0]..=ends[1]).contains(&peak_height(truth)));
    }
}

/// Returns tables by group, and the materials with the largest errors.
fn report(outcomes: &[Outcome]) -> String {
    use std::fmt::Write;
    let mut out = String::from(
        "| group | photographs | relight | log | BRDF log | > 4x glossier | > 4x duller | gloss held (90 %) | \
         cells held (50 / 90 %) |\n|---|---|---|---|---|---|---|---|---|",
    );
    let mut groups: BTreeMap<&str, Vec<&Outcome>> = BTreeMap::new();
    outcomes.iter().for_each(|o| groups.entry(&o.group).or_default().push(o));
    for (group, list) in &groups {
        let middle = |f: fn(&Outcome) -> f64| {
            let mut values: Vec<f64> = list.iter().map(|o| f(o)).collect();
            values.sort_by(f64::total_cmp);
            let ninety = values[(0.9 * (values.len() - 1) as f64).round() as usize];
            format!("{:.3} ({ninety:.2})", median(values))
        };
        let share = |outside: fn(f64) -> bool| {
            100.0 * list.iter().filter(|o| outside(o.gloss)).count() as f64 / list.len() as f64
        };
        let (glossier, duller) = (share(|gloss| gloss > 4_f64.ln()), share(|gloss| gloss < -4_f64.ln()));
        let held: Vec<bool> = list.iter().filter_map(|o| o.held).collect();
        let held = 100.0 * held.iter().filter(|h| **h).count() as f64 / held.len().max(1) as f64;
        write!(
            out,
            "\n| {group} | {} | {} | {} | {} | {glossier:.1} % | {duller:.1} % | {held:.0} % |",
            list.len(),
            middle(|o| o.relative),
            middle(|o| o.log),
            middle(|o| o.brdf),
        )
        .expect("memory");
        let of: Vec<[f64; 2]> = list.iter().filter_map(|o| o.coverage).collect();
        let mean = |k: usize| 100.0 * of.iter().map(|c| c[k]).sum::<f64>() / of.len().max(1) as f64;
        write!(out, " {:.0} / {:.0} |", mean(0), mean(1)).expect("memory");
    }
    let mut by: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    outcomes.iter().for_each(|o| by.entry(&o.material).or_default().push(o.log));
    let mut hardest: Vec<(f64, &str)> = by.into_iter().map(|(name, logs)| (median(logs), name)).collect();
    hardest.sort_by(|a, b| b.0.total_cmp(&a.0));
    out += "\n\nhardest (median log relight error):";
    hardest.iter().take(16).for_each(|(log, name)| write!(out, " {name} {log:.2};").expect("memory"));
    out
}
