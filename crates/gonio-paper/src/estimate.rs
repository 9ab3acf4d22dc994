//! Estimates from the observations of a photograph.

use std::fmt;

use gonio::estimate::ALBEDO;
use gonio::inference::Hyperparameters;
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::model::Model;
use gonio::reflectance::{BasisError, BivariateTable};
use gonio::render::{IntegratorSettings, LightTree, images_of_basis};
use gonio::scene::Observations;
use gonio::transfer::TransferError;
use thiserror::Error;

use crate::{
    JointMapSettings, Method, Plan, PlanError, PlanSettings, Posterior, Problem, ProblemError, Projected, Solver,
    VariationalSettings, infer,
};

/// Relative noise above which a result is unreliable: that of converged solutions is less than half
/// of it.
const UNEXPLAINED: f64 = 0.5;

/// Share of an image's energy outside a projection above which it is reported.
const MAX_LEFT_OVER: f64 = 0.02;

/// Slack with which the rank of a projection is chosen (see [`Plan::project`]).
const SLACK: f64 = 1e-5;

/// Objective under unknown light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PaperMethod {
    /// Separable posterior of light and reflectance: Algorithm 1.
    #[default]
    Variational,
    /// Joint maximum over light and reflectance.
    JointMap,
}

/// Settings of [`estimate`].
#[derive(Clone, Debug, PartialEq)]
pub struct PaperSettings {
    /// Objective under unknown light.
    pub method: PaperMethod,
    /// Number of texels along a side of the light grid, a power of two.
    pub side: usize,
    /// Solver of the separable posterior under unknown light, unless [`Self::as_printed`].
    pub solver: Solver,
    /// Random starts, at least one.
    pub starts: usize,
    /// Seed of the random starts.
    pub seed: u64,
    /// Use vague priors of noise and exposure, random starts and Algorithm 1 as printed. The prior
    /// of light is that of the model.
    pub as_printed: bool,
    /// Use all observations instead of their projection.
    pub all_observations: bool,
}

impl Default for PaperSettings {
    fn default() -> Self {
        Self {
            method: PaperMethod::default(),
            side: PlanSettings::default().transfer.side,
            solver: Solver::Blocks,
            starts: 4,
            seed: 1,
            as_printed: false,
            all_observations: false,
        }
    }
}

/// Part of an estimation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaperStage {
    /// Computes the bilinear operator.
    Plan,
    /// Computes the posterior.
    Inference,
}

/// Estimate of reflectance and light.
#[derive(Clone, Debug)]
pub struct PaperEstimate {
    /// Luminance of the BRDF (1/sr), of albedo [`ALBEDO`].
    pub table: BivariateTable,
    /// Factor from the reflectance of [`Self::posterior`] to [`Self::table`].
    pub scale: f64,
    /// The light on the scale of the table; `None` under a known light.
    pub light: Option<LightGrid>,
    /// Standard deviation of the noise, relative to the root mean square of the image.
    pub relative_noise: f64,
    /// Posterior of all unknowns.
    pub posterior: Posterior,
    /// Number of rows on which the inference ran.
    pub rows: usize,
    /// Losses of the projection; `None` if the inference ran on all observations.
    pub projection: Option<ProjectionLoss>,
    /// Texels along a side of the light grid.
    side: usize,
}

/// Energy outside a projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectionLoss {
    /// Share of the prior's energy, 0..=1.
    pub of_prior: f64,
    /// Share of the photograph's energy, 0..=1.
    pub of_image: f64,
}

/// Reason why a result may be wrong. Its text is a warning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PaperDiagnostic {
    /// No start converged.
    NotConverged,
    /// The relative noise is large.
    LargeResidual(f64),
    /// A light on a grid of `side` texels per side cannot reproduce this share of the image.
    LeftOver {
        /// Texels along a side.
        side: usize,
        /// Share of the image's energy.
        share: f64,
    },
}

impl fmt::Display for PaperDiagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConverged => write!(f, "no start of the solver converged; the result may be inaccurate"),
            Self::LargeResidual(noise) => write!(
                f,
                "the relative RMS residual of the photograph is {:.0} %; the result is unreliable",
                100.0 * noise
            ),
            Self::LeftOver { side, share } => write!(
                f,
                "the basis functions in a light of {side} x {side} texels cannot reproduce {:.0} % of the image's \
                 energy; the roughness of a sharp material is probably overestimated",
                100.0 * share
            ),
        }
    }
}

