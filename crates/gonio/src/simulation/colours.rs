//! Simulated photographs in colour, from which the [`ColourModel`] is learnt.

use glam::{DQuat, DVec3, Vec3};

use crate::appearance::{DiskImage, Sample};
use crate::colour::{ChannelReading, Chroma, ColourModel, ColourSample, channel_difference, white_chroma};
use crate::inference::learnt::LearntPosterior;
use crate::lighting::EnvironmentMap;
use crate::parallel;
use crate::picture::luminance;
use crate::reflectance::BivariateTable;
use crate::render::{IntegratorSettings, LightTree, Relighter};
use crate::scene::{ObservationSettings, sphere_points};
use crate::shape::SurfacePoint;
use crate::sphere::OctahedralMap;

/// Accuracy of the pictures. Differences of channels hardly depend on errors of single points.
const ACCURACY: IntegratorSettings = IntegratorSettings { tolerance: 0.3, max_cells: 8_000 };

/// Number of normals on the visible hemisphere, about that of a ball with a radius of 40 pixels.
const NORMALS: usize = 6_000;

/// Rotation of the camera from one light to the next, in degrees: the golden angle.
const TURN: f64 = 137.5;

/// Number of cameras around each light. The prior of lights is learnt from their chromas.
const CAMERAS: usize = 8;

/// Simulated photographs: one of every material in every light.
pub struct ColourPool<'a> {
    posterior: &'a LearntPosterior,
    materials: Vec<[BivariateTable; 3]>,
    luminances: Vec<BivariateTable>,
    /// Differences of the channels of each material from its luminance.
    truths: Vec<[Vec<f64>; 3]>,
    lights: usize,
    samples: Vec<ColourSample>,
    chromas: Vec<Chroma>,
}

impl<'a> ColourPool<'a> {
    /// Builds a pool of measured materials (red, green and blue of each), without photographs.
    ///
    /// `posterior` evaluates their channels. Cells beyond 80 degrees take the value of the nearest
    /// trusted cell.
    pub fn new(posterior: &'a LearntPosterior, mut materials: Vec<[BivariateTable; 3]>) -> Self {
        materials.iter_mut().flatten().for_each(BivariateTable::extend_from_trusted);
        let luminances: Vec<BivariateTable> = materials.iter().map(BivariateTable::luminance).collect();
        let truths = parallel::map_range(materials.len(), |at| {
            let difference = |channel| channel_difference(&posterior.latent_space, channel, &luminances[at]);
            materials[at].each_ref().map(difference)
        });
        Self { posterior, truths, luminances, materials, lights: 0, samples: Vec::new(), chromas: Vec::new() }
    }

    /// Adds photographs of every material in one more light.
    pub fn add_light(&mut self, map: &EnvironmentMap) {
        let grid = map.reduced(128).to_grid(OctahedralMap::EqualArea, 32);
        let around = |k: usize| DQuat::from_rotation_y(std::f64::consts::TAU * k as f64 / CAMERAS as f64);
        let chromas: Vec<Chroma> = parallel::map_range(CAMERAS, |k| white_chroma(&grid, around(k)));
        self.chromas.extend(chromas);
        let camera = DQuat::from_rotation_y((TURN * self.lights as f64).to_radians());
        let light = white_chroma(&grid, camera).rgb().to_array().map(f64::ln);
        let settings = ObservationSettings { normals: NORMALS, ..ObservationSettings::default() };
        let turned = |p: SurfacePoint| SurfacePoint { normal: camera * p.normal, view: camera * DVec3::Z };
        let points: Vec<SurfacePoint> = sphere_points(&settings).into_iter().map(turned).collect();
        let operator = Relighter::of_channels(&points, &self.luminances, &LightTree::of_map(map), &ACCURACY);
        let sample = |at: usize| {
            let (rgb, truth) = (&self.materials[at], &self.truths[at]);
            let channels: [Vec<f64>; 3] = std::array::from_fn(|c| operator[c].render(&rgb[c]));
            let colour = |i: usize| Vec3::from_array(std::array::from_fn(|c| channels[c][i] as f32));
            let seen = points.iter().enumerate().map(|(i, p)| (p, colour(i)));
            let samples: Vec<Sample> =
                seen.map(|(p, c)| Sample::of(p.in_view(), f64::from(luminance(c)), 1.0).coloured(c)).collect();
            let image = DiskImage::gather(&samples)?;
            let of_luminance = ChannelReading::of(self.posterior, &image);
            let error = |c: usize| -> Option<Vec<f64>> {
                let channel = DiskImage::gather_channel(&samples, c, &image)?;
                let mut read = ChannelReading::of(self.posterior, &channel).minus(&of_luminance);
                read.iter_mut().zip(&truth[c]).for_each(|(read, truth)| *read -= truth);
                *read.last_mut()? -= light[c];
                Some(read)
            };
            Some(ColourSample { errors: [error(0)?, error(1)?, error(2)?] })
        };
        let samples = parallel::flat_map_range(self.materials.len(), sample);
        self.samples.extend(samples);
        self.lights += 1;
    }

    /// Learns a colour model from all photographs.
    ///
    /// # Panics
    /// If there are no photographs.
    pub fn learn(&self) -> ColourModel {
        ColourModel::learn(&self.posterior.latent_space, &self.materials, &self.samples, &self.chromas)
    }
}
