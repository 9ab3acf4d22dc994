//! Relight error and BRDF error: both invariant to the common scale, which a photograph does not
//! determine.

use gonio::picture::{Picture, luminance};
use gonio::reflectance::{BivariateTable, trusted_cells};

use super::gloss::diffuse_level;

/// Relight error and its log version.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Relight {
    /// `min_s |s I^ - I| / |I|`.
    pub(crate) relative: f64,
    /// Root mean square of `ln((s I^ + e) / (I + e))`, `e` one percent of the mean of `I`, with the
    /// `s` that minimises it.
    pub(crate) log: f64,
    /// The `s` of the log version: the scale at which the estimate is shown beside the reference.
    pub(crate) scale: f64,
}

/// Luminances of the pixels of a sphere picture whose normal is within 80 degrees of the view.
pub(crate) fn sphere_pixels(picture: &Picture, radius: f64) -> Vec<f64> {
    let (width, height) = picture.rgb.size();
    let limit = 80.0_f64.to_radians().sin() * radius;
    (0..width * height)
        .filter(|i| {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            (x - 0.5 * width as f64).hypot(y - 0.5 * height as f64) < limit
        })
        .map(|i| f64::from(luminance(picture.rgb.as_slice()[i])))
        .collect()
}

/// Compares pictures of the same pixels under the same light.
pub(crate) fn relight(estimate: &[f64], reference: &[f64]) -> Relight {
    let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let best = inner(estimate, reference) / inner(estimate, estimate).max(1e-300);
    let residual: f64 = estimate.iter().zip(reference).map(|(a, b)| (best * a - b).powi(2)).sum();
    let relative = (residual / inner(reference, reference)).sqrt();
    let floor = 0.01 * reference.iter().sum::<f64>() / reference.len() as f64;
    let (scale, log) = log_fit(estimate.iter().copied().zip(reference.iter().copied()), floor);
    Relight { relative, log, scale }
}

/// BRDF error: `min_s` root mean square of `ln((s F^ + e)/(F + e))` over trusted cells, `e` a
/// thousandth of the diffuse level of the reference.
pub(crate) fn brdf_error(estimate: &BivariateTable, reference: &BivariateTable) -> f64 {
    brdf_fit(estimate, reference).1
}

/// The `s` of [`brdf_error`]: the factor that scales an estimate to the reference.
pub(crate) fn brdf_scale(estimate: &BivariateTable, reference: &BivariateTable) -> f64 {
    brdf_fit(estimate, reference).0
}

fn brdf_fit(estimate: &BivariateTable, reference: &BivariateTable) -> (f64, f64) {
    let floor = 1e-3 * diffuse_level(reference);
    let cells = trusted_cells();
    log_fit(cells.map(|c| (f64::from(estimate.as_slice()[c]), f64::from(reference.as_slice()[c]))), floor)
}

/// The `s` that minimises `rms ln((s a + e)/(b + e))` and the minimum, by golden section over
/// `ln s` around the ratio of geometric means.
pub(crate) fn log_fit(pairs: impl Iterator<Item = (f64, f64)>, floor: f64) -> (f64, f64) {
    let pairs: Vec<(f64, f64)> = pairs.map(|(a, b)| (a.max(0.0), (b.max(0.0) + floor).ln())).collect();
    let n = pairs.len() as f64;
    let cost = |log_scale: f64| {
        let s = log_scale.exp();
        (pairs.iter().map(|(a, log_b)| ((s * a + floor).ln() - log_b).powi(2)).sum::<f64>() / n).sqrt()
    };
    let tiny = floor.max(1e-300);
    let centre = pairs.iter().map(|(a, log_b)| log_b - (a + tiny * 1e-3).ln()).sum::<f64>() / n;
    // The cost is not convex in ln s: a coarse scan first.
    let step = 0.5;
    let best = (-24..=24).map(|i| centre + step * f64::from(i)).min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
    let best = best.unwrap_or(centre);
    let (mut low, mut high) = (best - step, best + step);
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut left, mut right) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_left, mut at_right) = (cost(left), cost(right));
    for _ in 0..28 {
        if at_left < at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - golden * (high - low);
            at_left = cost(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + golden * (high - low);
            at_right = cost(right);
        }
    }
    let log_scale = 0.5 * (low + high);
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
    fn identical_and_scaled_pictures_score_zero() {
        let image: Vec<f64> = (0..500).map(|i| 1.0 + f64::from(i % 17)).collect();
        let scaled: Vec<f64> = image.iter().map(|x| 0.01 * x).collect();
        for other in [&image, &scaled] {
            let r = relight(other, &image);
            assert!(r.relative < 1e-9 && r.log < 1e-4, "{r:?}");
        }
        let swapped: Vec<f64> = image.iter().rev().copied().collect();
        assert!(relight(&swapped, &image).relative > 0.1);
    }

    #[test]
    fn a_black_estimate_has_relative_error_one() {
        let r = relight(&[0.0; 4], &[1.0, 2.0, 3.0, 4.0]);
        assert!((r.relative - 1.0).abs() < 1e-12);
    }
}
