//! Medians with their uncertainty, rank correlation, paired comparison.

use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// Arithmetic mean; NaN when empty.
pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Median; NaN when empty.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
}

/// A value with its bootstrap interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Interval {
    /// Value over the cells themselves.
    pub(crate) value: f64,
    /// 2.5 % quantile over the resampled sets.
    pub(crate) low: f64,
    /// 97.5 % quantile.
    pub(crate) high: f64,
}

/// Number of resampled sets of a bootstrap.
const RESAMPLES: usize = 2000;

/// Median with its 95 % bootstrap interval. `clusters[i]` is the cluster (the material) of sample
/// `i`. Whole clusters are resampled, because the cells of one material are correlated.
pub(crate) fn median_interval(samples: &[f64], clusters: &[usize], seed: u64) -> Interval {
    assert_eq!(samples.len(), clusters.len());
    let value = median(samples.to_vec());
    let count = clusters.iter().max().map_or(0, |c| c + 1);
    let mut members = vec![Vec::new(); count];
    for (sample, cluster) in samples.iter().zip(clusters) {
        members[*cluster].push(*sample);
    }
    members.retain(|m| !m.is_empty());
    if members.len() < 2 {
        return Interval { value, low: f64::NAN, high: f64::NAN };
    }
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let mut medians: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let drawn = (0..members.len()).flat_map(|_| &members[rng.random_range(0..members.len())]);
            median(drawn.copied().collect())
        })
        .collect();
    medians.sort_by(f64::total_cmp);
    let quantile = |q: f64| medians[((RESAMPLES - 1) as f64 * q).round() as usize];
    Interval { value, low: quantile(0.025), high: quantile(0.975) }
}

/// Share of the pairs in which the first error is smaller; ties count half. NaN when empty.
pub(crate) fn win_rate(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut wins, mut count) = (0.0, 0.0);
    for (a, b) in pairs {
        count += 1.0;
        wins += if a < b {
            1.0
        } else if a == b {
            0.5
        } else {
            0.0
        };
    }
    wins / count
}

/// Spearman's rank correlation, ties at their mean rank; NaN when a list has no variation.
pub(crate) fn spearman(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len());
    let (x, y) = (ranks(x), ranks(y));
    let (mx, my) = (mean(&x), mean(&y));
    let sum = |f: &dyn Fn(f64, f64) -> f64| x.iter().zip(&y).map(|(a, b)| f(a - mx, b - my)).sum::<f64>();
    sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt()
}

fn ranks(x: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..x.len()).collect();
    order.sort_by(|&a, &b| x[a].total_cmp(&x[b]));
    let mut ranks = vec![0.0; x.len()];
    let mut start = 0;
    for tied in order.chunk_by(|&a, &b| x[a] == x[b]) {
        let rank = start as f64 + 0.5 * (tied.len() - 1) as f64;
        tied.iter().for_each(|&i| ranks[i] = rank);
        start += tied.len();
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_lies_in_the_middle() {
        assert!(median(Vec::new()).is_nan());
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), 2.5);
    }

    #[test]
    fn rank_correlation_of_known_cases() {
        let x = [1.0, 2.0, 3.0, 4.0, 5.0];
        assert!((spearman(&x, &[2.0, 4.0, 6.0, 8.0, 1000.0]) - 1.0).abs() < 1e-12);
        assert!((spearman(&x, &[5.0, 4.0, 3.0, 2.0, 1.0]) + 1.0).abs() < 1e-12);
        // By hand: d = (0, 1, -1, 0, 0), 1 - 6 * 2 / (5 * 24).
        assert!((spearman(&x, &[1.0, 3.0, 2.0, 4.0, 5.0]) - 0.9).abs() < 1e-12);
        // Ties, by hand: ranks 0.5 0.5 2 against 0 1 2.
        assert!((spearman(&[1.0, 1.0, 2.0], &[1.0, 2.0, 3.0]) - 0.75_f64.sqrt()).abs() < 1e-12);
        assert!(spearman(&[1.0, 1.0], &[1.0, 2.0]).is_nan());
    }

    #[test]
    fn intervals_cover_the_median_of_the_population() {
        // The median of uniform numbers is one half; a 95 % interval misses it about once in
        // twenty.
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        let missed = (0..200)
            .filter(|&trial| {
                let samples: Vec<f64> = (0..60).map(|_| rng.random_range(0.0..1.0)).collect();
                let clusters: Vec<usize> = (0..60).collect();
                let i = median_interval(&samples, &clusters, trial);
                assert!(i.low <= i.value && i.value <= i.high);
                i.low > 0.5 || i.high < 0.5
            })
            .count();
        assert!((2..=22).contains(&missed), "{missed} of 200");
    }

    #[test]
    fn clusters_widen_the_interval() {
        let samples: Vec<f64> = (0..100).map(|i| f64::from(i / 10)).collect();
        let each: Vec<usize> = (0..100).collect();
        let ten: Vec<usize> = (0..100).map(|i| i / 10).collect();
        let width = |clusters: &[usize]| {
            let i = median_interval(&samples, clusters, 1);
            i.high - i.low
        };
        assert!(width(&ten) > 1.5 * width(&each), "{} {}", width(&ten), width(&each));
        assert!(median_interval(&samples, &[0; 100], 1).low.is_nan());
    }

    #[test]
    fn ties_count_as_half_a_win() {
        assert_eq!(win_rate([(1.0, 2.0), (2.0, 1.0), (1.0, 3.0), (2.0, 2.0)].into_iter()), 0.625);
    }
}
