//! The whole chain on a small world of formulas.

use std::sync::OnceLock;

use glam::{DQuat, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use crate::appearance::{Gathered, Lattice, Statistics};
use crate::lighting::EnvironmentMap;
use crate::picture::Plane;
use crate::reflectance::{BivariateTable, CELLS, DictionarySettings, LogBasis, THETA_D, is_trusted};
use crate::render::{IntegratorSettings, LightTree, Relighter};
use crate::sphere::direction_of_lat_long;

/// A sky, a ground and a few lamps.
pub(crate) fn light_map(seed: u64) -> EnvironmentMap {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut draw = |low: f64, high: f64| -> f64 { rng.random_range(low..high) };
    let lamps: Vec<(DVec3, f64, f64)> = (0..4)
        .map(|_| {
            let direction = DVec3::new(draw(-1.0, 1.0), draw(-0.2, 1.0), draw(-1.0, 1.0)).normalize();
            (direction, draw(0.04, 0.4), draw(1.0, 5.0).exp())
        })
        .collect();
    let sky = draw(0.5, 2.0);
    let map = Plane::from_fn(96, 48, |x, y| {
        let d = direction_of_lat_long((x as f64 + 0.5) / 96.0, (y as f64 + 0.5) / 48.0);
        let base = if d.y > 0.0 { sky } else { 0.3 };
        let lit = lamps.iter().filter(|(lamp, width, _)| d.angle_between(*lamp) < *width).map(|l| l.2).sum::<f64>();
        Vec3::splat((base + lit) as f32)
    });
    EnvironmentMap::new(map).unwrap()
}

fn light(seed: u64) -> LightTree {
    LightTree::of_map(&light_map(seed))
}

fn lobe(width: f64, strength: f64) -> BivariateTable {
    BivariateTable::from_fn(move |h, d| 0.1 + strength * (-(h / width).powi(2)).exp() * (1.0 + d.powi(4)))
}

fn simulation() -> Simulation {
    let set = [(0.06, 30.0), (0.1, 8.0), (0.2, 3.0), (0.4, 1.0), (1.0, 0.05), (0.06, 2.0)];
    let tables: Vec<(String, BivariateTable)> = set.iter().map(|&(w, s)| (format!("{w} {s}"), lobe(w, s))).collect();
    let basis = LogBasis::fit(&tables, 8);
    let settings = DictionarySettings { draws: 60, dimensions: 3, seed: 1, ..Default::default() };
    let cheap = SimulationSettings { cameras: 3, draws: 24, tolerance: 2.0, max_cells: 600, ..Default::default() };
    let mut simulation = Simulation::new(Dictionary::new(basis, &settings), cheap);
    (0..12).for_each(|seed| simulation.add_light(&light(seed)));
    simulation
}

fn training() -> TrainingSettings {
    TrainingSettings { hidden: 32, epochs: 12, batch: 64, ..TrainingSettings::default() }
}

pub(crate) fn trained() -> &'static (Simulation, Amortised) {
    static ONCE: OnceLock<(Simulation, Amortised)> = OnceLock::new();
    ONCE.get_or_init(|| {
        let simulation = simulation();
        let amortised = simulation.train(&training(), &|_| ());
        (simulation, amortised)
    })
}

/// Photographs of materials in a light that was not seen.
fn photograph(table: &BivariateTable, seed: u64) -> Gathered {
    let lattice = Lattice::new();
    let points = lattice.points(DQuat::IDENTITY);
    let settings = IntegratorSettings { tolerance: 2.0, max_cells: 600 };
    let image = Relighter::new(&points, std::slice::from_ref(table), &light(seed), &settings).render(table);
    lattice.gather(&points, &image.into_iter().map(Some).collect::<Vec<_>>())
}

