//! Learning of a [`ColourModel`] from measured materials and simulated photographs of them.

use super::chroma::Chroma;
use super::differences::{channel_difference, mean_log_difference, student_covariance};
use super::model::{ColourModel, LightComponent};
use crate::reflectance::{BivariateTable, LatentSpace};

/// Variance added to each coefficient: that of a difference too small to be visible.
const RIDGE: f64 = 1e-3;

/// Variance added to the chroma of lights.
const LIGHT_RIDGE: f64 = 1e-4;

/// Number of rounds of expectation maximisation for the mixture of lights.
const ROUNDS: usize = 50;

/// Errors of the reading of a simulated photograph whose material and light are known.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourSample {
    /// Errors of the readings of red, green and blue: the coefficients of the reading
    /// ([`ChannelReading::minus`](super::ChannelReading::minus)) minus those of the material and
    /// the chroma of the light.
    pub errors: [Vec<f64>; 3],
}

impl ColourModel {
    /// Learns the model from measured materials, readings of photographs of them, and lights.
    ///
    /// `materials` contains the channels (red, green, blue) of the materials, `lights` the chromas
    /// of lights as returned by [`white_chroma`](super::white_chroma).
    ///
    /// Covariances are those of Student's distributions: a few materials of strong colours, and a
    /// few failed readings, have less weight than the many others.
    ///
    /// # Panics
    /// If there are no materials, no samples or no lights.
    pub fn learn(
        coordinates: &LatentSpace,
        materials: &[[BivariateTable; 3]],
        samples: &[ColourSample],
        lights: &[Chroma],
    ) -> Self {
        let luminances: Vec<BivariateTable> = materials.iter().map(BivariateTable::luminance).collect();
        let all = |difference: fn(&LatentSpace, &BivariateTable, &BivariateTable) -> Vec<f64>| -> Vec<Vec<f64>> {
            let each = materials.iter().zip(&luminances);
            each.flat_map(|(rgb, luminance)| rgb.each_ref().map(|channel| difference(coordinates, channel, luminance)))
                .collect()
        };
        let errors = |c: usize| samples.iter().map(|sample| sample.errors[c].clone()).collect::<Vec<_>>();
        Self {
            differences: student_covariance(&all(channel_difference), RIDGE),
            mean_log_differences: student_covariance(&all(mean_log_difference), RIDGE),
            errors: [0, 1, 2].map(|c| student_covariance(&errors(c), RIDGE)),
            lights: mixture(lights),
        }
    }
}

/// Fits a mixture of two Gaussians around neutral whose covariances differ by a factor.
///
/// Most lights are nearly neutral, and some are far from neutral.
fn mixture(lights: &[Chroma]) -> Vec<LightComponent> {
    let rows: Vec<Vec<f64>> = lights.iter().map(|light| light.0.to_vec()).collect();
    let mut shape = student_covariance(&rows, LIGHT_RIDGE);
    let (mut weights, mut scales) = ([0.6, 0.4], [0.2, 1.2]);
    let count = rows.len() as f64;
    for _ in 0..ROUNDS {
        let determinant = shape[0][0] * shape[1][1] - shape[0][1] * shape[1][0];
        let square = |x: &[f64]| {
            (shape[1][1] * x[0] * x[0] - 2.0 * shape[0][1] * x[0] * x[1] + shape[0][0] * x[1] * x[1]) / determinant
        };
        let responsibilities: Vec<[f64; 2]> = rows
            .iter()
            .map(|row| {
                let q = square(row);
                let logs = [0, 1].map(|k| f64::ln(weights[k]) - f64::ln(scales[k]) - 0.5 * q / scales[k]);
                let first = 1.0 / (1.0 + (logs[1] - logs[0]).exp());
                [first, 1.0 - first]
            })
            .collect();
        let mut next = vec![vec![0.0; 2]; 2];
        for k in 0..2 {
            let total: f64 = responsibilities.iter().map(|r| r[k]).sum::<f64>().max(1e-9);
            weights[k] = total / count;
            let spread: f64 = rows.iter().zip(&responsibilities).map(|(row, r)| r[k] * square(row)).sum();
            scales[k] = (spread / total / 2.0).max(1e-3);
        }
        for (row, r) in rows.iter().zip(&responsibilities) {
            let weight = (r[0] / scales[0] + r[1] / scales[1]) / count;
            (0..2).for_each(|i| (0..2).for_each(|j| next[i][j] += weight * row[i] * row[j]));
        }
        (0..2).for_each(|i| next[i][i] += LIGHT_RIDGE);
        shape = next;
    }
    let component = |k: usize| LightComponent {
        weight: weights[k],
        covariance: [0, 1].map(|i| [0, 1].map(|j| scales[k] * shape[i][j])),
    };
    vec![component(0), component(1)]
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn separates_near_and_far_lights() {
        let mut rng = Pcg64::seed_from_u64(5);
        let mut draw = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, &mut rng);
        let lights: Vec<Chroma> = (0..4000)
            .map(|i| {
                let sd = if i % 4 == 0 { 0.4 } else { 0.1 };
                let (along, across) = (draw(sd), draw(0.3 * sd));
                Chroma([0.6 * along + across, -along])
            })
            .collect();
        let found = mixture(&lights);
        let sd = |k: usize| found[k].covariance[1][1].sqrt();
        assert!((sd(0) - 0.1).abs() < 0.02 && (sd(1) - 0.4).abs() < 0.06, "{found:?}");
        assert!((found[1].weight - 0.25).abs() < 0.06 && found[1].covariance[0][1] < 0.0, "{found:?}");
    }
}
