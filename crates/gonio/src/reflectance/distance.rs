//! Scale-invariant distance between two BRDFs.
//!
//! A photograph under unknown light does not determine their scale.

use std::f64::consts::FRAC_PI_4;

use super::{BivariateTable, angles_of, trusted_cells};
use crate::search::golden_section;

/// Fraction of the reference's diffuse level that is added to both before the logarithm.
///
/// Without it, cells that are black in either table would count without bound.
const LOG_FLOOR: f64 = 1e-3;

/// Returns the symmetric distance of two BRDFs, the mean of both [`brdf_error`].
///
/// Small distances are approximately relative differences: 0.1 is 10 %. The distance is zero for
/// tables that differ by a factor, and not finite if one of them is black.
pub fn log_distance(a: &BivariateTable, b: &BivariateTable) -> f64 {
    0.5 * (brdf_error(a, b) + brdf_error(b, a))
}

/// Returns the BRDF error, invariant to the scale of the estimate.
///
/// The error is `min_s` of the root mean square of `ln((s F^ + e)/(F + e))` over trusted cells,
/// with `e` a thousandth of the diffuse level of the reference.
pub fn brdf_error(estimate: &BivariateTable, reference: &BivariateTable) -> f64 {
    brdf_fit(estimate, reference).1
}

/// Returns the `s` of [`brdf_error`], the factor that scales an estimate to the reference.
pub fn brdf_scale(estimate: &BivariateTable, reference: &BivariateTable) -> f64 {
    brdf_fit(estimate, reference).0
}

fn brdf_fit(estimate: &BivariateTable, reference: &BivariateTable) -> (f64, f64) {
    let floor = LOG_FLOOR * diffuse_level(reference);
    let cells = trusted_cells();
    log_fit(cells.map(|c| (f64::from(estimate.as_slice()[c]), f64::from(reference.as_slice()[c]))), floor)
}

/// Returns the diffuse level (1/sr): median over trusted cells with `theta_h` above 45 degrees.
pub fn diffuse_level(table: &BivariateTable) -> f64 {
    let mut cells: Vec<f32> =
        trusted_cells().filter(|c| angles_of(*c).0 > FRAC_PI_4).map(|c| table.as_slice()[c]).collect();
    cells.sort_by(f32::total_cmp);
    f64::from(cells[cells.len() / 2])
}

/// Returns the `s` that minimises `rms ln((s a + e)/(b + e))` over pairs `(a, b)`, and the minimum.
///
/// The method is golden section over `ln s`, after a scan around the ratio of geometric means. `e`
/// is `floor`, above zero; negative values count as zero.
pub fn log_fit(pairs: impl Iterator<Item = (f64, f64)>, floor: f64) -> (f64, f64) {
    let pairs: Vec<(f64, f64)> = pairs.map(|(a, b)| (a.max(0.0), (b.max(0.0) + floor).ln())).collect();
    let n = pairs.len() as f64;
    let cost = |log_scale: f64| {
        let s = log_scale.exp();
        (pairs.iter().map(|(a, log_b)| ((s * a + floor).ln() - log_b).powi(2)).sum::<f64>() / n).sqrt()
    };
    let tiny = floor.max(1e-300);
    let centre = pairs.iter().map(|(a, log_b)| log_b - (a + tiny * 1e-3).ln()).sum::<f64>() / n;
    // The cost is not convex in ln s and is therefore scanned coarsely first.
    let step = 0.5;
    let best = (-24..=24).map(|i| centre + step * f64::from(i)).min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
    let best = best.unwrap_or(centre);
    let log_scale = golden_section(|s| -cost(s), (best - step, best + step), 1e-6);
    (log_scale.exp(), cost(log_scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glossy(width: f64) -> BivariateTable {
        BivariateTable::from_fn(|h, _| 0.1 + 5.0 * (-(h / width).powi(2)).exp())
    }

    #[test]
    fn identical_and_scaled_tables_score_zero() {
        let a = glossy(0.1);
        let scaled = a.scaled(37.0);
        assert!(brdf_error(&a, &a) < 1e-6);
        assert!(brdf_error(&scaled, &a) < 1e-4);
        assert!(brdf_error(&glossy(0.3), &a) > 0.2 && brdf_error(&a, &glossy(0.3)) > 0.2);
        assert!((brdf_scale(&scaled, &a) * 37.0 - 1.0).abs() < 1e-4);
    }

    #[test]
    fn distance_is_symmetric_and_grows() {
        let (a, b, c) = (glossy(0.1), glossy(0.15), glossy(0.3));
        assert!((log_distance(&a, &b) - log_distance(&b, &a)).abs() < 1e-12);
        assert!(log_distance(&a, &a.scaled(5.0)) < 1e-4);
        assert!(log_distance(&a, &b) > 0.05 && log_distance(&a, &c) > 1.5 * log_distance(&a, &b));
    }

    #[test]
    fn step_in_half_of_the_cells_gives_half_of_its_logarithm() {
        // After the best scale, each half differs by half of the step.
        let cells: Vec<usize> = trusted_cells().collect();
        let mut stepped = BivariateTable::from_fn(|_, _| 1.0);
        for cell in &cells[..cells.len() / 2] {
            stepped.as_mut_slice()[*cell] = 1.2;
        }
        let distance = log_distance(&stepped, &BivariateTable::from_fn(|_, _| 1.0));
        assert!((distance - 0.5 * 1.2_f64.ln()).abs() < 1e-3, "{distance}");
    }

    #[test]
    fn distance_to_a_black_table_is_not_finite() {
        let black = BivariateTable::from_fn(|_, _| 0.0);
        assert!(!log_distance(&black, &glossy(0.1)).is_finite());
    }
}
