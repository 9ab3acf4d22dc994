//! A photograph to everything that a `gonio.Posterior` holds.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, Vec3};
use gonio::colour::Chroma;
use gonio::estimate::{ColouringRule, Estimate, EstimateSettings, Stage, estimate};
use gonio::picture::{Plane, srgb_encode};
use gonio::reflectance::{BivariateTable, THETA_D, THETA_H};
use gonio_report::clock::StageClock;
use gonio_report::panels::used::with_legend;
use gonio_report::panels::{Panels, Subject};
use gonio_report::report::{Fits, Report};
use gonio_report::{notes, summary, uncertainty};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};

use crate::arrays;
use crate::embedding::Embedding;
use crate::error::Problem;
use crate::model::Model;
use crate::scene::{GivenScene, Observed, Scene};
use crate::work::{self, Listeners, Reporter};

/// Height of the light's lat-long picture.
const LIGHT: usize = 128;

/// How the answer is to be found.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Settings {
    grid: usize,
    shadows: bool,
    color: String,
    light_color: Option<[f64; 3]>,
    pictures: bool,
    report: bool,
}

impl Settings {
    /// The rule, and in words what it takes for the light's colour.
    fn colouring(&self) -> Result<(ColouringRule, &'static str), Problem> {
        if self.light_color.is_some() && self.color != "estimate" {
            return Err(Problem::new("light_color serves color=\"estimate\" alone"));
        }
        Ok(match (self.color.as_str(), self.light_color) {
            ("none", _) => (ColouringRule::Grey, ""),
            ("median", _) => (ColouringRule::Median, ""),
            ("estimate", Some(rgb)) if rgb.iter().all(|x| x.is_finite() && *x > 0.0) => {
                let light = Some(Chroma::of(DVec3::from_array(rgb)));
                (ColouringRule::Estimate { light }, "the light has the colour given by light_color")
            }
            ("estimate", Some(_)) => {
                return Err(Problem::new("light_color: give three positive numbers on a linear scale"));
            }
            ("estimate", None) => (
                ColouringRule::Estimate { light: None },
                "the light has a colour as captured lights have, around white",
            ),
            (other, _) => {
                return Err(Problem::new(format!("color {other:?}: give \"estimate\", \"median\" or \"none\"")));
            }
        })
    }
}

/// Everything that was found.
struct Answer {
    tables: [BivariateTable; 3],
    ends: [[BivariateTable; 3]; 2],
    found: Estimate,
    light: Plane<Vec3>,
    pictures: Vec<(&'static str, Plane<Vec3>)>,
    warnings: Vec<String>,
    notes: String,
    page: Option<String>,
}

/// Infers; gives the values of a `Posterior` by name.
#[pyfunction]
pub(crate) fn infer<'py>(
    py: Python<'py>,
    scene: GivenScene<'py>,
    settings: Settings,
    model: &Bound<'py, Model>,
    listeners: Listeners,
) -> PyResult<Bound<'py, PyDict>> {
    let scene = scene.take()?;
    let (known, name) = (model.get().model.clone(), model.get().name.clone());
    let answer = work::run(py, listeners, move |reporter| answer(scene, &settings, &known, &name, reporter))?;
    answer.spell_out(py, model)
}

