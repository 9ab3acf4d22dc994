//! Fig. 2: a light as lat-long and octahedral map; wavelet coefficients of lights and the prior
//! fitted to them.

use anyhow::{Context, Result};
use gonio::lighting::{LightGrid, PriorGroup};
use gonio::picture::Plane;
use gonio::render::Exposure;
use gonio::sphere::Orientation;
use maud::{Markup, html};
use rayon::prelude::*;

use super::context::{LIGHTS, PaperContext};
use super::step;
use crate::data;
use gonio_report::page::chart::{self, Axis, Histogram, Series};
use gonio_report::page::figure;

/// Texels along a side, as in the paper.
const GRID_SIDE: usize = 32;
/// Groups of coefficients that are shown, coarse to fine.
const GROUPS: [PriorGroup; 6] = [
    PriorGroup::Coarsest(Orientation::Vertical),
    PriorGroup::Middle { scale: 2, orientation: Orientation::Vertical, above: true },
    PriorGroup::Middle { scale: 2, orientation: Orientation::Vertical, above: false },
    PriorGroup::Middle { scale: 3, orientation: Orientation::Horizontal, above: true },
    PriorGroup::Fine { scale: 4 },
    PriorGroup::Fine { scale: 5 },
];

pub(super) fn section(context: &PaperContext) -> Result<Markup> {
    let lights = step("Fig. 2, training lights", || coefficients(context))?;
    let prior = &context.model.light;
    let all = PriorGroup::all(prior.scales);
    let mut charts = Vec::new();
    for group in GROUPS {
        let at = all.iter().position(|g| *g == group).context("the model's prior has no such group")?;
        let samples: Vec<f64> = (1..GRID_SIDE * GRID_SIDE)
            .filter(|&m| PriorGroup::of_index(m) == Some(group))
            .flat_map(|m| lights.iter().map(move |l| l[m]))
            .collect();
        charts.push(density(group, &samples, |x| prior.groups[at].log_density(x)));
    }
    Ok(html! {
        (octahedral(context)?)
        h3 { "Wavelet coefficients and their prior" }
        p {
            "Haar coefficients of " (lights.len()) " training lights, each scaled to integrate to one, on a " (GRID_SIDE) " x " (GRID_SIDE)
            " equal-area octahedral map, against the embedded prior of light, which was fitted to them. Where bars exceed the "
            "curve, the prior underestimates the frequency of such coefficients."
        }
        (figure::grid(20, &charts))
    })
}

/// Reads the training lights and returns their normalised coefficients.
fn coefficients(context: &PaperContext) -> Result<Vec<Vec<f64>>> {
    let folder = context.data.join("lighting/train");
    let entries = std::fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|e| Ok(e?.path())).collect::<std::io::Result<Vec<_>>>()?;
    paths.retain(|p| p.extension().is_some_and(|e| e == "hdr"));
    paths.sort();
    let map = context.model.light.map;
    let one = |path: &std::path::PathBuf| {
        let grid = data::read_map(path)?.to_grid(map, GRID_SIDE);
        grid.normalised_coefficients().with_context(|| format!("{}: the light is black", path.display()))
    };
    paths.par_iter().map(one).collect()
}

fn density(group: PriorGroup, samples: &[f64], log_density: impl Fn(f64) -> f64) -> Markup {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let moment = |k: i32| samples.iter().map(|x| (x - mean).powi(k)).sum::<f64>() / n;
    let (variance, kurtosis) = (moment(2), moment(4) / moment(2).powi(2));
    // Range of all but three samples in a thousand.
    let mut sizes: Vec<f64> = samples.iter().map(|x| x.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let reach = 1.05 * sizes[((sizes.len() - 1) as f64 * 0.997) as usize];
    let histogram = Histogram::new(samples, -reach, reach, if samples.len() < 200 { 15 } else { 41 });
    let along = |f: &dyn Fn(f64) -> f64| -> Vec<(f64, f64)> {
        // Points are closer together near zero, where mixtures are sharp; an odd count includes
        // zero.
        let at = |i: i32| reach * (f64::from(i) / 200.0).powi(3);
        (-200..=200).map(at).map(|x| (x, f(x))).collect()
    };
    let gaussian = |x: f64| (-0.5 * (x - mean).powi(2) / variance).exp() / (std::f64::consts::TAU * variance).sqrt();
    let curves = [
        Series::line("prior", along(&|x| log_density(x).exp())),
        Series::dashed("Gaussian of the same variance", along(&gaussian)),
    ];
    let title = format!("Scale {}", group.label());
    let chart = chart::histogram(&title, "coefficient", &histogram, &curves, Axis::Log);
    figure::figure(
        &chart,
        &html! {
            (samples.len()) " coefficients, kurtosis " (format!("{kurtosis:.1}")) " (a Gaussian's is 3)"
            @if histogram.outside() > 0.0 { "; " (format!("{:.1} %", 100.0 * histogram.outside())) " lie outside" }
            "."
        },
    )
}

fn octahedral(context: &PaperContext) -> Result<Markup> {
    let (file, name) = LIGHTS[0];
    let light = context.test_lights.map(file)?;
    let map = context.model.light.map;
    let exposed = |rgb: Plane<glam::Vec3>| {
        let exposure = Exposure::by_quantile(&rgb, |_| true, 0.9, 0.6);
        rgb.map(|p| exposure.apply(*p))
    };
    let square = |grid: LightGrid| exposed(Plane::from_vec(grid.side(), grid.side(), grid.texels().to_vec()));
    // Each pixel of the picture is the mean of a block of texels, not a sample.
    let radiance = light.radiance();
    let step = (radiance.width() / 512).max(1);
    let small = Plane::from_fn(radiance.width() / step, radiance.height() / step, |x, y| {
        let texels = (0..step * step).map(|i| radiance[(x * step + i % step, y * step + i / step)]);
        texels.sum::<glam::Vec3>() / (step * step) as f32
    });
    let tiles = figure::tiles(&[
        ("lat-long", figure::picture(&exposed(small), &format!("{name} as a lat-long map"))),
        (
            "octahedral, 256 x 256",
            figure::picture(&square(light.to_grid(map, 256)), &format!("{name} as an octahedral map, fine")),
        ),
        (
            "octahedral, 32 x 32",
            figure::cells(
                &square(light.to_grid(map, GRID_SIDE)),
                &format!("{name} as an octahedral map of 32 by 32 texels"),
                8,
            ),
        ),
    ]);
    Ok(figure::figure(
        &tiles,
        &html! {
            strong { (name) } " in both projections. The centre of the lat-long map is behind the object. The centre of the square is "
            "the direction of the camera; its corners meet behind the object, and its upper half is the upper half of the world. The inference "
        "represents light on 32 x 32 texels."
        },
    ))
}
