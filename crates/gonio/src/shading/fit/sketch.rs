//! Approximate pictures of smooth models from few evaluations, for the search.

use std::f64::consts::PI;

use faer::{Mat, MatRef};
use glam::DVec3;
use gonio_linalg::product;

use crate::reflectance::parametric::{HORIZON, directions};
use crate::reflectance::{BivariateTable, CELLS, THETA_D, THETA_H, angles_of, theta_d_of, theta_h_of};
use crate::render::Relighter;
use crate::shading::Shading;

/// Step between the half angles at which a model is evaluated, in cells (dense at the peak).
const STEP_H: usize = 3;
/// Difference angles (degrees) at which a model is evaluated, dense where reflectance rises.
const ALONG_D: [usize; 12] = [0, 10, 20, 30, 40, 50, 60, 68, 74, 79, 84, 89];

/// Number of azimuths `phi_d`, equally spaced over the quarter circle. Every second one is mirrored
/// to the other quarter, where reciprocal models have the same values.
const AZIMUTHS: usize = 6;

/// Smallest mean product of both cosines by which a model is scaled for interpolation.
const MIN_COSINES: f64 = 1e-3;

/// Step between the points of the sphere that are used.
const POINTS: usize = 3;

/// Part of a sphere in a light, as a linear function of a model's values in a few cells.
///
/// The values are means over azimuth. Between the cells, the model is interpolated.
pub(super) struct Sketch {
    /// Directions of each cell, at the azimuths with light and viewer above the horizon.
    cells: Vec<Vec<(DVec3, DVec3)>>,
    /// Weights of the cells for each point, by channel.
    matrix: [Vec<f32>; 3],
}

/// Returns the half angles at which a model is evaluated, in cells.
fn along_h() -> Vec<usize> {
    (0..THETA_H).step_by(STEP_H).chain([THETA_H - 1]).collect()
}

/// Iterates over the half and difference angles at which a model is evaluated, in radians.
fn places() -> impl Iterator<Item = (f64, f64)> {
    along_h().into_iter().flat_map(|h| ALONG_D.map(|d| (theta_h_of(h), theta_d_of(d))))
}

impl Sketch {
    /// Builds the sketch from the matrices of the whole sphere.
    pub(super) fn new(relighters: &[Relighter; 3]) -> Self {
        let along_h = along_h();
        let (in_h, in_d) = (shares(&along_h, THETA_H), shares(&ALONG_D, THETA_D));
        let count = along_h.len() * ALONG_D.len();
        // Microfacet models divide by both cosines, so their product with the cosines is smoother.
        let cosines: Vec<f32> = (0..CELLS)
            .map(|cell| {
                let (h, d) = angles_of(cell);
                let all = above(h, d);
                let sum: f64 = all.iter().map(|(wi, wo)| wi.z * wo.z).sum();
                (sum / all.len().max(1) as f64).max(MIN_COSINES) as f32
            })
            .collect();
        let rows = (0..relighters[0].len()).step_by(POINTS);
        let matrix = relighters.each_ref().map(|relighter| {
            let mut matrix = vec![0.0_f32; rows.clone().count() * count];
            for (row, point) in matrix.chunks_exact_mut(count).zip(rows.clone()) {
                for (cell, weight) in relighter.row(point) {
                    for (h, of_h) in in_h[cell / THETA_D] {
                        for (d, of_d) in in_d[cell % THETA_D] {
                            let at = along_h[h] * THETA_D + ALONG_D[d];
                            row[h * ALONG_D.len() + d] += weight * of_h * of_d * cosines[at] / cosines[cell];
                        }
                    }
                }
            }
            matrix
        });
        Self { cells: places().map(|(h, d)| above(h, d)).collect(), matrix }
    }

    /// Returns the picture of the tables to fit.
    pub(super) fn target(&self, tables: &[BivariateTable; 3]) -> Vec<DVec3> {
        let value = |(h, d)| DVec3::from_array(tables.each_ref().map(|table| table.eval(h, d)));
        self.picture(places().map(value).collect())
    }

    /// Returns the picture of a model.
    pub(super) fn picture_of<S: Shading>(&self, model: &S) -> Vec<DVec3> {
        self.picture(self.values(model.evaluator()))
    }

