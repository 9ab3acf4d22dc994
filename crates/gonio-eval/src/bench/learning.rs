//! What a protocol lets the estimators know beforehand.

use anyhow::{Context, Result};
use gonio::appearance::{Lattice, Statistics};
use gonio::inference::amortised::SimulationSettings;
use gonio::model::Model;
use gonio::reflectance::{BivariateTable, TrainSettings};
use gonio::transfer::{Plan, PlanSettings, SurfacePoint};
use gonio_io::cache::Cache;

use super::grid::Protocol;
use crate::bases::Trained;
use crate::data::Lights;
use crate::materials::Materials;
use crate::posteriors;

/// Everything learnt before a photograph is seen, and the operator made of it.
pub(crate) struct Knowledge {
    /// Prior of light and basis of reflectance.
    pub(crate) model: Model,
    /// Luminance tables of the training materials, with their names.
    pub(crate) training: Vec<(String, BivariateTable)>,
    /// The bilinear operator at the points of a sphere.
    pub(crate) plan: Plan,
    /// Those points.
    pub(crate) points: Vec<SurfacePoint>,
    /// What images are gathered on for the marginal posterior, where one is asked for.
    pub(crate) lattice: Lattice,
    /// The statistics that it looks at.
    pub(crate) statistics: Statistics,
}

impl Knowledge {
    /// Of the protocol's training materials; the light prior is the embedded one, from lights that no test uses.
    pub(crate) fn gather(
        materials: &Materials,
        protocol: Protocol,
        rank: usize,
        points: &[SurfacePoint],
        plan: &PlanSettings,
        simulated: Option<(&Lights, &SimulationSettings)>,
        cache: &Cache,
    ) -> Result<Self> {
        let kept = protocol.training(materials);
        let mut settings = TrainSettings::default();
        settings.nmf.rank = rank;
        let green: Vec<(String, BivariateTable)> =
            kept.iter().map(|&at| (materials.names[at].clone(), materials.green(at).clone())).collect();
        let reflectance = Trained::load_or_train(Some(cache), &green, &settings)?.basis;
        let light = gonio_io::model::embedded()?.light;
        let (plan, _, _) =
            gonio_io::plan::load_or_build(Some(cache), points, &reflectance.functions, &light, plan, &|_| ())
                .context("the operator")?;
        let training: Vec<(String, BivariateTable)> =
            kept.iter().map(|&at| (materials.names[at].clone(), materials.luminance(at))).collect();
        let learn = |(lights, settings)| posteriors::load_or_train(cache, &training, lights, settings);
        let posterior = simulated.map(learn).transpose().context("the marginal posterior")?;
        let lattice = Lattice::new();
        let statistics = Statistics::new(&lattice);
        let provenance = format!("basis of {} materials", kept.len());
        Ok(Self {
            model: Model { light, reflectance, posterior, provenance },
            training,
            plan,
            points: points.to_vec(),
            lattice,
            statistics,
        })
    }
}
