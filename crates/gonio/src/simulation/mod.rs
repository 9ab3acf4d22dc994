//! Simulated photographs: materials of the prior under captured and artificial lights, with camera
//! effects.
//!
//! A [`ScenePool`] contains groups of scenes. A group has some materials and some views of lights;
//! its scenes are ideal images of a ball of each material in each view. Any number of photographs
//! can be drawn from a pool, since images are linear in the light and in the material. A
//! photograph shows one material of a group or a mixture of two. Its light is the sum of up to four
//! views with random weights and turns. The number of lights is therefore unlimited, and an encoder
//! cannot memorise them (`docs/training.md`).

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
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use glam::DQuat;
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

pub use camera::PhotographEffects;
pub use colours::ColourPool;
pub use lights::LightKind;
pub use pyramid::LightPyramid;
use scene::Packed;
pub use scene::{Scene, SceneRenderer};

use crate::appearance::DiskImage;
use crate::appearance::disk::{self, DISK_SIDE, on_disk};
use crate::lighting::EnvironmentMap;
use crate::parallel;
use crate::reflectance::{BivariateTable, Dictionary, DrawnMaterial, Prior};

/// Settings of the simulated scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScenePoolSettings {
    /// Number of groups from which photographs are drawn at a time.
    pub groups: usize,
    /// Number of views of captured lights in each group.
    pub views: usize,
    /// Number of materials in each group.
    pub group_materials: usize,
    /// Standard deviation of the angle by which cameras are tilted up or down, in degrees.
    pub tilt: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Prior from which materials are drawn.
    pub prior: Prior,
}

impl Default for ScenePoolSettings {
    fn default() -> Self {
        Self { groups: 8, views: 24, group_materials: 120, tilt: 12.0, seed: 1, prior: Prior::default() }
    }
}

impl ScenePoolSettings {
    /// Returns the number of groups for a training run of this many steps: short runs need fewer
    /// than the default.
    pub fn groups_for(steps: usize) -> usize {
        Self::default().groups.min(steps.div_ceil(8))
    }
}

/// Scenes from which photographs are drawn.
///
/// The scenes of the default settings take 0.9 GB. Training replaces one group after the other
/// ([`Self::load_groups`]), so memory does not depend on the number of scenes in a training run.
pub struct ScenePool {
    dictionary: Dictionary,
    lights: Vec<EnvironmentMap>,
    settings: ScenePoolSettings,
    renderer: SceneRenderer,
    /// Number of the first group of `groups`.
    first: u64,
    groups: VecDeque<Group>,
}

/// Materials, and their scenes in some views of lights.
struct Group {
    materials: Vec<DrawnMaterial>,
    /// Coordinates of each material.
    coordinates: Vec<Vec<f64>>,
    /// Scenes of the materials in each view.
    views: Vec<Vec<Packed>>,
}

/// Share of the photographs that show a mixture of two drawn materials.
const MIXED: f64 = 0.5;

/// Shares of the photographs with one, two, three and four views.
const SUMMED: [f64; 4] = [0.35, 0.3, 0.2, 0.15];

/// Range of the standard deviations of the logarithms of the weights of summed views.
const WEIGHTS: (f64, f64) = (0.3, 2.0);

/// Range of the exponent that is applied to the radiance of half of the lights to change their
/// contrast.
const CONTRASTS: (f64, f64) = (0.75, 1.3);

/// A photograph and its ground truth.
pub struct Photograph {
    /// Image of the photograph.
    pub image: DiskImage,
    /// Position of the material in the coordinates of the dictionary.
    pub coordinates: Vec<f64>,
}

impl ScenePool {
    /// Builds a pool without scenes.
    ///
    /// # Panics
    /// If there are no lights, or if `groups`, `views` or `group_materials` is zero.
    pub fn new(dictionary: Dictionary, lights: Vec<EnvironmentMap>, settings: ScenePoolSettings) -> Self {
        assert!(!lights.is_empty() && settings.groups * settings.views * settings.group_materials > 0);
        let renderer = SceneRenderer::new();
        Self { dictionary, lights, settings, renderer, first: 0, groups: VecDeque::new() }
    }

