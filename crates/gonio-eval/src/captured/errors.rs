//! Errors of a BRDF against a captured object: against the measured slice, and against photographs
//! in other lights.

use glam::DVec3;
use gonio::picture::{Plane, luminance};
use gonio::reflectance::BivariateTable;

use super::object::Captured;
use super::slice::Cell;
use crate::metrics::{self, Relight};

/// Predictions are compared at pixels whose normal is less than this many degrees from the view.
pub(super) const WITHIN: f32 = 75.0;

/// Half angles, in degrees, that count as the highlight, and those that count as the base.
const HIGHLIGHT: f64 = 3.0;
const BASE: std::ops::Range<f64> = 45.0..80.0;

/// A BRDF of half and difference angle in radians, up to a scale.
pub(super) type Reflectance<'a> = &'a (dyn Fn(f64, f64) -> f64 + Sync);

/// Natural logarithm of a reflectance over that of the measurement, in each cell.
fn log_ratios(cells: &[Cell], f: Reflectance<'_>) -> Vec<f64> {
    cells.iter().map(|c| f(c.theta_h, c.theta_d).max(1e-12).ln() - c.value.ln()).collect()
}

/// Root mean square of the difference of natural logarithms over the cells, after the median
/// offset.
pub(super) fn slice_error(cells: &[Cell], f: Reflectance<'_>) -> f64 {
    let ratios = log_ratios(cells, f);
    let offset = metrics::median(ratios.clone());
    (ratios.iter().map(|r| (r - offset).powi(2)).sum::<f64>() / ratios.len() as f64).sqrt()
}

/// Shares of the cells inside the 50 % and the 90 % interval, after the measurement is scaled to
/// the estimate by the median offset. `quantiles` are at
/// [`SHARES`](gonio::estimate::QUANTILE_LEVELS).
pub(super) fn coverage(cells: &[Cell], table: &BivariateTable, quantiles: &[BivariateTable; 4]) -> [f64; 2] {
    let scale = metrics::median(log_ratios(cells, &|h, d| table.eval(h, d))).exp();
    let inside = |low: &BivariateTable, high: &BivariateTable| {
        let holds = |c: &&Cell| {
            let value = scale * c.value;
            low.eval(c.theta_h, c.theta_d) <= value && value <= high.eval(c.theta_h, c.theta_d)
        };
        cells.iter().filter(holds).count() as f64 / cells.len() as f64
    };
    [inside(&quantiles[1], &quantiles[2]), inside(&quantiles[0], &quantiles[3])]
}

/// Gloss of a reflectance over the measured cells: the ratio of its mean over cells with `theta_h`
/// below 3 degrees to its mean over cells from 45 to 80 degrees. One for a Lambertian surface; NaN
/// if either range has no cells.
pub(super) fn gloss(cells: &[Cell], f: Reflectance<'_>) -> f64 {
    let mean = |wanted: &dyn Fn(f64) -> bool| {
        let those = cells.iter().filter(|c| wanted(c.theta_h.to_degrees()));
        metrics::mean(&those.map(|c| f(c.theta_h, c.theta_d)).collect::<Vec<f64>>())
    };
    mean(&|h| h < HIGHLIGHT) / mean(&|h| BASE.contains(&h)).max(1e-300)
}

/// Gloss of the measurement.
pub(super) fn measured_gloss(object: &Captured, cells: &[Cell]) -> f64 {
    // At the centre of a cell the slice equals the measured value.
    gloss(cells, &|h, d| object.slice.eval(h, d))
}

/// Renders the object in the lights of a photograph, and compares the picture with the photograph,
/// in luminance at the best scale.
pub(super) fn prediction(object: &Captured, photograph: usize, f: Reflectance<'_>) -> (Plane<DVec3>, Relight) {
    let sent = object.render(photograph, f);
    let observed = object.photographs[photograph].picture.rgb.as_slice();
    let grey = |&p: &usize| [f64::from(luminance(sent.as_slice()[p].as_vec3())), f64::from(luminance(observed[p]))];
    let pairs: Vec<[f64; 2]> = object.pixels(WITHIN).iter().map(grey).collect();
    let column = |i: usize| pairs.iter().map(|pair| pair[i]).collect::<Vec<f64>>();
    let error = metrics::relight(&column(0), &column(1));
    (sent, error)
}

/// Errors of the [`prediction`] of each photograph.
pub(super) fn predictions(object: &Captured, f: Reflectance<'_>) -> Vec<Relight> {
    (0..object.photographs.len()).map(|i| prediction(object, i, f).1).collect()
}

#[cfg(test)]
mod tests {
    use super::super::planted;
    use super::*;

    fn glossy() -> BivariateTable {
        BivariateTable::from_fn(|h, d| 0.1 + 3.0 * (-(h / 0.2).powi(2)).exp() + 0.05 * d)
    }

    #[test]
    fn the_truth_has_no_error_at_any_scale() {
        let truth = glossy();
        let ball = planted::ball(&truth);
        let scaled = |h: f64, d: f64| 7.0 * truth.eval(h, d);
        assert!(slice_error(&ball.slice.judged(), &scaled) < 1e-5);
        for error in predictions(&ball, &scaled) {
            assert!(error.relative < 1e-6 && error.log < 1e-4, "{error:?}");
        }
        for error in predictions(&ball, &|_, _| 1.0) {
            assert!(error.relative > 0.1 && error.log > 0.1, "{error:?}");
        }
    }

    #[test]
    fn the_slice_error_is_the_spread_around_the_median() {
        // A quarter of the judged cells is doubled: the median offset is unchanged, and the mean
        // square error is a quarter of ln(2)^2.
        let cells = planted::measured(|h, _| 1.0 + h).judged();
        assert_eq!(cells.len(), 80 * 30);
        let edge = 20.0_f64.to_radians();
        let off = slice_error(&cells, &|h, _| if h < edge { 6.0 * (1.0 + h) } else { 3.0 * (1.0 + h) });
        assert!((off - 0.5 * std::f64::consts::LN_2).abs() < 1e-6, "{off}");
    }

    #[test]
    fn gloss_is_the_highlight_over_the_base() {
        let f = |h: f64, _: f64| if h.to_degrees() < 10.0 { 24.0 } else { 2.0 };
        let ball = Captured { slice: planted::measured(f), ..planted::ball(&glossy()) };
        let cells = ball.slice.judged();
        assert!((measured_gloss(&ball, &cells) - 12.0).abs() < 1e-5);
        assert!((gloss(&cells, &|_, _| 0.3) - 1.0).abs() < 1e-9);
        let base: Vec<Cell> = cells.iter().copied().filter(|c| c.theta_h > 0.5).collect();
        assert!(gloss(&base, &f).is_nan());
    }

    #[test]
    fn coverage_counts_the_cells_inside_the_intervals() {
        let truth = glossy();
        // Three quarters of the cells equal the table, the others are 1.5 times as large.
        let edge = 20.0_f64.to_radians();
        let cells = planted::measured(|h, d| truth.eval(h, d) * if h < edge { 1.5 } else { 1.0 }).judged();
        let estimate = truth.scaled(0.2);
        let quantiles = [0.5, 0.9, 1.1, 2.0].map(|factor| estimate.scaled(factor));
        assert_eq!(coverage(&cells, &estimate, &quantiles), [0.75, 1.0]);
        let narrow = [0.5, 0.9, 1.1, 1.4].map(|factor| estimate.scaled(factor));
        assert_eq!(coverage(&cells, &estimate, &narrow), [0.75, 0.75]);
    }
}
