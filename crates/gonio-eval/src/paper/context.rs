//! Data, model and inference that the figures share.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::inference::Hyperparameters;
use gonio::model::Model;
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::LightTree;
use gonio::shape::SurfacePoint;
use gonio_paper::{
    JointMapSettings, Method, Plan, PlanSettings, Posterior, Problem, Projected, VariationalSettings, infer,
};

use super::{Estimator, PaperOptions};
use crate::cache::Cache;
use crate::data::Lights;
use crate::materials::{Materials, Source};

/// Materials of Figs. 4 and 5 from matte to the sharpest that a 32 x 32 light can resolve.
pub(super) const MATERIALS: [&str; 8] = [
    "red-fabric",
    "yellow-plastic",
    "pearl-paint",
    "blue-metallic-paint",
    "gold-metallic-paint2",
    "red-phenolic",
    "alum-bronze",
    "nickel",
];
/// Lights of the inputs, by file and by name.
pub(super) const LIGHTS: [(&str, &str); 2] = [("debevec_stpeters", "St. Peter's"), ("debevec_grace", "Grace")];
/// The novel light.
pub(super) const NOVEL: (&str, &str) = ("debevec_galileo", "Galileo's tomb");

/// A material with its ground truth.
pub(super) struct Material {
    pub(super) name: &'static str,
    /// Table that pictures are rendered from.
    pub(super) full: MerlTable,
    /// Bivariate luminance, 1/sr, with which estimates are compared.
    pub(super) truth: BivariateTable,
}

/// Data and settings of a report.
pub(super) struct PaperContext {
    pub(super) data: PathBuf,
    pub(super) model: Model,
    /// The whole database.
    pub(super) all: Materials,
    /// Lights outside the training data of the prior.
    pub(super) test_lights: Lights,
    /// The materials of [`MATERIALS`].
    pub(super) materials: Vec<Material>,
    /// The lights of [`LIGHTS`].
    pub(super) lights: Vec<LightTree>,
    /// The light of [`NOVEL`].
    pub(super) novel: LightTree,
    pub(super) cache: Cache,
    /// Materials without a full table.
    spread: Vec<&'static str>,
    method: Method,
}

impl PaperContext {
    pub(super) fn open(folder: &Path, options: &PaperOptions) -> Result<Self> {
        let (all, test_lights) = (Materials::open(folder, options.merl.as_deref())?, Lights::open(folder)?);
        let mut spread = Vec::new();
        let mut materials = Vec::new();
        for name in MATERIALS {
            let at = all.index(name)?;
            if all.source(at) == Source::Bivariate {
                spread.push(name);
            }
            materials.push(Material { name, full: all.full(at)?, truth: all.luminance(at) });
        }
        let starts = options.starts as usize;
        let method = match options.estimator {
            Estimator::CKl => Method::Variational(VariationalSettings { starts, ..VariationalSettings::default() }),
            Estimator::JointMap => Method::JointMap(JointMapSettings { starts, ..JointMapSettings::default() }),
        };
        Ok(Self {
            data: folder.to_owned(),
            model: gonio_io::model::embedded()?,
            all,
            materials,
            lights: LIGHTS.iter().map(|(file, _)| test_lights.tree(file)).collect::<Result<_>>()?,
            novel: test_lights.tree(NOVEL.0)?,
            test_lights,
            cache: Cache::open(),
            spread,
            method,
        })
    }

    /// Returns a sentence on the tables from which the inputs are rendered.
    pub(super) fn inputs_note(&self) -> String {
        match self.spread.len() {
            0 => "Inputs and ground truth are rendered from full 90 x 90 x 180 tables in the MERL format.".into(),
            missing if missing == self.materials.len() => "Full MERL tables (--merl) are missing: inputs and ground \
                truth are rendered from bivariate tables spread over phi_d."
                .into(),
            _ => format!(
                "Inputs and ground truth are rendered from full 90 x 90 x 180 tables in the MERL format, except for {}, whose \
                 bivariate tables are spread over phi_d.",
                self.spread.join(", ")
            ),
        }
    }

    /// Builds the plan for these points.
    pub(super) fn plan(&self, points: &[SurfacePoint]) -> Result<Plan> {
        let tables = &self.model.reflectance.functions;
        Ok(Plan::build(points, tables, &self.model.light, &PlanSettings::default(), &|_| ())?)
    }

    /// Infers blind from an image: returns the posterior and its mean BRDF. `name` appears in error
    /// messages.
    pub(super) fn infer(&self, image: &Projected, name: &str) -> Result<(Posterior, BivariateTable)> {
        self.infer_by(image, Hyperparameters::with_model_error(image.pixels), &self.method, name)
    }

    /// Infers blind by another method and with other priors of noise and exposure.
    pub(super) fn infer_by(
        &self,
        image: &Projected,
        hyper: Hyperparameters,
        method: &Method,
        name: &str,
    ) -> Result<(Posterior, BivariateTable)> {
        let problem = Problem::blind(image, &self.model.light, &self.model.reflectance.rates, hyper)
            .with_context(|| name.to_owned())?
            .starting_from(self.examples());
        self.solve(&problem, method, name)
    }

    /// Infers the BRDF with the light known: `rows` are the images of the basis functions,
    /// `[point][function]`.
    pub(super) fn infer_under_known_light(
        &self,
        rows: &[f32],
        image: &[Option<f64>],
        name: &str,
    ) -> Result<BivariateTable> {
        let basis = &self.model.reflectance;
        let projected = Projected::under_known_light(rows, basis.len(), image);
        let problem =
            Problem::with_known_light(&projected, &basis.rates, Hyperparameters::with_model_error(projected.pixels))
                .with_context(|| name.to_owned())?;
        let settings = VariationalSettings { starts: 1, ..VariationalSettings::default() };
        Ok(self.solve(&problem, &Method::Variational(settings), name)?.1)
    }

    fn solve(&self, problem: &Problem<'_>, method: &Method, name: &str) -> Result<(Posterior, BivariateTable)> {
        let posterior = infer(problem, method, &|_| ());
        let table = self.model.reflectance.combine(&posterior.reflectance)?;
        if table.trusted_max() <= 0.0 {
            bail!("{name}: all reflectance coefficients are zero");
        }
        Ok((posterior, table))
    }

    fn examples(&self) -> Vec<Vec<f64>> {
        self.model.reflectance.materials.iter().map(|m| m.coefficients.clone()).collect()
    }

    /// The mean of the training materials, each scaled to maximum one.
    pub(super) fn training_mean(&self) -> Result<BivariateTable> {
        let examples = self.examples();
        let mean = |k: usize| examples.iter().map(|e| e[k]).sum::<f64>() / examples.len() as f64;
        Ok(self.model.reflectance.combine(&(0..self.model.reflectance.len()).map(mean).collect::<Vec<f64>>())?)
    }
}
