//! The two halves of a run: rendering, then estimating.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, anyhow};
use glam::Vec3;
use gonio::colour::ChromaField;
use gonio::inference::known_light::{self, KnownLight, Operator};
use gonio::lighting::LightPrior;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio::render::{IntegratorSettings, LightTree, Relighter, median_colour};
use gonio::scene::{ObservationSettings, sphere_points};
use gonio::shape::SurfacePoint;

use super::errors::{GroundTruth, encoded};
use super::estimators::{Estimator, Lit, Photograph};
use super::grid::{Protocol, Unit, id, relight_lights, units};
use super::learning::{LearntModels, MaterialSpace};
use super::options::BenchOptions;
use super::progress::Progress;
use super::renders::{self, Render};
use super::report;
use super::store::{Conditions, Store};
use super::test_sphere::TestSphere;
use crate::cache::Cache;
use crate::data::Lights;
use crate::materials::{Materials, Source};
use crate::metrics::luminances;

/// Runs the benchmark and writes its report.
pub(crate) fn bench(data: &Path, options: &BenchOptions) -> Result<()> {
    let (materials, lights) = (options.open_materials(data)?, Lights::open(data)?);
    let grid = options.grid(&materials, &lights)?;
    let conditions = options.conditions(&lights.names())?;
    let store = Store::open(&options.output, &conditions)?;
    let tested = |protocol: Protocol| {
        let may = protocol.tested(&materials);
        grid.materials.iter().copied().filter(|m| may.contains(m)).collect()
    };
    let units = units(&grid.protocols, &tested, &grid.lights);
    let paper = conditions.separable.paper;
    let known = if paper { ObservationSettings::of_paper() } else { ObservationSettings::default() };
    let observation = ObservationSettings { normals: conditions.normals, ..known };
    let fingerprints = Fingerprints::of(&materials, &lights, &units, &conditions)?;
    let (points, stage) = (sphere_points(&observation), TestSphere::new(conditions.size));
    let prior = match &options.prior {
        Some(path) => Some(gonio_io::model::read_lighting(path)?.0),
        None if paper => Some(gonio_io::model::lighting_of_paper()?),
        None => None,
    };
    let bench = Bench {
        materials,
        lights,
        prior,
        training: grid.estimators.contains(&Estimator::Learnt).then(|| Lights::training(data)).transpose()?,
        shown: stage.nearest(&points),
        points,
        stage,
        conditions,
        cache: Cache::open(),
        fingerprints,
        store,
    };
    let work = bench.unfinished(units, &grid.estimators);
    if work.is_empty() {
        eprintln!("all cells are finished");
    } else {
        let threads = options.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, Into::into));
        bench.render(&work)?;
        bench.estimate(&work, threads)?;
    }
    report::write(&options.output, &bench.conditions, &bench.store.records()?)
}

/// Hashes of the materials and lights of a run.
struct Fingerprints {
    materials: BTreeMap<usize, String>,
    lights: BTreeMap<String, String>,
}

impl Fingerprints {
    fn of(materials: &Materials, lights: &Lights, units: &[Unit], conditions: &Conditions) -> Result<Self> {
        let used: BTreeSet<usize> = units.iter().map(|u| u.material).collect();
        let names = units.iter().map(|u| &u.light).chain(&conditions.relight).chain(&conditions.spare);
        let names: BTreeSet<&String> = names.collect();
        Ok(Self {
            materials: used.into_iter().map(|m| Ok((m, materials.fingerprint(m)?))).collect::<Result<_>>()?,
            lights: names.into_iter().map(|l| Ok((l.clone(), lights.fingerprint(l)?))).collect::<Result<_>>()?,
        })
    }
}

/// A photograph and its unfinished estimators, each with the key of its cell.
type Work = (Unit, Vec<(Estimator, String)>);

/// Data that both halves of a run share.
struct Bench {
    materials: Materials,
    lights: Lights,
    /// Prior of light in place of the embedded one.
    prior: Option<LightPrior>,
    /// Training lights of the learnt posterior, if it is among the estimators.
    training: Option<Lights>,
    points: Vec<SurfacePoint>,
    stage: TestSphere,
    /// For each pixel of the stage, the index of the observed point that it shows.
    shown: Vec<usize>,
    conditions: Conditions,
    cache: Cache,
    fingerprints: Fingerprints,
    store: Store,
}

impl Bench {
    fn unfinished(&self, units: Vec<Unit>, estimators: &[Estimator]) -> Vec<Work> {
        let conditions = serde_json::to_string(&self.conditions).expect("conditions are JSON");
        let all_materials = self.materials.names[self.materials.database()].join(" ");
        let open = |unit: &Unit| -> Vec<(Estimator, String)> {
            let name = &self.materials.names[unit.material];
            let (material, light) =
                (&self.fingerprints.materials[&unit.material], &self.fingerprints.lights[&unit.light]);
            let keyed = estimators.iter().map(|&estimator| {
                let (protocol, name) = (id(&unit.protocol), id(&estimator));
                let parts = [&conditions, &all_materials, &protocol, material, light, &name].map(String::as_str);
                (estimator, blake3::hash(parts.join("\n").as_bytes()).to_hex().to_string())
            });
            keyed.filter(|(e, key)| !self.store.has(unit.protocol, name, &unit.light, *e, key)).collect()
        };
        units.into_iter().map(|u| (open(&u), u)).filter(|(o, _)| !o.is_empty()).map(|(o, u)| (u, o)).collect()
    }

