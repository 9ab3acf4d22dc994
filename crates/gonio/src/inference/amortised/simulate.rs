//! Photographs that could have been: materials of the prior in captured lights.

use glam::DQuat;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::appearance::{Lattice, STATISTICS, Statistics};
use crate::reflectance::{Dictionary, Mixture};
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
}

impl Default for SimulationSettings {
    fn default() -> Self {
        Self { cameras: 12, tilt: 12.0, draws: 60, noise: 0.01, tolerance: 0.3, max_cells: 8_000, seed: 1 }
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

/// One photograph's share of the random numbers.
struct Draw {
    mixture: Mixture,
    noise: f64,
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
        let relighter = Relighter::new(&points, &self.dictionary.components, light, &accuracy);
        let images: Vec<Vec<f64>> = self.dictionary.components.par_iter().map(|t| relighter.render(t)).collect();
        let draws: Vec<Draw> = (0..settings.draws)
            .map(|_| Draw {
                mixture: self.dictionary.draw(rng),
                noise: settings.noise * rng.random_range(0.0..1.0),
                seed: rng.random(),
            })
            .collect();
        let results: Vec<(Vec<f32>, Vec<f32>)> = draws
            .par_chunks(16)
            .map(|draws| {
                let photographs: Vec<f32> = draws.iter().flat_map(|draw| draw.photograph(&images)).collect();
                let place = |d: &Draw| self.dictionary.coordinates.of(&self.dictionary.table(&d.mixture));
                let places = draws.iter().flat_map(place).map(|z| z as f32).collect();
                (self.statistics.of(&photographs), places)
            })
            .collect();
        for (statistics, places) in results {
            self.statistics_of_all.extend(statistics);
            self.places_of_all.extend(places);
        }
    }
}

impl Draw {
    fn photograph(&self, images: &[Vec<f64>]) -> Vec<f32> {
        let mut sum = vec![0.0; images[0].len()];
        for &(component, weight) in &self.mixture {
            sum.iter_mut().zip(&images[component]).for_each(|(s, v)| *s += weight * v);
        }
        let mean = sum.iter().sum::<f64>() / sum.len() as f64;
        let mut rng = Pcg64::seed_from_u64(self.seed);
        let mut noisy = |v: f64| {
            let z: f64 = StandardNormal.sample(&mut rng);
            (v + self.noise * mean * z).max(0.0) as f32
        };
        sum.into_iter().map(&mut noisy).collect()
    }
}
