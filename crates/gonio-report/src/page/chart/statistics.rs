//! Statistics computed before drawing: histograms and empirical distributions.

/// Samples counted in bins of equal width.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    low: f64,
    width: f64,
    counts: Vec<usize>,
    /// Number of all samples, including those beyond the bins.
    total: usize,
}

impl Histogram {
    /// Counts samples in `bins` bins from `low` to `high`. Samples outside have no bin, but count
    /// in the density.
    pub fn new(samples: &[f64], low: f64, high: f64, bins: usize) -> Self {
        let width = (high - low) / bins as f64;
        let mut counts = vec![0; bins];
        for sample in samples.iter().filter(|s| (low..=high).contains(*s)) {
            // The upper end belongs to the last bin.
            counts[(((sample - low) / width) as usize).min(bins - 1)] += 1;
        }
        Self { low, width, counts, total: samples.len() }
    }

    /// Returns the density of one sample in one bin.
    pub fn one_sample(&self) -> f64 {
        1.0 / (self.total.max(1) as f64 * self.width)
    }

    /// Returns the share of the samples that have no bin.
    pub fn outside(&self) -> f64 {
        1.0 - self.counts.iter().sum::<usize>() as f64 / self.total.max(1) as f64
    }

    /// Returns the upper corners `(x, density)` of each bin that is not empty, left and right in
    /// turn.
    pub(super) fn corners(&self) -> Vec<(f64, f64)> {
        let edge = |i: usize| self.low + i as f64 * self.width;
        let filled = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        filled.flat_map(|(i, count)| [edge(i), edge(i + 1)].map(|x| (x, *count as f64 * self.one_sample()))).collect()
    }
}

/// Returns the steps of the empirical distribution of finite values: from `(smallest, 0)` up to
/// `(largest, 1)`.
pub fn ecdf_steps(mut values: Vec<f64>) -> Vec<(f64, f64)> {
    values.sort_by(f64::total_cmp);
    let n = values.len() as f64;
    let step = |(i, x): (usize, f64)| [(x, i as f64 / n), (x, (i + 1) as f64 / n)];
    values.into_iter().enumerate().flat_map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_integrate_to_the_share_inside() {
        let samples = [-1.0, 0.0, 0.1, 0.5, 0.99, 1.0, 7.0, f64::NAN];
        let histogram = Histogram::new(&samples, 0.0, 1.0, 4);
        assert_eq!(histogram.counts, [2, 0, 1, 2]);
        let corners = histogram.corners();
        assert_eq!(corners.len(), 6);
        let area: f64 = corners.chunks(2).map(|c| (c[1].0 - c[0].0) * c[0].1).sum();
        assert!((area - 5.0 / 8.0).abs() < 1e-12 && (histogram.outside() - 3.0 / 8.0).abs() < 1e-12);
        assert!((corners[2].0 - 0.5).abs() < 1e-12, "the empty bin is omitted");
        assert_eq!(Histogram::new(&[], 0.0, 1.0, 2).corners(), []);
    }

    #[test]
    fn distributions_rise_in_equal_steps() {
        assert_eq!(ecdf_steps(vec![2.0, 1.0]), [(1.0, 0.0), (1.0, 0.5), (2.0, 0.5), (2.0, 1.0)]);
        assert_eq!(ecdf_steps(vec![]), []);
    }
}