    fn relit_in(&self, unit: &Unit) -> Vec<String> {
        relight_lights(&self.conditions.relight, &self.conditions.spare, &unit.light)
    }

    fn is_outside(&self, unit: &Unit) -> bool {
        self.materials.out_of_domain().contains(&unit.material)
    }

    /// Luminance tables for which relighting must be accurate. Tables outside of the database are
    /// included only if one of them is tested, so that the other cells do not depend on them.
    fn examples(&self, outside: bool) -> Vec<BivariateTable> {
        let last = if outside { self.materials.out_of_domain().end } else { self.materials.database().end };
        (0..last).map(|m| self.materials.luminance(m)).collect()
    }

    fn key(&self, material: usize, light: &str, points: &[SurfacePoint]) -> String {
        renders::render_key(&self.fingerprints.materials[&material], &self.fingerprints.lights[light], points)
    }

    /// Renders every photograph and every reference picture that is not in the cache, one light
    /// after the other.
    fn render(&self, work: &[Work]) -> Result<()> {
        let mut wanted: BTreeSet<(String, bool, usize)> = BTreeSet::new();
        for (unit, _) in work {
            wanted.insert((unit.light.clone(), false, unit.material));
            wanted.extend(self.relit_in(unit).into_iter().map(|light| (light, true, unit.material)));
        }
        let points = |relit: bool| if relit { &self.stage.points } else { &self.points };
        let stored = |key: &str| self.cache.load_json::<Render>(key);
        wanted.retain(|(light, relit, m)| stored(&self.key(*m, light, points(*relit))).is_none());
        let progress = Progress::new("rendering", wanted.len());
        let mut tree: Option<(&str, LightTree)> = None;
        for (light, relit, material) in &wanted {
            if tree.as_ref().is_none_or(|(name, _)| name != light) {
                tree = Some((light, self.lights.tree(light)?));
            }
            let (_, tree) = tree.as_ref().expect("just made");
            let points = points(*relit);
            let render = renders::render(&self.materials.full(*material)?, tree, points);
            self.cache.store_json(&self.key(*material, light, points), &render)?;
            progress.step();
        }
        progress.finish();
        Ok(())
    }

    fn load(&self, material: usize, light: &str, points: &[SurfacePoint]) -> Result<Render> {
        self.cache
            .load_json(&self.key(material, light, points))
            .context("a render is no longer in the cache; run again")
    }

