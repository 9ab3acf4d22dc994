//! Fig. 6: a BRDF from a photograph of a real ball, compared with photographs under other lights
//! and with the measured BRDF.

use std::path::Path;

use anyhow::{Context, Result, bail};
use glam::{DVec3, Vec3};
use gonio::picture::{Picture, Plane, luminance};
use gonio::reflectance::BivariateTable;
use gonio::render::median_colour;
use gonio::scene::{ObservationSettings, Observations};
use maud::{Markup, html};
use rayon::prelude::*;

use super::context::PaperContext;
use super::show;
use super::step;
use crate::captured::{Captured, Cell, reflected};
use crate::metrics::{self, Relight};
use gonio_report::page::chart::{self, Axis, Series};
use gonio_report::page::{figure, table};

/// The lights of the photographs that are shown.
const LIGHTS: [&str; 3] = ["city", "interior", "sunset"];

/// Charted columns of the measurement, degrees of `theta_d`; each number is the lower end of a cell
/// of one degree.
const CHARTED: [usize; 3] = [2, 10, 20];

/// Estimates from one photograph.
struct Estimate {
    /// BRDF inferred blind, up to scale.
    blind: BivariateTable,
    /// BRDF inferred with the light known, up to scale.
    known: BivariateTable,
    /// Median colour of the photograph.
    colour: DVec3,
    observations: usize,
    left_over: f64,
}

/// A prediction of one photograph.
struct Prediction {
    picture: Picture,
    error: Relight,
}

pub(super) fn section(context: &PaperContext) -> Result<Markup> {
    let ball = read(&context.data)?;
    let estimates = (0..LIGHTS.len()).map(|i| infer(context, &ball, i)).collect::<Result<Vec<_>>>()?;
    let mean = context.training_mean()?;
    let pixels = ball.pixels(80.0);
    let predict = |light: usize, colour: DVec3, f: &(dyn Fn(f64, f64) -> f64 + Sync)| {
        prediction(&ball, &pixels, light, &ball.render(light, f), colour)
    };
    let (mut cards, mut rows, mut columns) = (Vec::new(), Vec::new(), vec![Vec::new(); 5]);
    for (i, estimate) in estimates.iter().enumerate() {
        let mut tiles = vec![(format!("input: {}", LIGHTS[i]), photograph(&ball, i))];
        let mut errors = Vec::new();
        for light in (0..LIGHTS.len()).filter(|l| *l != i) {
            let of = |t: &BivariateTable| predict(light, estimate.colour, &|h, d| t.eval(h, d));
            let ours = of(&estimate.blind);
            let references = [
                of(&estimate.known),
                of(&mean),
                predict(light, estimate.colour, &|_, _| 1.0),
                predict(light, estimate.colour, &|h, d| ball.slice.eval(h, d)),
            ];
            let exposure = show::exposure(&ball.cropped(&ball.photographs[light].picture.rgb));
            let alt = format!("The ball under {}, predicted from {}", LIGHTS[light], LIGHTS[i]);
            let shown = show::display(&ball.cropped(&ours.picture.rgb), exposure);
            tiles.push((format!("{} predicted", LIGHTS[light]), figure::picture(&shown, &alt)));
            tiles.push((format!("{} photographed", LIGHTS[light]), photograph(&ball, light)));
            errors.push(format!("{} {:.2}, log {:.2}", LIGHTS[light], ours.error.relative, ours.error.log));
            let all: Vec<Relight> = std::iter::once(&ours).chain(&references).map(|p| p.error).collect();
            let mut row = vec![format!("{} from {}", LIGHTS[light], LIGHTS[i])];
            row.extend(all.iter().map(|e| format!("{:.3} ({:.3})", e.relative, e.log)));
            rows.push(row);
            all.iter().zip(&mut columns).for_each(|(e, column)| column.push(*e));
        }
        let tiles: Vec<(&str, Markup)> = tiles.iter().map(|(label, html)| (label.as_str(), html.clone())).collect();
        let caption = html! { "Relight error: " (errors.join("; ")) ". " (estimate.observations) " observations." };
        cards.push(figure::card(&format!("From the photograph under {}", LIGHTS[i]), &figure::tiles(&tiles), &caption));
    }
    let median = |column: &Vec<Relight>, f: &dyn Fn(&Relight) -> f64| metrics::median(column.iter().map(f).collect());
    let mut last = vec!["median".to_owned()];
    last.extend(columns.iter().map(|c| format!("{:.3} ({:.3})", median(c, &|e| e.relative), median(c, &|e| e.log))));
    rows.push(last);
    let [ours, known, training, lambert, measured] = [0, 1, 2, 3, 4].map(|c| median(&columns[c], &|e| e.relative));
    let beyond = estimates.iter().map(|e| e.left_over).fold(0.0, f64::max);
    Ok(html! {
        p {
            "The ball was photographed under single lamps, which add up to three known lights. All light comes from a frontal patch, at most "
            (format!("{:.0}", reach(&ball))) " degrees from the view: " strong { "the prior of natural light is wrong for it" }
            ", since natural light comes from all around. The blind estimates use one photograph each, and neither its light nor the other photographs. "
            "Predictions sum the inferred BRDF over the lamps of the other lights; their colour is the median colour of the input."
        }
        (figure::grid(30, &cards))
        (table::table(
            "Relight error of the predicted photographs (log version in brackets)",
            &["photograph", "inferred blind", "inferred, light known", "training mean", "Lambertian", "measured BRDF"],
            &rows,
        ))
        p {
            "In the median the blind prediction is off by " (format!("{ours:.3}")) ", the mean of the training materials by "
            (format!("{training:.3}")) ", a Lambertian ball by " (format!("{lambert:.3}")) ", the BRDF inferred with the light known by "
            (format!("{known:.3}")) ", and the BRDF measured from the single lamps, which include those of the photograph, by "
            (format!("{measured:.3}")) ". " (better_than_blind(ours, &[("the training mean", training), ("the Lambertian ball", lambert)]))
            " Energy of a photograph that no 32 x 32 light can produce: at most "
            (format!("{:.1} %", 100.0 * beyond)) "."
        }
        (against_measurement(&ball, &estimates, &mean))
    })
}

