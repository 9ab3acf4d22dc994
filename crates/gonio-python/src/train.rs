//! Training of models.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gonio::lighting::EnvironmentMap;
use gonio::reflectance::BivariateTable;
use gonio_app::AppError;
use gonio_app::names::{CHANNELS, MAPPINGS, named};
use gonio_app::training::{
    self, LightingSettings, Lights, Materials, PosteriorSettings, ReflectanceSettings, Resumption,
};
use gonio_io::model::{
    decode_lighting, decode_posterior, decode_reflectance, encode_lighting, encode_posterior, encode_reflectance,
};
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays;
use crate::error::raise;
use crate::model::Model;
use crate::work::{self, Listeners};

/// Lights: a folder, or maps.
#[derive(FromPyObject)]
pub(crate) enum GivenLights<'py> {
    Folder(PathBuf),
    Maps(Vec<Bound<'py, PyArray3<f32>>>),
}

impl GivenLights<'_> {
    fn take(self) -> PyResult<Lights> {
        let maps = match self {
            Self::Folder(folder) => return Ok(Lights::Folder(folder)),
            Self::Maps(maps) => maps,
        };
        let map = |(i, map): (usize, Bound<'_, PyArray3<f32>>)| {
            let picture = arrays::colours(&map)?;
            EnvironmentMap::new(picture).map_err(|e| raise(&AppError::of(format!("light {i}"), e), map.py()))
        };
        Ok(Lights::Maps(maps.into_iter().enumerate().map(map).collect::<PyResult<_>>()?))
    }
}

/// Materials: a folder, or names and tables.
#[derive(FromPyObject)]
pub(crate) enum GivenMaterials<'py> {
    Folder(PathBuf),
    Tables(Vec<(String, Bound<'py, PyArray3<f32>>)>),
}

impl GivenMaterials<'_> {
    fn take(self) -> PyResult<Materials> {
        let tables = match self {
            Self::Folder(folder) => return Ok(Materials::Folder(folder)),
            Self::Tables(tables) => tables,
        };
        let one = |(name, table): (String, Bound<'_, PyArray3<f32>>)| -> PyResult<(String, [BivariateTable; 3])> {
            Ok((name, arrays::tables(&table)?))
        };
        Ok(Materials::Tables(tables.into_iter().map(one).collect::<PyResult<_>>()?))
    }
}

/// Settings for learning the light prior.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LightingOptions {
    grid: usize,
    mapping: String,
    rotations: usize,
    cap: Option<f64>,
    seed: u64,
}

/// Bytes of a model file that was not written to disk, and the note of its origin.
type Part = (Py<PyBytes>, String);

/// Learns the light prior.
#[pyfunction]
pub(crate) fn train_lighting(
    py: Python<'_>,
    lights: GivenLights<'_>,
    options: LightingOptions,
    listeners: Listeners,
) -> PyResult<Part> {
    let lights = lights.take()?;
    let (bytes, provenance) = work::run(py, listeners, move |reporter| {
        let LightingOptions { grid, mapping, rotations, cap, seed } = options;
        let map = named("mapping", &mapping, MAPPINGS)?;
        if !(1..=64).contains(&rotations) {
            return Err(AppError::new(format!("rotations {rotations}: must be from 1 to 64")));
        }
        let settings = LightingSettings { grid, map, rotations, cap, seed };
        let (prior, provenance) = training::lighting(&lights, &settings, &|stage, x| reporter.at(stage, x))?;
        Ok((encode_lighting(&prior, &provenance), provenance))
    })?;
    Ok((PyBytes::new(py, &bytes).unbind(), provenance))
}

/// Settings for learning the reflectance basis.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ReflectanceOptions {
    rank: usize,
    channel: String,
    starts: Option<usize>,
    seed: u64,
}

/// Root mean square errors by material.
type Errors = Vec<(String, f64)>;

