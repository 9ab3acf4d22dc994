//! Photographs that could have been: materials of the prior in captured and made-up lights, taken by ordinary cameras.
//!
//! A [`Stock`] holds scenes, pictures of a ball without any fault; photographs are drawn from it without end, each of a material of its own (any mixture of two
//! in one light is a material, and its picture the mixture of theirs) with camera effects of its own ([`Camera`]).

mod ball;
mod camera;
mod lights;
mod pyramid;

use glam::{DQuat, Vec3};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use ball::BallRenderer;
pub use camera::Camera;
pub use lights::LightKind;
pub use pyramid::LightPyramid;

use crate::appearance::DiskImage;
use crate::appearance::disk::{self, SIDE, on_disk};
use crate::lighting::EnvironmentMap;
use crate::reflectance::{BivariateTable, Dictionary, Mixture, Prior};

/// How scenes are simulated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StockSettings {
    /// Cameras in each captured light, at even azimuths from a random one on.
    pub cameras: usize,
    /// Standard deviation of the angle at which cameras look up or down, in degrees.
    pub tilt: f64,
    /// Materials drawn for each camera.
    pub draws: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// What is drawn.
    pub prior: Prior,
}

impl Default for StockSettings {
    fn default() -> Self {
        Self { cameras: 6, tilt: 12.0, draws: 160, seed: 1, prior: Prior::default() }
    }
}

/// Scenes to draw photographs from.
pub struct Stock {
    dictionary: Dictionary,
    settings: StockSettings,
    renderer: BallRenderer,
    /// The cells of the disk, and their normals.
    cells: Vec<usize>,
    normals: Vec<Vec3>,
    lights: u64,
    shots: Vec<Shot>,
}

/// Materials before one camera in one light.
struct Shot {
    materials: Vec<Mixture>,
    /// Pictures, one after the other.
    pictures: Vec<Packed>,
}

/// A picture as logarithms in 16 bits, to 0.04 %.
struct Packed {
    /// Logarithm of the largest value.
    top: f32,
    values: Vec<u16>,
}

/// Share of the photographs that are of a mixture of two drawn materials.
const MIXED: f64 = 0.25;

/// Range of the logarithms of a packed picture.
const RANGE: f32 = 24.0;

impl Packed {
    fn of(values: &[f32]) -> Self {
        let top = values.iter().copied().fold(1e-30, f32::max).ln();
        let steps = f32::from(u16::MAX) / RANGE;
        let pack = |v: &f32| ((top - v.max(1e-35).ln()) * steps).round().clamp(0.0, f32::from(u16::MAX)) as u16;
        Self { top, values: values.iter().map(pack).collect() }
    }

    fn add_to(&self, weight: f32, cells: &[usize], image: &mut [f32]) {
        let step = RANGE / f32::from(u16::MAX);
        for (value, &cell) in self.values.iter().zip(cells) {
            image[cell] += weight * (self.top - step * f32::from(*value)).exp();
        }
    }
}

/// A photograph and the material that it is of.
pub struct Photograph {
    /// What it shows.
    pub image: DiskImage,
    /// The material, of albedo one.
    pub material: Mixture,
}

impl Stock {
    /// Without scenes yet.
    pub fn new(dictionary: Dictionary, settings: StockSettings) -> Self {
        let cells: Vec<usize> = (0..SIDE * SIDE).filter(|&c| on_disk(c)).collect();
        let normals = cells.iter().map(|&c| disk::normal(c)).collect();
        let renderer = BallRenderer::new();
        Self { dictionary, settings, renderer, cells, normals, lights: 0, shots: Vec::new() }
    }

    /// The materials that are drawn.
    pub fn dictionary(&self) -> &Dictionary {
        &self.dictionary
    }

    /// Scenes so far.
    pub fn scenes(&self) -> usize {
        self.shots.iter().map(|s| s.materials.len()).sum()
    }

