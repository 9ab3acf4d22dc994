//! The estimates of Figs. 4 and 5 and of the gloss order: every material under every light.

use anyhow::Result;
use gonio::picture::Picture;
use gonio::reflectance::BivariateTable;
use gonio::render::{Tinted, render_sphere};
use gonio::scene::{ObservationSettings, sphere_points};

use super::context::{LIGHTS, PaperContext};
use super::show;
use super::step;
use crate::metrics::{self, Relight};

/// Estimate of one material under one light.
pub(super) struct Estimate {
    /// The input picture, in colour.
    pub(super) input: Picture,
    /// Inferred monochrome BRDF, up to scale.
    pub(super) table: BivariateTable,
    /// The estimate rendered in the novel light, in the colour that fits the truth best.
    pub(super) predicted: Picture,
    /// Error of the prediction.
    pub(super) relight: Relight,
    /// BRDF log error.
    pub(super) brdf: f64,
    /// Share of the input's energy that no light on the grid can produce.
    pub(super) left_over: f64,
}

/// A material and its estimates.
pub(super) struct Recovered {
    /// Ground truth in the novel light.
    pub(super) truth: Picture,
    /// Estimates, one per light, in the order of [`LIGHTS`].
    pub(super) estimates: Vec<Estimate>,
}

/// Estimates every material under every light, in the order of the materials of the context.
pub(super) fn recover(context: &PaperContext) -> Result<Vec<Recovered>> {
    let points = sphere_points(&ObservationSettings::default());
    let plan = step("plan of a sphere", || context.plan(&points))?;
    let settings = show::settings(show::SPHERE, true);
    let pixels = |picture: &Picture| metrics::sphere_pixels(picture, settings.radius());
    let mut all = Vec::new();
    for material in &context.materials {
        let truth = step(&format!("Fig. 4, {}", material.name), || {
            Ok(render_sphere(&material.full, &context.novel, &settings, &|_| ()))
        })?;
        let mut estimates = Vec::new();
        for (tree, (_, light)) in context.lights.iter().zip(LIGHTS) {
            let name = format!("{} under {light}", material.name);
            let estimate = step(&format!("Fig. 4, {name}"), || {
                let projected = plan.project(&show::luminances(&points, &material.full, tree), 1e-5)?;
                let (_, table) = context.infer(&projected, &name)?;
                let grey = Tinted { table, colour: glam::DVec3::ONE };
                let predicted = render_sphere(&grey, &context.novel, &settings, &|_| ());
                Ok(Estimate {
                    input: show::sphere(&material.full, tree),
                    relight: metrics::relight(&pixels(&predicted), &pixels(&truth)),
                    predicted: show::best_coloured(&predicted, &truth),
                    brdf: metrics::brdf_error(&grey.table, &material.truth),
                    left_over: projected.left_over(),
                    table: grey.table,
                })
            })?;
            estimates.push(estimate);
        }
        all.push(Recovered { truth, estimates });
    }
    Ok(all)
}
