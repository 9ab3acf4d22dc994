//! What a protocol lets the estimators know beforehand.

use anyhow::{Context, Result};
use gonio::model::Model;
use gonio::reflectance::{BivariateTable, ReflectanceBasis, TrainSettings, train};
use gonio::transfer::{Plan, PlanSettings, SurfacePoint};
use gonio_io::cache::Cache;
use serde::Serialize;

use super::grid::Protocol;
use super::materials::Materials;

/// Everything learnt before a photograph is seen, and the operator made of it.
pub(crate) struct Knowledge {
    /// Prior of light and basis of reflectance.
    pub(crate) model: Model,
    /// Luminance tables of the training materials, with their names.
    pub(crate) training: Vec<(String, BivariateTable)>,
    /// The bilinear operator at the points of a sphere.
    pub(crate) plan: Plan,
}

/// Raised when training gives other results for the same input.
const VERSION: u32 = 1;

impl Knowledge {
    /// Of the protocol's training materials; the light prior is the embedded one, from lights that no test uses.
    pub(crate) fn gather(
        materials: &Materials,
        protocol: Protocol,
        rank: usize,
        points: &[SurfacePoint],
        plan: &PlanSettings,
        cache: Option<&Cache>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self> {
        let held_out = materials.held_out();
        let kept: Vec<usize> =
            (0..materials.names.len()).filter(|at| protocol == Protocol::All || !held_out.contains(at)).collect();
        let mut settings = TrainSettings::default();
        settings.nmf.rank = rank;
        let green: Vec<(String, BivariateTable)> =
            kept.iter().map(|&at| (materials.names[at].clone(), materials.green(at).clone())).collect();
        let reflectance = learn(&green, &settings, cache)?;
        let light = gonio_io::model::embedded()?.light;
        let (plan, _, _) = gonio_io::plan::load_or_build(cache, points, &reflectance.functions, &light, plan, progress)
            .context("the operator")?;
        let training = kept.iter().map(|&at| (materials.names[at].clone(), materials.luminance(at))).collect();
        let provenance = format!("basis of {} materials", kept.len());
        Ok(Self { model: Model { light, reflectance, provenance }, training, plan })
    }
}

/// A basis, from the cache where it was learnt before.
fn learn(
    materials: &[(String, BivariateTable)],
    settings: &TrainSettings,
    cache: Option<&Cache>,
) -> Result<ReflectanceBasis> {
    #[derive(Serialize)]
    struct Key<'a>(u32, &'a TrainSettings, Vec<&'a str>);
    let names = materials.iter().map(|(name, _)| name.as_str()).collect();
    let mut hasher = blake3::Hasher::new();
    hasher.update(&serde_json::to_vec(&Key(VERSION, settings, names))?);
    for value in materials.iter().flat_map(|(_, table)| table.as_slice()) {
        hasher.update(&value.to_le_bytes());
    }
    let key = format!("basis-{}", hasher.finalize().to_hex());
    let stored = cache.and_then(|c| c.load(&key)).and_then(|bytes| serde_json::from_slice(&bytes).ok());
    if let Some(basis) = stored {
        return Ok(basis);
    }
    let (basis, _) = train(materials, settings).context("the reflectance basis")?;
    if let Some(cache) = cache {
        // A cache that cannot be written costs time, nothing else.
        let _ = cache.store(&key, &serde_json::to_vec(&basis)?);
    }
    Ok(basis)
}