/// Error of [`estimate`].
#[derive(Debug, Error)]
pub enum PaperError {
    /// The operator cannot be computed from points, basis and grid.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The image is black or not finite, or basis and operator do not match.
    #[error(transparent)]
    Problem(#[from] ProblemError),
    /// The basis of the model is not valid.
    #[error(transparent)]
    Basis(#[from] BasisError),
    /// All reflectance coefficients are zero.
    #[error("all reflectance coefficients are zero; check that the object is lit")]
    Black,
}

impl From<TransferError> for PaperError {
    fn from(error: TransferError) -> Self {
        Self::Plan(error.into())
    }
}

/// Estimates reflectance, and the light unless it is known, by a method of the paper.
///
/// `light` is the known light, in camera space. `progress` receives each stage with a fraction in
/// 0..=1.
///
/// # Errors
/// If there are too few observations, the model's prior does not cover the grid, or the image is
/// black or not finite.
pub fn estimate(
    model: &Model,
    observations: &Observations,
    light: Option<&EnvironmentMap>,
    settings: &PaperSettings,
    progress: &(dyn Fn(PaperStage, f64) + Sync),
) -> Result<PaperEstimate, PaperError> {
    progress(PaperStage::Plan, 0.0);
    let (projected, projection) = match light {
        Some(light) => {
            let (tables, integrator) = (&model.reflectance.functions, IntegratorSettings::default());
            let rows = images_of_basis(
                observations.points_with_visibility(),
                tables,
                &LightTree::of_map(light),
                &integrator,
                &|x| progress(PaperStage::Plan, x),
            );
            (Projected::under_known_light(&rows, tables.len(), &observations.values), None)
        }
        None => project(model, observations, settings, &|x| progress(PaperStage::Plan, x))?,
    };
    progress(PaperStage::Inference, 0.0);
    let posterior = posterior(model, &projected, light.is_some(), settings, &|x| progress(PaperStage::Inference, x))?;
    let table = model.reflectance.combine(&posterior.reflectance)?;
    if table.trusted_max() <= 0.0 {
        return Err(PaperError::Black);
    }
    let relative_noise = posterior.noise / (projected.energy() / projected.pixels as f64).sqrt();
    let (table, scale) = table.with_normal_albedo(ALBEDO);
    let light = light.is_none().then(|| {
        let radiance: Vec<f64> = posterior.light.iter().map(|l| l * posterior.exposure / scale).collect();
        LightGrid::from_coefficients(model.light.map, &radiance)
    });
    let rows = projected.bilinear.rows();
    Ok(PaperEstimate { table, scale, light, relative_noise, posterior, rows, projection, side: settings.side })
}

impl PaperEstimate {
    /// Returns the reasons why the estimate may be wrong.
    pub fn diagnostics(&self) -> Vec<PaperDiagnostic> {
        let mut found = Vec::new();
        if let Some(ProjectionLoss { of_image: share, .. }) = self.projection
            && share > MAX_LEFT_OVER
        {
            found.push(PaperDiagnostic::LeftOver { side: self.side, share });
        }
        if self.posterior.starts.iter().all(|start| !start.converged) {
            found.push(PaperDiagnostic::NotConverged);
        }
        if self.relative_noise > UNEXPLAINED {
            found.push(PaperDiagnostic::LargeResidual(self.relative_noise));
        }
        found
    }
}

/// Computes the rows for the inference.
fn project(
    model: &Model,
    observations: &Observations,
    settings: &PaperSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<(Projected, Option<ProjectionLoss>), PaperError> {
    let (points, tables) = (observations.points_with_visibility(), &model.reflectance.functions);
    let plan = PlanSettings::of_side(settings.side);
    // With few observations, a plan would have more rows than there are values.
    if settings.all_observations || observations.report.used <= plan.rank {
        return Ok((Projected::unprojected(points, &observations.values, tables, &model.light, &plan.transfer)?, None));
    }
    let plan = Plan::build(points, tables, &model.light, &plan, progress)?;
    let projected = plan.project(&observations.values, SLACK)?;
    let loss = ProjectionLoss { of_prior: plan.left_out(), of_image: projected.left_over() };
    Ok((projected, Some(loss)))
}

fn posterior(
    model: &Model,
    projected: &Projected,
    known_light: bool,
    settings: &PaperSettings,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Posterior, ProblemError> {
    let rates = &model.reflectance.rates;
    let PaperSettings { method, solver, starts, seed, as_printed, .. } = *settings;
    let (hyper, variational) = if as_printed {
        (Hyperparameters::default(), VariationalSettings::of_paper(starts, seed))
    } else {
        let settings = VariationalSettings { solver, starts, seed, ..VariationalSettings::default() };
        (Hyperparameters::with_model_error(projected.pixels), settings)
    };
    let (problem, method) = if known_light {
        let settings = VariationalSettings { solver: Solver::Blocks, ..variational };
        (Problem::with_known_light(projected, rates, hyper)?, Method::Variational(settings))
    } else {
        let method = match method {
            PaperMethod::Variational => Method::Variational(variational),
            PaperMethod::JointMap => Method::JointMap(JointMapSettings { starts, seed, ..JointMapSettings::default() }),
        };
        (Problem::blind(projected, &model.light, rates, hyper)?, method)
    };
    let known = model.reflectance.materials.iter().map(|m| m.coefficients.clone()).collect();
    let problem = if as_printed { problem } else { problem.starting_from(known) };
    Ok(infer(&problem, &method, progress))
}
