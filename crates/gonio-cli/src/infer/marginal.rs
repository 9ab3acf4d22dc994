//! The method `marginal`: the posterior of the material with the light integrated out, then the light given its mean.

use std::time::Instant;

use anyhow::{Context, Result, bail};
use gonio::appearance::{Lattice, Statistics};
use gonio::inference::amortised::{
    Amortised, MaterialPosterior, Neighbour, UnshadowSettings, peak_over_base, unshadow,
};
use gonio::inference::marginal::{LightProblem, NonNegativeSettings, cut_off_at_zero};
use gonio::lighting::LightGrid;
use gonio::model::Model;
use gonio::reflectance::{BivariateTable, CELLS, THETA_D, is_trusted};
use gonio::scene::Observations;
use gonio::transfer::PlanSettings;
use serde_json::{Value, json};

use super::{Answer, Options, Outlook, with_albedo};
use crate::progress::Stage;

/// Observations from which the light is found, about: a mirror sees each texel of 32 x 32 in one or two of them. With fewer than there are texels
/// those between the observations are left to the prior, and show as a checkerboard.
const ROWS: usize = 1600;

/// The largest grid on which the light is kept from negative texels by its posterior, which takes a minute there; on finer ones, whose
/// dense matrices would not fit, the mean is cut off at zero.
const LARGEST: usize = 64;

/// Materials named in the result: at most so many, of at least this weight.
const NAMED: (usize, f64) = (10, 0.005);

/// Whether the model can serve the method.
pub(super) fn check(options: &Options, model: &Model) -> Result<()> {
    if model.posterior.is_none() {
        let name = options.model.as_ref().map_or("the embedded model".into(), |path| path.display().to_string());
        bail!(
            "{name}: has no posterior of materials, which --method marginal needs; learn one with `gonio train posterior` and \
             join it with `gonio train model --posterior`, or choose another --method"
        );
    }
    Ok(())
}

/// The answer of the method.
pub(super) fn answer(
    options: &Options,
    model: &Model,
    observations: &Observations,
    warnings: &mut Vec<String>,
) -> Result<Answer> {
    let amortised = model.posterior.as_ref().context("a model without a posterior of materials")?;
    let started = Instant::now();
    let lattice = Lattice::new();
    let measures = Statistics::new(&lattice);
    let plan = PlanSettings { side: options.grid, ..PlanSettings::default() };
    let unshadowed =
        unshadow(observations, (&lattice, &measures), amortised, &model.light, &plan, &UnshadowSettings::default())
            .with_context(|| options.image.display().to_string())?;
    let gathered = unshadowed.gathered;
    let statistics = measures.of(&gathered.values);
    let posterior = amortised.posterior(&statistics);
    let strangeness = amortised.strangeness(&statistics);
    let (table, scale) = with_albedo(&posterior.mean);
    let posterior_seconds = started.elapsed().as_secs_f64();
    // The factorisations of the light leave a core idle half of the time.
    let (material, light) = rayon::join(
        || describe(amortised, &posterior, scale),
        || find_light(options, model, observations, &posterior.mean),
    );
    let light = light?;
    let filled = gathered.filled as f64 / lattice.normals().len() as f64;
    warnings.extend(doubts(filled, strangeness, material.open));
    let radiance: Vec<f64> = light.coefficients.iter().map(|l| l / scale).collect();
    let share = |n: &Neighbour| json!({ "name": n.name, "weight": n.weight });
    let sections = json!({
        "settings": { "grid": options.grid, "linear": options.reading.linear, "rows": ROWS, "steps": LightProblem::STEPS },
        "posterior": {
            "materials": material.outlook.materials.iter().map(share).collect::<Vec<_>>(),
            "undetermined": material.open,
            "strangeness": strangeness,
            "normals": lattice.normals().len(),
            "filled": gathered.filled,
            "unshadowed": unshadowed.change,
            "gloss": {
                "5": material.gloss[0], "50": material.gloss[1], "95": material.gloss[2],
                "note": "the BRDF along the normal over its mean at half angles beyond 45 degrees: its quantiles at 5, 50 and 95 %",
            },
            "note": "undetermined: share of the domain (both angles below 80 degrees) where the 90 % interval is most of \
                     what it is without a photograph; strangeness: share of the picture's statistics outside of what was \
                     seen in training; filled: normals of the lattice without an observation near; unshadowed: mean absolute logarithm of the ratio by which \
                     values were changed to those of a sphere, for shapes that keep light from themselves",
        },
        "reflectance": {
            "quantiles": "brdf_quantiles.npy",
            "note": "brdf.binary is the mean of the posterior, in 1/sr with a normal albedo of 0.5; brdf_quantiles.npy holds \
                     its 5, 25, 75 and 95 % quantiles, [quantile][theta_h][theta_d]; the scale of reflectance is not \
                     determined by a photograph under unknown light",
        },
        "light": light.notes,
        "noise": { "sd": light.noise, "relative": light.relative_noise, "misfit": light.misfit },
    });
    Ok(Answer {
        table,
        light: Some(LightGrid::from_coefficients(model.light.map, &radiance)),
        caption: format!("misfit {:.1} %", 100.0 * light.misfit),
        sections,
        seconds: vec![("posterior", posterior_seconds), ("transfer", light.transfer_seconds), ("light", light.seconds)],
        outlook: Some(material.outlook),
    })
}

