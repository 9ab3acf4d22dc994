//! Fig. 1, top: tests whether the single best explanation of an image drifts to a mirror in a
//! blurry light. Shows the joint maximum and the separable posterior at several noise levels, and
//! the joint maximum over the iterations.

use anyhow::{Context, Result};
use gonio::inference::Hyperparameters;
use gonio::picture::Picture;
use gonio::reflectance::BivariateTable;
use gonio::render::Tinted;
use gonio::scene::{ObservationSettings, sphere_points};
use gonio::sphere::{OctahedralMap, Wavelet};
use gonio_paper::{JointMapSettings, Method, Posterior, Projected, VariationalSettings};
use maud::{Markup, html};
use rayon::prelude::*;

use super::context::{LIGHTS, Material, NOVEL, PaperContext};
use super::show;
use super::step;
use crate::metrics::Gloss;
use gonio_report::page::chart::{self, Axis, Frame, Series};
use gonio_report::page::{figure, table};

/// Photographed materials: a matte one, whose image a mirror could show only in a blurry light, and
/// a satin one.
const PHOTOGRAPHED: [&str; 2] = ["red-fabric", "blue-metallic-paint"];
/// Standard deviations at which the noise is fixed, relative to the root mean square of the image.
const NOISE_LEVELS: [f64; 6] = [0.3, 0.1, 0.05, 0.02, 0.01, 0.003];
/// Weight of the prior that fixes the noise, relative to the number of observations.
const HOLD: f64 = 1e3;
/// Iterations after which the joint maximum is shown.
const ITERATIONS: [usize; 7] = [1, 3, 10, 30, 100, 300, 600];
/// Texels along a side of the light grid.
const GRID_SIDE: usize = 32;

/// One explanation of an image.
struct Explanation {
    table: BivariateTable,
    gloss: Gloss,
    /// Root mean square of the light's coefficients at the two finest scales.
    detail: f64,
    /// Norm of the residual over that of the image.
    misfit: f64,
    converged: bool,
}

impl Explanation {
    fn of(image: &Projected, (posterior, table): (Posterior, BivariateTable)) -> Self {
        let shown = image.bilinear.apply(&posterior.light, &posterior.reflectance);
        let residual: f64 = image.target.iter().zip(shown).map(|(i, y)| (i - posterior.exposure * y).powi(2)).sum();
        let outside = image.energy() - image.target.iter().map(|i| i * i).sum::<f64>();
        Self {
            gloss: Gloss::of(&table),
            detail: detail(&posterior.light),
            misfit: ((residual + outside.max(0.0)) / image.energy()).sqrt(),
            converged: posterior.starts[posterior.best_start].converged,
            table,
        }
    }
}

