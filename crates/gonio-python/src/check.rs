//! Checks of photographs without inference, and merging of exposures.

use std::path::PathBuf;

use gonio::bracket::MergedPixelStatus;
use gonio::picture::Plane;
use gonio_app::photograph::merge_files;
use gonio_app::{ProgressLog, check as look_at};
use gonio_io::picture::encode_response;
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays;
use crate::error::worded;
use crate::infer::GivenRegions;
use crate::scene::{ReadingArg, SceneArg};
use crate::work::{self, Listeners};

/// Detects the objects of a photograph; returns the values of a `Checked` by name.
#[pyfunction]
#[pyo3(signature = (scene, regions, listeners))]
pub(crate) fn check<'py>(
    py: Python<'py>,
    scene: SceneArg<'py>,
    regions: Option<GivenRegions<'py>>,
    listeners: Listeners,
) -> PyResult<Bound<'py, PyDict>> {
    let (scene, regions) = (scene.take()?, regions.map(GivenRegions::take).transpose()?);
    let (picture, outlines, document, warnings) = work::run(py, listeners, move |reporter| {
        let listener = |stage, fraction| reporter.at(stage, fraction);
        let checked =
            look_at(scene, regions, &ProgressLog::new("reading", &listener)).map_err(|unchecked| unchecked.problem)?;
        let outlines: Vec<String> = checked.objects.iter().map(gonio_app::DetectedObject::outline).collect();
        Ok((checked.draw(), outlines, checked.document(), worded(&checked.warnings)))
    })?;
    let out = PyDict::new(py);
    out.set_item("picture", arrays::coded(py, &picture))?;
    out.set_item("outlines", outlines)?;
    out.set_item("document", document.to_string())?;
    out.set_item("warnings", warnings)?;
    Ok(out)
}

/// Merges exposures; returns the values of a `Merged` by name.
#[pyfunction]
pub(crate) fn merge(
    py: Python<'_>,
    images: Vec<PathBuf>,
    reading: ReadingArg,
    listeners: Listeners,
) -> PyResult<Bound<'_, PyDict>> {
    let reading = reading.take();
    let (bracket, warnings) = work::run(py, listeners, move |_| {
        let mut warnings = Vec::new();
        Ok((merge_files(&images, &reading, &mut warnings)?, worded(&warnings)))
    })?;
    let document = bracket.document();
    let merged = bracket.merged;
    let response = &merged.response;
    let (width, height) = merged.picture.rgb.size();
    let out = PyDict::new(py);
    out.set_item("origin", origin(py, &merged.known))?;
    out.set_item("clip_level", merged.clip_level)?;
    out.set_item("picture", arrays::of_colours(py, merged.picture.rgb))?;
    let alpha = merged.picture.alpha.map(|alpha| arrays::array(py, (height, width), alpha.into_vec()));
    out.set_item("alpha", alpha)?;
    let curves = [0, 1, 2].map(|channel| response.curve(channel)).concat();
    out.set_item("response", arrays::array(py, (3, usize::from(response.max()) + 1), curves))?;
    out.set_item("response_file", PyBytes::new(py, &encode_response(response)))?;
    out.set_item("document", document.to_string())?;
    out.set_item("warnings", warnings)?;
    Ok(out)
}

/// Returns the main exposure of each pixel, from 0. The value is -1 if all exposures are clipped,
/// -2 if all are black, -3 if they contradict each other.
fn origin<'py>(py: Python<'py>, known: &Plane<MergedPixelStatus>) -> Bound<'py, PyArray2<i16>> {
    let (width, height) = known.size();
    let code = |known: &MergedPixelStatus| match known {
        MergedPixelStatus::From(exposure) => i16::from(*exposure),
        MergedPixelStatus::Clipped => -1,
        MergedPixelStatus::Dark => -2,
        MergedPixelStatus::Inconsistent => -3,
    };
    arrays::array(py, (height, width), known.as_slice().iter().map(code).collect())
}