fn answer(
    scene: Scene,
    settings: &Settings,
    model: &Arc<gonio::model::Model>,
    model_name: &str,
    reporter: &Reporter,
) -> Result<Answer, Problem> {
    let start = Instant::now();
    let (rule, assumption) = settings.colouring()?;
    let side = settings.grid;
    if model.learnt.is_none() {
        return Err(Problem::of(
            model_name,
            "has no posterior of materials; learn one with train_posterior and join it with train_model",
        ));
    }
    let covered = 1 << model.light.scales;
    if !side.is_power_of_two() || !(4..=covered).contains(&side) {
        return Err(Problem::new(format!(
            "grid {side}: give a power of two from 4 to {covered}, which the model's prior of light covers"
        )));
    }
    let mut warnings = Vec::new();
    let (name, linear) = (scene.name.clone(), scene.linear);
    let stem = Path::new(&name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    reporter.at("reading", 0.0);
    let shadows = settings.shadows.then_some((model.light.map, side));
    let Observed { picture, sighting, notes: seen } = scene.observe(shadows, &mut warnings, reporter)?;
    let read = start.elapsed().as_secs_f64();
    let clock = StageClock::default();
    let begin = |stage: Stage| {
        if let Some(last) = clock.begin(stage) {
            reporter.at(last.name(), 1.0);
        }
        reporter.at(stage.name(), 0.0);
    };
    let ask = EstimateSettings { side, colouring: rule, ..EstimateSettings::default() };
    let found = estimate(model, &sighting.observations, &ask, &begin).map_err(|error| Problem::of(&name, error))?;
    let end = Instant::now();
    let stages = clock.finish();
    let mut seconds: serde_json::Map<String, Value> =
        stages.into_iter().map(|(name, s)| (name.to_owned(), json!(s))).collect();
    warnings.extend(found.doubts().iter().map(ToString::to_string));
    reporter.at(Stage::Colours.name(), 1.0);
    let (colours, light_colour) = (found.colouring.colours(), found.colouring.light());
    let subject = Subject {
        picture: &picture,
        sighting: &sighting,
        shadows: settings.shadows,
        colours,
        light_colour,
        table: &found.material.table,
        light: Some(&found.light.grid),
        known_light: None,
        material: Some(&found.material),
    };
    let panels = settings.pictures.then(|| Panels::draw(&subject, &|x| reporter.at("drawing", x)));
    let mut result = notes::head(&name, "learnt", model);
    result["observations"] = seen;
    result["colour"] = notes::colouring(&found.colouring, assumption);
    result["settings"] = notes::settings(&ask, linear);
    result["warnings"] = json!(warnings);
    seconds.insert("reading".into(), json!(read));
    seconds.insert("drawing".into(), json!(end.elapsed().as_secs_f64()));
    seconds.insert("total".into(), json!(start.elapsed().as_secs_f64()));
    result["seconds"] = Value::Object(seconds);
    notes::extend(&mut result, notes::estimate(&found));
    let page = panels.as_ref().filter(|_| settings.report).map(|panels| {
        reporter.at("report", 0.0);
        let fits = Fits::of(&subject.coloured(&found.material.table));
        let (name, warnings) = (&stem, &warnings[..]);
        Report { name, subject: &subject, panels, fits: &fits, warnings, result: &result }.render()
    });
    let pictures = panels.map_or_else(Vec::new, |panels| {
        let caption = format!(
            "learnt | {} observations | misfit {:.1} % | {:.0} s",
            sighting.observations.report.used,
            100.0 * found.light.misfit,
            start.elapsed().as_secs_f64()
        );
        pictures(&subject, panels, &found, &caption)
    });
    Ok(Answer {
        tables: colours.tables(&found.material.table),
        ends: found.material.ends.each_ref().map(|table| colours.tables(table)),
        light: found.light.grid.to_lat_long(LIGHT),
        found,
        pictures,
        warnings,
        notes: result.to_string(),
        page,
    })
}

/// All pictures by name.
fn pictures(
    subject: &Subject<'_>,
    panels: Panels,
    found: &Estimate,
    caption: &str,
) -> Vec<(&'static str, Plane<Vec3>)> {
    let mut pictures = vec![
        ("summary", summary::compose(subject, &panels, caption)),
        ("uncertainty", uncertainty::draw(&found.material)),
    ];
    let Panels { photograph, observed, used, reproduction, residual, light, spheres, .. } = panels;
    if let (Some(used), Some(fates)) = (used, &subject.sighting.observations.fates) {
        pictures.push(("used", with_legend(&used, fates)));
    }
    pictures.extend([("photograph", photograph), ("observed", observed), ("reproduction", reproduction)]);
    pictures.extend([("residual", residual), ("light", light)]);
    // The first is the one that folders of results hold.
    let name = |i: usize, name: &'static str| if i == 0 { "relit" } else { name };
    pictures.extend(spheres.into_iter().enumerate().map(|(i, (own, sphere))| (name(i, own), sphere)));
    pictures
}

impl Answer {
    /// By the names of `gonio._posterior.Found`.
    fn spell_out<'py>(self, py: Python<'py>, model: &Bound<'py, Model>) -> PyResult<Bound<'py, PyDict>> {
        let Self { tables, ends, found, light, pictures, warnings, notes, page } = self;
        let (material, colour) = (found.material, found.colouring.light());
        let shape = (THETA_H, THETA_D);
        let out = PyDict::new(py);
        out.set_item("table", arrays::of_tables(py, &tables))?;
        out.set_item("ends", ends.each_ref().map(|table| arrays::of_tables(py, table)))?;
        out.set_item("luminance", arrays::array(py, shape, material.table.into()))?;
        let (count, quantiles) = (material.quantiles.len(), material.quantiles.concat());
        out.set_item("quantiles", arrays::array(py, (count, THETA_H, THETA_D), quantiles))?;
        out.set_item("undetermined", arrays::array(py, shape, material.undetermined))?;
        out.set_item("open", material.open)?;
        let materials: Vec<(String, f64)> = material.neighbours.into_iter().map(|n| (n.name, n.weight)).collect();
        out.set_item("materials", materials)?;
        out.set_item("gloss", material.gloss.to_vec())?;
        out.set_item("embedding", Embedding(material.posterior.embedding))?;
        out.set_item("scatter", material.scatter)?;
        out.set_item("light", arrays::of_colours(py, light))?;
        out.set_item("light_color", arrays::array(py, 3, colour.to_array().to_vec()))?;
        out.set_item("misfit", found.light.misfit)?;
        let shown = PyDict::new(py);
        for (name, picture) in pictures {
            let (width, height) = picture.size();
            let code = |v: f32| (srgb_encode(v.max(0.0)) * 255.0).round() as u8;
            let samples: Vec<u8> = picture.as_slice().iter().flat_map(|v| v.to_array().map(code)).collect();
            shown.set_item(name, arrays::array(py, (height, width, 3), samples))?;
        }
        out.set_item("pictures", shown)?;
        out.set_item("warnings", warnings)?;
        out.set_item("notes", notes)?;
        out.set_item("page", page)?;
        out.set_item("model", model)?;
        Ok(out)
    }
}
