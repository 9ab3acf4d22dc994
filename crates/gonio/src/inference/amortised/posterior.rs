//! What a photograph says of its material.

use rayon::prelude::*;

use crate::reflectance::{BivariateTable, CELLS, Dictionary, THETA_D, is_trusted};

/// Standard deviation of the logarithm of reflectance that is added to every entry when intervals are taken: materials are not
/// entries of a dictionary, and its best entry for one that it does not hold is off by so much. Chosen so that intervals hold what they
/// say for kinds of materials that were left out of the training, and more for those that were not (`docs/trials.md`).
pub(super) const SPREAD: f64 = 0.45;

/// A cell is undetermined if its 90 % interval is at least this share of the prior's.
const UNDETERMINED: f64 = 0.6;

/// Entries with less than this share of the largest weight do not count for intervals.
const NEGLIGIBLE: f64 = 1e-3;

/// A Gaussian as four equally likely values.
pub(super) const QUARTERS: [f64; 4] = [-1.271_1, -0.324_7, 0.324_7, 1.271_1];

/// A measured material and its share of the posterior.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbour {
    /// Its name.
    pub name: String,
    /// Its weight; those of all measured materials sum to one.
    pub weight: f64,
}

/// Weights over the entries of a dictionary, and what follows from them.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialPosterior {
    /// Weight of each entry, with sum one.
    pub weights: Vec<f64>,
    /// The estimate: the mean of the entries as the eye sees it, of the cube roots of their tables (each of albedo one), cubed.
    ///
    /// A mean of the tables themselves (eq. 3) has the peak of the sharpest entry that has a share in it and is glossier than most of what
    /// it stands for; a mean of the logarithms is duller. Relit, all three are as good (`docs/trials.md`).
    pub mean: BivariateTable,
    /// Measured materials by falling weight.
    pub neighbours: Vec<Neighbour>,
}

impl MaterialPosterior {
    /// From the logarithm of the density at each entry.
    pub(super) fn of(dictionary: &Dictionary, log_densities: &[f64]) -> Self {
        let weights = normalised(log_densities.iter().copied());
        let measured = dictionary.measured.len();
        // Among themselves: their entries are few beside the draws.
        let own = normalised(log_densities[..measured].iter().copied());
        let mut neighbours: Vec<Neighbour> = dictionary
            .measured
            .names
            .iter()
            .zip(own)
            .map(|(name, weight)| Neighbour { name: name.clone(), weight })
            .collect();
        neighbours.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        Self { mean: mean_lightness(dictionary, &weights), weights, neighbours }
    }

    /// Quantiles of each cell, `[quantile][cell]`, on the scale of [`Self::mean`]: of the entries' tables brought to the
    /// geometric mean of `mean` over the trusted cells, spread by what the dictionary misses. Shares in 0..1, ascending. Cells beyond the trusted
    /// ones have the quantiles of the nearest trusted cell.
    pub fn quantiles(&self, dictionary: &Dictionary, shares: &[f64]) -> Vec<Vec<f32>> {
        self.quantiles_spread(dictionary, shares, SPREAD)
    }

