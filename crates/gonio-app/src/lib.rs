//! The application layer shared by all front ends: the program, the Python package and the web
//! page.
//!
//! A [`Scene`] specifies the photograph and the shape of its object. [`infer`] reads the scene,
//! detects the object and estimates its BRDF according to the [`Settings`]. It returns an
//! [`InferenceResult`]; [`InferenceResult::files`] are the contents of the folder of results. A
//! [`ProgressLog`] reports progress. Errors are [`AppError`]s, which name the faulty input, and
//! [`Warning`]s; both carry [suggestions](gonio::suggestion::Suggestion), which each front end
//! words in its own terms.

#![deny(clippy::print_stdout, clippy::print_stderr)]

mod check;
mod coded_floats;
pub mod combine;
pub mod compare;
pub mod document;
pub mod draws;
pub mod export;
pub mod folder;
mod inference;
mod inpaint;
mod mask;
mod mirror;
pub mod names;
pub mod panics;
mod paper;
pub mod photograph;
mod probe;
mod problem;
mod progress_log;
mod reference;
pub mod regions;
pub mod results;
mod scene;
mod settings;
mod shape;
pub mod spaces;
pub mod training;

pub use check::{CheckError, CheckResult, DetectedObject, check};
pub use gonio::estimate::Alignment;
pub use inference::{InferenceResult, contradiction, infer, read_light};
pub use mirror::MirrorBall;
pub use photograph::{Curve, Photograph, PhotographSource, Reading};
pub use probe::{LightProbe, ProbePhotographs, light_probe};
pub use problem::{AppError, SuggestionFormatter, Warning};
pub use progress_log::ProgressLog;
pub use reference::{GREY_REFLECTANCE, MeasuredReference, Reference, ReferenceTarget, WHITE_REFLECTANCE};
pub use scene::{ObservedScene, Scene};
pub use settings::{AS_CAPTURED, ColourMode, EnvironmentSource, KnownLight, Method, Settings};
pub use shape::{NormalSource, PositionSource, Shape, ShapeKind, Source};
pub use spaces::{Spaces, read_brdf};