#[test]
fn unseen_photographs_are_told_apart() {
    let (_, amortised) = trained();
    let statistics = Statistics::new(&Lattice::new());
    let dictionary = &amortised.dictionary;
    let mut gain = 0.0;
    for (seed, material) in [(100, 0), (101, 2), (102, 4), (103, 5), (104, 1), (105, 3)] {
        let image = photograph(&dictionary.table(&dictionary.entries[material]), seed);
        let posterior = amortised.posterior(&statistics.of(&image.values));
        assert!((posterior.weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        // The mean of cube roots is below that of the tables, whose albedo is one.
        assert!((0.5..1.001).contains(&posterior.mean.normal_albedo()));
        assert!((posterior.neighbours.iter().map(|n| n.weight).sum::<f64>() - 1.0).abs() < 1e-9);
        // The logarithm of its share against that of one in six.
        let own = posterior.neighbours.iter().find(|n| n.name == dictionary.measured.names[material]).unwrap().weight;
        gain += (6.0 * own).max(1e-6).ln() / 6.0;
    }
    assert!(gain > 0.7, "{gain} nats a photograph");
}

#[test]
fn intervals_are_ordered_and_hold_the_mean_material() {
    let (_, amortised) = trained();
    let statistics = Statistics::new(&Lattice::new());
    let dictionary = &amortised.dictionary;
    let truth = dictionary.table(&dictionary.entries[2]);
    let posterior = amortised.posterior(&statistics.of(&photograph(&truth, 200).values));
    let quantiles = posterior.quantiles(dictionary, &[0.05, 0.5, 0.95]);
    let trusted = |c: &usize| is_trusted(c / THETA_D, c % THETA_D);
    for pair in quantiles.windows(2) {
        assert!(pair[0].iter().zip(&pair[1]).all(|(a, b)| a < b));
    }
    let level = |t: &[f32]| (0..CELLS).filter(trusted).map(|c| f64::from(t[c]).ln()).sum::<f64>();
    let cells = (0..CELLS).filter(trusted).count() as f64;
    let shift = ((level(posterior.mean.as_slice()) - level(truth.as_slice())) / cells).exp() as f32;
    let inside = (0..CELLS)
        .filter(trusted)
        .filter(|&c| (quantiles[0][c]..=quantiles[2][c]).contains(&(shift * truth.as_slice()[c])))
        .count() as f64;
    assert!(inside / cells > 0.6, "{}", inside / cells);
    // Without an image everything is open, with one not.
    let open = |p: &MaterialPosterior| p.undetermined(dictionary).iter().filter(|o| **o).count();
    let n = dictionary.entries.len();
    let prior = MaterialPosterior::of(dictionary, &vec![0.0; n]);
    assert_eq!(open(&prior), CELLS);
    assert!(open(&posterior) < CELLS);
}

#[test]
fn a_seed_makes_one_network_whatever_the_threads() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let set = vec![("a".to_owned(), lobe(0.1, 8.0)), ("b".to_owned(), lobe(0.5, 0.4))];
            let settings = DictionarySettings { draws: 10, dimensions: 2, seed: 3, ..Default::default() };
            let dictionary = Dictionary::new(LogBasis::fit(&set, 4), &settings);
            let cheap =
                SimulationSettings { cameras: 1, draws: 20, tolerance: 5.0, max_cells: 100, ..Default::default() };
            let mut simulation = Simulation::new(dictionary, cheap);
            simulation.add_light(&light(1));
            let settings = TrainingSettings { hidden: 8, epochs: 2, batch: 16, ..TrainingSettings::default() };
            simulation.train(&settings, &|_| ())
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn a_strange_image_is_called_strange() {
    let (simulation, amortised) = trained();
    let statistics = Statistics::new(&Lattice::new());
    let dictionary = &amortised.dictionary;
    let usual = photograph(&dictionary.table(&dictionary.entries[2]), 300);
    assert!(amortised.strangeness(&statistics.of(&usual.values)) < 0.05);
    // Salt and pepper.
    let mut rng = Pcg64::seed_from_u64(1);
    let values: Vec<f32> = usual.values.iter().map(|_| if rng.random_range(0..2) == 0 { 0.0 } else { 1.0 }).collect();
    assert!(amortised.strangeness(&statistics.of(&values)) > 0.2);
    assert_eq!(simulation.count(), 12 * 3 * 24);
}
