//! Start of the fit: the material of the prior whose rendering is nearest to the photograph.

use faer::Mat;
use gonio_linalg::product;

use super::fit::{ImageModel, LOG_FLOOR, State};
use super::{Operator, PriorMaterials, thinned};
use crate::parallel;
use crate::reflectance::CELLS;
use crate::statistics::median;

/// Largest number of observations that are compared.
pub(super) const COMPARED: usize = 200;

/// Gains of clipped pixels that are compared.
const GAINS: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// Number of materials that one task renders; constant, so that results do not depend on the number
/// of threads.
const GROUP: usize = 64;

/// Initial material of a fit.
pub(super) struct Start {
    coordinates: Vec<f64>,
    gain: f64,
    /// Median absolute deviation of the logarithm of its rendering from that of the image.
    pub(super) deviation: f64,
}

impl Start {
    pub(super) fn state(&self, image: &ImageModel<'_>) -> State {
        image.start(&self.coordinates, self.gain)
    }
}

/// Returns the material and the gain of the clipped pixels whose rendering is nearest to the image.
///
/// The distance is the median absolute deviation of the logarithm. A thousand materials share the
/// rows of the matrix, so a dense product in single precision is much faster than a sparse
/// product for each material.
pub(super) fn start(operator: &Operator, values: &[f64], materials: &PriorMaterials<'_>) -> Start {
    let rows = thinned(values.len(), COMPARED);
    let floor = LOG_FLOOR * values.iter().sum::<f64>() / values.len() as f64;
    let values: Vec<f64> = rows.iter().map(|&at| values[at]).collect();
    let all: f64 = values.iter().sum();
    let deviation = |picture: &[f32]| {
        let ratio = all / picture.iter().map(|p| f64::from(*p)).sum::<f64>().max(1e-300);
        let logs: Vec<f64> = values
            .iter()
            .zip(picture)
            .map(|(value, p)| ((value + floor) / (ratio * f64::from(*p) + floor)).ln())
            .collect();
        let middle = median(logs.iter().copied()).unwrap_or(0.0);
        median(logs.iter().map(|l| (l - middle).abs())).unwrap_or(0.0)
    };
    let gains = if operator.clips() { &GAINS[..] } else { &GAINS[..1] };
    let matrices: Vec<(f64, Mat<f32>)> = gains.iter().map(|&gain| (gain, dense(operator, &rows, gain))).collect();
    let count = materials.starts.len();
    // Gain and deviation of each material.
    let deviations = parallel::flat_map_range(count.div_ceil(GROUP), |group| {
        let first = group * GROUP;
        let tables = materials.tables.subcols(first, GROUP.min(count - first));
        let mut best = vec![(1.0, f64::INFINITY); tables.ncols()];
        for (gain, matrix) in &matrices {
            let pictures = product(matrix.as_ref(), tables);
            for (at, best) in best.iter_mut().enumerate() {
                let deviation = deviation(pictures.col_as_slice(at));
                if deviation < best.1 {
                    *best = (*gain, deviation);
                }
            }
        }
        best
    });
    let best = deviations.into_iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
    let (at, (gain, deviation)) = best.expect("at least one material");
    Start { coordinates: materials.starts[at].clone(), gain, deviation }
}

/// Returns rows of an operator (rows x cells), divided by their largest weight.
///
/// The scale of the light has no effect on the comparison, and cannot overflow single precision.
fn dense(operator: &Operator, rows: &[usize], gain: f64) -> Mat<f32> {
    let weights = rows.iter().flat_map(|&at| operator.row(at, gain).map(|(_, weight)| weight));
    let largest = weights.fold(f64::MIN_POSITIVE, f64::max);
    let mut matrix = Mat::zeros(rows.len(), CELLS);
    for (i, &at) in rows.iter().enumerate() {
        for (cell, weight) in operator.row(at, gain) {
            matrix[(i, cell)] += (weight / largest) as f32;
        }
    }
    matrix
}
