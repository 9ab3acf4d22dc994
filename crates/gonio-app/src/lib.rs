//! From files to a folder of results, for every front end: the program, the Python package and the
//! page translate what they are asked for, and show what goes on.
//!
//! A [`Scene`] says where the photograph and the shape of its object come from; [`infer`] reads it,
//! finds the object, and finds what it is made of: an [`Answer`], whose [`Answer::files`] make a
//! folder. [`Settings`] say how. A [`Journal`] tells how far it is. What is wrong is a [`Problem`]
//! that names the input at fault, what is odd a [`Warning`]; both carry
//! [remedies](gonio::remedy::Remedy), which each front end words in its own terms.

#![deny(clippy::print_stdout, clippy::print_stderr)]

mod answer;
mod basis;
mod check;
pub mod combine;
pub mod compare;
pub mod export;
pub mod folder;
mod journal;
mod mask;
pub mod notes;
pub mod photograph;
pub mod plan;
mod probe;
mod problem;
mod reference;
pub mod regions;
pub mod results;
mod scene;
mod settings;
mod shape;
pub mod spaces;
pub mod training;

pub use answer::{Answer, infer, read_light};
pub use check::{Checked, Looked, Unchecked, check};
pub use gonio::estimate::Alignment;
pub use journal::Journal;
pub use photograph::{Curve, Photograph, Reading, Shots};
pub use probe::{LightProbe, Mirror, light_probe};
pub use problem::{Problem, Warning, Words};
pub use reference::{GREY_REFLECTANCE, MeasuredReference, Reference, ReferenceTarget, WHITE_REFLECTANCE};
pub use scene::{Scene, Seen};
pub use settings::{AS_CAPTURED, Colours, KnownLight, Method, Search, Settings};
pub use shape::{Form, Normals, Places, Shape, Source};
pub use spaces::{Spaces, read_brdf};
