//! The extension module `gonio._gonio`: functions of the library for the Python package.
//!
//! The functions use plain arrays and dictionaries. Classes, defaults and documentation are in
//! `python/gonio`, the types of this module in `_gonio.pyi`.
//!
//! Long computations run on a separate thread without the interpreter's lock and stop on Ctrl-C
//! (`work`). Arrays are passed without copies (`arrays`).

mod arrays;
mod check;
mod compare;
mod error;
mod export;
mod files;
mod infer;
mod likelihood;
mod model;
mod probe;
mod render;
mod scene;
mod train;
mod work;

use pyo3::prelude::*;

/// Internal functions of the package `gonio`; not for direct use.
#[pymodule]
mod _gonio {
    #[pymodule_export]
    use super::check::{check, merge};
    #[pymodule_export]
    use super::compare::compare;
    #[pymodule_export]
    use super::export::{export, export_targets};
    #[pymodule_export]
    use super::files::{
        colour_spaces, convert_colours, encode_png, read_brdf, read_file, read_image, read_light, read_normals, save,
        write_brdf, write_file, write_image,
    };
    #[pymodule_export]
    use super::infer::{infer, infer_regions};
    #[pymodule_export]
    use super::likelihood::{Likelihood, combine_all, draw};
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::probe::light_probe;
    #[pymodule_export]
    use super::render::{eval, highlights, normal_albedo, render, studio};
    #[pymodule_export]
    use super::train::{join, train_colours, train_lighting, train_posterior, train_reflectance};
    #[pymodule_export]
    use super::work::set_threads;
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        gonio_app::panics::record();
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
