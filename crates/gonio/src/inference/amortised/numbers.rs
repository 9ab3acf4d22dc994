//! What a posterior of materials says of one number, such as gloss.

use rayon::prelude::*;

use super::posterior::{MaterialPosterior, QUARTERS, SPREAD, active, weighted_quantiles};
use crate::reflectance::{BivariateTable, Dictionary, THETA_D, THETA_H, is_trusted, theta_d_of, theta_h_of};

/// How much brighter the mirror direction is than what lies far from it: the value along the normal over the mean at half angles beyond
/// 45 degrees (difference angles below). One for chalk, tens for a satin paint, thousands for polished metal.
pub fn peak_over_base(table: &BivariateTable) -> f64 {
    let far = std::f64::consts::FRAC_PI_4;
    let (mut sum, mut count) = (0.0, 0.0);
    for i in (0..THETA_H).filter(|&i| theta_h_of(i) > far) {
        for j in (0..THETA_D).filter(|&j| theta_d_of(j) < far && is_trusted(i, j)) {
            sum += f64::from(table.cell(i, j));
            count += 1.0;
        }
    }
    f64::from(table.cell(0, 0)) * count / f64::max(sum, 1e-300)
}

/// Entries of a dictionary by a number of their tables.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranking {
    /// Logarithm of the number, weight, entry; by rising number.
    entries: Vec<(f64, f64, usize)>,
}

impl MaterialPosterior {
    /// The entries, but for those of next to no weight, by a positive number of their tables.
    pub fn ranking(&self, dictionary: &Dictionary, number: impl Fn(&BivariateTable) -> f64 + Sync) -> Ranking {
        let mut entries: Vec<(f64, f64, usize)> = active(&self.weights)
            .into_par_iter()
            .map(|e| (number(&dictionary.table(&dictionary.entries[e])).max(1e-300).ln(), self.weights[e], e))
            .collect();
        entries.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ranking { entries }
    }
}

impl Ranking {
    /// Quantiles of the number, spread by what the dictionary misses as those of the cells are. Shares in 0..1, ascending.
    pub fn quantiles(&self, shares: &[f64]) -> Vec<f64> {
        let spread = |&(value, weight, _): &(f64, f64, usize)| QUARTERS.map(|z| (value + SPREAD * z, weight));
        let mut values: Vec<(f64, f64)> = self.entries.iter().flat_map(spread).collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        weighted_quantiles(&values, shares).into_iter().map(f64::exp).collect()
    }

    /// The entry at a quantile, by weight.
    pub fn entry(&self, share: f64) -> usize {
        let total: f64 = self.entries.iter().map(|(_, w, _)| w).sum();
        let mut below = 0.0;
        for &(_, weight, entry) in &self.entries {
            below += weight;
            if below >= share * total {
                return entry;
            }
        }
        self.entries.last().map_or(0, |e| e.2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gloss_of_known_tables() {
        assert!((peak_over_base(&BivariateTable::from_fn(|_, _| 0.2)) - 1.0).abs() < 1e-6);
        let lobe = BivariateTable::from_fn(|h, _| 0.1 + 4.9 * (-(h / 0.1).powi(2)).exp());
        assert!((peak_over_base(&lobe) - 50.0).abs() < 1e-3);
    }

    #[test]
    fn entries_and_quantiles_by_weight() {
        let ranking = Ranking { entries: vec![(0.0, 0.1, 7), (1.0, 0.8, 3), (2.0, 0.1, 5)] };
        assert_eq!([0.05, 0.5, 0.95].map(|share| ranking.entry(share)), [7, 3, 5]);
        let quantiles = ranking.quantiles(&[0.05, 0.5, 0.95]);
        assert!((quantiles[1] - 1.0_f64.exp()).abs() < 0.1, "{quantiles:?}");
        assert!(quantiles[0] < 2.0 && quantiles[2] > 5.0, "{quantiles:?}");
    }
}
