//! Models, which are decoded only once.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gonio_io::atomic::write_file;
use gonio_io::model::{decode_model, embedded, encode_model, read_model};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::error::raise;

/// Model of an inference: light prior, reflectance basis and posterior of materials.
///
/// A model comes from a file, from `gonio.train_model`, or is embedded in the package. Models can
/// be pickled.
#[pyclass(frozen, module = "gonio")]
pub(crate) struct Model {
    pub(crate) model: Arc<gonio::model::Model>,
    /// Name in messages.
    pub(crate) name: String,
    is_embedded: bool,
}

/// Name of the embedded model in messages.
const EMBEDDED: &str = "the embedded model";

impl Model {
    /// Wraps a newly trained model.
    pub(crate) fn learnt(model: Arc<gonio::model::Model>) -> Self {
        Self { model, name: "the model".into(), is_embedded: false }
    }
}

#[pymethods]
impl Model {
    /// Return the embedded model, which is decoded on the first call.
    ///
    /// Returns
    /// -------
    /// Model
    ///     The embedded model.
    #[staticmethod]
    fn embedded(py: Python<'_>) -> PyResult<Py<Self>> {
        static MODEL: PyOnceLock<Py<Model>> = PyOnceLock::new();
        let decode = || -> PyResult<Py<Self>> {
            let model = py.detach(embedded).map_err(|e| raise(&e.into(), py))?;
            Py::new(py, Self { model: Arc::new(model), name: EMBEDDED.into(), is_embedded: true })
        };
        Ok(MODEL.get_or_try_init(py, decode)?.clone_ref(py))
    }

    /// Read a model from a file.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     The file.
    ///
    /// Returns
    /// -------
    /// Model
    ///     Model for the argument `model` of `gonio.infer`.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let model = py.detach(|| read_model(&path)).map_err(|e| raise(&e.into(), py))?;
        Ok(Self { model: Arc::new(model), name: path.display().to_string(), is_embedded: false })
    }

    /// Decode a model from the bytes of its file.
    ///
    /// Parameters
    /// ----------
    /// bytes : bytes
    ///     The contents of the file.
    /// name : str
    ///     Name in messages.
    ///
    /// Returns
    /// -------
    /// Model
    ///     The decoded model.
    #[staticmethod]
    fn decode(py: Python<'_>, bytes: &[u8], name: String) -> PyResult<Self> {
        let model = decode_model(Path::new(&name), bytes).map_err(|e| raise(&e.into(), py))?;
        Ok(Self { model: Arc::new(model), name, is_embedded: false })
    }

    /// Write the model to a file, atomically.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     The file.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_file(&path, &encode_model(&self.model))).map_err(|e| raise(&e.into(), py))
    }

    /// Training data and settings.
    #[getter]
    fn provenance(&self) -> &str {
        &self.model.provenance
    }

    /// Largest supported light grid, in texels per side.
    #[getter]
    fn largest_grid(&self) -> usize {
        self.model.light.finest_side()
    }

    /// Whether the model has a posterior of materials, which the default method requires.
    #[getter]
    fn has_posterior(&self) -> bool {
        self.model.learnt.is_some()
    }

    fn __repr__(&self) -> String {
        format!("<gonio.Model: {}>", self.name)
    }

    /// Pickles the embedded model by reference, and other models by value.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let class = py.get_type::<Self>();
        if self.is_embedded {
            return Ok((class.getattr("embedded")?, pyo3::types::PyTuple::empty(py).into_any()));
        }
        let bytes = pyo3::types::PyBytes::new(py, &py.detach(|| encode_model(&self.model)));
        Ok((class.getattr("decode")?, (bytes, &self.name).into_pyobject(py)?.into_any()))
    }
}