fn detail(light: &[f64]) -> f64 {
    let finest = GRID_SIDE.ilog2();
    let fine = light.iter().enumerate().filter(|(m, _)| Wavelet::of_index(*m).is_some_and(|w| w.scale + 1 >= finest));
    let squares: Vec<f64> = fine.map(|(_, l)| l * l).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

pub(super) fn section(context: &PaperContext) -> Result<Markup> {
    let light = &context.lights[0];
    let grid = context.test_lights.map(LIGHTS[0].0)?.to_grid(OctahedralMap::default(), GRID_SIDE);
    let true_light = grid.normalised_coefficients().context("a black light")?;
    let points = sphere_points(&ObservationSettings::default());
    let plan = context.plan(&points)?;
    let parts = PHOTOGRAPHED.iter().map(|name| {
        step(&format!("Fig. 1, {name}"), || {
            let material = context.materials.iter().find(|m| m.name == *name).context("one of the materials")?;
            let image = plan.project(&show::luminances(&points, &material.full, light), 1e-5)?;
            of_material(context, material, &image, &true_light)
        })
    });
    let parts = parts.collect::<Result<Vec<_>>>()?;
    Ok(html! {
        p {
            "The paper's reason to marginalise: any image is explained perfectly by a mirror-like BRDF and a blurry light, so that the joint "
            "maximum of both must drift there. Here a sphere under " (LIGHTS[0].1) " is explained by the joint maximum of eq. 10 and by the "
            "separable posterior, with the noise held at one level after another, each from the same random start, to convergence or for at most "
            (ITERATIONS[ITERATIONS.len() - 1]) " iterations. Gloss is the "
            "logarithm of the highlight's peak over that of a Lambertian surface of the same albedo; the light's detail is the root mean "
            "square of its coefficients at the two finest scales, where the true light has " (format!("{:.3}", detail(&true_light))) "."
        }
        @for part in &parts { (part) }
    })
}

fn of_material(
    context: &PaperContext,
    material: &Material,
    projected: &Projected,
    true_light: &[f64],
) -> Result<Markup> {
    let name = material.name;
    let held = |noise: f64| {
        let shape = HOLD * projected.pixels as f64;
        Hyperparameters { noise_shape: shape, noise_rate: shape * noise * noise, ..Hyperparameters::default() }
    };
    let joint = |max_iterations| Method::JointMap(JointMapSettings { starts: 1, max_iterations, ..Default::default() });
    let separable = Method::Variational(VariationalSettings { starts: 1, ..Default::default() });
    let explain = |hyper, method: &Method| {
        Ok::<_, anyhow::Error>(Explanation::of(projected, context.infer_by(projected, hyper, method, name)?))
    };
    let last = ITERATIONS[ITERATIONS.len() - 1];
    let levels: Vec<Hyperparameters> =
        NOISE_LEVELS.iter().map(|n| held(*n)).chain([Hyperparameters::default()]).collect();
    let joints = levels.par_iter().map(|h| explain(*h, &joint(last))).collect::<Result<Vec<_>>>()?;
    let separables = levels.par_iter().map(|h| explain(*h, &separable)).collect::<Result<Vec<_>>>()?;
    // The last point of the walk is the joint maximum with free noise.
    let earlier = &ITERATIONS[..ITERATIONS.len() - 1];
    let walk =
        earlier.par_iter().map(|n| explain(Hyperparameters::default(), &joint(*n))).collect::<Result<Vec<_>>>()?;

    let truth = Gloss::of(&material.truth);
    let label = |i: usize| NOISE_LEVELS.get(i).map_or("free".into(), |n| format!("{} %", 100.0 * n));
    let rows: Vec<Vec<String>> = (0..=NOISE_LEVELS.len())
        .map(|i| {
            let (j, s) = (&joints[i], &separables[i]);
            let converged = |e: &Explanation| if e.converged { "" } else { " (not converged)" };
            vec![
                label(i),
                format!("{:.2}{}", j.gloss.peak, converged(j)),
                format!("{:.2}{}", s.gloss.peak, converged(s)),
                format!("{:.3}", j.detail),
                format!("{:.3}", s.detail),
                format!("{:.2} %", 100.0 * j.misfit),
                format!("{:.2} %", 100.0 * s.misfit),
            ]
        })
        .collect();
    let along = |list: &[Explanation], of: &dyn Fn(&Explanation) -> f64| -> Vec<(f64, f64)> {
        NOISE_LEVELS.iter().zip(list).map(|(n, e)| (100.0 * n, of(e))).collect()
    };
    let flat = |x: [f64; 2], y: f64| Series::dashed("truth", x.map(|x| (x, y)).to_vec());
    let ends = [100.0 * NOISE_LEVELS[NOISE_LEVELS.len() - 1], 100.0 * NOISE_LEVELS[0]];
    let panel = |title: &str, y: &str, axis: Axis, of: &dyn Fn(&Explanation) -> f64, true_value: f64| {
        let series = [
            Series::line("joint maximum", along(&joints, of)),
            Series::line("separable posterior", along(&separables, of)),
            flat(ends, true_value),
        ];
        let frame = Frame { title, x: ("noise held at (%)", Axis::Log), y: (y, axis), y_range: None };
        figure::figure(&chart::chart(&frame, &series), &html! {})
    };
    let steps = |of: &dyn Fn(&Explanation) -> f64| -> Vec<(f64, f64)> {
        ITERATIONS.iter().zip(walk.iter().chain(joints.last())).map(|(n, e)| (*n as f64, of(e))).collect()
    };
    let frame = Frame {
        title: "Joint maximum, noise free",
        x: ("iterations", Axis::Log),
        y: ("gloss", Axis::Linear),
        y_range: None,
    };
    let walked = chart::chart(
        &frame,
        &[
            Series::line("joint maximum", steps(&|e| e.gloss.peak)),
            flat([ITERATIONS[0] as f64, last as f64], truth.peak),
        ],
    );
    let pictures = pictures(context, &material.full, &joints, &separables);
    let shown: Vec<(String, Markup)> = pictures
        .into_iter()
        .map(|(what, strip)| {
            let alt = format!("{name} in {} as explained by the {what}, noise from high to low", NOVEL.1);
            (what, figure::picture(&strip, &alt))
        })
        .collect();
    Ok(html! {
        h3 { (name) }
        @for (what, strip) in &shown { (figure::tiles(&[(what.as_str(), strip.clone())])) }
        p.note {
            "Relit in " (NOVEL.1) ", the truth first; then the noise held at "
            (NOISE_LEVELS.iter().map(|n| format!("{} %", 100.0 * n)).collect::<Vec<_>>().join(", ")) " and free."
        }
        (figure::grid(19, &[
            panel("Gloss", "gloss", Axis::Linear, &|e| e.gloss.peak, truth.peak),
            panel("Detail of the light", "root mean square", Axis::Log, &|e| e.detail, detail(true_light)),
            figure::figure(&walked, &html! {}),
        ]))
        (table::table(
            &format!("Explanations of {name}; the true gloss is {:.2}", truth.peak),
            &["noise", "gloss, joint", "gloss, separable", "detail, joint", "detail, separable", "misfit, joint", "misfit, separable"],
            &rows,
        ))
    })
}

/// Strips of spheres in the novel light, the truth first, for each method.
fn pictures(
    context: &PaperContext,
    full: &gonio::reflectance::MerlTable,
    joints: &[Explanation],
    separables: &[Explanation],
) -> Vec<(String, gonio::picture::Plane<glam::Vec3>)> {
    let truth = show::sphere(full, &context.novel);
    let strip = |list: &[Explanation]| {
        let estimates = list.iter().map(|e| {
            let grey = Tinted { table: e.table.clone(), colour: glam::DVec3::ONE };
            show::best_coloured(&show::sphere(&grey, &context.novel), &truth)
        });
        let all: Vec<Picture> = std::iter::once(truth.clone()).chain(estimates).collect();
        let exposure = show::exposure(&truth);
        show::beside(&all.iter().map(|p| show::display(p, exposure)).collect::<Vec<_>>())
    };
    vec![("joint maximum".to_owned(), strip(joints)), ("separable posterior".to_owned(), strip(separables))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detail_measures_the_two_finest_scales() {
        let mut light = vec![0.0; GRID_SIDE * GRID_SIDE];
        light[..64].fill(7.0);
        assert_eq!(detail(&light), 0.0);
        light[64..].fill(-0.5);
        assert!((detail(&light) - 0.5).abs() < 1e-12);
    }
}
