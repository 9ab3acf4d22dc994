//! The paper's methods and baselines: reflectance as coefficients in a basis.

use gonio::estimate::ALBEDO;
use gonio::inference::{
    Hyperparameters, JointMapSettings, MODEL_ERROR, Posterior, Problem as Bilinear, VariationalSettings,
};
use gonio::inference::{Method as Finder, Solver, infer};
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::render::{IntegratorSettings, LightTree, images_of_basis};
use gonio::scene::Observations;
use gonio::transfer::{PlanSettings, Projected};
use gonio_io::cache::Cache;
use gonio_io::result::{Cost, Exposure, Light, Reflectance, Residual, ResultDocument, SettingsSection, Transfer};

use crate::plan::{PlanOrigin, load_or_build};
use crate::{AppError, BasisSettings, Method, ProgressLog, Settings, Warning, document};

/// Relative noise above which a result is unreliable: that of converged solutions is less than half
/// of it.
const UNEXPLAINED: f64 = 0.5;

/// Result of a method of the paper.
pub(crate) struct BasisResult {
    /// Reflectance, of albedo [`ALBEDO`].
    pub(crate) table: BivariateTable,
    /// The light on the scale of `table`, for a blind method.
    pub(crate) light: Option<LightGrid>,
    /// Noise relative to the root mean square of the image.
    pub(crate) noise: f64,
    /// Sections of the result.
    pub(crate) document: ResultDocument,
}

