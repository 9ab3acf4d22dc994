//! Estimates the light around a mirror ball.

use gonio_app::{ProbePhotographs, ProgressLog};
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::arrays;
use crate::error::worded;
use crate::scene::SceneArg;
use crate::work::{self, Listeners};

/// Settings of a light probe.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ProbeSettings {
    reflectance: [f64; 3],
    rows: Option<usize>,
    second_azimuth: Option<f64>,
}

/// Light, observed fraction of each texel, picture, document and warnings. The light has the shape
/// (rows, 2 rows, 3), the fraction (rows, 2 rows); the picture has 8-bit samples, the document is
/// JSON.
type Probe<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<f32>>, Bound<'py, PyArray3<u8>>, String, Vec<String>);

/// Unwraps one or two photographs of a mirror ball.
#[pyfunction]
#[pyo3(signature = (first, second, settings, listeners))]
pub(crate) fn light_probe<'py>(
    py: Python<'py>,
    first: SceneArg<'py>,
    second: Option<SceneArg<'py>>,
    settings: ProbeSettings,
    listeners: Listeners,
) -> PyResult<Probe<'py>> {
    let ProbeSettings { reflectance, rows, second_azimuth } = settings;
    let second = second.map(SceneArg::take).transpose()?.map(|scene| (scene, second_azimuth));
    let mirror = ProbePhotographs { first: first.take()?, second, reflectance, rows };
    let found = work::run(py, listeners, move |reporter| {
        let listener = |stage, fraction| reporter.at(stage, fraction);
        gonio_app::light_probe(mirror, &ProgressLog::new("reading", &listener))
    })?;
    let (rows, columns) = (found.coverage.height(), found.coverage.width());
    let coverage = arrays::array(py, (rows, columns), found.coverage.into_vec());
    let warnings = worded(&found.warnings);
    Ok((
        arrays::of_colours(py, found.light),
        coverage,
        arrays::coded(py, &found.picture),
        found.document.to_string(),
        warnings,
    ))
}
