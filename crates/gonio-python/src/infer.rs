//! Inference from a photograph to everything that a `gonio.Posterior` holds.

use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::{THETA_D, THETA_H};
use gonio_app::results::LIGHT_ROWS;
use gonio_app::{Answer, Colours, Journal, Method, Problem};
use gonio_report::panels::Panels;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::embedding::Embedding;
use crate::error::words;
use crate::model::Model;
use crate::scene::GivenScene;
use crate::work::{self, Listeners};

/// Settings of the inference.
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
    fn colours(&self) -> Result<Colours, Problem> {
        let problem = |text: &str| Err(Problem::new(text));
        match (self.color.as_str(), self.light_color) {
            ("estimate", None) => Ok(Colours::Estimate),
            ("estimate", Some(rgb)) => Colours::under(rgb)
                .map_or_else(|| problem("light_color: give three positive numbers on a linear scale"), Ok),
            (_, Some(_)) => problem("light_color serves color=\"estimate\" alone"),
            ("median", None) => Ok(Colours::Median),
            ("none", None) => Ok(Colours::Grey),
            (other, None) => problem(&format!("color {other:?}: give \"estimate\", \"median\" or \"none\"")),
        }
    }
}

/// Infers; returns the values of a `Posterior` by name.
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
    let answer = work::run(py, listeners, move |reporter| {
        let listener = |stage, fraction| reporter.at(stage, fraction);
        let settings = gonio_app::Settings {
            method: Method::Learnt,
            side: settings.grid,
            shadows: settings.shadows,
            colours: settings.colours()?,
            pictures: settings.pictures,
            report: settings.report,
            words: &words,
        };
        gonio_app::infer((&known, &name), scene, &settings, &Journal::new("reading", &listener))
    })?;
    spell_out(py, answer, model)
}

/// All pictures by name: those of a folder of results, and the panels they are made of.
fn pictures(answer: &Answer) -> Vec<(&'static str, Plane<Vec3>)> {
    let mut pictures = answer.pictures();
    if let Some(panels) = &answer.panels {
        let Panels { photograph, observed, reproduction, residual, light, spheres, .. } = panels;
        let named = [photograph, observed, reproduction, residual, light].map(Clone::clone);
        pictures.extend(["photograph", "observed", "reproduction", "residual", "light"].into_iter().zip(named));
        // The first sphere is the one that folders of results hold.
        pictures.extend(spheres.iter().skip(1).cloned());
    }
    pictures
}

/// Dictionary of the results, by the names of `gonio._posterior.Found`.
fn spell_out<'py>(py: Python<'py>, answer: Answer, model: &Bound<'py, Model>) -> PyResult<Bound<'py, PyDict>> {
    let (colours, light_colour) = (answer.colouring.colours(), answer.colouring.light());
    let pictures = pictures(&answer);
    let light = answer.light.as_ref().map(|light| light.to_lat_long(LIGHT_ROWS));
    let Answer { table, material, left, notes, warnings, page, .. } = answer;
    let material = material.expect("the learnt posterior tells of the material");
    let shape = (THETA_H, THETA_D);
    let out = PyDict::new(py);
    out.set_item("table", arrays::of_tables(py, &colours.tables(&table)))?;
    let ends = material.ends.each_ref().map(|end| arrays::of_tables(py, &colours.tables(end)));
    out.set_item("ends", ends)?;
    out.set_item("luminance", arrays::array(py, shape, table.into()))?;
    let (count, quantiles) = (material.quantiles.len(), material.quantiles.concat());
    out.set_item("quantiles", arrays::array(py, (count, THETA_H, THETA_D), quantiles))?;
    out.set_item("undetermined", arrays::array(py, shape, material.undetermined))?;
    out.set_item("open", material.open)?;
    let materials: Vec<(String, f64)> = material.neighbours.into_iter().map(|n| (n.name, n.weight)).collect();
    out.set_item("materials", materials)?;
    out.set_item("gloss", material.gloss.to_vec())?;
    out.set_item("embedding", Embedding(material.posterior.embedding))?;
    out.set_item("scatter", material.scatter)?;
    out.set_item("light", light.map(|light| arrays::of_colours(py, light)))?;
    out.set_item("light_color", arrays::array(py, 3, light_colour.to_array().to_vec()))?;
    out.set_item("misfit", left.1)?;
    let shown = PyDict::new(py);
    for (name, picture) in pictures {
        shown.set_item(name, arrays::coded(py, &picture))?;
    }
    out.set_item("pictures", shown)?;
    out.set_item("warnings", warnings)?;
    out.set_item("notes", notes.to_string())?;
    out.set_item("page", page)?;
    out.set_item("model", model)?;
    Ok(out)
}
