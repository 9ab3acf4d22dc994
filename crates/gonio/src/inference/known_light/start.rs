//! Start of the fit: the material of the prior whose rendering is nearest to the photograph.

use faer::Mat;
use gonio_linalg::product;

use super::fit::{ImageModel, LOG_FLOOR, State};
use super::{Operator, PriorMaterials, thinned};
use crate::parallel;
use crate::reflectance::CELLS;
use crate::render::Relighter;
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
/// The distance is the median absolute deviation of the logarithm. All materials share the rows of
/// the matrices, so dense products in single precision are faster than sparse products for each
/// material.
pub(super) fn start(operator: &Operator, values: &[f64], materials: &PriorMaterials<'_>) -> Start {
    let rows = thinned(values.len(), COMPARED);
    let floor = LOG_FLOOR * values.iter().sum::<f64>() / values.len() as f64;
    let values: Vec<f64> = rows.iter().map(|&at| values[at]).collect();
    let all: f64 = values.iter().sum();
    let deviation = |picture: &[f64]| {
        let ratio = all / picture.iter().sum::<f64>().max(1e-300);
        let logs: Vec<f64> =
            values.iter().zip(picture).map(|(value, p)| ((value + floor) / (ratio * p + floor)).ln()).collect();
        let middle = median(logs.iter().copied()).unwrap_or(0.0);
        median(logs.iter().map(|l| (l - middle).abs())).unwrap_or(0.0)
    };
    let gains = if operator.clips() { &GAINS[..] } else { &GAINS[..1] };
    let matrices = dense(operator, &rows);
    let count = materials.starts.len();
    // Gain and deviation of each material.
    let deviations = parallel::flat_map_range(count.div_ceil(GROUP), |group| {
        let first = group * GROUP;
        let tables = materials.tables.subcols(first, GROUP.min(count - first));
        let pictures: Vec<Mat<f32>> = matrices.iter().map(|matrix| product(matrix.as_ref(), tables)).collect();
        let best = |at: usize| {
            let with_gain = |gain: f64| {
                let sum = |row| pictures.iter().zip([1.0, gain]).map(|(p, by)| by * f64::from(p[(row, at)])).sum();
                (gain, deviation(&(0..rows.len()).map(sum).collect::<Vec<f64>>()))
            };
            let each = gains.iter().map(|gain| with_gain(*gain));
            each.min_by(|a, b| a.1.total_cmp(&b.1)).expect("at least one gain")
        };
        (0..tables.ncols()).map(best).collect::<Vec<_>>()
    });
    let best = deviations.into_iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
    let (at, (gain, deviation)) = best.expect("at least one material");
    Start { coordinates: materials.starts[at].clone(), gain, deviation }
}

/// Returns rows of the parts of an operator (rows x cells), divided by the largest weight of all.
///
/// The scale of the light has no effect on the comparison, and cannot overflow single precision.
fn dense(operator: &Operator, rows: &[usize]) -> Vec<Mat<f32>> {
    let weights = operator.parts().flat_map(|part| rows.iter().flat_map(|&at| part.row(at).map(|(_, weight)| weight)));
    let largest = weights.fold(f32::MIN_POSITIVE, f32::max);
    let part = |part: &Relighter| {
        let mut matrix = Mat::zeros(rows.len(), CELLS);
        for (i, &at) in rows.iter().enumerate() {
            for (cell, weight) in part.row(at) {
                matrix[(i, cell)] += weight / largest;
            }
        }
        matrix
    };
    operator.parts().map(part).collect()
}
