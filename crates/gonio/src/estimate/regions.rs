//! Several materials under one light: regions of an object, or objects seen together.
//!
//! Each material is estimated independently. The common light then determines the relative albedos,
//! which separate photographs do not determine. The common light does not improve the shapes of the
//! BRDFs: the light estimated from the sharpest reflections made the other estimates worse
//! (docs/trials.md).

use glam::DVec3;

use super::{Estimate, EstimateError, EstimateSettings, EstimateStage};
use crate::lighting::LightGrid;
use crate::model::Model;
use crate::parallel;
use crate::picture::luminance;
use crate::scene::Observations;

/// Estimate of one of several regions.
#[derive(Clone, Debug)]
pub struct RegionEstimate {
    /// Material, light and colours, estimated from this region alone.
    pub estimate: Estimate,
    /// Albedo relative to that of the brightest region, in 0..=1.
    pub relative_albedo: f64,
}

/// Estimates the materials of regions under one light.
///
/// # Errors
/// Those of [`estimate`](super::estimate), with the index of the region.
pub fn estimate_regions(
    model: &Model,
    regions: &[&Observations],
    settings: &EstimateSettings,
    progress: &(dyn Fn(EstimateStage) + Sync),
) -> Result<Vec<RegionEstimate>, (usize, EstimateError)> {
    let alone = |(at, region): (usize, &&Observations)| {
        super::estimate(model, region, settings, progress).map_err(|error| (at, error))
    };
    let all: Vec<Estimate> = regions.iter().enumerate().map(alone).collect::<Result<_, _>>()?;
    // Each light was estimated for an albedo of one half. Under the common light, a region with a
    // brighter light therefore has a larger albedo.
    let brightness: Vec<f64> = parallel::map(&all, |one| irradiance(&one.light.grid));
    let brightest = brightness.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let beside = |(estimate, own)| RegionEstimate { estimate, relative_albedo: own / brightest };
    Ok(all.into_iter().zip(brightness).map(beside).collect())
}

/// Returns the irradiance (luminance) of a surface that faces the camera.
///
/// There, the camera observes the albedo along the normal.
pub fn irradiance(grid: &LightGrid) -> f64 {
    let (map, side) = (grid.map(), grid.side());
    let texel = |t: usize| {
        let (u, v) = LightGrid::centre_of(side, t);
        let cosine = map.direction(u, v).dot(DVec3::Z).max(0.0);
        f64::from(luminance(grid.texels()[t])) * cosine * map.density(u, v) * 4.0 / (side * side) as f64
    };
    (0..side * side).map(texel).sum()
}