    /// Scenes in one more captured light and in others made of it. The random numbers depend on the seed and on how many lights there were before.
    pub fn add_light(&mut self, map: &EnvironmentMap) {
        let mut rng = Pcg64::seed_from_u64(self.settings.seed.wrapping_mul(0x9e37_79b9).wrapping_add(self.lights));
        let first: f64 = rng.random_range(0.0..1.0);
        for camera in 0..self.settings.cameras {
            let azimuth = (camera as f64 + first) / self.settings.cameras as f64 * std::f64::consts::TAU;
            let tilt = self.settings.tilt.to_radians() * Distribution::<f64>::sample(&StandardNormal, &mut rng);
            let turn = DQuat::from_rotation_y(azimuth) * DQuat::from_rotation_x(tilt);
            let kind = LightKind::of(self.lights as usize * self.settings.cameras + camera);
            let light = kind.light(map, turn, &mut rng);
            let materials: Vec<Mixture> =
                (0..self.settings.draws).map(|_| self.dictionary.draw(&self.settings.prior, &mut rng)).collect();
            let tables: Vec<BivariateTable> = materials.par_iter().map(|m| self.dictionary.table(m)).collect();
            let pictures = self.renderer.render(&self.normals, &tables, &light);
            let pictures = pictures.par_iter().map(|p| Packed::of(p)).collect();
            self.shots.push(Shot { materials, pictures });
        }
        self.lights += 1;
    }

    /// One of endless photographs, the same for the same number: of one of the materials or, in a quarter, of a mixture of two; turned by quarters about the view and
    /// mirrored at random.
    ///
    /// # Panics
    /// Without scenes.
    pub fn photograph(&self, number: u64) -> Photograph {
        let mut rng = Pcg64::seed_from_u64(self.settings.seed ^ number.wrapping_mul(0xd134_2543_de82_ef95));
        let shot = &self.shots[rng.random_range(0..self.shots.len())];
        let mut pick = || rng.random_range(0..shot.materials.len());
        let (one, two, three) = (pick(), pick(), pick());
        let share: f32 = if rng.random_range(0.0..1.0) < MIXED { rng.random_range(0.0..1.0) } else { 1.0 };
        let (mut scene, mut other) = (vec![0.0; SIDE * SIDE], vec![0.0; SIDE * SIDE]);
        shot.pictures[one].add_to(share, &self.cells, &mut scene);
        let mut material: Mixture = shot.materials[one].iter().map(|(c, w)| (*c, w * f64::from(share))).collect();
        if share < 1.0 {
            shot.pictures[two].add_to(1.0 - share, &self.cells, &mut scene);
            material.extend(shot.materials[two].iter().map(|(c, w)| (*c, w * f64::from(1.0 - share))));
        }
        let camera = Camera::draw(&mut rng);
        if camera.foreign > 0.0 {
            shot.pictures[three].add_to(1.0, &self.cells, &mut other);
        }
        let mut image = camera.photograph(&scene, &other, &mut rng);
        turn(&mut image, rng.random_range(0..8));
        Photograph { image, material }
    }

    /// A fresh scene without faults: luminance at each cell of the disk of a table in one light, for tests and benchmarks.
    pub fn scenes_of(&self, tables: &[BivariateTable], light: &LightPyramid) -> Vec<Vec<f32>> {
        let spread = |picture: Vec<f32>| {
            let mut image = vec![0.0; SIDE * SIDE];
            self.cells.iter().zip(picture).for_each(|(&cell, value)| image[cell] = value);
            image
        };
        self.renderer.render(&self.normals, tables, light).into_iter().map(spread).collect()
    }
}

/// One of the eight ways to lay a square upon itself.
fn turn(image: &mut DiskImage, way: usize) {
    let last = SIDE - 1;
    let from = |cell: usize| {
        let (x, y) = (cell % SIDE, cell / SIDE);
        let (x, y) = if way & 1 == 0 { (x, y) } else { (last - x, y) };
        let (x, y) = if way & 2 == 0 { (x, y) } else { (x, last - y) };
        let (x, y) = if way & 4 == 0 { (x, y) } else { (y, x) };
        y * SIDE + x
    };
    let laid = |values: &[f32]| (0..SIDE * SIDE).map(|c| values[from(c)]).collect();
    image.values = laid(&image.values);
    image.counts = laid(&image.counts);
}

/// A generator for the photographs of a camera outside of a stock.
pub fn generator(seed: u64) -> impl Rng {
    Pcg64::seed_from_u64(seed)
}
