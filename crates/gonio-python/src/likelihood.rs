//! Draws from a posterior.

use gonio::estimate::draws;
use gonio::inference::Likelihood;
use gonio::reflectance::{THETA_D, THETA_H};
use gonio_app::Problem;
use numpy::PyArray3;
use pyo3::prelude::*;

use crate::arrays;
use crate::error::raise;
use crate::model::Model;
use crate::work::{self, Listeners};

/// What photographs say of a material.
#[pyclass(frozen, name = "Likelihood", module = "gonio._gonio")]
pub(crate) struct SavedLikelihood(pub(crate) Likelihood);

#[pymethods]
impl SavedLikelihood {
    /// Decodes the pickled form.
    #[staticmethod]
    fn decode(py: Python<'_>, json: &str) -> PyResult<Self> {
        let likelihood = serde_json::from_str(json).map_err(|e| raise(&Problem::of("the pickled posterior", e), py))?;
        Ok(Self(likelihood))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        let json = serde_json::to_string(&self.0).map_err(|e| raise(&Problem::new(e.to_string()), py))?;
        Ok((py.get_type::<Self>().getattr("decode")?, (json,)))
    }
}

/// Draws from a posterior: shape (count, 90, 90).
#[pyfunction]
pub(crate) fn draw<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    likelihood: &Bound<'py, SavedLikelihood>,
    count: usize,
    seed: u64,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (model, likelihood) = (model.get().model.clone(), likelihood.get().0.clone());
    let listeners = Listeners::none();
    let tables = work::run(py, listeners, move |_| {
        let tables = draws(&model, &likelihood, count, seed).map_err(|e| Problem::new(e.to_string()))?;
        Ok(tables.into_iter().flat_map(Vec::<f32>::from).collect::<Vec<f32>>())
    })?;
    Ok(arrays::array(py, (count, THETA_H, THETA_D), tables))
}