    /// Returns the dictionary that materials are drawn from.
    pub fn dictionary(&self) -> &Dictionary {
        &self.dictionary
    }

    /// Returns the number of scenes in the pool.
    pub fn scenes(&self) -> usize {
        self.groups.iter().map(|group| group.views.len() * group.materials.len()).sum()
    }

    /// Renders the groups `first` to `first + settings.groups - 1`, and drops all others.
    ///
    /// Groups that are already in the pool are kept. A group depends only on the settings, the
    /// lights and its number.
    pub fn load_groups(&mut self, first: u64) {
        let held = self.groups.len() as u64;
        if first < self.first || first >= self.first + held {
            self.groups.clear();
        } else {
            self.groups.drain(..(first - self.first) as usize);
        }
        self.first = first;
        while self.groups.len() < self.settings.groups {
            self.groups.push_back(self.group(first + self.groups.len() as u64));
        }
    }

    fn group(&self, number: u64) -> Group {
        let Self { dictionary, lights, settings, renderer, .. } = self;
        let mut rng = Pcg64::seed_from_u64(settings.seed.wrapping_mul(0x9e37_79b9).wrapping_add(number));
        let materials: Vec<DrawnMaterial> =
            (0..settings.group_materials).map(|_| dictionary.draw(&settings.prior, &mut rng)).collect();
        let tables: Vec<BivariateTable> = parallel::map(&materials, |m| dictionary.table(m));
        let mut view = |view: usize| {
            let map = &lights[rng.random_range(0..lights.len())];
            let changed = rng.random_bool(0.5).then(|| map.contrasted(rng.random_range(CONTRASTS.0..CONTRASTS.1)));
            let azimuth = rng.random_range(0.0..std::f64::consts::TAU);
            let tilt = settings.tilt.to_radians() * Distribution::<f64>::sample(&StandardNormal, &mut rng);
            let turn = DQuat::from_rotation_y(azimuth) * DQuat::from_rotation_x(tilt);
            let kind = LightKind::of(number as usize * settings.views + view);
            let light = kind.light(changed.as_ref().unwrap_or(map), turn, &mut rng);
            parallel::map(&renderer.render(&tables, &light), Packed::of)
        };
        let views = (0..settings.views).map(&mut view).collect();
        let coordinates = parallel::map(&tables, |t| dictionary.latent_space.of(t));
        Group { materials, coordinates, views }
    }

    /// Returns a photograph of one material or of a mixture of two, in the sum of some views.
    ///
    /// The number of photographs is unlimited. The same number and groups give the same photograph.
    ///
    /// # Panics
    /// If there are no scenes.
    pub fn photograph(&self, number: u64) -> Photograph {
        let mut rng = self.generator(number);
        let pick = self.pick(&mut rng);
        let camera = PhotographEffects::draw(&mut rng);
        let (mut scene, mut other) = (Scene::black(), Scene::black());
        for &(view, weight, way) in &pick.views {
            let scenes = &pick.group.views[view];
            let mut one = Scene::black();
            for (at, share) in pick.parts() {
                scenes[at].add_to(share, &mut one);
            }
            // Views contribute by their weights, independent of the brightness of their lights.
            let scale = weight / disk::mean(&one.values).max(1e-30);
            one.add_turned(way, scale, &mut scene);
            if camera.other_material > 0.0 {
                let mut other_material = Scene::black();
                scenes[pick.other_material].add_to(1.0, &mut other_material);
                other_material.add_turned(way, scale, &mut other);
            }
        }
        Photograph { image: camera.photograph(&scene, &other, &mut rng), coordinates: self.coordinates_of(&pick) }
    }

    /// Draws the coordinates of a material from the distribution of the materials of photographs.
    ///
    /// The number of materials is unlimited. The same number gives the same material, independent
    /// of the groups.
    pub fn draw_coordinates(&self, number: u64) -> Vec<f64> {
        let mut rng = self.generator(number);
        let mut draw = || self.dictionary.draw(&self.settings.prior, &mut rng);
        let (one, two) = (draw(), draw());
        self.coordinates_of_mixture(&one, &two, share(&mut rng))
    }

