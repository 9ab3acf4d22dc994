//! Coverage of intervals.

use gonio::reflectance::{BivariateTable, brdf_scale, trusted_cells};

/// Shares of trusted cells inside the 50 % and the 90 % interval, after the reference is scaled to
/// the estimate.
pub(crate) fn coverage(table: &BivariateTable, quantiles: &[Vec<f32>; 4], truth: &BivariateTable) -> [f64; 2] {
    let scale = 1.0 / brdf_scale(table, truth);
    let cells: Vec<usize> = trusted_cells().collect();
    let inside = |low: usize, high: usize| {
        let hits = cells.iter().filter(|&&c| {
            let value = scale * f64::from(truth.as_slice()[c]);
            f64::from(quantiles[low][c]) <= value && value <= f64::from(quantiles[high][c])
        });
        hits.count() as f64 / cells.len() as f64
    };
    [inside(1, 2), inside(0, 3)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_counts_the_cells_inside_at_any_scale() {
        let table = BivariateTable::from_fn(|h, _| 1.0 + h);
        let at = |x: f32| table.as_slice().iter().map(|v| x * v).collect::<Vec<f32>>();
        let quantiles = [at(0.8), at(0.9), at(1.1), at(1.2)];
        let scaled = BivariateTable::from_vec(at(5.0));
        assert_eq!(coverage(&table, &quantiles, &scaled), [1.0, 1.0]);
        // A reference of another shape leaves the intervals: a step of 15 % up in half of the
        // domain, 15 % down in the other half.
        let bent = BivariateTable::from_fn(|h, d| (1.0 + h) * if d < 0.698 { 1.15 } else { 0.87 });
        let [half, ninety] = coverage(&table, &quantiles, &bent);
        assert!(half < 0.1 && ninety > 0.9, "{half} {ninety}");
    }
}
