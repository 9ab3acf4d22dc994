//! Draws from a posterior.

use gonio::estimate::draws;
use gonio::reflectance::{THETA_D, THETA_H};
use gonio_app::Problem;
use numpy::PyArray3;
use pyo3::prelude::*;

use crate::arrays;
use crate::error::raise;
use crate::model::Model;
use crate::work::{self, Listeners};

/// Embedding of a photograph, which weighs the materials of a model.
#[pyclass(frozen, module = "gonio._gonio")]
pub(crate) struct Embedding(pub(crate) Vec<f32>);

#[pymethods]
impl Embedding {
    /// Decodes the pickled form.
    #[staticmethod]
    fn decode(py: Python<'_>, json: &str) -> PyResult<Self> {
        let embedding = serde_json::from_str(json).map_err(|e| raise(&Problem::of("the pickled posterior", e), py))?;
        Ok(Self(embedding))
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
    embedding: &Bound<'py, Embedding>,
    count: usize,
    seed: u64,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (model, embedding) = (model.get().model.clone(), embedding.get().0.clone());
    let listeners = Listeners::none();
    let tables = work::run(py, listeners, move |_| {
        let tables = draws(&model, &embedding, count, seed).map_err(|e| Problem::new(e.to_string()))?;
        Ok(tables.into_iter().flat_map(Vec::<f32>::from).collect::<Vec<f32>>())
    })?;
    Ok(arrays::array(py, (count, THETA_H, THETA_D), tables))
}
