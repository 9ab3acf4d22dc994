//! Quantiles of one number of a material, such as gloss.

use super::posterior::MaterialPosterior;
use super::spread::{NUMBER_ERROR_SCALE, spread_quantile, student_quantile};
use crate::parallel;
use crate::reflectance::{BivariateTable, THETA_D, THETA_H, is_trusted, theta_d_of, theta_h_of};

/// Computes the brightness of the mirror direction relative to directions far from it.
///
/// This is the value along the normal over the mean at half angles above 45 degrees and difference
/// angles below. It is one for chalk, tens for a satin paint and thousands for polished metal.
pub fn peak_height(table: &BivariateTable) -> f64 {
    let far = std::f64::consts::FRAC_PI_4;
    let (mut sum, mut count) = (0.0, 0.0);
    for i in (0..THETA_H).filter(|&i| theta_h_of(i) > far) {
        for j in (0..THETA_D).filter(|&j| theta_d_of(j) < far && is_trusted(i * THETA_D + j)) {
            sum += f64::from(table.cell(i, j));
            count += 1.0;
        }
    }
    f64::from(table.cell(0, 0)) * count / f64::max(sum, 1e-300)
}

impl MaterialPosterior {
    /// Computes quantiles of a positive number of each draw.
    ///
    /// The quantiles include the errors that the draws do not show. `shares` are in 0..1,
    /// ascending.
    pub fn number_quantiles(&self, number: impl Fn(&BivariateTable) -> f64 + Sync, shares: &[f64]) -> Vec<f64> {
        let mut logs: Vec<f32> = parallel::map(&self.draws, |table| number(table).max(1e-300).ln() as f32);
        logs.sort_by(f32::total_cmp);
        quantiles_of_logs(&logs, shares)
    }
}

fn quantiles_of_logs(logs: &[f32], shares: &[f64]) -> Vec<f64> {
    let end = |share: &f64| spread_quantile(logs, *share, (NUMBER_ERROR_SCALE * student_quantile(*share)) as f32);
    shares.iter().map(|share| f64::from(end(share)).exp()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gloss_is_the_peak_over_the_base() {
        assert!((peak_height(&BivariateTable::from_fn(|_, _| 0.2)) - 1.0).abs() < 1e-6);
        assert!((peak_height(&crate::testing::lobe(0.1, 4.9, 0.1)) - 50.0).abs() < 1e-3);
    }

    #[test]
    fn quantiles_include_the_error() {
        let logs: Vec<f32> = (0..101).map(|i| 0.01 * i as f32).collect();
        let quantiles = quantiles_of_logs(&logs, &[0.05, 0.5, 0.95]);
        assert!((quantiles[1] - 0.5_f64.exp()).abs() < 0.01, "{quantiles:?}");
        assert!(quantiles[0] < 1.0 && quantiles[2] > 2.8, "{quantiles:?}");
    }
}
