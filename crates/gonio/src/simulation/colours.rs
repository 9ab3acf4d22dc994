//! Simulated photographs in colour, from which the [`ColourModel`] is learnt.

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::appearance::{DiskImage, Sample};
use crate::colour::{self, ClueFinder, ColourModel, LeftOut, TwoColours, white_chroma};
use crate::inference::learnt::LearntPosterior;
use crate::lighting::EnvironmentMap;
use crate::picture::luminance;
use crate::reflectance::BivariateTable;
use crate::render::{IntegratorSettings, LightTree, Relighter};
use crate::scene::{ObservationSettings, sphere_points};
use crate::shape::SurfacePoint;
use crate::sphere::OctahedralMap;

/// Accuracy of the pictures. Clues are means, medians and regressions over a ball, which an error
/// in single points does not move.
const ACCURACY: IntegratorSettings = IntegratorSettings { tolerance: 0.3, max_cells: 8_000 };

/// Number of normals on the visible hemisphere: that of a ball of some 40 pixels of radius.
const NORMALS: usize = 6_000;

/// Turn of the camera from one light to the next in degrees, the golden angle.
const TURN: f64 = 137.5;

/// Photographs of every material in every light, one each.
pub struct ColourStock<'a> {
    posterior: &'a LearntPosterior,
    materials: Vec<[BivariateTable; 3]>,
    luminances: Vec<BivariateTable>,
    truths: Vec<TwoColours>,
    finder: ClueFinder,
    lights: usize,
    /// Indices of material and light, and the sample.
    samples: Vec<(usize, usize, colour::Sample)>,
}

impl<'a> ColourStock<'a> {
    /// Starts with measured materials (red, green and blue of each) and the posterior that reads
    /// their luminance. Cells beyond 80 degrees take the value of the nearest trusted one.
    pub fn new(posterior: &'a LearntPosterior, mut materials: Vec<[BivariateTable; 3]>) -> Self {
        materials.iter_mut().flatten().for_each(BivariateTable::extend_from_trusted);
        Self {
            posterior,
            luminances: materials.iter().map(BivariateTable::luminance).collect(),
            truths: materials.iter().map(TwoColours::of).collect(),
            materials,
            finder: ClueFinder::new(),
            lights: 0,
            samples: Vec::new(),
        }
    }

    /// Photographs every material in one more light.
    pub fn add_light(&mut self, map: &EnvironmentMap) {
        let camera = DQuat::from_rotation_y((TURN * self.lights as f64).to_radians());
        let light = white_chroma(&map.to_grid(OctahedralMap::EqualArea, 32), camera);
        let settings = ObservationSettings { normals: NORMALS, ..ObservationSettings::default() };
        let turned = |p: SurfacePoint| SurfacePoint { normal: camera * p.normal, view: camera * DVec3::Z };
        let points: Vec<SurfacePoint> = sphere_points(&settings).into_iter().map(turned).collect();
        let operator = Relighter::of_channels(&points, &self.luminances, &LightTree::of_map(map), &ACCURACY);
        let sample = |(material, rgb): (usize, &[BivariateTable; 3])| {
            let channels: [Vec<f64>; 3] = std::array::from_fn(|c| operator[c].render(&rgb[c]));
            let colour = |i: usize| Vec3::from_array(std::array::from_fn(|c| channels[c][i] as f32));
            let image: Vec<Option<Vec3>> = (0..points.len()).map(|i| Some(colour(i))).collect();
            let seen = points.iter().zip(image.iter().flatten());
            let values: Vec<Sample> =
                seen.map(|(p, c)| Sample::of(p.in_view(), f64::from(luminance(*c)), 1.0)).collect();
            let table = self.posterior.posterior(&DiskImage::gather(&values)?).mean;
            let clues = self.finder.read(&points, &image, &table);
            Some((material, self.lights, colour::Sample { clues, colours: self.truths[material], light }))
        };
        let samples: Vec<_> = self.materials.par_iter().enumerate().filter_map(sample).collect();
        self.samples.extend(samples);
        self.lights += 1;
    }

    /// Learns from all photographs.
    ///
    /// # Panics
    /// If there are none.
    pub fn learn(&self) -> ColourModel {
        let samples: Vec<colour::Sample> = self.samples.iter().map(|(.., sample)| sample.clone()).collect();
        ColourModel::learn(&samples)
    }

    /// Measures the errors on materials and lights that are left out of the learning, in turn.
    pub fn left_out(&self) -> LeftOut {
        LeftOut::of(&self.samples)
    }
}
