//! Simulated photographs: materials of the prior under captured and artificial lights, with camera
//! effects.
//!
//! A [`Stock`] contains scenes: ideal images of a ball. An unlimited number of photographs can be
//! drawn from it, each with a new material and new camera effects ([`Camera`]). A mixture of two
//! materials under one light is also a material, and its image is the mixture of their images.

mod ball;
mod camera;
mod colours;
mod fields;
mod figure;
mod gather;
mod lights;
mod orbit;
mod pyramid;
mod scene;

use glam::DQuat;
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use camera::Camera;
pub use colours::ColourStock;
pub use lights::LightKind;
pub use pyramid::LightPyramid;
use scene::Packed;
pub use scene::{Scene, SceneRenderer};

use crate::appearance::DiskImage;
use crate::appearance::disk::SIDE;
use crate::lighting::EnvironmentMap;
use crate::reflectance::{BivariateTable, Dictionary, Mixture, Prior};

/// Settings of the simulated scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StockSettings {
    /// Number of cameras in each captured light, at even azimuths from a random start.
    pub cameras: usize,
    /// Standard deviation of the angle at which cameras look up or down, in degrees.
    pub tilt: f64,
    /// Number of materials drawn for each camera.
    pub draws: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Prior from which materials are drawn.
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
    renderer: SceneRenderer,
    lights: u64,
    shots: Vec<Shot>,
}

/// Materials in front of one camera in one light.
struct Shot {
    materials: Vec<Mixture>,
    /// Their coordinates.
    places: Vec<Vec<f64>>,
    /// Their scenes.
    scenes: Vec<Packed>,
}

/// Share of the photographs that are of a mixture of two drawn materials.
const MIXED: f64 = 0.25;

/// A photograph and its ground truth.
pub struct Photograph {
    /// Image of the photograph.
    pub image: DiskImage,
    /// Coordinates of the material in those of the dictionary.
    pub place: Vec<f64>,
}

impl Stock {
    /// Builds a stock without scenes.
    pub fn new(dictionary: Dictionary, settings: StockSettings) -> Self {
        Self { dictionary, settings, renderer: SceneRenderer::new(), lights: 0, shots: Vec::new() }
    }

    /// Returns the dictionary that materials are drawn from.
    pub fn dictionary(&self) -> &Dictionary {
        &self.dictionary
    }

    /// Returns the number of scenes so far.
    pub fn scenes(&self) -> usize {
        self.shots.iter().map(|s| s.materials.len()).sum()
    }

    /// Adds scenes in one more captured light and in others derived from it. The random numbers
    /// depend on the seed and on the number of lights before.
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
            let scenes = self.renderer.render(&tables, &light).par_iter().map(Packed::of).collect();
            let places = tables.par_iter().map(|t| self.dictionary.coordinates.of(t)).collect();
            self.shots.push(Shot { materials, places, scenes });
        }
        self.lights += 1;
    }

    /// Returns one of an unlimited number of photographs, the same for the same number: of one of
    /// the materials or, in a quarter of them, of a mixture of two; turned by quarters about the
    /// view and mirrored at random.
    ///
    /// # Panics
    /// If there are no scenes.
    pub fn photograph(&self, number: u64) -> Photograph {
        let mut rng = self.generator(number);
        let pick = self.pick(&mut rng);
        let (mut scene, mut other) = (Scene::black(), Scene::black());
        for (at, share) in pick.parts() {
            pick.shot.scenes[at].add_to(share, &mut scene);
        }
        let camera = Camera::draw(&mut rng);
        if camera.foreign > 0.0 {
            pick.shot.scenes[pick.foreign].add_to(1.0, &mut other);
        }
        let mut image = camera.photograph(&scene, &other, &mut rng);
        turn(&mut image, rng.random_range(0..8));
        Photograph { image, place: self.place_of(&pick) }
    }

    /// Returns the coordinates of the material of the photograph with this number.
    ///
    /// # Panics
    /// If there are no scenes.
    pub fn place(&self, number: u64) -> Vec<f64> {
        self.place_of(&self.pick(&mut self.generator(number)))
    }

    fn generator(&self, number: u64) -> Pcg64 {
        Pcg64::seed_from_u64(self.settings.seed ^ number.wrapping_mul(0xd134_2543_de82_ef95))
    }

    fn pick(&self, rng: &mut Pcg64) -> Pick<'_> {
        let shot = &self.shots[rng.random_range(0..self.shots.len())];
        let mut any = || rng.random_range(0..shot.materials.len());
        let (one, two, foreign) = (any(), any(), any());
        let share = if rng.random_range(0.0..1.0) < MIXED { rng.random_range(0.0..1.0) } else { 1.0 };
        Pick { shot, one, two, foreign, share }
    }

    fn place_of(&self, pick: &Pick) -> Vec<f64> {
        if pick.share == 1.0 {
            return pick.shot.places[pick.one].clone();
        }
        let part =
            |(at, share): (usize, f32)| pick.shot.materials[at].iter().map(move |(c, w)| (*c, w * f64::from(share)));
        let material: Mixture = pick.parts().flat_map(part).collect();
        self.dictionary.coordinates.of(&self.dictionary.table(&material))
    }
}

/// Choice of the materials in a photograph.
struct Pick<'a> {
    shot: &'a Shot,
    one: usize,
    two: usize,
    /// Material of the pixels that do not show the object's material.
    foreign: usize,
    /// Share of the first material.
    share: f32,
}

impl Pick<'_> {
    /// Iterates over the materials of the mixture and their shares.
    fn parts(&self) -> impl Iterator<Item = (usize, f32)> {
        [(self.one, self.share), (self.two, 1.0 - self.share)].into_iter().filter(|part| part.1 > 0.0)
    }
}

/// Applies one of the eight symmetries of the square.
fn turn(image: &mut DiskImage, way: usize) {
    let last = SIDE - 1;
    let from = |cell: usize| {
        let (x, y) = (cell % SIDE, cell / SIDE);
        let (x, y) = if way & 1 == 0 { (x, y) } else { (last - x, y) };
        let (x, y) = if way & 2 == 0 { (x, y) } else { (x, last - y) };
        let (x, y) = if way & 4 == 0 { (x, y) } else { (y, x) };
        y * SIDE + x
    };
    fn laid<T: Copy>(values: &[T], from: impl Fn(usize) -> usize) -> Vec<T> {
        (0..SIDE * SIDE).map(|c| values[from(c)]).collect()
    }
    image.values = laid(&image.values, from);
    image.counts = laid(&image.counts, from);
    image.details = laid(&image.details, from);
}

/// Builds a random generator for photographs by a camera without a stock.
pub fn generator(seed: u64) -> impl Rng {
    Pcg64::seed_from_u64(seed)
}
