//! The paper's methods and baselines: reflectance as coefficients in a basis.

use gonio::estimate::ALBEDO;
use gonio::inference::{Hyper, JointMapSettings, MODEL_ERROR, Posterior, Problem as Bilinear, VariationalSettings};
use gonio::inference::{Method as Finder, Solver, infer};
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::render::{IntegratorSettings, LightTree, images_of_basis};
use gonio::scene::Observations;
use gonio::transfer::{PlanSettings, Projected};
use gonio_io::cache::Cache;
use serde_json::{Value, json};

use crate::plan::{PlanOrigin, load_or_build};
use crate::{Method, Problem, ProgressLog, Search, Settings, Warning};

/// Relative noise above which a result is unreliable: that of converged solutions is less than half
/// of it.
const UNEXPLAINED: f64 = 0.5;

/// Result of a method of the paper.
pub(crate) struct Coefficients {
    /// Reflectance, of albedo [`ALBEDO`].
    pub(crate) table: BivariateTable,
    /// The light on the scale of `table`, for a blind method.
    pub(crate) light: Option<LightGrid>,
    /// Noise relative to the root mean square of the image.
    pub(crate) noise: f64,
    /// Sections of the result.
    pub(crate) sections: Value,
}

/// Runs a method of the paper on the observations of `image`. Reports the stages `plan` and
/// `inference`.
pub(crate) fn find(
    (model, image): (&Model, &str),
    (settings, search): (&Settings<'_>, &Search),
    known: Option<&EnvironmentMap>,
    observations: &Observations,
    warnings: &mut Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<Coefficients, Problem> {
    let blame = |error: &dyn std::error::Error| Problem::of(image, error);
    progress_log.at("plan", 0.0);
    let (projected, transfer) = match known {
        Some(light) => {
            let (tables, integrator) = (&model.reflectance.functions, IntegratorSettings::default());
            let report = |x| progress_log.at("plan", x);
            let rows = images_of_basis(observations.seen(), tables, &LightTree::of_map(light), &integrator, &report);
            let projected = Projected::under_known_light(&rows, tables.len(), &observations.values);
            (projected, json!({ "light": settings.method.light().map(|light| light.name("the light")) }))
        }
        None => project(model, settings.side, search.full_rows, observations, warnings, progress_log)
            .map_err(|error| blame(&*error))?,
    };
    progress_log.at("inference", 0.0);
    let posterior = posterior(model, settings, search, &projected, progress_log).map_err(|error| blame(&error))?;
    let table = model.reflectance.combine(&posterior.reflectance).map_err(|error| blame(&error))?;
    if table.trusted_max() <= 0.0 {
        return Err(Problem::of(image, "all reflectance coefficients are zero; check that the object is lit"));
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
    let sections = json!({
        "settings": {
            "seed": search.seed, "starts": search.starts, "grid": settings.side,
            "solver": format!("{:?}", search.solver), "paper": search.paper,
            "model_error": (!search.paper).then_some(MODEL_ERROR),
            "full_rows": search.full_rows,
        },
        "transfer": transfer,
        "reflectance": {
            "coefficients": posterior.reflectance,
            "sd": posterior.reflectance_sd,
            "scale": scale,
            "note": "BRDF = scale * sum_k coefficients[k] * basis[k], in 1/sr with an albedo of 0.5 at normal incidence; a \
                     photograph under unknown light does not determine the scale of reflectance",
        },
        "light": { "coefficients": posterior.light, "sd": posterior.light_sd },
        "exposure": { "mean": posterior.exposure, "sd": posterior.exposure_sd },
        "noise": { "sd": posterior.noise, "relative": noise },
        "cost": {
            "name": if matches!(settings.method, Method::JointMap(_)) { "minus log posterior" } else { "C_KL" },
            "trace": posterior.trace, "starts": posterior.starts, "best_start": posterior.best_start,
        },
    });
    Ok(Coefficients { table, light, noise, sections })
}

/// Computes the rows for the inference, and the section `transfer` of the result.
fn project(
    model: &Model,
    side: usize,
    full_rows: bool,
    observations: &Observations,
    warnings: &mut Vec<Warning>,
    progress_log: &ProgressLog<'_>,
) -> Result<(Projected, Value), Box<dyn std::error::Error>> {
    let tables = &model.reflectance.functions;
    let settings = PlanSettings { side, ..PlanSettings::default() };
    // With few observations, a plan would have more rows than there are values.
    if full_rows || observations.report.used <= settings.rank {
        let projected =
            Projected::unprojected(observations.seen(), &observations.values, tables, &model.light, &settings)?;
        return Ok((projected, json!({ "rows": observations.report.used, "full_rows": true })));
    }
    let cache = Cache::user();
    let report = |x| progress_log.at("plan", x);
    let (plan, origin, failed) =
        load_or_build(cache.as_ref(), observations.seen(), tables, &model.light, &settings, &report)?;
    if let Some(error) = failed {
        warnings.push(format!("the light transport plan was not cached: {error}").into());
    }
    let projected = plan.project(&observations.values, 1e-5)?;
    let left_over = projected.left_over();
    if left_over > 0.02 {
        warnings.push(
            format!(
                "a light of {side} x {side} texels cannot reproduce {:.0} % of the image's energy with any basis \
                 material; the roughness of a sharp material is probably overestimated",
                100.0 * left_over
            )
            .into(),
        );
    }
    let notes = json!({
        "plan": if matches!(origin, PlanOrigin::Cache) { "cache" } else { "built" },
        "rank": projected.bilinear.rows(),
        "left_out_a_priori": plan.left_out(),
        "left_over_of_the_image": left_over,
    });
    Ok((projected, notes))
}

fn posterior(
    model: &Model,
    settings: &Settings<'_>,
    search: &Search,
    projected: &Projected,
    progress_log: &ProgressLog<'_>,
) -> Result<Posterior, gonio::inference::ProblemError> {
    let rates = &model.reflectance.rates;
    let Search { solver, starts, seed, paper, .. } = *search;
    let (hyper, variational) = if paper {
        (Hyper::default(), VariationalSettings::of_paper(starts, seed))
    } else {
        let settings = VariationalSettings { solver, starts, seed, ..VariationalSettings::default() };
        (Hyper::with_model_error(projected.pixels), settings)
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
    Ok(infer(&problem, &finder, &|x| progress_log.at("inference", x)))
}
