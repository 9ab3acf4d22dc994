//! Methods that find the coefficients of reflectance in a basis: the paper's and those to compare
//! with.

use anyhow::{Context, Result, bail};
use gonio::estimate::ALBEDO;
use gonio::inference::{
    Hyper, JointMapSettings, MODEL_ERROR, Method, Posterior, Problem, Solver, VariationalSettings,
    infer as find_posterior,
};
use gonio::lighting::{EnvironmentMap, LightGrid};
use gonio::model::Model;
use gonio::render::{IntegratorSettings, LightTree, images_of_basis};
use gonio::scene::Observations;
use gonio::transfer::{PlanSettings, Projected};
use gonio_io::cache::Cache;
use gonio_io::plan::{PlanOrigin, load_or_build};
use serde_json::json;

use super::{Answer, MethodName, Options, SolverName};
use crate::progress::Stage;

/// The answer of the methods `variational`, `map` and `known-light`.
pub(super) fn answer(
    options: &Options,
    model: &Model,
    known: Option<&EnvironmentMap>,
    observations: &Observations,
    warnings: &mut Vec<String>,
) -> Result<Answer> {
    let (projected, plan_notes, plan_seconds) = project(options, model, known, observations, warnings)?;
    let (posterior, infer_seconds) = posterior(options, model, &projected)?;
    let table = model.reflectance.combine(&posterior.reflectance)?;
    if table.trusted_max() <= 0.0 {
        bail!("{}: every reflectance coefficient came out zero; is the object lit at all?", options.image.display());
    }
    if posterior.starts.iter().all(|s| !s.converged) {
        warnings.push("no start converged within its iterations; the result may be rough".into());
    }
    let (table, scale) = table.with_normal_albedo(ALBEDO);
    let light = (options.method() != MethodName::KnownLight).then(|| {
        let radiance: Vec<f64> = posterior.light.iter().map(|l| l * posterior.exposure / scale).collect();
        LightGrid::from_coefficients(model.light.map, &radiance)
    });
    let relative = posterior.noise / (projected.energy() / projected.pixels as f64).sqrt();
    let sections = json!({
        "settings": {
            "seed": options.seed, "starts": options.starts, "grid": options.grid,
            "solver": format!("{:?}", options.solver), "paper": options.paper,
            "model_error": (!options.paper).then_some(MODEL_ERROR),
            "full_rows": options.full_rows, "linear": options.reading.linear,
        },
        "transfer": plan_notes,
        "reflectance": {
            "coefficients": posterior.reflectance,
            "sd": posterior.reflectance_sd,
            "scale": scale,
            "note": "BRDF = scale * sum_k coefficients[k] * basis[k], in 1/sr with a normal albedo of 0.5; the scale of \
                     reflectance is not determined by a photograph under unknown light",
        },
        "light": { "coefficients": posterior.light, "sd": posterior.light_sd },
        "exposure": { "mean": posterior.exposure, "sd": posterior.exposure_sd },
        "noise": { "sd": posterior.noise, "relative": relative },
        "cost": {
            "name": if options.method() == MethodName::Map { "minus log posterior" } else { "C_KL" },
            "trace": posterior.trace, "starts": posterior.starts, "best_start": posterior.best_start,
        },
    });
    let seconds = vec![("plan", plan_seconds), ("inference", infer_seconds)];
    let caption = format!("noise {:.1} %", 100.0 * relative);
    Ok(Answer { table, light, caption, sections, seconds, material: None })
}

/// The rows on which the inference runs.
fn project(
    options: &Options,
    model: &Model,
    known: Option<&EnvironmentMap>,
    observations: &Observations,
    warnings: &mut Vec<String>,
) -> Result<(Projected, serde_json::Value, f64)> {
    let tables = &model.reflectance.functions;
    if let (Some(path), Some(light)) = (&options.light, known) {
        let stage = Stage::new("rendering the basis");
        let tree = LightTree::of_map(light);
        let rows =
            images_of_basis(observations.seen(), tables, &tree, &IntegratorSettings::default(), &|x| stage.at(x));
        let projected = Projected::under_known_light(&rows, tables.len(), &observations.values);
        return Ok((projected, json!({ "light": path.display().to_string() }), stage.finish()));
    }
    let settings = PlanSettings { side: options.grid, ..PlanSettings::default() };
    // Few observations: nothing to gain from a plan, which has more directions than there are
    // values.
    if options.full_rows || observations.report.used <= settings.rank {
        let stage = Stage::new("integrating the basis");
        let projected =
            Projected::unprojected(observations.seen(), &observations.values, tables, &model.light, &settings)?;
        return Ok((projected, json!({ "rows": observations.report.used, "full_rows": true }), stage.finish()));
    }
    let stage = Stage::new("planning (kept for next time)");
    let cache = Cache::user();
    let (plan, origin, failed) =
        load_or_build(cache.as_ref(), observations.seen(), tables, &model.light, &settings, &|x| stage.at(x))?;
    if let Some(error) = failed {
        warnings.push(format!("the plan could not be kept for next time: {error}"));
    }
    let projected = plan.project(&observations.values, 1e-5)?;
    let seconds = stage.finish();
    let left_over = projected.left_over();
    if left_over > 0.02 {
        warnings.push(format!(
            "{:.0} % of the picture's energy is finer than a {} x {} light can make with any of these materials: a sharp \
             material is likely to come out too dull",
            100.0 * left_over,
            options.grid,
            options.grid
        ));
    }
    let notes = json!({
        "plan": if matches!(origin, PlanOrigin::Cache) { "cache" } else { "built" },
        "rank": projected.bilinear.rows(),
        "left_out_a_priori": plan.left_out(),
        "left_over_of_the_image": left_over,
    });
    Ok((projected, notes, seconds))
}

fn posterior(options: &Options, model: &Model, projected: &Projected) -> Result<(Posterior, f64)> {
    let rates = &model.reflectance.rates;
    let (starts, seed) = (options.starts as usize, options.seed);
    let solver = match options.solver {
        SolverName::Blocks => Solver::Blocks,
        SolverName::Parallel => Solver::Parallel,
        SolverName::Printed => Solver::Printed,
    };
    let (hyper, variational) = if options.paper {
        (Hyper::default(), VariationalSettings::of_paper(starts, seed))
    } else {
        let settings = VariationalSettings { solver, starts, seed, ..VariationalSettings::default() };
        (Hyper::with_model_error(projected.pixels), settings)
    };
    let (problem, method) = match options.method() {
        MethodName::Learnt => unreachable!("a method without coefficients"),
        MethodName::KnownLight => {
            let settings = VariationalSettings { solver: Solver::Blocks, ..variational };
            (Problem::with_known_light(projected, rates, hyper), Method::KnownLight(settings))
        }
        MethodName::Variational => {
            (Problem::blind(projected, &model.light, rates, hyper), Method::Variational(variational))
        }
        MethodName::Map => {
            let settings =
                JointMapSettings { starts: options.starts as usize, seed: options.seed, ..JointMapSettings::default() };
            (Problem::blind(projected, &model.light, rates, hyper), Method::JointMap(settings))
        }
    };
    let problem = problem.with_context(|| options.image.display().to_string())?;
    let known = model.reflectance.materials.iter().map(|m| m.coefficients.clone()).collect();
    let problem = if options.paper { problem } else { problem.starting_from(known) };
    let stage = Stage::new("inferring");
    let posterior = find_posterior(&problem, &method, &|x| stage.at(x));
    Ok((posterior, stage.finish()))
}
