//! Posterior of the material of a photograph.

use super::LearntPosterior;
use super::spread::{error_scales, quantile, spread_quantile, student_quantile};
use crate::colour::ChromaField;
use crate::inference::known_light::Gaussian;
use crate::inference::likelihood::{Embedding, Likelihood};
use crate::parallel;
use crate::reflectance::{BivariateTable, CELLS, LatentSpace, is_trusted, trusted_cells};

/// Number of draws that represent a posterior.
const DRAWS: usize = 256;

/// Ratio of a cell's 90 % interval to the prior's above which the cell is undetermined.
const UNDETERMINED: f64 = 0.6;

/// Largest number of [`MaterialPosterior::neighbours`], and the smallest weight of each.
const MAX_NEIGHBOURS: usize = 10;
const MIN_NEIGHBOUR_WEIGHT: f64 = 0.005;

/// A measured material and its share of the posterior.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbour {
    /// Name of the material.
    pub name: String,
    /// Weight of the material; the weights of all measured materials sum to one.
    pub weight: f64,
    /// Its BRDF, on an arbitrary scale.
    pub table: BivariateTable,
}

/// Posterior of the material: equally likely draws, and weights of measured materials.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialPosterior {
    /// Likelihood of the material given the photographs.
    pub likelihood: Likelihood,
    /// Equally likely materials drawn from the posterior, with albedo one along the normal. The
    /// same embedding always gives the same draws.
    pub draws: Vec<BivariateTable>,
    /// Estimate: the geometric mean of the draws. This is the mean of the logarithms, in which the
    /// errors of a BRDF are measured.
    ///
    /// The arithmetic mean of the tables (eq. 3) has the peak of the sharpest material among them,
    /// and is glossier than most of the materials that it represents. Both means relight equally
    /// well (`docs/trials.md`).
    pub mean: BivariateTable,
    /// Measured materials of the largest weights, in descending order, at most ten.
    pub neighbours: Vec<Neighbour>,
}

impl MaterialPosterior {
    /// Computes the posterior from a likelihood; `None` if the likelihood is that of another model.
    pub fn of(learnt: &LearntPosterior, likelihood: Likelihood) -> Option<Self> {
        if !likelihood.is_of(learnt) {
            return None;
        }
        match likelihood {
            Likelihood::Embedding(embedding) => Some(Self::of_embedding(learnt, embedding)),
            Likelihood::Gaussian(gaussian) => {
                let neighbours = nearest(learnt, gaussian.coordinates());
                Self::of_gaussian(&learnt.latent_space, gaussian, neighbours)
            }
        }
    }

    /// Computes the posterior under a known light, with these neighbours.
    ///
    /// Returns `None` if the inverse covariance of the Gaussian is not positive definite.
    pub fn of_gaussian(coordinates: &LatentSpace, gaussian: Gaussian, neighbours: Vec<Neighbour>) -> Option<Self> {
        let (draws, mean) = (gaussian.draws(coordinates, DRAWS, 1)?, gaussian.table(coordinates));
        Some(Self { likelihood: Likelihood::Gaussian(gaussian), draws, mean, neighbours })
    }

    /// Computes the posterior from the embedding of images.
    ///
    /// # Panics
    /// If the embedding does not have the length of the candidates' embeddings.
    pub(super) fn of_embedding(learnt: &LearntPosterior, embedding: Embedding) -> Self {
        let weighed = embedding.tempered();
        let draws = draws(learnt, &weighed, DRAWS, 1);
        let mut sum = vec![0.0_f64; CELLS];
        for table in &draws {
            sum.iter_mut().zip(table.as_slice()).for_each(|(sum, v)| *sum += f64::from(v.max(1e-12)).ln());
        }
        let count = draws.len() as f64;
        let mean = BivariateTable::from_vec(sum.into_iter().map(|v| (v / count).exp() as f32).collect());
        let shares = learnt.measured.weights(&weighed);
        let neighbours = heaviest(learnt, &shares);
        Self { likelihood: Likelihood::Embedding(embedding), draws, mean, neighbours }
    }

