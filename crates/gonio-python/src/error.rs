//! What can go wrong, and the exception that it becomes: the classes of `gonio._errors`, with the
//! messages of the library.

use std::fmt::Display;
use std::io::ErrorKind;
use std::sync::Mutex;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Why something was not done.
pub(crate) struct Problem {
    message: String,
    /// What the operating system said, if it was asked.
    io: Option<ErrorKind>,
}

impl Problem {
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), io: None }
    }

    /// A fault in something that has a name.
    pub(crate) fn of(name: impl Display, error: impl Display) -> Self {
        Self::new(format!("{name}: {error}"))
    }

    /// The exception: [`Problem`]s of files are also `OSError`s.
    pub(crate) fn raise(self, py: Python<'_>) -> PyErr {
        static INPUT: PyOnceLock<Py<PyType>> = PyOnceLock::new();
        static FILE: PyOnceLock<Py<PyType>> = PyOnceLock::new();
        static MISSING: PyOnceLock<Py<PyType>> = PyOnceLock::new();
        let (class, name) = match self.io {
            None => (&INPUT, "GonioError"),
            Some(ErrorKind::NotFound) => (&MISSING, "MissingFileError"),
            Some(_) => (&FILE, "FileError"),
        };
        match class.import(py, "gonio._errors", name) {
            Ok(class) => PyErr::from_type(class.clone(), self.message),
            Err(error) => error,
        }
    }
}

impl From<gonio_io::Error> for Problem {
    fn from(error: gonio_io::Error) -> Self {
        Self { io: error.io_kind(), message: error.to_string() }
    }
}

/// What the last panic said. Decoders of third parties panic on damaged files; `gonio-io` catches
/// that and says what is wrong in one line, to which the message of the panic would only add noise.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Keeps panics from being printed.
pub(crate) fn keep_panics_quiet() {
    std::panic::set_hook(Box::new(|panic| {
        if let Ok(mut noted) = PANIC.lock() {
            *noted = panic.to_string();
        }
    }));
}

/// The exception for a panic of our own.
pub(crate) fn fault() -> PyErr {
    let said = PANIC.lock().map(|noted| noted.clone()).unwrap_or_default();
    PyRuntimeError::new_err(format!("a fault of gonio itself: {said}; please report it"))
}
