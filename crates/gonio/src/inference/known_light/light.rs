//! Known light: a map that may be clipped and rotated.

use glam::{DQuat, Vec3};

use super::{ACCURACY, PriorMaterials};
use crate::colour::{ChromaField, luminance_weights};
use crate::lighting::EnvironmentMap;
use crate::picture::Plane;
use crate::render::{LightTree, Relighter};
use crate::shape::{Points, SurfacePoint, Visibility};
use crate::sphere::lat_long_solid_angle;

/// Share of the largest value from which pixels count as clipped.
const PLATEAU: f32 = 0.999;

/// Smallest number of pixels of a clipped plateau, and the largest share of the sphere that it may
/// cover.
const CLIPPED: (usize, f64) = (4, 0.2);

/// Number of rows to which finer maps are averaged: pixels of 0.18 degrees, a third of the sun.
const ROWS: usize = 1024;

/// Given light, divided into pixels that may be clipped and the others.
///
/// The true radiance of clipped pixels is at least that in the map.
#[derive(Clone, Debug)]
pub struct KnownLight {
    rest: LightTree,
    clipped: Option<LightTree>,
}

impl KnownLight {
    /// Creates the light from a map in camera space, averaged to at most 1,024 rows.
    pub fn of_map(map: &EnvironmentMap) -> Self {
        let map = map.reduced(ROWS);
        match clipped(&map) {
            None => Self { rest: LightTree::of_map(&map), clipped: None },
            Some(mask) => {
                let part = |keep: bool| {
                    let (width, height) = map.radiance().size();
                    let value = |x, y| if mask[(x, y)] == keep { map.radiance()[(x, y)] } else { Vec3::ZERO };
                    EnvironmentMap::new(Plane::from_fn(width, height, value)).ok()
                };
                match (part(false), part(true)) {
                    (Some(rest), Some(of_clipped)) => {
                        Self { rest: LightTree::of_map(&rest), clipped: Some(LightTree::of_map(&of_clipped)) }
                    }
                    _ => Self { rest: LightTree::of_map(&map), clipped: None },
                }
            }
        }
    }

    /// Returns the light rotated relative to the map, in place of an earlier rotation.
    #[must_use]
    pub fn rotated(mut self, turn: DQuat) -> Self {
        self.set_rotation(turn);
        self
    }

    pub(super) fn set_rotation(&mut self, turn: DQuat) {
        self.rest.set_rotation(turn);
        self.clipped.iter_mut().for_each(|tree| tree.set_rotation(turn));
    }

    /// Returns the parts with their factors, for clipped pixels `gain` times as bright.
    pub(super) fn parts(&self, gain: f64) -> impl Iterator<Item = (&LightTree, f64)> {
        std::iter::once((&self.rest, 1.0)).chain(self.clipped.iter().map(move |tree| (tree, gain)))
    }
}

/// Returns the pixels at the largest value of a map, if there are enough to indicate clipping.
///
/// A lamp of constant radiance has the same appearance; its estimated gain is then one.
pub fn clipped(map: &EnvironmentMap) -> Option<Plane<bool>> {
    let radiance = map.radiance();
    let (width, height) = radiance.size();
    let largest = radiance.as_slice().iter().map(|p| p.max_element()).fold(0.0, f32::max);
    let mask = radiance.map(|p| p.max_element() >= PLATEAU * largest);
    let count = mask.as_slice().iter().filter(|m| **m).count();
    let clipped = |y: usize| (0..width).filter(|x| mask[(*x, y)]).count() as f64;
    let covered: f64 = (0..height).map(|y| lat_long_solid_angle(y, height) * clipped(y)).sum();
    let share = covered / (4.0 * std::f64::consts::PI);
    (count >= CLIPPED.0 && share <= CLIPPED.1).then_some(mask)
}

/// Matrices from a table to the luminance of points.
///
/// One is for the light without its clipped pixels, the other for the clipped pixels.
#[derive(Clone, Debug)]
pub struct Operator {
    rest: Relighter,
    clipped: Option<Relighter>,
}