/// What is said of the material.
struct Material {
    outlook: Outlook,
    /// Share of the trusted domain that is undetermined.
    open: f64,
    /// 5, 50 and 95 % quantiles of the gloss.
    gloss: Vec<f64>,
}

fn describe(amortised: &Amortised, posterior: &MaterialPosterior, scale: f64) -> Material {
    let dictionary = &amortised.dictionary;
    let quantiles: Vec<Vec<f32>> = posterior
        .quantiles(dictionary, &[0.05, 0.25, 0.75, 0.95])
        .into_iter()
        .map(|values| values.into_iter().map(|v| (f64::from(v) * scale) as f32).collect())
        .collect();
    let undetermined = posterior.undetermined(dictionary);
    let trusted: Vec<usize> = (0..CELLS).filter(|c| is_trusted(c / THETA_D, c % THETA_D)).collect();
    let open = trusted.iter().filter(|&&c| undetermined[c]).count() as f64 / trusted.len() as f64;
    let (most, least) = NAMED;
    let materials = posterior.neighbours.iter().take(most).filter(|n| n.weight >= least).cloned().collect();
    let ranking = posterior.ranking(dictionary, peak_over_base);
    let end = |share: f64| with_albedo(&dictionary.table(&dictionary.entries[ranking.entry(share)])).0;
    let ends = [("its dull end, at 5 %", end(0.05)), ("its glossy end, at 95 %", end(0.95))];
    Material {
        outlook: Outlook { quantiles, undetermined, materials, ends },
        open,
        gloss: ranking.quantiles(&[0.05, 0.5, 0.95]),
    }
}

/// What to warn of.
fn doubts(filled: f64, strangeness: f64, open: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    if filled > 0.2 {
        doubts.push(format!(
            "{:.0} % of the normals of a sphere are not seen on the object and were filled in from others: the answer is \
             less certain than it says",
            100.0 * filled
        ));
    }
    if strangeness > 0.05 {
        doubts.push(format!(
            "the photograph is unlike those the posterior was learnt from: {:.0} % of its statistics are out of their range; \
             the answer may be far off",
            100.0 * strangeness
        ));
    }
    if open > 0.5 {
        doubts.push(format!(
            "the photograph leaves {:.0} % of the BRDF's domain undetermined (hatched in uncertainty.png)",
            100.0 * open
        ));
    }
    doubts
}

/// A light and how well it explains the picture.
struct Light {
    /// On the scale of the image, for the table it was found with.
    coefficients: Vec<f64>,
    noise: f64,
    relative_noise: f64,
    /// Root mean square of what light and table leave of the picture, relative to the picture's.
    misfit: f64,
    notes: Value,
    transfer_seconds: f64,
    seconds: f64,
}

/// The mean of the light without negative texels given the BRDF: of the ways compared by `gonio-eval lights` the nearest to the true one.
fn find_light(options: &Options, model: &Model, observations: &Observations, table: &BivariateTable) -> Result<Light> {
    let stage = Stage::new("integrating the BRDF");
    let settings = PlanSettings { side: options.grid, ..PlanSettings::default() };
    let problem = LightProblem::of_observations(&observations.thinned(ROWS), table, &model.light, &settings)
        .with_context(|| options.image.display().to_string())?;
    let transfer_seconds = stage.finish();
    let stage = Stage::new("estimating the light");

    let evidence = problem.posterior()?;
    let (light, sd, exposure, how) = if options.grid <= LARGEST {
        let found = problem.non_negative(&evidence, &NonNegativeSettings::default())?;
        let how =
            json!({ "estimator": "mean without negative texels", "steps": found.steps, "settled": found.converged });
        (found.light, found.light_sd, found.exposure, how)
    } else {
        let how = json!({ "estimator": "mean cut off at zero" });
        (cut_off_at_zero(&evidence.light), evidence.light_sd.clone(), evidence.exposure, how)
    };
    let coefficients: Vec<f64> = light.iter().map(|l| l * exposure).collect();
    let notes = json!({
        "coefficients": light,
        "sd": sd,
        "exposure": exposure,
        "non_negative": how,
        "rows": problem.rows(),
        "evidence": {
            "objective": evidence.objective, "effective": evidence.effective, "converged": evidence.converged,
            "trace": evidence.trace,
        },
        "note": "given the mean of the posterior of reflectance: the mean of the posterior of the light among those without \
                 negative texels",
    });
    Ok(Light {
        misfit: problem.misfit(&coefficients),
        coefficients,
        noise: evidence.noise,
        relative_noise: evidence.noise / problem.rms(),
        notes,
        transfer_seconds,
        seconds: stage.finish(),
    })
}
