//! Runs a method of the paper, and converts its estimate to sections of the result.

use gonio::inference::MODEL_ERROR;
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::scene::Observations;
use gonio_io::result::{Cost, Exposure, Light, Reflectance, Residual, ResultDocument, SettingsSection, Transfer};
use gonio_paper::{PaperEstimate, PaperMethod, PaperSettings, PaperStage, estimate};

use crate::{AppError, ProgressLog, Settings, Warning, document};

/// Result of a method of the paper.
pub(crate) struct PaperResult {
    /// Reflectance, of albedo [`ALBEDO`](gonio::estimate::ALBEDO).
    pub(crate) table: BivariateTable,
    /// The light on the scale of `table`, for a blind method.
    pub(crate) light: Option<LightGrid>,
    /// Noise relative to the root mean square of the image.
    pub(crate) noise: f64,
    /// Sections of the result.
    pub(crate) document: ResultDocument,
}

/// Runs a method of the paper on the observations of `image`.
pub(crate) fn infer(
    (model, image): (&Model, &str),
    (settings, paper): (&Settings<'_>, &PaperSettings),
    known: Option<&EnvironmentMap>,
    observations: &Observations,
    warnings: &mut Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<PaperResult, AppError> {
    let report = |stage: PaperStage, x: f64| {
        let name = match stage {
            PaperStage::Plan => "plan",
            PaperStage::Inference => "inference",
        };
        progress_log.report(name, x);
    };
    let found = estimate(model, observations, known, paper, &report).map_err(|error| AppError::of(image, error))?;
    warnings.extend(found.diagnostics().iter().map(|diagnostic| Warning::of(image, diagnostic)));
    let document = ResultDocument {
        settings: SettingsSection {
            grid: Some(paper.side),
            seed: Some(paper.seed),
            starts: Some(paper.starts),
            solver: Some(format!("{:?}", paper.solver)),
            paper: Some(paper.as_printed),
            model_error: (!paper.as_printed).then_some(MODEL_ERROR),
            all_observations: Some(paper.all_observations),
            ..SettingsSection::default()
        },
        transfer: Some(Transfer {
            light: settings.method.light().map(|light| light.name("the light")),
            rank: known.is_none().then_some(found.rows),
            truncated_prior_energy: found.projection.map(|loss| loss.of_prior),
            unexplained_energy: found.projection.map(|loss| loss.of_image),
        }),
        ..document_of(&found, paper, settings.method.name())
    };
    let PaperEstimate { table, light, relative_noise: noise, .. } = found;
    Ok(PaperResult { table, light, noise, document })
}

/// Returns the sections of the posterior.
fn document_of(found: &PaperEstimate, paper: &PaperSettings, method: &str) -> ResultDocument {
    let posterior = &found.posterior;
    let joint_map = paper.method == PaperMethod::JointMap;
    ResultDocument {
        reflectance: Reflectance {
            coefficients: posterior.reflectance.clone(),
            sd: posterior.reflectance_sd.clone(),
            scale: Some(found.scale),
            ..document::reflectance(None)
        },
        light: Some(Light {
            coefficients: posterior.light.clone(),
            sd: posterior.light_sd.clone(),
            ..Light::default()
        }),
        exposure: Some(Exposure {
            mean: Some(posterior.exposure),
            sd: Some(posterior.exposure_sd),
            ..Exposure::default()
        }),
        residual: Some(Residual {
            noise_sd: Some(posterior.noise),
            relative_noise: Some(found.relative_noise),
            ..Residual::default()
        }),
        cost: Some(Cost {
            name: if joint_map { "minus log posterior" } else { "C_KL" }.to_owned(),
            trace: posterior.trace.clone(),
            starts: posterior.starts.iter().map(Into::into).collect(),
            best_start: posterior.best_start,
        }),
        ..document::new(method)
    }
}