    fn estimate(&self, work: &[Work], threads: usize) -> Result<()> {
        let start = Instant::now();
        let is_lit = |e: &Estimator| matches!(e, Estimator::KnownLight | Estimator::KnownLightRotated);
        let known_light = work.iter().flat_map(|(_, open)| open).any(|(e, _)| is_lit(e));
        let mut knowledge: BTreeMap<Protocol, LearntModels> = BTreeMap::new();
        for protocol in work.iter().map(|(u, _)| u.protocol.learns_as()).collect::<BTreeSet<_>>() {
            let (prior, lights) = (self.prior.as_ref(), (self.training.as_ref(), known_light));
            let learnt = LearntModels::learn(
                &self.materials,
                protocol,
                &self.conditions,
                &self.points,
                prior,
                lights,
                &self.cache,
            )?;
            knowledge.insert(protocol, learnt);
        }
        let relit: BTreeSet<(bool, String)> = work
            .iter()
            .flat_map(|(u, _)| self.relit_in(u).into_iter().map(|light| (self.is_outside(u), light)))
            .collect();
        let relighters: BTreeMap<(bool, String), [Relighter; 3]> = relit
            .into_iter()
            .map(|(outside, light)| {
                let (tree, settings) = (self.lights.tree(&light)?, IntegratorSettings::default());
                let examples = self.examples(outside);
                let relighters = Relighter::of_channels(&self.stage.points, &examples, &tree, &settings);
                Ok(((outside, light), relighters))
            })
            .collect::<Result<_>>()?;
        // Images of the basis functions for the known-light oracle, by training protocol and light.
        let mut images: BTreeMap<(Protocol, &str), Vec<f32>> = BTreeMap::new();
        for (unit, _) in work {
            let learnt = unit.protocol.learns_as();
            if let Entry::Vacant(place) = images.entry((learnt, unit.light.as_str())) {
                let functions = &knowledge[&learnt].model.reflectance.functions;
                let (name, tree) = (&self.fingerprints.lights[&unit.light], || self.lights.tree(&unit.light));
                place.insert(renders::images(&self.cache, functions, name, &tree, &self.points)?);
            }
        }
        // Matrices of the known lights, by training protocol and light.
        let mut operators: BTreeMap<(Protocol, &str), Lit> = BTreeMap::new();
        for (unit, _) in work {
            let learnt = unit.protocol.learns_as();
            let Some(MaterialSpace { coordinates, places, .. }) = &knowledge[&learnt].space else { continue };
            if let Entry::Vacant(place) = operators.entry((learnt, unit.light.as_str())) {
                let step = self.points.len().div_ceil(known_light::ROWS);
                let points: Vec<SurfacePoint> = self.points.iter().step_by(step).copied().collect();
                let map = self.lights.map(&unit.light)?;
                let light = KnownLight::of_map(&map);
                place.insert(Lit {
                    operator: Operator::of(
                        &points,
                        None,
                        &light,
                        &known_light::PriorMaterials::of(coordinates, places),
                    ),
                    step,
                    map,
                });
            }
        }
        eprintln!("bases, operators and known lights: {:.0} s", start.elapsed().as_secs_f64());
        let progress = Progress::new("estimating", work.iter().map(|(_, open)| open.len()).sum());
        let next = AtomicUsize::new(0);
        let failure: Mutex<Option<anyhow::Error>> = Mutex::new(None);
        let fail = |error: anyhow::Error| {
            failure.lock().expect("nothing panics while it is locked").get_or_insert(error);
            next.store(work.len(), Ordering::Relaxed);
        };
        std::thread::scope(|scope| {
            for _ in 0..threads.min(work.len()) {
                scope.spawn(|| {
                    // Each photograph runs on one core. Threads wait less than if all cores
                    // processed one photograph after the other, and the times are comparable.
                    let pool = match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
                        Ok(pool) => pool,
                        Err(error) => return fail(anyhow!(error)),
                    };
                    while let Some((unit, open)) = work.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let learnt = unit.protocol.learns_as();
                        let of_light = (learnt, unit.light.as_str());
                        let given = (&images[&of_light][..], operators.get(&of_light));
                        let done = pool.install(|| {
                            self.photograph(unit, open, &knowledge[&learnt], given, &relighters, &progress)
                        });
                        if let Err(error) = done {
                            let name = &self.materials.names[unit.material];
                            return fail(error.context(format!("{name} in {}", unit.light)));
                        }
                    }
                });
            }
        });
        progress.finish();
        failure.into_inner().expect("nothing panics while it is locked").map_or(Ok(()), Err)
    }

    /// Computes all unfinished cells of one photograph.
    fn photograph(
        &self,
        unit: &Unit,
        open: &[(Estimator, String)],
        knowledge: &LearntModels,
        (under_true_light, operator): (&[f32], Option<&Lit>),
        relighters: &BTreeMap<(bool, String), [Relighter; 3]>,
        progress: &Progress,
    ) -> Result<()> {
        let mut colours = self.load(unit.material, &unit.light, &self.points)?.colours();
        let seed = self.key(unit.material, &unit.light, &self.points);
        renders::add_noise_rgb(&mut colours, self.conditions.noise, &seed);
        let image: Vec<Option<f64>> = luminances(&colours).into_iter().map(Some).collect();
        let projected = knowledge.plan.project(&image, 1e-5)?;
        let truth = self.materials.luminance(unit.material);
        let chroma = ChromaField::of_tables(self.materials.rgb(unit.material));
        let (relit, outside) = (self.relit_in(unit), self.is_outside(unit));
        let references = relit
            .iter()
            .map(|light| self.load(unit.material, light, &self.stage.points))
            .collect::<Result<Vec<Render>>>()?;
        let reference = GroundTruth {
            unit,
            name: &self.materials.names[unit.material],
            full_table: self.materials.source(unit.material) == Source::Full,
            truth: (&truth, &chroma),
            median: median_colour(&Plane::from_vec(colours.len(), 1, colours.clone()), |_| true),
            stage: &self.stage,
            lights: relit
                .iter()
                .zip(&references)
                .map(|(l, r)| (l.as_str(), &relighters[&(outside, l.clone())], r))
                .collect(),
            left_over: projected.left_over(),
            photograph: {
                let picture: Vec<Vec3> = self.shown.iter().map(|&i| colours[i]).collect();
                encoded(&self.stage, &picture, 1.0, &colours)
            },
        };
        let Conditions { starts, separable, .. } = self.conditions;
        let photograph = Photograph {
            knowledge,
            colours: &colours,
            image: &image,
            projected: &projected,
            operator,
            under_true_light,
            truth: &truth,
            chroma: &chroma,
            starts,
            separable,
        };
        for (estimator, key) in open {
            let start = Instant::now();
            let estimate = estimator.estimate(&photograph);
            let seconds = start.elapsed().as_secs_f64();
            self.store.put(&reference.evaluate(*estimator, key.clone(), seconds, estimate))?;
            progress.step();
        }
        Ok(())
    }
}