    /// [`Self::quantiles`] with entries spread by another standard deviation of the logarithm.
    pub fn quantiles_spread(&self, dictionary: &Dictionary, shares: &[f64], spread: f64) -> Vec<Vec<f32>> {
        let level = log_level(&self.mean);
        let mut out = vec![vec![0.0_f32; CELLS]; shares.len()];
        for (cell, values) in quantiles_of_log(dictionary, &self.weights, shares, spread).into_iter().enumerate() {
            for (out, value) in out.iter_mut().zip(values) {
                out[cell] = (value + level).exp() as f32;
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

    /// Which cells the image leaves open: those in which the entries' 90 % interval, in the logarithm and without the spread of
    /// [`Self::quantiles`], is more than six tenths of what it is without an image. Cells beyond the trusted ones always are.
    pub fn undetermined(&self, dictionary: &Dictionary) -> Vec<bool> {
        let width = |weights: &[f64]| -> Vec<f64> {
            // No photograph narrows the spread.
            let ends = quantiles_of_log(dictionary, weights, &[0.05, 0.95], 0.0);
            ends.into_iter().map(|e| e[1] - e[0]).collect()
        };
        let prior = vec![1.0 / self.weights.len() as f64; self.weights.len()];
        let (posterior, prior) = (width(&self.weights), width(&prior));
        let open = |c: usize| posterior[c] > UNDETERMINED * prior[c];
        (0..CELLS).map(|c| !is_trusted(c / THETA_D, c % THETA_D) || open(c)).collect()
    }
}

/// Mean of the cube roots of the entries, cubed.
fn mean_lightness(dictionary: &Dictionary, weights: &[f64]) -> BivariateTable {
    let mut sum = vec![0.0_f64; CELLS];
    for (entry, &weight) in dictionary.entries.iter().zip(weights).filter(|(_, w)| **w > 1e-6) {
        let table = dictionary.table(entry);
        sum.iter_mut().zip(table.as_slice()).for_each(|(sum, v)| *sum += weight * f64::from(*v).cbrt());
    }
    BivariateTable::from_vec(sum.into_iter().map(|v| v.powi(3) as f32).collect())
}

/// Weights in proportion to the exponentials, with sum one.
fn normalised(logs: impl Iterator<Item = f64>) -> Vec<f64> {
    let logs: Vec<f64> = logs.collect();
    let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = logs.iter().map(|l| (l - top).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.into_iter().map(|w| w / total).collect()
}

/// Mean logarithm of a table over the trusted cells.
fn log_level(table: &BivariateTable) -> f64 {
    let logs = (0..CELLS)
        .filter(|c| is_trusted(c / THETA_D, c % THETA_D))
        .map(|c| f64::from(table.as_slice()[c].max(1e-12)).ln());
    let (sum, count) = logs.fold((0.0, 0.0), |(sum, count), l| (sum + l, count + 1.0));
    sum / count
}

/// The entries that count for intervals.
pub(super) fn active(weights: &[f64]) -> Vec<usize> {
    let largest = weights.iter().copied().fold(0.0, f64::max);
    (0..weights.len()).filter(|&e| weights[e] > NEGLIGIBLE * largest).collect()
}

/// Quantiles of the logarithm of each cell relative to the [`log_level`] of its table, `[cell][quantile]`; zeros beyond the trusted cells.
fn quantiles_of_log(dictionary: &Dictionary, weights: &[f64], shares: &[f64], spread: f64) -> Vec<Vec<f64>> {
    let active = active(weights);
    let tables: Vec<(BivariateTable, f64)> = active
        .par_iter()
        .map(|&e| {
            let table = dictionary.table(&dictionary.entries[e]);
            let level = log_level(&table);
            (table, level)
        })
        .collect();
    let cell = |c: usize| {
        if !is_trusted(c / THETA_D, c % THETA_D) {
            return vec![0.0; shares.len()];
        }
        let value = |(table, level): &(BivariateTable, f64)| f64::from(table.as_slice()[c].max(1e-12)).ln() - level;
        let mut values: Vec<(f64, f64)> =
            tables.iter().zip(&active).map(|(table, &entry)| (value(table), weights[entry])).collect();
        values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        if spread > 0.0 {
            // Four rising runs, which the stable sort merges.
            let shifted = |z: f64| values.iter().map(move |&(value, weight)| (value + spread * z, weight));
            let mut all: Vec<(f64, f64)> = QUARTERS.into_iter().flat_map(shifted).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            values = all;
        }
        weighted_quantiles(&values, shares)
    };
    (0..CELLS).into_par_iter().map(cell).collect()
}

/// Of `(value, weight)` by rising value: linear between the middles of the weights.
pub(super) fn weighted_quantiles(values: &[(f64, f64)], shares: &[f64]) -> Vec<f64> {
    let total: f64 = values.iter().map(|(_, w)| w).sum();
    let (mut below, mut last, mut next) = (0.0, None::<(f64, f64)>, 0);
    let mut out = Vec::with_capacity(shares.len());
    for &(value, weight) in values {
        let middle = (below + 0.5 * weight) / total;
        below += weight;
        while next < shares.len() && shares[next] <= middle {
            out.push(match last {
                Some((at, before)) => before + (value - before) * (shares[next] - at) / (middle - at),
                None => value,
            });
            next += 1;
        }
        last = Some((middle, value));
    }
    out.resize(shares.len(), values.last().map_or(0.0, |v| v.0));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_weights() {
        let values = [(1.0, 1.0), (2.0, 2.0), (4.0, 1.0)];
        // Middles at 1/8, 1/2, 7/8.
        assert_eq!(weighted_quantiles(&values, &[0.05, 0.125, 0.3125, 0.5, 0.99]), [1.0, 1.0, 1.5, 2.0, 4.0]);
        assert_eq!(weighted_quantiles(&[(3.0, 0.2)], &[0.1, 0.9]), [3.0, 3.0]);
    }

    #[test]
    fn four_values_stand_for_a_gaussian() {
        // Quarters have its mean and its variance.
        assert!(QUARTERS.iter().sum::<f64>().abs() < 1e-12);
        assert!((QUARTERS.iter().map(|z| z * z).sum::<f64>() / 4.0 - 0.861).abs() < 0.01);
    }
}