impl Operator {
    /// Computes the matrices for points of a surface with this visibility.
    ///
    /// The light is divided as finely as the sharpest of the materials requires.
    pub fn of(
        points: &[SurfacePoint],
        visibility: Option<&Visibility>,
        light: &KnownLight,
        materials: &PriorMaterials<'_>,
    ) -> Self {
        let points = Points::new(points, visibility);
        let part = |tree: &LightTree| Relighter::new(points, &materials.examples, tree, &ACCURACY);
        Self { rest: part(&light.rest), clipped: light.clipped.as_ref().map(part) }
    }

    /// Computes the matrices of the channels (red, green, blue) of the light, with its clipped
    /// pixels `gain` times as bright as in the map.
    pub(super) fn of_channels(
        points: &[SurfacePoint],
        visibility: Option<&Visibility>,
        (light, gain): (&KnownLight, f64),
        materials: &PriorMaterials<'_>,
    ) -> [Self; 3] {
        let points = Points::new(points, visibility);
        let part = |tree| Relighter::of_channels(points, &materials.examples, tree, &ACCURACY);
        let rest = part(&light.rest);
        let whole = match &light.clipped {
            None => rest,
            Some(clipped) => {
                let clipped = part(clipped);
                std::array::from_fn(|c| rest[c].plus(&clipped[c], gain))
            }
        };
        whole.map(|rest| Self { rest, clipped: None })
    }

    /// Returns the matrix to the luminance of a coloured material, `sum_c w_c x_c R_c`.
    ///
    /// `R_c` are the matrices of the channels of the light, `x_c` the ratios of the material's
    /// channels to its luminance, and `w_c` the shares of the channels in the luminance.
    pub(super) fn of_colours(channels: &[Self; 3], field: &ChromaField) -> Self {
        let shares = luminance_weights();
        let scaled = |c: usize| {
            let ratios = field.ratios(c);
            channels[c].rest.map(|cell, weight| {
                let ratio = ratios.map_or(1.0, |ratios| f64::from(ratios[cell]));
                (shares[c] * ratio * f64::from(weight)) as f32
            })
        };
        Self { rest: scaled(0).plus(&scaled(1), 1.0).plus(&scaled(2), 1.0), clipped: None }
    }

    /// Returns the matrix of a subset of the points, without clipped pixels of the light.
    pub(super) fn select(&self, points: &[usize]) -> Self {
        Self { rest: self.rest.select(points), clipped: None }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.rest.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether the light has clipped pixels.
    pub(super) fn clips(&self) -> bool {
        self.clipped.is_some()
    }

    /// Returns the matrix of the light without its clipped pixels, and that of the clipped pixels.
    pub(super) fn parts(&self) -> impl Iterator<Item = &Relighter> {
        std::iter::once(&self.rest).chain(&self.clipped)
    }

    /// Returns cells and weights of a point, for clipped pixels `gain` times as bright.
    ///
    /// A cell may occur twice.
    pub(super) fn row(&self, point: usize, gain: f64) -> impl Iterator<Item = (usize, f64)> {
        let of_clipped = self.clipped.iter().flat_map(move |matrix| matrix.row(point));
        let of_clipped = of_clipped.map(move |(cell, w)| (cell, gain * f64::from(w)));
        self.rest.row(point).map(|(cell, w)| (cell, f64::from(w))).chain(of_clipped)
    }

    /// Returns the luminance of a point under the clipped pixels alone, as bright as in the map.
    pub(super) fn under_clipped(&self, point: usize, values: &[f64]) -> f64 {
        let matrix = self.clipped.iter();
        matrix.flat_map(|matrix| matrix.row(point)).map(|(cell, w)| f64::from(w) * values[cell]).sum()
    }

    /// Returns the luminance of every point, given the reflectance in every cell.
    pub(super) fn apply(&self, values: &[f64], gain: f64) -> Vec<f64> {
        (0..self.len()).map(|at| self.row(at, gain).map(|(cell, w)| w * values[cell]).sum()).collect()
    }
}