/// Reads the ball with the photographs in [`LIGHTS`].
fn read(data: &Path) -> Result<Captured> {
    let folder = data.join("captured/ball");
    let mut ball = Captured::read(&folder)?;
    ball.photographs.retain(|p| LIGHTS.contains(&p.name.as_str()));
    if ball.photographs.len() != LIGHTS.len() {
        bail!("{}: there must be photographs in {}", folder.display(), LIGHTS.join(", "));
    }
    Ok(ball)
}

/// The largest angle (degrees) between a light and the view.
fn reach(ball: &Captured) -> f64 {
    let lights = ball.photographs.iter().flat_map(|p| &p.lights);
    lights.map(|l| l.direction.angle_between(DVec3::Z).to_degrees()).fold(0.0, f64::max)
}

/// Returns a sentence on the trivial estimates with smaller errors than the blind estimate.
fn better_than_blind(ours: f64, trivial: &[(&str, f64)]) -> String {
    let better: Vec<&str> = trivial.iter().filter(|(_, error)| *error < ours).map(|(name, _)| *name).collect();
    if better.is_empty() {
        "The blind estimate has a smaller error than both trivial estimates.".into()
    } else {
        format!("Trivial estimates with a smaller error than the blind estimate: {}.", better.join(" and "))
    }
}

fn infer(context: &PaperContext, ball: &Captured, i: usize) -> Result<Estimate> {
    let name = format!("captured/ball/{}.exr", LIGHTS[i]);
    step(&format!("Fig. 6, {}", LIGHTS[i]), || {
        let settings = ObservationSettings::default();
        let found = Observations::of_normals(&ball.photographs[i].picture, &ball.normals, Some(&ball.mask), &settings)
            .with_context(|| name.clone())?;
        let projected = context.plan(&found.points)?.project(&found.values, 1e-5)?;
        let (_, blind) = context.infer(&projected, &name)?;
        let functions = &context.model.reflectance.functions;
        let row = |normal: DVec3| {
            let of = |t: &BivariateTable| reflected(&|h, d| t.eval(h, d), normal, &ball.photographs[i].lights);
            functions.iter().map(|t| luminance(of(t).as_vec3())).collect::<Vec<f32>>()
        };
        let rows: Vec<f32> = found.points.par_iter().flat_map_iter(|p| row(p.normal)).collect();
        let known = context.infer_under_known_light(&rows, &found.values, &name)?;
        let colours: Vec<Vec3> = found.colours.iter().flatten().copied().collect();
        let colour = median_colour(&Plane::from_vec(colours.len(), 1, colours), |_| true).as_dvec3();
        Ok(Estimate { blind, known, colour, observations: found.report.used, left_over: projected.left_over() })
    })
}

