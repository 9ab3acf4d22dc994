//! The estimates of Figs. 4 and 5 and of the gloss order: every material under every light.

use anyhow::Result;
use gonio::picture::{Picture, Plane, luminance};
use gonio::reflectance::BivariateTable;
use gonio::render::{Brdf, IntegratorSettings, Tinted, median_colour, radiance, render_sphere};
use gonio::scene::{ObservationSettings, sphere_points};
use rayon::prelude::*;

use super::show;
use super::step;
use super::workshop::{LIGHTS, Workshop};
use crate::metrics::{self, Relight};

/// What was made of one material under one light.
pub(super) struct Estimate {
    /// The picture that was the input, in colour.
    pub(super) input: Picture,
    /// Inferred monochrome BRDF, on a scale of its own.
    pub(super) table: BivariateTable,
    /// The novel light on the estimate in the colour of the input, brought to the brightness of the
    /// truth.
    pub(super) predicted: Picture,
    /// Error of the prediction.
    pub(super) relight: Relight,
    /// BRDF log error.
    pub(super) brdf: f64,
    /// Share of the input's energy that no light of the grid can make.
    pub(super) left_over: f64,
}

/// A material and its estimates.
pub(super) struct Recovered {
    /// Ground truth in the novel light.
    pub(super) truth: Picture,
    /// One per light, in the order of [`LIGHTS`].
    pub(super) estimates: Vec<Estimate>,
}

/// In the order of the materials of the workshop.
pub(super) fn recover(workshop: &Workshop) -> Result<Vec<Recovered>> {
    let points = sphere_points(&ObservationSettings::default());
    let plan = step("plan of a sphere", || workshop.plan(&points))?;
    let settings = show::settings(show::SPHERE, true);
    let pixels = |picture: &Picture| metrics::sphere_pixels(picture, settings.radius());
    let mut all = Vec::new();
    for material in &workshop.materials {
        let envelope = material.full.envelope();
        let truth = step(&format!("Fig. 4, {}", material.name), || {
            Ok(render_sphere(&material.full, &workshop.novel, &settings, &|_| ()))
        })?;
        let mut estimates = Vec::new();
        for (tree, (_, light)) in workshop.lights.iter().zip(LIGHTS) {
            let name = format!("{} under {light}", material.name);
            let estimate = step(&format!("Fig. 4, {name}"), || {
                let accuracy = IntegratorSettings::default();
                let colours: Vec<glam::Vec3> = points
                    .par_iter()
                    .map(|p| radiance(p, &material.full, &envelope, tree, &accuracy).as_vec3())
                    .collect();
                let image: Vec<Option<f64>> = colours.iter().map(|c| Some(f64::from(luminance(*c)))).collect();
                let projected = plan.project(&image, 1e-5)?;
                let (_, table) = workshop.infer(&projected, &name)?;
                let colour = median_colour(&Plane::from_vec(colours.len(), 1, colours), |_| true);
                let tinted = Tinted { table, colour: colour.as_dvec3() };
                let predicted = render_sphere(&tinted, &workshop.novel, &settings, &|_| ());
                let (ours, reference) = (pixels(&predicted), pixels(&truth));
                Ok(Estimate {
                    input: show::sphere(&material.full, tree),
                    predicted: show::scaled(&predicted, show::median_ratio(&ours, &reference)),
                    relight: metrics::relight(&ours, &reference),
                    brdf: metrics::brdf_error(&tinted.table, &material.truth),
                    left_over: projected.left_over(),
                    table: tinted.table,
                })
            })?;
            estimates.push(estimate);
        }
        all.push(Recovered { truth, estimates });
    }
    Ok(all)
}
