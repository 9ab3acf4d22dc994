//! Differences between the channels of a material and its luminance, and their estimates.

use faer::Mat;
use gonio_linalg::eigenvectors;

use crate::appearance::DiskImage;
use crate::inference::Embedding;
use crate::inference::learnt::LearntPosterior;
use crate::reflectance::{BivariateTable, LatentSpace, trusted_cells};

/// Smallest ratio of a channel's albedo or mean to that of the luminance.
const MIN_RATIO: f64 = 5e-3;

/// Smallest value of a table (1/sr) in logarithms, relative to its normal albedo.
const MIN_VALUE: f64 = 1e-6;

/// Reading of a channel of a photograph: its position among the materials, and its brightness.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelReading {
    /// Mean of the posterior in the coordinates of materials.
    pub coordinates: Vec<f64>,
    /// Mean of the channel over the pixels of the ball.
    pub mean: f64,
}

impl ChannelReading {
    /// Reads the image of a channel or of the luminance.
    pub fn of(learnt: &LearntPosterior, image: &DiskImage) -> Self {
        let embedding = Embedding::of(learnt.encode(image).embedding);
        Self { coordinates: learnt.mean_coordinates(&embedding), mean: image.mean() }
    }

    /// Returns the coefficients of the difference of this channel from the luminance.
    ///
    /// They are in the order of [`channel_difference`] and contain the chroma of the light.
    pub fn minus(&self, luminance: &Self) -> Vec<f64> {
        let differences = self.coordinates.iter().zip(&luminance.coordinates).map(|(own, other)| own - other);
        differences.chain([log_ratio(self.mean, luminance.mean)]).collect()
    }
}

fn log_ratio(value: f64, of: f64) -> f64 {
    (value / of.max(f64::MIN_POSITIVE)).max(MIN_RATIO).ln()
}

/// Returns the coefficients of the difference of a channel of a material from its luminance.
///
/// They are the differences of the coordinates, followed by the logarithm of the ratio of the
/// albedos along the normal.
pub fn channel_difference(coordinates: &LatentSpace, channel: &BivariateTable, luminance: &BivariateTable) -> Vec<f64> {
    let (own, other) = (coordinates.of(channel), coordinates.of(luminance));
    let last = log_ratio(channel.normal_albedo(), luminance.normal_albedo());
    own.iter().zip(&other).map(|(own, other)| own - other).chain([last]).collect()
}

/// Like [`channel_difference`], with the difference of the mean logarithms as the last coefficient.
///
/// The means extend over the trusted cells. The last coefficient is that of a constant added to the
/// logarithm.
pub fn mean_log_difference(
    coordinates: &LatentSpace,
    channel: &BivariateTable,
    luminance: &BivariateTable,
) -> Vec<f64> {
    let mut out = channel_difference(coordinates, channel, luminance);
    let floor = MIN_VALUE * luminance.normal_albedo();
    let level = |table: &BivariateTable| {
        let logs = trusted_cells().map(|cell| f64::from(table.as_slice()[cell]).max(floor).ln());
        let (sum, count) = logs.fold((0.0, 0.0), |(sum, count), log| (sum + log, count + 1.0));
        sum / count
    };
    if let Some(last) = out.last_mut() {
        *last = level(channel) - level(luminance);
    }
    out
}

/// Number of rounds of reweighting of [`student_covariance`].
const ROUNDS: usize = 10;

/// Degrees of freedom of Student's distribution.
const FREEDOM: f64 = 3.0;

/// Fits the scale matrix of a Student distribution with mean zero to the rows.
///
/// The distribution has three degrees of freedom. The fit uses expectation maximisation, in which
/// outliers have less weight. `ridge` is added to the diagonal. The matrix is returned row by row.
///
/// # Panics
/// If there are no rows.
pub(super) fn student_covariance(rows: &[Vec<f64>], ridge: f64) -> Vec<Vec<f64>> {
    let (count, size) = (rows.len() as f64, rows[0].len());
    let mut weights = vec![1.0; rows.len()];
    let mut covariance = Mat::<f64>::zeros(size, size);
    for _ in 0..ROUNDS {
        covariance = Mat::zeros(size, size);
        for (row, weight) in rows.iter().zip(&weights) {
            for j in 0..size {
                let scaled = weight * row[j] / count;
                (j..size).for_each(|i| covariance[(i, j)] += scaled * row[i]);
            }
        }
        for j in 0..size {
            covariance[(j, j)] += ridge;
            (0..j).for_each(|i| covariance[(i, j)] = covariance[(j, i)]);
        }
        let (values, vectors) = eigenvectors(covariance.as_ref());
        for (weight, row) in weights.iter_mut().zip(rows) {
            let along = |k: usize| (0..size).map(|i| vectors[(i, k)] * row[i]).sum::<f64>();
            let square: f64 = (0..size).map(|k| along(k).powi(2) / values[k].max(ridge)).sum();
            *weight = (FREEDOM + size as f64) / (FREEDOM + square);
        }
    }
    (0..size).map(|i| (0..size).map(|j| covariance[(i, j)]).collect()).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::inference::learnt::tests::WORLD;

    #[test]
    fn outliers_do_not_move_the_covariance() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut draw = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, &mut rng);
        let mut rows: Vec<Vec<f64>> = (0..4000)
            .map(|_| {
                let (a, b) = (draw(1.0), draw(0.3));
                vec![a, 0.5 * a + b]
            })
            .collect();
        let clean = student_covariance(&rows, 1e-9);
        // The scale of Student's distribution is smaller than that of a Gaussian with its tails.
        assert!((clean[0][1] / clean[0][0] - 0.5).abs() < 0.03, "{clean:?}");
        assert!((0.5..1.1).contains(&clean[0][0]), "{clean:?}");
        rows.extend((0..40).map(|_| vec![100.0, -100.0]));
        let spoilt = student_covariance(&rows, 1e-9);
        assert!((spoilt[0][0] / clean[0][0]).ln().abs() < 0.25, "{spoilt:?} {clean:?}");
    }

    #[test]
    fn a_grey_material_has_no_differences() {
        let table = BivariateTable::from_fn(|h, d| 0.1 + (-h * h / 0.01).exp() + 0.1 * d);
        let coordinates = &WORLD.latent_space;
        assert!(channel_difference(coordinates, &table, &table).iter().all(|x| x.abs() < 1e-9));
        // A factor changes only the last coefficient.
        let moved = channel_difference(coordinates, &table.scaled(0.5), &table);
        let (last, others) = moved.split_last().unwrap();
        assert!((last - 0.5_f64.ln()).abs() < 1e-6 && others.iter().all(|x| x.abs() < 1e-3), "{moved:?}");
        let dark = channel_difference(coordinates, &table.scaled(1e-9), &table);
        assert!(dark.iter().all(|x| x.is_finite()));
        let mean = mean_log_difference(coordinates, &table.scaled(0.5), &table);
        assert!((mean[mean.len() - 1] - 0.5_f64.ln()).abs() < 1e-4);
    }
}
