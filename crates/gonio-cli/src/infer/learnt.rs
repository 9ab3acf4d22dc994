//! The method `learnt`: the posterior of the material with the light integrated out, then the
//! light given its mean.

use anyhow::{Context, Result, bail};
use gonio::estimate::{Colouring, Estimate, EstimateSettings, estimate};
use gonio::model::Model;
use gonio::scene::Observations;
use gonio_report::clock::StageClock;

use super::{Answer, Options};

/// Whether the model can serve the method.
pub(super) fn check(options: &Options, model: &Model) -> Result<()> {
    if model.learnt.is_none() {
        let name = options.model.as_ref().map_or("the embedded model".into(), |path| path.display().to_string());
        bail!(
            "{name}: has no posterior of materials, which --method learnt needs; learn one with `gonio train posterior` and \
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
    let clock = StageClock::default();
    let begin = |stage| {
        clock.begin(stage);
    };
    let found = estimate(model, observations, settings, &begin).with_context(|| options.image.display().to_string())?;
    let seconds = clock.finish();
    let mut sections = gonio_report::notes::estimate(&found);
    sections["settings"] = gonio_report::notes::settings(settings, options.reading.linear);
    warnings.extend(found.doubts().iter().map(ToString::to_string));
    let Estimate { material, light, colouring } = found;
    let answer = Answer {
        table: material.table.clone(),
        caption: format!("misfit {:.1} %", 100.0 * light.misfit),
        light: Some(light.grid),
        sections,
        seconds,
        material: Some(material),
    };
    Ok((answer, colouring))
}
