//! Converts errors to the Python exceptions of `gonio._errors`.

use std::io::ErrorKind;

use gonio::scene::Circle;
use gonio::suggestion::Suggestion;
use gonio_app::{AppError, Warning, panics};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Returns the text of a suggestion, in terms of the arguments of the package.
pub(crate) fn words(suggestion: &Suggestion) -> Option<String> {
    let words = match suggestion {
        Suggestion::Inflate => "use shape=\"outline\" if the object is smooth",
        Suggestion::MirrorBall => "check mirror_ball=(x, y, radius)",
        Suggestion::Outline => "specify the outline of the ball with circle=(x, y, radius)",
        Suggestion::Ellipsoid => "use shape=\"ellipsoid\" if the object is an ellipsoid",
        Suggestion::DepthAxis => "specify it with depth_axis=PIXELS if it is known",
        Suggestion::Camera => "specify the camera with camera=",
        Suggestion::Pose => "check pose=",
        Suggestion::Mask => "specify a mask with mask=",
        Suggestion::Mesh => "specify the shape with shape=MESH",
        Suggestion::Normals => "specify the shape with normals=",
        Suggestion::NormalAxes(corrections) => {
            let first = corrections.first()?;
            let order = first.reordered().map(|order| format!("normals_order=\"{order}\""));
            let flips = first.flips().into_iter().map(|axis| format!("normals_flip_{axis}=True"));
            let given = order.into_iter().chain(flips).collect::<Vec<_>>().join(" and ");
            return Some(format!("use {given}"));
        }
        Suggestion::OneOf(circles) => {
            let argument = |circle: &Circle| format!("circle=({:.1}, {:.1}, {:.1})", circle.x, circle.y, circle.radius);
            let listed: Vec<String> = circles.iter().map(argument).collect();
            return (!listed.is_empty()).then(|| format!("select one with {}", listed.join(" or ")));
        }
        Suggestion::TrustNormals => "skip this check with trust_normals=True",
        Suggestion::OneMaterial => "to use all pixels unchanged, specify one_material=True",
        Suggestion::AlignLight => "search for the rotation of the environment map with align_light=\"vertical\"",
        Suggestion::Force => "use force=True to estimate anyway",
        Suggestion::Linear => "use linear=True if the values are linear radiance",
        Suggestion::Layer => "select another layer with layer=NAME",
        Suggestion::Separately => "pass one photograph at a time, or use infer_many for several",
        Suggestion::DepthRange => "specify the range with depth_range=(near, far)",
        Suggestion::ChartCorners => {
            "specify the centres of its corner patches (dark skin, bluish green, black, white) with color_checker=[(x, y), ...]"
        }
        Suggestion::ClipLevel => "if they are not clipped, specify the clip level with clip=",
        Suggestion::ReferenceColourOnly => "use only its colour with reference_color_only=True",
        Suggestion::Times => "specify them with times=[...]",
        Suggestion::TrustTimes => "use trust_times=True to merge anyway and ignore inconsistent pixels",
        Suggestion::Response => "specify the response curve with response=",
        Suggestion::SecondAzimuth => "specify the angle with second_azimuth=DEGREES",
        Suggestion::SecondOutline => "specify the outline of the ball with second_circle=(x, y, radius)",
        Suggestion::SecondMask => "specify a mask with second_mask=",
        Suggestion::OtherFolder => "use another folder",
        Suggestion::LearnPosterior => {
            "train one with train_posterior and add it with train_model, or use another method="
        }
    };
    Some(words.to_owned())
}

/// Returns the texts of warnings for users of the package.
pub(crate) fn worded(warnings: &[Warning]) -> Vec<String> {
    warnings.iter().map(|warning| warning.worded(&words)).collect()
}

/// Creates the exception for an error; exceptions for files are also `OSError`s.
pub(crate) fn raise(problem: &AppError, py: Python<'_>) -> PyErr {
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

/// Creates the exception for an internal panic.
pub(crate) fn fault() -> PyErr {
    PyRuntimeError::new_err(format!("internal error: {}; please report this bug", panics::message()))
}
