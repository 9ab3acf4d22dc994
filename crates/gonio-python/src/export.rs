//! Files for renderers.

use std::path::PathBuf;

use gonio::lighting::EnvironmentMap;
use gonio_app::AppError;
use gonio_app::export::{Export, Target};
use gonio_app::folder::for_exports;
use gonio_io::colour_space::ColourSpace;
use gonio_io::result;
use numpy::{PyArray3, PyArray4};
use pyo3::prelude::*;

use crate::arrays;
use crate::error::raise;
use crate::render::merl_table;
use crate::work::{self, Listeners};

/// Returns the names and descriptions of the targets.
#[pyfunction]
pub(crate) fn export_targets() -> Vec<(&'static str, &'static str)> {
    Target::ALL.map(Target::names).into()
}

/// Writes the files for renderers to a folder; returns the contents of its `export.json`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "called from one place, which names them")]
#[pyo3(signature = (folder, table, full, light, to, name, albedo, absolute, roughness, tables, draws, colorspace, input, listeners))]
pub(crate) fn export(
    py: Python<'_>,
    folder: PathBuf,
    table: &Bound<'_, PyArray3<f32>>,
    full: Option<&Bound<'_, PyArray4<f32>>>,
    light: Option<&Bound<'_, PyArray3<f32>>>,
    to: Option<Vec<String>>,
    name: String,
    albedo: Option<f64>,
    absolute: bool,
    roughness: Option<[f64; 2]>,
    tables: bool,
    draws: Vec<Bound<'_, PyArray3<f32>>>,
    colorspace: String,
    input: String,
    listeners: Listeners,
) -> PyResult<String> {
    let wanted = |to: Vec<String>| -> Result<Vec<Target>, AppError> {
        let all = || Target::ALL.map(|target| target.names().0).join(", ");
        let target = |name: &String| {
            Target::named(name).ok_or_else(|| AppError::new(format!("to {name:?}: must be among {}", all())))
        };
        to.iter().map(target).collect()
    };
    let targets = to.map_or_else(|| Ok(Target::DEFAULT.to_vec()), wanted).map_err(|problem| raise(&problem, py))?;
    if let Some(albedo) = albedo.filter(|a| !(*a > 0.0 && *a <= 1.0)) {
        return Err(raise(&AppError::new(format!("albedo {albedo}: must be above 0 and at most 1")), py));
    }
    let full_table = full.map(merl_table).transpose()?;
    let light = light.map(arrays::colours).transpose()?.map(EnvironmentMap::new).transpose();
    let light = light.map_err(|error| raise(&AppError::of("the light", error), py))?;
    // The package has checked the name.
    let space = ColourSpace::named(&colorspace).unwrap_or_default();
    let tables_of = arrays::tables(table)?;
    let draws = draws.iter().map(arrays::tables).collect::<PyResult<Vec<_>>>()?;
    let export = Export {
        name,
        tables: tables_of,
        full_table,
        light,
        space,
        albedo,
        absolute,
        roughness,
        with_tables: tables,
        draws,
    };
    work::run(py, listeners, move |reporter| {
        let folder = for_exports(&folder)?;
        let summary = export.write(&folder, &targets, &input, &|x| reporter.at("fitting models", x))?;
        folder.commit()?;
        Ok(result::encode(&summary))
    })
}
