//! Several materials under one light: regions of an object, or objects seen together.
//!
//! The region with the sharpest reflections shows the light best. Its material is found as if it
//! were alone, and the light given its mean; under that light each other material is found as under
//! a known one, whose errors are part of the error of the image that is estimated there. Where the
//! light does not explain a region, it is found as if it were alone, too.

use super::known_light::{Given, estimate_given};
use super::material::Impression;
use super::{Colouring, Estimate, EstimateError, EstimateSettings, Light, Material, Stage};
use crate::inference::known_light::{Alignment, GivenLight};
use crate::lighting::LightGrid;
use crate::model::Model;
use crate::scene::Observations;

/// Residual under the light of another region, relative to that under the own light, above which
/// the other light is not used.
const WORSE: f64 = 1.5;

/// Residual that is always small enough for it.
const SMALL: f64 = 0.08;

/// Estimate of a region that shares its light with others.
#[derive(Clone, Debug)]
pub struct Shared {
    /// Its material, light and colours.
    pub estimate: Estimate,
    /// Index of the region whose light it is under; its own if it was found as if alone.
    pub light_of: usize,
    /// Factor from the albedo of that region to its own: one light tells how bright regions are
    /// beside each other.
    pub albedo_ratio: f64,
}

/// Estimates the materials of regions under one light.
///
/// # Errors
/// As [`estimate`](super::estimate), with the index of the region at fault.
///
/// # Panics
/// If nothing is observed of a region.
pub fn estimate_together(
    model: &Model,
    regions: &[&Observations],
    settings: &EstimateSettings,
    progress: &(dyn Fn(Stage) + Sync),
) -> Result<Vec<Shared>, (usize, EstimateError)> {
    let alone = |at: usize| -> Result<(Material, Light), EstimateError> {
        settings.check(model)?;
        progress(Stage::Material);
        let material = Impression::of(model, regions[at], settings.side)?.describe();
        let light = Light::of(model, regions[at], &material.table, settings, progress)?;
        Ok((material, light))
    };
    let own: Vec<(Material, Light)> =
        (0..regions.len()).map(|at| alone(at).map_err(|error| (at, error))).collect::<Result<_, _>>()?;
    let sharpest = |a: &usize, b: &usize| own[*a].0.gloss[1].total_cmp(&own[*b].0.gloss[1]);
    let best = (0..regions.len()).max_by(sharpest).unwrap_or(0);
    let light = own.get(best).map(|(_, light)| light.clone());
    let mut all = Vec::new();
    for (at, (material, own_light)) in own.into_iter().enumerate() {
        let colouring = Colouring::of(model, regions[at], &material.table, &settings.colouring);
        let mut found =
            Shared { estimate: Estimate { material, light: own_light, colouring }, light_of: at, albedo_ratio: 1.0 };
        if let Some(light) = light.as_ref().filter(|_| at != best) {
            progress(Stage::Material);
            let given = Given { light: GivenLight::of_grid(&light.grid), alignment: Alignment::Fixed };
            let lit = estimate_given(model, regions[at], given, &settings.colouring).map_err(|error| (at, error))?;
            if lit.misfit <= SMALL.max(WORSE * found.estimate.light.misfit) {
                let light = Light { grid: scaled(&light.grid, lit.exposure), misfit: lit.misfit, ..light.clone() };
                let estimate = Estimate { material: lit.material, light, colouring: lit.colouring };
                found = Shared { estimate, light_of: best, albedo_ratio: lit.exposure };
            }
        }
        all.push(found);
    }
    Ok(all)
}

fn scaled(grid: &LightGrid, by: f64) -> LightGrid {
    let texels = grid.texels().iter().map(|texel| *texel * by as f32).collect();
    LightGrid::from_texels(grid.map(), grid.side(), texels)
}