/// Runs a method of the paper on the observations of `image`. Reports the stages `plan` and
/// `inference`.
pub(crate) fn find(
    (model, image): (&Model, &str),
    (settings, search): (&Settings<'_>, &BasisSettings),
    known: Option<&EnvironmentMap>,
    observations: &Observations,
    warnings: &mut Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<BasisResult, AppError> {
    let blame = |error: &dyn std::error::Error| AppError::of(image, error);
    progress_log.report("plan", 0.0);
    let (projected, transfer) = match known {
        Some(light) => {
            let (tables, integrator) = (&model.reflectance.functions, IntegratorSettings::default());
            let report = |x| progress_log.report("plan", x);
            let rows = images_of_basis(
                observations.points_with_visibility(),
                tables,
                &LightTree::of_map(light),
                &integrator,
                &report,
            );
            let projected = Projected::under_known_light(&rows, tables.len(), &observations.values);
            let light = settings.method.light().map(|light| light.name("the light"));
            (projected, Transfer { light, ..Transfer::default() })
        }
        None => project(model, settings.side, search.full_rows, observations, warnings, progress_log)
            .map_err(|error| blame(&*error))?,
    };
    progress_log.report("inference", 0.0);
    let posterior = posterior(model, settings, search, &projected, progress_log).map_err(|error| blame(&error))?;
    let table = model.reflectance.combine(&posterior.reflectance).map_err(|error| blame(&error))?;
    if table.trusted_max() <= 0.0 {
        return Err(AppError::of(image, "all reflectance coefficients are zero; check that the object is lit"));
    }
    if posterior.starts.iter().all(|s| !s.converged) {
        warnings.push(Warning::of(image, "no start of the solver converged; the result may be inaccurate"));
    }
    let noise = posterior.noise / (projected.energy() / projected.pixels as f64).sqrt();
    if noise > UNEXPLAINED {
        let text = format!(
            "the solver did not converge: the relative RMS residual of the photograph is {:.0} %; the result is unreliable",
            100.0 * noise
        );
        warnings.push(Warning::of(image, text));
    }
    let (table, scale) = table.with_normal_albedo(ALBEDO);
    let light = known.is_none().then(|| {
        let radiance: Vec<f64> = posterior.light.iter().map(|l| l * posterior.exposure / scale).collect();
        LightGrid::from_coefficients(model.light.map, &radiance)
    });
    let joint_map = matches!(settings.method, Method::JointMap(_));
    let document = ResultDocument {
        settings: SettingsSection {
            grid: Some(settings.side),
            seed: Some(search.seed),
            starts: Some(search.starts),
            solver: Some(format!("{:?}", search.solver)),
            paper: Some(search.paper),
            model_error: (!search.paper).then_some(MODEL_ERROR),
            full_rows: Some(search.full_rows),
            ..SettingsSection::default()
        },
        transfer: Some(transfer),
        reflectance: Reflectance {
            normal_albedo: ALBEDO,
            coefficients: posterior.reflectance.clone(),
            sd: posterior.reflectance_sd.clone(),
            scale: Some(scale),
            ..Reflectance::default()
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
            relative_noise: Some(noise),
            ..Residual::default()
        }),
        cost: Some(Cost {
            name: if joint_map { "minus log posterior" } else { "C_KL" }.to_owned(),
            trace: posterior.trace.clone(),
            starts: posterior.starts.iter().map(Into::into).collect(),
            best_start: posterior.best_start,
        }),
        ..document::new(settings.method.name())
    };
    Ok(BasisResult { table, light, noise, document })
}

/// Computes the rows for the inference, and the section `transfer` of the result.
fn project(
    model: &Model,
    side: usize,
    full_rows: bool,
    observations: &Observations,
    warnings: &mut Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<(Projected, Transfer), Box<dyn std::error::Error>> {
    let tables = &model.reflectance.functions;
    let settings = PlanSettings { side, ..PlanSettings::default() };
    // With few observations, a plan would have more rows than there are values.
    if full_rows || observations.report.used <= settings.rank {
        let projected = Projected::unprojected(
            observations.points_with_visibility(),
            &observations.values,
            tables,
            &model.light,
            &settings,
        )?;
        return Ok((projected, Transfer { rank: Some(observations.report.used), ..Transfer::default() }));
    }
    let cache = Cache::user();
    let report = |x| progress_log.report("plan", x);
    let (plan, origin, failed) =
        load_or_build(cache.as_ref(), observations.points_with_visibility(), tables, &model.light, &settings, &report)?;
    if let Some(error) = failed {
        warnings.push(format!("the light transport plan was not cached: {error}").into());
    }
    let projected = plan.project(&observations.values, 1e-5)?;
    let left_over = projected.left_over();
    if left_over > 0.02 {
        warnings.push(
            format!(
                "the basis functions in a light of {side} x {side} texels cannot reproduce {:.0} % of the image's energy; \
                 the roughness of a sharp material is probably overestimated",
                100.0 * left_over
            )
            .into(),
        );
    }
    let transfer = Transfer {
        light: None,
        plan: Some(if matches!(origin, PlanOrigin::Cache) { "cache" } else { "built" }.to_owned()),
        rank: Some(projected.bilinear.rows()),
        truncated_prior_energy: Some(plan.left_out()),
        unexplained_energy: Some(left_over),
    };
    Ok((projected, transfer))
}

fn posterior(
    model: &Model,
    settings: &Settings<'_>,
    search: &BasisSettings,
    projected: &Projected,
    progress_log: &ProgressLog<'_>,
) -> Result<Posterior, gonio::inference::ProblemError> {
    let rates = &model.reflectance.rates;
    let BasisSettings { solver, starts, seed, paper, .. } = *search;
    let (hyper, variational) = if paper {
        (Hyperparameters::default(), VariationalSettings::of_paper(starts, seed))
    } else {
        let settings = VariationalSettings { solver, starts, seed, ..VariationalSettings::default() };
        (Hyperparameters::with_model_error(projected.pixels), settings)
    };
    let (problem, finder) = match settings.method {
        Method::KnownLightBasis(..) => {
            let settings = VariationalSettings { solver: Solver::Blocks, ..variational };
            (Bilinear::with_known_light(projected, rates, hyper)?, Finder::KnownLight(settings))
        }
        Method::JointMap(_) => {
            let settings = JointMapSettings { starts, seed, ..JointMapSettings::default() };
            (Bilinear::blind(projected, &model.light, rates, hyper)?, Finder::JointMap(settings))
        }
        Method::Variational(_) | Method::Learnt | Method::KnownLight(_) => {
            (Bilinear::blind(projected, &model.light, rates, hyper)?, Finder::Variational(variational))
        }
    };
    let known = model.reflectance.materials.iter().map(|m| m.coefficients.clone()).collect();
    let problem = if paper { problem } else { problem.starting_from(known) };
    Ok(infer(&problem, &finder, &|x| progress_log.report("inference", x)))
}
