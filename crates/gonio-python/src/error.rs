//! Problems as Python exceptions: the classes of `gonio._errors`, with the messages of the library.

use std::io::ErrorKind;
use std::sync::Mutex;

use gonio::remedy::Remedy;
use gonio::scene::Circle;
use gonio_app::{Problem, Warning};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Remedy in the words of the package: its arguments.
pub(crate) fn words(remedy: &Remedy) -> Option<String> {
    let words = match remedy {
        Remedy::Outline => "give the outline of the ball with circle=(x, y, radius)",
        Remedy::Ellipsoid => "say shape=\"ellipsoid\" if it is one",
        Remedy::DepthAxis => "give it with depth_axis=PIXELS if you know it",
        Remedy::Camera => "give the camera with camera=",
        Remedy::Pose => "check pose=",
        Remedy::Mask => "give a mask with mask=",
        Remedy::Mesh => "give the shape with shape=MESH",
        Remedy::Normals => "give the shape with normals=",
        Remedy::NormalAxes(corrections) => {
            let first = corrections.first()?;
            let order = first.reordered().map(|order| format!("normals_order=\"{order}\""));
            let flips = first.flips().into_iter().map(|axis| format!("normals_flip_{axis}=True"));
            let given = order.into_iter().chain(flips).collect::<Vec<_>>().join(" and ");
            return Some(format!("give {given}"));
        }
        Remedy::OneOf(circles) => {
            let argument = |circle: &Circle| format!("circle=({:.1}, {:.1}, {:.1})", circle.x, circle.y, circle.radius);
            let listed: Vec<String> = circles.iter().map(argument).collect();
            return (!listed.is_empty()).then(|| format!("give the right one with {}", listed.join(" or ")));
        }
        Remedy::TrustNormals => "take them as they are with trust_normals=True",
        Remedy::KeepColours => "use them with keep_colors=True",
        Remedy::Linear => "give linear=True if its values are linear radiance",
        Remedy::Layer => "take another with layer=NAME",
        Remedy::Separately => "give each photograph by itself, or all of them to infer_many",
        Remedy::DepthRange => "give the range with depth_range=(near, far)",
        Remedy::ChartCorners => {
            "give the centres of its corner patches (dark skin, bluish green, black, white) with color_checker=[(x, y), ...]"
        }
        Remedy::ClipLevel => "give the level with clip= if they are not clipped",
        Remedy::ReferenceColourOnly => "use its colour alone with reference_color_only=True",
        Remedy::Times => "times=[...] takes them",
        Remedy::Turn => "give the angle with second_yaw=DEGREES",
        Remedy::SecondOutline => "give the outline of the ball with second_circle=(x, y, radius)",
        Remedy::SecondMask => "give a mask with second_mask=",
        Remedy::LearnPosterior => {
            "learn one with train_posterior and join it with train_model, or choose another method="
        }
        _ => return None,
    };
    Some(words.to_owned())
}

/// Warnings in the words of the package.
pub(crate) fn worded(warnings: &[Warning]) -> Vec<String> {
    warnings.iter().map(|warning| warning.worded(&words)).collect()
}

/// Exception for a problem; exceptions for files are also `OSError`s.
pub(crate) fn raise(problem: &Problem, py: Python<'_>) -> PyErr {
    static INPUT: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    static FILE: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    static MISSING: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let (class, name) = match problem.io_kind() {
        None => (&INPUT, "GonioError"),
        Some(ErrorKind::NotFound) => (&MISSING, "MissingFileError"),
        Some(_) => (&FILE, "FileError"),
    };
    match class.import(py, "gonio._errors", name) {
        Ok(class) => PyErr::from_type(class.clone(), problem.worded(&words)),
        Err(error) => error,
    }
}

/// Message of the last panic. Third-party decoders panic on damaged files; `gonio-io` catches that
/// and reports the problem in one line, to which the message of the panic would only add noise.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Keeps panics from being printed.
pub(crate) fn keep_panics_quiet() {
    std::panic::set_hook(Box::new(|panic| {
        if let Ok(mut noted) = PANIC.lock() {
            *noted = panic.to_string();
        }
    }));
}

/// Exception for a panic of gonio itself.
pub(crate) fn fault() -> PyErr {
    let said = PANIC.lock().map(|noted| noted.clone()).unwrap_or_default();
    PyRuntimeError::new_err(format!("a fault of gonio itself: {said}; please report it"))
}