/// Compares the rendered radiance `sent` with the photograph, and colours it.
fn prediction(ball: &Captured, pixels: &[usize], light: usize, sent: &Plane<DVec3>, colour: DVec3) -> Prediction {
    let photograph = ball.photographs[light].picture.rgb.as_slice();
    let ours: Vec<f64> = pixels.iter().map(|&i| f64::from(luminance(sent.as_slice()[i].as_vec3()))).collect();
    let reference: Vec<f64> = pixels.iter().map(|&i| f64::from(luminance(photograph[i]))).collect();
    let rgb = sent.map(|c| (*c * colour).as_vec3());
    // The colour changes the luminance, so the brightness is matched after colouring.
    let rendered: Vec<f64> = pixels.iter().map(|&i| f64::from(luminance(rgb.as_slice()[i]))).collect();
    let factor = show::median_ratio(&rendered, &reference);
    Prediction {
        picture: show::scaled(&Picture { rgb, alpha: None }, factor),
        error: metrics::relight(&ours, &reference),
    }
}

fn photograph(ball: &Captured, light: usize) -> Markup {
    let picture = ball.cropped(&ball.photographs[light].picture.rgb);
    let alt = format!("Photograph of the ball under {}", LIGHTS[light]);
    figure::picture(&show::display(&picture, show::exposure(&picture)), &alt)
}

/// Returns the best scale of a BRDF against the measured cells, and the log error at that scale:
/// `min_s rms ln((s F^ + e)/(F + e))`, `e` a thousandth of the measured diffuse level, over cells
/// below 80 degrees.
fn fit(ball: &Captured, f: impl Fn(f64, f64) -> f64) -> (f64, f64) {
    let degrees = |cell: &Cell| cell.theta_h.to_degrees();
    let broad = ball.slice.cells().filter(|c| (45.0..80.0).contains(&degrees(c))).map(|c| c.value);
    let floor = 1e-3 * metrics::median(broad.collect());
    let cells = ball.slice.cells().filter(|c| degrees(c) < 80.0);
    metrics::log_fit(cells.map(|c| (f(c.theta_h, c.theta_d), c.value)), floor)
}

fn against_measurement(ball: &Captured, estimates: &[Estimate], mean: &BivariateTable) -> Markup {
    let of = |t: &BivariateTable| fit(ball, |h, d| t.eval(h, d));
    let mut rows = Vec::new();
    for (estimate, light) in estimates.iter().zip(LIGHTS) {
        rows.push(vec![
            format!("from {light}"),
            format!("{:.3}", of(&estimate.blind).1),
            format!("{:.3}", of(&estimate.known).1),
        ]);
    }
    let plain = |name: &str, error: f64| vec![name.to_owned(), format!("{error:.3}"), String::new()];
    rows.push(plain("training mean", of(mean).1));
    rows.push(plain("Lambertian", fit(ball, |_, _| 1.0).1));
    let charts: Vec<Markup> = CHARTED
        .iter()
        .map(|&column| {
            let theta_d = (column as f64 + 0.5).to_radians();
            let inside = |c: &Cell| (c.theta_d - theta_d).abs() < 1e-9 && c.theta_h.to_degrees() < 80.0;
            let measured = ball.slice.cells().filter(inside).map(|c| (c.theta_h.to_degrees(), c.value)).collect();
            let mut series = vec![Series::line("measured", measured)];
            let curve = |t: &BivariateTable| -> Vec<(f64, f64)> {
                let scale = of(t).0;
                // Starts well within the first measured cell.
                let at = |i: i32| 0.3 * (80.0_f64 / 0.3).powf(f64::from(i) / 160.0);
                (0..=160).map(at).map(|h| (h, scale * t.eval(h.to_radians(), theta_d))).collect()
            };
            for (estimate, light) in estimates.iter().zip(LIGHTS) {
                series.push(Series::line(format!("blind, {light}"), curve(&estimate.blind)));
            }
            series.push(Series::dashed(format!("light known, {}", LIGHTS[0]), curve(&estimates[0].known)));
            let title = format!("theta_d of {column} to {} degrees", column + 1);
            let (x, y) = (("theta_h (degrees)", Axis::Log), ("reflectance (relative)", Axis::Log));
            figure::figure(&chart::lines(&title, x, y, &series), &html! { "Scales aligned over all measured cells." })
        })
        .collect();
    let count = ball.slice.cells().count();
    let furthest = ball.slice.cells().map(|c| c.theta_d.to_degrees() + 0.5).fold(0.0, f64::max);
    html! {
        h3 { "Against the measured BRDF" }
        p {
            "The BRDF of the ball as measured from its single-lamp photographs: " (count) " cells of one degree, theta_d up to "
            (format!("{furthest:.0}")) " degrees. There are no measurements beyond."
        }
        (figure::grid(20, &charts))
        (table::table("BRDF log error over the measured cells with theta_h below 80 degrees", &["BRDF", "blind", "light known"], &rows))
    }
}
