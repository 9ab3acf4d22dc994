//! Misfit of the estimated light on clean photographs, for the calibration of
//! [`expected_misfit`](gonio::estimate::expected_misfit).

use std::fmt::Write;

use anyhow::{Context, Result};
use glam::DVec3;
use gonio::appearance::DiskImage;
use gonio::appearance::disk::{DISK_SIDE, normal, on_disk};
use gonio::estimate::EstimateSettings;
use gonio::inference::learnt::{MaterialPosterior, peak_height};
use gonio::inference::light::LightProblem;
use gonio::lighting::LightPrior;
use gonio::shape::SurfacePoint;
use gonio::transfer::TransferSettings;

/// Bounds of the gloss classes of the photographs, as logarithms.
const BOUNDS: [f64; 6] = [f64::NEG_INFINITY, 1.5, 3.5, 6.0, 8.5, f64::INFINITY];

/// Residual of one photograph.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightMisfit {
    /// Logarithm of the posterior median of the gloss.
    gloss: f64,
    /// Relative root mean square of the residual of light and material, less the part that noise
    /// explains.
    misfit: f64,
}

impl LightMisfit {
    /// Estimates the light of an image of the disk, and measures the residual.
    pub(super) fn of(image: &DiskImage, posterior: &MaterialPosterior, prior: &LightPrior) -> Result<Self> {
        let seen: Vec<usize> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c) && image.counts[c] > 0.0).collect();
        let seen: Vec<usize> = seen
            .iter()
            .copied()
            .step_by(seen.len().div_ceil(EstimateSettings::default().observations).max(1))
            .collect();
        let point = |&c: &usize| SurfacePoint { normal: normal(c).as_dvec3(), view: DVec3::Z };
        let points: Vec<SurfacePoint> = seen.iter().map(point).collect();
        let values: Vec<Option<f64>> = seen.iter().map(|&c| Some(f64::from(image.values[c]))).collect();
        let problem = LightProblem::new(&points, &values, None, &posterior.mean, prior, &TransferSettings::default())
            .context("the light of a photograph")?;
        let light = problem.non_negative(&problem.posterior()?)?;
        let radiance: Vec<f64> = light.light.iter().map(|l| l * light.exposure).collect();
        let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
        let noise =
            square(&mut seen.iter().map(|&c| f64::from(image.scatter * image.values[c] / image.counts[c].sqrt())));
        let all = square(&mut values.iter().flatten().copied());
        Ok(Self {
            gloss: posterior.ranking(peak_height).quantiles(&[0.5])[0].ln(),
            misfit: (problem.misfit(&radiance).powi(2) - noise / all).max(0.0).sqrt(),
        })
    }
}

/// Table of misfits by gloss.
pub(super) fn report(all: &[LightMisfit]) -> String {
    let mut out = String::from(
        "| logarithm of gloss | photographs | median of it | misfit without noise: median | 95 % |\n|---|---|---|---|---|\n",
    );
    for bounds in BOUNDS.windows(2) {
        let those: Vec<&LightMisfit> = all.iter().filter(|l| (bounds[0]..bounds[1]).contains(&l.gloss)).collect();
        if those.is_empty() {
            continue;
        }
        let sorted = |f: fn(&LightMisfit) -> f64| {
            let mut values: Vec<f64> = those.iter().map(|l| f(l)).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let (glosses, misfits) = (sorted(|l| l.gloss), sorted(|l| l.misfit));
        let at = |values: &[f64], share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
        let _ = writeln!(
            out,
            "| {:.1} to {:.1} | {} | {:.1} | {:.3} | {:.3} |",
            bounds[0],
            bounds[1],
            those.len(),
            at(&glosses, 0.5),
            at(&misfits, 0.5),
            at(&misfits, 0.95),
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_by_gloss() {
        let all: Vec<LightMisfit> =
            (0..40).map(|i| LightMisfit { gloss: f64::from(i % 2) * 5.0, misfit: 0.01 * f64::from(i) }).collect();
        let table = report(&all);
        assert!(table.contains("| -inf to 1.5 | 20 | 0.0 | 0.200 | 0.360 |"), "{table}");
        assert!(table.contains("| 3.5 to 6.0 | 20 | 5.0 | 0.210 | 0.370 |"), "{table}");
        assert_eq!(table.lines().count(), 4);
    }
}