    /// Returns the unclamped pictures of several lists of values in the cells: `[list][point]`.
    pub(super) fn unclamped_pictures(&self, lists: &[Vec<DVec3>]) -> Vec<Vec<DVec3>> {
        let [r, g, b] = [0, 1, 2].map(|c| {
            let cells = self.cells.len();
            let values = Mat::from_fn(cells, lists.len(), |cell, k| lists[k][cell][c] as f32);
            let matrix = MatRef::from_row_major_slice(&self.matrix[c], self.matrix[c].len() / cells, cells);
            product(matrix, values.as_ref())
        });
        let colour = |point, k| DVec3::new(r[(point, k)].into(), g[(point, k)].into(), b[(point, k)].into());
        (0..lists.len()).map(|k| (0..r.nrows()).map(|point| colour(point, k)).collect()).collect()
    }

    /// Returns the RGB values of a model in the cells.
    pub(super) fn values(&self, eval: impl Fn(DVec3, DVec3) -> DVec3) -> Vec<DVec3> {
        let mean = |directions: &Vec<(DVec3, DVec3)>| {
            let sum: DVec3 = directions.iter().map(|(wi, wo)| eval(*wi, *wo)).sum();
            sum / directions.len().max(1) as f64
        };
        self.cells.iter().map(mean).collect()
    }

    /// Returns the colour of each point for these values.
    pub(super) fn picture(&self, values: Vec<DVec3>) -> Vec<DVec3> {
        let mut pictures = self.unclamped_pictures(&[values]);
        pictures[0].iter_mut().for_each(|colour| *colour = colour.max(DVec3::ZERO));
        pictures.swap_remove(0)
    }
}

/// Returns the directions of a cell, at the azimuths with light and viewer above the horizon.
fn above(theta_h: f64, theta_d: f64) -> Vec<(DVec3, DVec3)> {
    let azimuth = |i: usize| {
        let in_quarter = 0.5 * PI * (i as f64 + 0.5) / AZIMUTHS as f64;
        if i.is_multiple_of(2) { in_quarter } else { PI - in_quarter }
    };
    let all = (0..AZIMUTHS).map(|i| directions(theta_h, theta_d, azimuth(i)));
    all.filter(|(wi, wo)| wi.z > HORIZON && wo.z > HORIZON).collect()
}

/// Returns index and share of the two evaluated cells nearest to each of `count` cells.
fn shares(evaluated: &[usize], count: usize) -> Vec<[(usize, f32); 2]> {
    let share = |cell: usize| {
        let right = evaluated.partition_point(|at| *at <= cell).clamp(1, evaluated.len() - 1);
        let (low, high) = (evaluated[right - 1], evaluated[right]);
        let x = (cell - low) as f32 / (high - low) as f32;
        [(right - 1, 1.0 - x), (right, x)]
    };
    (0..count).map(share).collect()
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::super::super::MetallicRoughness;
    use super::*;
    use crate::appearance::Lattice;
    use crate::lighting::studio_light;
    use crate::render::{IntegratorSettings, LightTree};

    /// The approximate picture matches that of the whole table up to the interpolation error.
    #[test]
    fn sketch_approximates_the_picture() {
        let model = MetallicRoughness::of(&[0.5, 0.2, 0.1, 0.3, 0.35, 1.4, 1.0, 0.9, 0.8, 0.5, 0.9]);
        let tables = model.to_bivariate(super::super::FINE_AZIMUTHS);
        let settings = IntegratorSettings { tolerance: 0.5, max_cells: 8000 };
        let points = Lattice::new().points(DQuat::IDENTITY);
        let relighters = Relighter::of_channels(&points, &tables, &LightTree::of_map(&studio_light(32)), &settings);
        let sketch = Sketch::new(&relighters);
        let target = sketch.target(&tables);
        let drawn = sketch.picture_of(&model);
        let exact: Vec<f64> = relighters[1].render(&tables[1]).into_iter().step_by(POINTS).collect();
        let all: f64 = exact.iter().map(|e| e * e).sum();
        let off: f64 = drawn.iter().zip(&exact).map(|(a, e)| (a.y - e).powi(2)).sum();
        assert!((off / all).sqrt() < 0.03, "{}", (off / all).sqrt());
        let own: f64 = drawn.iter().zip(&target).map(|(a, b)| (*a - *b).length_squared()).sum();
        assert!((own / (3.0 * all)).sqrt() < 0.01, "{}", (own / all).sqrt());
    }

    #[test]
    fn shares_reproduce_lines() {
        for (cell, shares) in shares(&[0, 3, 7, 9], 10).into_iter().enumerate() {
            let place: f32 = shares.iter().map(|(at, share)| [0.0, 3.0, 7.0, 9.0][*at] * share).sum();
            assert!((place - cell as f32).abs() < 1e-5);
        }
    }
}