    /// Computes quantiles of each cell, `[quantile][cell]`, on the scale of [`Self::mean`].
    ///
    /// The draws are scaled to the geometric mean of `mean` over the trusted cells, and the errors
    /// that they do not show are included. `shares` are in 0..1, ascending. Cells beyond the
    /// trusted ones have the quantiles of the nearest trusted cell.
    pub fn quantiles(&self, shares: &[f64]) -> Vec<Vec<f32>> {
        self.quantiles_of(&relative_logs(&self.draws), shares)
    }

    /// Computes quantiles of each cell of a channel, like [`Self::quantiles`].
    ///
    /// `fields` are equally likely chromas of the cells; draws and chromas are paired in turn.
    ///
    /// # Panics
    /// If there are no chromas.
    pub fn channel_quantiles(&self, fields: &[ChromaField], channel: usize, shares: &[f64]) -> Vec<Vec<f32>> {
        self.quantiles_of(&self.relative_channel_logs(fields, channel), shares)
    }

    /// Computes the logarithms of a channel of each draw, `[draw][cell]`.
    ///
    /// Their scale is that of [`Self::quantiles`], but they do not include the errors that the
    /// draws do not show. Draws and chromas are paired in turn; grey chromas give the luminance.
    ///
    /// # Panics
    /// If there are no chromas.
    pub fn channel_logs(&self, fields: &[ChromaField], channel: usize) -> Vec<Vec<f32>> {
        let (mut logs, level) = (self.relative_channel_logs(fields, channel), log_level(&self.mean) as f32);
        logs.iter_mut().flatten().for_each(|log| *log += level);
        logs
    }

    /// Computes [`Self::channel_logs`] relative to the mean log luminance of each draw.
    fn relative_channel_logs(&self, fields: &[ChromaField], channel: usize) -> Vec<Vec<f32>> {
        parallel::map_range(self.draws.len(), |at| {
            let mut logs = relative_log(&self.draws[at]);
            if let Some(ratios) = fields[at % fields.len()].ratios(channel) {
                logs.iter_mut().zip(ratios).for_each(|(log, ratio)| *log += ratio.ln());
            }
            logs
        })
    }

    fn quantiles_of(&self, logs: &[Vec<f32>], shares: &[f64]) -> Vec<Vec<f32>> {
        let (level, scales) = (log_level(&self.mean) as f32, error_scales(&self.likelihood));
        let errors: Vec<f32> = shares.iter().map(|share| student_quantile(*share) as f32).collect();
        let ends = |cell: usize, values: &[f32]| {
            let end = |(share, error): (&f64, &f32)| spread_quantile(values, *share, scales[cell] * error);
            shares.iter().zip(&errors).map(end).collect()
        };
        let mut out = vec![vec![0.0_f32; CELLS]; shares.len()];
        for (cell, values) in by_cell(logs, shares.len(), ends).into_iter().enumerate() {
            for (out, value) in out.iter_mut().zip(values) {
                out[cell] = (value + level).exp();
            }
        }
        out.into_iter()
            .map(|values| {
                let mut table = BivariateTable::from_vec(values);
                table.extend_from_trusted();
                table.as_slice().to_vec()
            })
            .collect()
    }

    /// Returns for each cell whether the image leaves it undetermined.
    ///
    /// A cell is undetermined if the 90 % interval of its draws is more than six tenths of the
    /// prior's. Both are intervals of the logarithm, without the errors that the draws do
    /// not show. Cells beyond the trusted ones always count as undetermined.
    pub fn undetermined(&self, learnt: &LearntPosterior) -> Vec<bool> {
        let widths = interval_widths(&self.draws);
        let open = |c: usize| f64::from(widths[c]) > UNDETERMINED * f64::from(learnt.widths[c]);
        (0..CELLS).map(|c| !is_trusted(c) || open(c)).collect()
    }
}

/// Returns the measured materials of the largest weights, in descending order.
fn heaviest(learnt: &LearntPosterior, weights: &[f64]) -> Vec<Neighbour> {
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|a, b| weights[*b].total_cmp(&weights[*a]));
    order.truncate(MAX_NEIGHBOURS);
    order.retain(|at| weights[*at] >= MIN_NEIGHBOUR_WEIGHT);
    let materials: Vec<Vec<f64>> =
        order.iter().map(|at| learnt.measured.coordinates[*at].iter().map(|z| f64::from(*z)).collect()).collect();
    let tables = learnt.latent_space.tables(&materials);
    let neighbour = |(at, table): (usize, _)| Neighbour { name: learnt.names[at].clone(), weight: weights[at], table };
    order.into_iter().zip(tables).map(neighbour).collect()
}