/// Learns the reflectance basis; also returns the error of each material.
#[pyfunction]
pub(crate) fn train_reflectance(
    py: Python<'_>,
    materials: GivenMaterials<'_>,
    options: ReflectanceOptions,
    listeners: Listeners,
) -> PyResult<(Py<PyBytes>, String, Errors)> {
    let materials = materials.take()?;
    let (bytes, provenance, errors) = work::run(py, listeners, move |reporter| {
        let default = ReflectanceSettings::default();
        let settings = ReflectanceSettings {
            rank: options.rank,
            channel: named("channel", &options.channel, CHANNELS)?,
            starts: options.starts.unwrap_or(default.starts),
            seed: options.seed,
        };
        let (basis, report, provenance) =
            training::reflectance(&materials, &settings, &|stage, x| reporter.at(stage, x))?;
        let errors: Errors = report.fits.into_iter().map(|fit| (fit.name, fit.rms)).collect();
        Ok((encode_reflectance(&basis, &provenance), provenance, errors))
    })?;
    Ok((PyBytes::new(py, &bytes).unbind(), provenance, errors))
}

/// Settings for learning the posterior of materials.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PosteriorOptions {
    channel: String,
    views: Option<usize>,
    group_materials: Option<usize>,
    steps: Option<usize>,
    initial: Option<Py<Model>>,
    seed: u64,
}

/// Learns the posterior of materials.
#[pyfunction]
pub(crate) fn train_posterior(
    py: Python<'_>,
    lights: GivenLights<'_>,
    materials: GivenMaterials<'_>,
    options: PosteriorOptions,
    listeners: Listeners,
) -> PyResult<Part> {
    let (lights, materials) = (lights.take()?, materials.take()?);
    let (bytes, provenance) = work::run(py, listeners, move |reporter| {
        let default = PosteriorSettings::default();
        let initial = |model: &Py<Model>| training::initial(&model.get().model, &model.get().name);
        let settings = PosteriorSettings {
            initial: options.initial.as_ref().map(initial).transpose()?,
            channel: named("channel", &options.channel, CHANNELS)?,
            views: options.views.unwrap_or(default.views),
            group_materials: options.group_materials.unwrap_or(default.group_materials),
            steps: options.steps.unwrap_or(default.steps),
            seed: options.seed,
            ..default
        };
        let resumption = Resumption { start: None, keep: &|_| () };
        let materials = std::slice::from_ref(&materials);
        let (learnt, _, provenance) =
            training::posterior(&lights, materials, &settings, resumption, &|stage, x| reporter.at(stage, x))?;
        Ok((encode_posterior(&learnt, &provenance), provenance))
    })?;
    Ok((PyBytes::new(py, &bytes).unbind(), provenance))
}

/// Trains only the colour model of an existing model.
#[pyfunction]
pub(crate) fn train_colours(
    py: Python<'_>,
    model: Py<Model>,
    lights: GivenLights<'_>,
    materials: GivenMaterials<'_>,
    listeners: Listeners,
) -> PyResult<Model> {
    let (lights, materials) = (lights.take()?, materials.take()?);
    let recoloured = work::run(py, listeners, move |reporter| {
        let mut model = (*model.get().model).clone();
        training::recolour(&mut model, &lights, &[materials], &|stage, x| reporter.at(stage, x))?;
        Ok(model)
    })?;
    Ok(Model::learnt(Arc::new(recoloured)))
}

/// Bytes of a part of a model, and its name in messages.
type GivenPart = Option<(Vec<u8>, String)>;

/// Joins the parts of a model.
#[pyfunction]
#[pyo3(signature = (lighting, reflectance, posterior))]
pub(crate) fn join(
    py: Python<'_>,
    lighting: GivenPart,
    reflectance: GivenPart,
    posterior: GivenPart,
) -> PyResult<Model> {
    fn decoded<T>(
        part: GivenPart,
        decode: impl Fn(&Path, &[u8]) -> Result<T, gonio_io::Error>,
    ) -> Result<Option<T>, gonio_io::Error> {
        part.map(|(bytes, name)| decode(Path::new(&name), &bytes)).transpose()
    }
    let join = || -> Result<_, AppError> {
        let light = decoded(lighting, decode_lighting)?;
        let basis = decoded(reflectance, decode_reflectance)?;
        Ok(training::join(light, basis, decoded(posterior, decode_posterior)?)?)
    };
    let model = py.detach(join).map_err(|problem| raise(&problem, py))?;
    Ok(Model::learnt(Arc::new(model)))
}
