//! Consistency of exposures: whether their times match their brightness, and whether one radiance
//! explains all codes of a pixel.

use rayon::prelude::*;

use super::table::Table;
use super::{BracketError, Exposure, median};

/// Tolerance of the logarithm of the radiance, in addition to that of the codes.
const TOLERANCE: f64 = 0.08;
/// Factor between brightness and times above which the times are wrong. Nominal times are off by at
/// most 7 %.
const WRONG_TIMES: f64 = 1.25;
/// Range of codes, as a share of the largest, used to check the times.
const MIDDLE: std::ops::Range<f64> = 0.1..0.9;
/// Smallest number of samples for this check.
const LEAST_SAMPLES: usize = 50;
/// Largest number of pixels for this check.
const MOST_PIXELS: usize = 1 << 16;

/// Computes the relative excess of each exposure's brightness over that expected from its time.
///
/// The excess is relative to the next shorter exposure (0 for the shortest): the median over
/// samples that are well exposed in both.
pub(super) fn time_errors(exposures: &[Exposure], tables: &[Table; 3]) -> Result<Vec<f64>, BracketError> {
    let mut order: Vec<usize> = (0..exposures.len()).collect();
    order.sort_by(|&a, &b| exposures[a].amount.total_cmp(&exposures[b].amount));
    let mut errors = vec![0.0; exposures.len()];
    for pair in order.windows(2) {
        let (a, b) = (&exposures[pair[0]], &exposures[pair[1]]);
        let (width, height) = a.codes.size();
        let step = (width * height).div_ceil(MOST_PIXELS).max(1);
        let middle = |code: u16| MIDDLE.contains(&(f64::from(code) / f64::from(a.codes.max())));
        let mut ratios: Vec<f64> = (0..width * height)
            .into_par_iter()
            .step_by(step)
            .flat_map_iter(|i| {
                let (a, b) = (a.codes.at(i), b.codes.at(i));
                (0..3)
                    .filter(move |&c| middle(a[c]) && middle(b[c]))
                    .map(move |c| tables[c].log(b[c]) - tables[c].log(a[c]))
            })
            .collect();
        if ratios.len() < LEAST_SAMPLES {
            continue;
        }
        let seen = median(&mut ratios).unwrap_or(0.0);
        let said = (b.amount / a.amount).ln();
        if (seen - said).abs() > WRONG_TIMES.ln() {
            let (first, second) = (pair[0] + 1, pair[1] + 1);
            return Err(BracketError::Times { first, second, seen: seen.exp(), said: said.exp() });
        }
        errors[pair[1]] = (seen - said).exp_m1();
    }
    Ok(errors)
}

/// Whether no radiance explains the codes of one channel of a pixel, in the order of the exposures.
///
/// Returns `None` if there is nothing to compare.
pub(super) fn disagree(codes: &[u16], log_amounts: &[f64], table: &Table) -> Option<bool> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut telling, mut known) = (0, false);
    for (&code, &log_amount) in codes.iter().zip(log_amounts) {
        let (from, to) = table.bounds(code);
        low = low.max(from - TOLERANCE - log_amount);
        high = high.min(to + TOLERANCE - log_amount);
        telling += 1;
        known |= table.is_known(code);
    }
    (telling > 1 && known).then_some(low > high)
}