    fn generator(&self, number: u64) -> Pcg64 {
        Pcg64::seed_from_u64(self.settings.seed ^ number.wrapping_mul(0xd134_2543_de82_ef95))
    }

    fn pick(&self, rng: &mut Pcg64) -> Pick<'_> {
        let group = &self.groups[rng.random_range(0..self.groups.len())];
        let mut any = || rng.random_range(0..group.materials.len());
        let (one, two, other_material) = (any(), any(), any());
        let share = share(rng);
        let at = rng.random_range(0.0..1.0);
        let below = |count: usize| SUMMED[..count].iter().sum::<f64>();
        let count = (1..SUMMED.len()).find(|&count| at < below(count)).unwrap_or(SUMMED.len());
        let deviation = rng.random_range(WEIGHTS.0..WEIGHTS.1);
        let view = |_| {
            let weight = (deviation * Distribution::<f64>::sample(&StandardNormal, &mut *rng)).exp() as f32;
            (rng.random_range(0..group.views.len()), weight, rng.random_range(0..8))
        };
        let views = (0..count).map(view).collect();
        Pick { group, one, two, other_material, share, views }
    }

    fn coordinates_of(&self, pick: &Pick) -> Vec<f64> {
        if pick.share == 1.0 {
            return pick.group.coordinates[pick.one].clone();
        }
        let [one, two] = [pick.one, pick.two].map(|at| &pick.group.materials[at]);
        self.coordinates_of_mixture(one, two, pick.share)
    }

    /// Returns the coordinates of a mixture of two materials. `share` is that of the first.
    fn coordinates_of_mixture(&self, one: &DrawnMaterial, two: &DrawnMaterial, share: f32) -> Vec<f64> {
        let mut table = self.dictionary.table(one);
        if share < 1.0 {
            let other = self.dictionary.table(two);
            let cells = table.as_mut_slice().iter_mut().zip(other.as_slice());
            cells.for_each(|(a, b)| *a = share * *a + (1.0 - share) * b);
        }
        self.dictionary.latent_space.of(&table)
    }
}

/// Draws the share of the first of two materials.
fn share(rng: &mut Pcg64) -> f32 {
    if rng.random_bool(MIXED) { rng.random_range(0.0..1.0) } else { 1.0 }
}

/// Choice of the materials and the light of a photograph.
struct Pick<'a> {
    group: &'a Group,
    one: usize,
    two: usize,
    /// Material of the pixels that do not show the object's material.
    other_material: usize,
    /// Share of the first material.
    share: f32,
    /// Views, each with its weight and the symmetry of the square that turns it.
    views: Vec<(usize, f32, usize)>,
}

impl Pick<'_> {
    /// Iterates over the materials of the mixture and their shares.
    fn parts(&self) -> impl Iterator<Item = (usize, f32)> {
        [(self.one, self.share), (self.two, 1.0 - self.share)].into_iter().filter(|part| part.1 > 0.0)
    }
}

impl Scene {
    /// Adds the scene, scaled and turned by one of the eight symmetries of the square, to another.
    ///
    /// Details of different lights are independent: their squares add.
    fn add_turned(&self, way: usize, scale: f32, to: &mut Self) {
        let last = DISK_SIDE - 1;
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)) {
            let (x, y) = (cell % DISK_SIDE, cell / DISK_SIDE);
            let x = if way & 1 == 0 { x } else { last - x };
            let y = if way & 2 == 0 { y } else { last - y };
            let (x, y) = if way & 4 == 0 { (x, y) } else { (y, x) };
            let from = y * DISK_SIDE + x;
            to.values[cell] += scale * self.values[from];
            // Far faster than `hypot`, and no value is near the limits of f32.
            let (own, other) = (to.details[cell], scale * self.details[from]);
            to.details[cell] = (own * own + other * other).sqrt();
        }
    }
}

/// Builds a random generator for photographs that a [`PhotographEffects`] takes without a pool.
pub fn generator(seed: u64) -> impl Rng {
    Pcg64::seed_from_u64(seed)
}