/// Returns the measured materials nearest to given coordinates.
///
/// The weights are proportional to `exp(-d^2 / 2)`, where `d` is the distance.
fn nearest(learnt: &LearntPosterior, from: &[f64]) -> Vec<Neighbour> {
    let distance =
        |coordinates: &Vec<f32>| from.iter().zip(coordinates).map(|(a, b)| (a - f64::from(*b)).powi(2)).sum::<f64>();
    let distances: Vec<f64> = learnt.measured.coordinates.iter().map(distance).collect();
    let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
    let weights: Vec<f64> = distances.iter().map(|d| (-0.5 * (d - least)).exp()).collect();
    let total: f64 = weights.iter().sum();
    heaviest(learnt, &weights.into_iter().map(|weight| weight / total).collect::<Vec<_>>())
}

/// Draws materials with albedo one along the normal from a posterior.
///
/// The same seed gives the same draws. Returns `None` if the likelihood is that of another model.
pub(crate) fn sample(
    learnt: &LearntPosterior,
    likelihood: &Likelihood,
    count: usize,
    seed: u64,
) -> Option<Vec<BivariateTable>> {
    match likelihood {
        likelihood if !likelihood.is_of(learnt) => None,
        Likelihood::Embedding(embedding) => Some(draws(learnt, &embedding.tempered(), count, seed)),
        Likelihood::Gaussian(gaussian) => gaussian.draws(&learnt.latent_space, count, seed),
    }
}

/// Draws materials with albedo one along the normal from the posterior of an embedding.
///
/// The same seed gives the same draws.
fn draws(learnt: &LearntPosterior, embedding: &[f32], count: usize, seed: u64) -> Vec<BivariateTable> {
    let candidates = &learnt.prior;
    let coordinates = |at: usize| candidates.coordinates[at].iter().map(|z| f64::from(*z)).collect();
    let drawn = candidates.draw(&candidates.weights(embedding), count, seed);
    let materials: Vec<Vec<f64>> = drawn.into_iter().map(coordinates).collect();
    parallel::map(&learnt.latent_space.tables(&materials), |table| table.with_normal_albedo(1.0).0)
}

/// Computes the width of the 90 % interval of each cell's logarithm over equally likely tables.
///
/// Each table is relative to its own geometric mean. Widths are zero beyond the trusted cells.
pub fn interval_widths(tables: &[BivariateTable]) -> Vec<f32> {
    let ends = |_, values: &[f32]| vec![quantile(values, 0.95) - quantile(values, 0.05)];
    by_cell(&relative_logs(tables), 1, ends).into_iter().map(|width| width[0]).collect()
}

/// Computes the mean logarithm of a table over the trusted cells.
fn log_level(table: &BivariateTable) -> f64 {
    let logs = trusted_cells().map(|c| f64::from(table.as_slice()[c].max(1e-12)).ln());
    let (sum, count) = logs.fold((0.0, 0.0), |(sum, count), l| (sum + l, count + 1.0));
    sum / count
}

/// Computes the logarithm of each cell relative to the [`log_level`] of its table, `[table][cell]`.
fn relative_logs(tables: &[BivariateTable]) -> Vec<Vec<f32>> {
    parallel::map(tables, relative_log)
}

fn relative_log(table: &BivariateTable) -> Vec<f32> {
    let level = log_level(table) as f32;
    table.as_slice().iter().map(|v| v.max(1e-12).ln() - level).collect()
}

/// Computes `count` numbers of each cell, `[cell][number]`, from its ascending logarithms.
///
/// The numbers are zero beyond the trusted cells.
fn by_cell(logs: &[Vec<f32>], count: usize, numbers: impl Fn(usize, &[f32]) -> Vec<f32> + Sync) -> Vec<Vec<f32>> {
    let cell = |c: usize| {
        if !is_trusted(c) {
            return vec![0.0; count];
        }
        let mut values: Vec<f32> = logs.iter().map(|l| l[c]).collect();
        values.sort_unstable_by(f32::total_cmp);
        numbers(c, &values)
    };
    parallel::map_range(CELLS, cell)
}
