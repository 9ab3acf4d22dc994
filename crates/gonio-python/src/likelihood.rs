//! Likelihood of a material given photographs: draws from the posterior, and combinations.

use std::path::PathBuf;

use gonio::estimate::{draws, predictive_draws};
use gonio::reflectance::{THETA_D, THETA_H};
use gonio_app::combine::{self, CombinedResult};
use gonio_app::{AppError, ProgressLog};
use gonio_io::posterior::SavedPosterior;
use gonio_io::result;
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::error::raise;
use crate::infer::{of_material, shown};
use crate::model::Model;
use crate::work::{self, Listeners};

/// Likelihood of the materials of a model given photographs.
#[pyclass(frozen, module = "gonio._gonio")]
pub(crate) struct Likelihood(pub(crate) SavedPosterior);

#[pymethods]
impl Likelihood {
    /// Decodes the pickled form.
    #[staticmethod]
    fn decode(py: Python<'_>, json: &str) -> PyResult<Self> {
        let saved = serde_json::from_str(json).map_err(|e| raise(&AppError::of("the pickled posterior", e), py))?;
        Ok(Self(saved))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        let json = serde_json::to_string(&self.0).map_err(|e| raise(&AppError::new(e.to_string()), py))?;
        Ok((py.get_type::<Self>().getattr("decode")?, (json,)))
    }
}

/// Draws tables from a posterior, or with `errors` from its predictive distribution: shape (count,
/// 90, 90).
#[pyfunction]
pub(crate) fn draw<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    likelihood: &Bound<'py, Likelihood>,
    count: usize,
    seed: u64,
    errors: bool,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (model, likelihood) = (model.get().model.clone(), likelihood.get().0.likelihood.clone());
    let listeners = Listeners::none();
    let tables = work::run(py, listeners, move |_| {
        let draw = if errors { predictive_draws } else { draws };
        let tables = draw(&model, &likelihood, count, seed).map_err(|e| AppError::new(e.to_string()))?;
        Ok(tables.into_iter().flat_map(Vec::<f32>::from).collect::<Vec<f32>>())
    })?;
    Ok(arrays::array(py, (count, THETA_H, THETA_D), tables))
}

/// Likelihood of one photograph, in memory or in a result folder.
#[derive(FromPyObject)]
pub(crate) enum LikelihoodArg<'py> {
    Found((String, Bound<'py, Likelihood>)),
    Folder(PathBuf),
}

/// Combines the likelihoods of several photographs; returns the values of a `Combined` by name.
#[pyfunction]
pub(crate) fn combine_all<'py>(
    py: Python<'py>,
    given: Vec<LikelihoodArg<'py>>,
    model: &Bound<'py, Model>,
    listeners: Listeners,
) -> PyResult<Bound<'py, PyDict>> {
    let mut all = Vec::new();
    for one in given {
        match one {
            LikelihoodArg::Found((name, likelihood)) => all.push((name, likelihood.get().0.clone())),
            LikelihoodArg::Folder(path) => all.extend(combine::read_posteriors(&[path]).map_err(|e| raise(&e, py))?),
        }
    }
    let (known, name) = (model.get().model.clone(), model.get().name.clone());
    let combined = work::run(py, listeners, move |reporter| {
        let listener = |stage, fraction| reporter.at(stage, fraction);
        combine::combine((&known, &name), &all, &ProgressLog::new("reading", &listener))
    })?;
    let CombinedResult { material, field, agreement, pictures, document, saved, .. } = combined;
    let out = of_material(py, &material, (&field, None), 1.0)?;
    out.set_item("likelihood", Likelihood(saved))?;
    out.set_item("agreement", agreement)?;
    out.set_item("pictures", shown(py, pictures)?)?;
    out.set_item("document", result::encode(&document))?;
    out.set_item("model", model)?;
    Ok(out)
}
