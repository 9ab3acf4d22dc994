//! Models that the estimators of a protocol learn before the run.

use anyhow::{Context, Result};
use gonio::colour::{Chroma, ColourModel, ColourSample};
use gonio::inference::learnt::LearntPosterior;
use gonio::lighting::LightPrior;
use gonio::model::Model;
use gonio::reflectance::{BivariateTable, Dictionary, DictionarySettings, LatentSpace, LogBasis};
use gonio::shape::SurfacePoint;
use gonio_paper::Plan;
use gonio_paper::training::TrainSettings;

use super::grid::Protocol;
use super::store::Conditions;
use crate::bases::Trained;
use crate::cache::Cache;
use crate::data::Lights;
use crate::materials::Materials;
use crate::posteriors::{self, Learning};

/// Models learnt before the first photograph, and the operator built from them.
pub(crate) struct LearntModels {
    /// Prior of light and basis of reflectance.
    pub(crate) model: Model,
    /// Luminance tables of the training materials, with their names.
    pub(crate) training: Vec<(String, BivariateTable)>,
    /// The bilinear operator at the points of a sphere.
    pub(crate) plan: Plan,
    /// The space of materials, for known light.
    pub(crate) space: Option<MaterialSpace>,
    /// The points of the sphere.
    pub(crate) points: Vec<SurfacePoint>,
}

/// The space of materials of the posterior under a known light.
pub(crate) struct MaterialSpace {
    /// Coordinate system of the materials.
    pub(crate) coordinates: LatentSpace,
    /// Coordinates of the prior's materials.
    pub(crate) places: Vec<Vec<f64>>,
    /// Differences between the channels of the training materials.
    pub(crate) colours: ColourModel,
}

impl MaterialSpace {
    /// Learns from the channels of training materials, whose luminances are `training`.
    fn of(training: &[(String, BivariateTable)], rgb: &[[BivariateTable; 3]], settings: &DictionarySettings) -> Self {
        let basis = LogBasis::fit(training, LogBasis::RANK);
        let Dictionary { latent_space: coordinates, coordinates: places, .. } = Dictionary::new(basis, settings);
        // Under a known light, the errors of blind estimates and the chromas of lights are not
        // needed.
        let error = vec![0.0; coordinates.axes.len() + 1];
        let sample = ColourSample { errors: [error.clone(), error.clone(), error] };
        let colours = ColourModel::learn(&coordinates, rgb, &[sample], &[Chroma::default()]);
        Self { coordinates, places, colours }
    }
}

/// The colours of the learnt posterior are learnt in every `COLOUR_STRIDE`-th training light.
const COLOUR_STRIDE: usize = 6;

impl LearntModels {
    /// Learns the models from the protocol's training materials. The prior of light is `prior`. The
    /// default is the embedded prior, whose training lights do not occur in any test.
    pub(crate) fn learn(
        materials: &Materials,
        protocol: Protocol,
        conditions: &Conditions,
        points: &[SurfacePoint],
        prior: Option<&LightPrior>,
        (lights, known_light): (Option<&Lights>, bool),
        cache: &Cache,
    ) -> Result<Self> {
        let Conditions { rank, ref plan, ref learning, .. } = *conditions;
        let kept = protocol.training(materials);
        let mut settings = TrainSettings::default();
        settings.nmf.rank = rank;
        let green: Vec<(String, BivariateTable)> =
            kept.iter().map(|&at| (materials.names[at].clone(), materials.green(at).clone())).collect();
        let reflectance = Trained::load_or_train(cache, &green, &settings)?.basis;
        let Model { light, learnt: embedded, .. } = gonio_io::model::embedded()?;
        let light = prior.cloned().unwrap_or(light);
        let plan = Plan::build(points, &reflectance.functions, &light, plan, &|_| ()).context("the operator")?;
        let training: Vec<(String, BivariateTable)> =
            kept.iter().map(|&at| (materials.names[at].clone(), materials.luminance(at))).collect();
        let learn = |lights: &Lights| {
            let names = lights.names();
            // Use the embedded posterior if it was learnt from the same number of lights and the
            // same materials with the default settings. Training would give the same result.
            let same = |found: &LearntPosterior| {
                *learning == Learning::default()
                    && names.len() == light.lights
                    && found.names.iter().eq(training.iter().map(|(name, _)| name))
            };
            match embedded.filter(same) {
                Some(found) => Ok(found),
                None => posteriors::load_or_train(cache, &training, lights, &names, learning),
            }
        };
        let mut rgb: Vec<[BivariateTable; 3]> = kept.iter().map(|&at| materials.rgb(at).clone()).collect();
        rgb.iter_mut().flatten().for_each(BivariateTable::extend_from_trusted);
        let mut posterior = lights.map(learn).transpose().context("the posterior of materials")?;
        if let (Some(posterior), Some(lights)) = (posterior.as_mut(), lights) {
            // The embedded model of colours was learnt from other materials.
            posterior.colours = Some(posteriors::colours(cache, posterior, rgb.clone(), lights, COLOUR_STRIDE)?);
        }
        let space = known_light.then(|| MaterialSpace::of(&training, &rgb, &learning.dictionary));
        let provenance = format!("basis of {} materials", kept.len());
        Ok(Self {
            model: Model { light, reflectance, learnt: posterior, provenance },
            training,
            plan,
            space,
            points: points.to_vec(),
        })
    }
}
