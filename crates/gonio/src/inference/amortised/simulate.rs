//! Photographs that could have been: materials of the prior in captured lights.

use glam::DQuat;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::appearance::{Lattice, STATISTICS, Statistics};
use crate::reflectance::{BivariateTable, Dictionary, Prior};
use crate::render::{IntegratorSettings, LightTree, Relighter};

/// How photographs are simulated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulationSettings {
    /// Cameras in each light, at even azimuths from a random one on.
    pub cameras: usize,
    /// Standard deviation of the angle at which cameras look up or down, in degrees.
    pub tilt: f64,
    /// Materials drawn for each camera.
    pub draws: usize,
    /// Largest standard deviation of the noise of a photograph, relative to its mean; each has a level of its own, down to none.
    pub noise: f64,
    /// Accuracy of the rendering (see [`IntegratorSettings`]).
    pub tolerance: f64,
    /// Directions of light at most for one point.
    pub max_cells: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// What is drawn.
    pub prior: Prior,
}

impl Default for SimulationSettings {
    fn default() -> Self {
        let prior = Prior::default();
        Self { cameras: 12, tilt: 12.0, draws: 60, noise: 0.01, tolerance: 0.3, max_cells: 8_000, seed: 1, prior }
    }
}

/// Simulated photographs as pairs of statistics and places of materials: samples of `p(F) p(I | F)` with the light integrated
/// out by drawing it from captured ones.
#[derive(Clone, Debug)]
pub struct Simulation {
    pub(super) dictionary: Dictionary,
    settings: SimulationSettings,
    lattice: Lattice,
    statistics: Statistics,
    lights: u64,
    /// [`STATISTICS`] for each photograph.
    pub(super) statistics_of_all: Vec<f32>,
    /// Coordinates of the material of each photograph.
    pub(super) places_of_all: Vec<f32>,
}

/// Noise of one photograph.
struct Noise {
    /// Standard deviation relative to the mean of the picture.
    level: f64,
    seed: u64,
}

impl Simulation {
    /// Without photographs yet.
    pub fn new(dictionary: Dictionary, settings: SimulationSettings) -> Self {
        let lattice = Lattice::new();
        let statistics = Statistics::new(&lattice);
        Self {
            dictionary,
            settings,
            lattice,
            statistics,
            lights: 0,
            statistics_of_all: Vec::new(),
            places_of_all: Vec::new(),
        }
    }

    /// Photographs so far.
    pub fn count(&self) -> usize {
        self.statistics_of_all.len() / STATISTICS
    }

    /// Photographs in one more light. The random numbers depend on the seed and on how many lights there were before.
    pub fn add_light(&mut self, light: &LightTree) {
        let mut rng = Pcg64::seed_from_u64(self.settings.seed.wrapping_mul(0x9e37_79b9).wrapping_add(self.lights));
        self.lights += 1;
        let first: f64 = rng.random_range(0.0..1.0);
        for camera in 0..self.settings.cameras {
            let azimuth = (camera as f64 + first) / self.settings.cameras as f64 * std::f64::consts::TAU;
            let tilt = self.settings.tilt.to_radians() * Distribution::<f64>::sample(&StandardNormal, &mut rng);
            self.add_camera(light, DQuat::from_rotation_y(azimuth) * DQuat::from_rotation_x(tilt), &mut rng);
        }
    }

    fn add_camera(&mut self, light: &LightTree, camera: DQuat, rng: &mut Pcg64) {
        let settings = &self.settings;
        let accuracy = IntegratorSettings { tolerance: settings.tolerance, max_cells: settings.max_cells };
        let points = self.lattice.points(camera);
        let (tables, noises): (Vec<BivariateTable>, Vec<Noise>) = (0..settings.draws)
            .map(|_| {
                let table = self.dictionary.table(&self.dictionary.draw(&settings.prior, rng));
                (table, Noise { level: settings.noise * rng.random_range(0.0..1.0), seed: rng.random() })
            })
            .unzip();
        let relighter = Relighter::new(&points, &tables, light, &accuracy);
        let results: Vec<(Vec<f32>, Vec<f32>)> = tables
            .par_chunks(16)
            .zip(noises.par_chunks(16))
            .map(|(tables, noises)| {
                let photograph = |(table, noise): (&BivariateTable, &Noise)| noise.on(relighter.render(table));
                let photographs: Vec<f32> = tables.iter().zip(noises).flat_map(photograph).collect();
                let places = tables.iter().flat_map(|table| self.dictionary.coordinates.of(table));
                (self.statistics.of(&photographs), places.map(|z| z as f32).collect())
            })
            .collect();
        for (statistics, places) in results {
            self.statistics_of_all.extend(statistics);
            self.places_of_all.extend(places);
        }
    }
}

impl Noise {
    fn on(&self, image: Vec<f64>) -> Vec<f32> {
        let mean = image.iter().sum::<f64>() / image.len() as f64;
        let mut rng = Pcg64::seed_from_u64(self.seed);
        let mut noisy = |v: f64| {
            let z: f64 = StandardNormal.sample(&mut rng);
            (v + self.level * mean * z).max(0.0) as f32
        };
        image.into_iter().map(&mut noisy).collect()
    }
}
