//! The method `marginal`: the posterior of the material with the light integrated out, then the light given its mean.

use std::sync::Mutex;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use gonio::estimate::{Colouring, Estimate, EstimateSettings, Stage, estimate};
use gonio::model::Model;
use gonio::scene::Observations;

use super::{Answer, Options};

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
    settings: &EstimateSettings,
    warnings: &mut Vec<String>,
) -> Result<(Answer, Colouring)> {
    let clock = Mutex::new(Vec::new());
    let begin = |stage: Stage| {
        if let Ok(mut clock) = clock.lock() {
            clock.push((stage, Instant::now()));
        }
    };
    let found = estimate(model, observations, settings, &begin).with_context(|| options.image.display().to_string())?;
    let end = Instant::now();
    let clock = clock.into_inner().unwrap_or_default();
    let ends = clock.iter().skip(1).map(|(_, begin)| *begin).chain([end]);
    let seconds = clock.iter().zip(ends).map(|((stage, begin), end)| (name_of(*stage), (end - *begin).as_secs_f64()));
    let mut sections = gonio_report::notes::estimate(&found);
    sections["settings"] = gonio_report::notes::settings(settings, options.reading.linear);
    let Estimate { material, light, colouring } = found;
    warnings.extend(material.doubts().iter().map(ToString::to_string));
    let answer = Answer {
        table: material.table.clone(),
        caption: format!("misfit {:.1} %", 100.0 * light.misfit),
        light: Some(light.grid),
        sections,
        seconds: seconds.collect(),
        material: Some(material),
    };
    Ok((answer, colouring))
}

/// The name of a stage among the seconds of result.json.
fn name_of(stage: Stage) -> &'static str {
    match stage {
        Stage::Material => "posterior",
        Stage::Transfer => "transfer",
        Stage::Light => "light",
        Stage::Colours => "colour",
    }
}
