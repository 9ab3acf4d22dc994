//! Reading and writing files.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use gonio::picture::Picture;
use gonio::reflectance::{CELLS, MerlTable, PHI_D, THETA_D, THETA_H};
use gonio_app::AppError;
use gonio_app::folder::for_results;
use gonio_app::photograph::read_picture;
use gonio_app::results::{Files, PICTURES, levels};
use gonio_io::atomic::write_file as write_whole;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{ExrOptions, ReadOptions, encode_exr_with, encode_hdr, encode_pfm, encode_png_srgb8};
use gonio_io::result::{ResultFile, decode};
use gonio_io::result_brdf::BrdfQuantiles;
use numpy::ndarray::Axis;
use numpy::{PyArray2, PyArray3, PyArray4, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays;
use crate::error::{raise, worded};
use crate::likelihood::Likelihood;
use crate::render::merl_table;

/// Colours, coverage, clip level of the file, and warnings.
type ReadImage<'py> = (Bound<'py, PyArray3<f32>>, Option<Bound<'py, PyArray2<f32>>>, Option<f32>, Vec<String>);

/// Returns the colour space of a name that the package has checked.
fn named(name: Option<&str>) -> Option<ColourSpace> {
    name.and_then(ColourSpace::named)
}

/// Reads a picture.
#[pyfunction]
#[pyo3(signature = (path, linear, layer, colorspace))]
pub(crate) fn read_image(
    py: Python<'_>,
    path: PathBuf,
    linear: bool,
    layer: Option<String>,
    colorspace: Option<String>,
) -> PyResult<ReadImage<'_>> {
    let mut warnings = Vec::new();
    let colour_space = named(colorspace.as_deref());
    let options = ReadOptions { linear, layer, colour_space, ..ReadOptions::default() };
    let decoded = py.detach(|| read_picture(&path, &options, &mut warnings)).map_err(|problem| raise(&problem, py))?;
    let Picture { rgb, alpha } = decoded.picture;
    let alpha = alpha.map(|alpha| arrays::array(py, (alpha.height(), alpha.width()), alpha.into_vec()));
    Ok((arrays::of_colours(py, rgb), alpha, decoded.full_scale, worded(&warnings)))
}

/// Reads an environment map or a list of directional lights, or creates a built-in light by its
/// name.
#[pyfunction]
#[pyo3(signature = (path, colorspace))]
pub(crate) fn read_light(
    py: Python<'_>,
    path: PathBuf,
    colorspace: Option<String>,
) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let light = py
        .detach(|| gonio_app::read_light(&path, named(colorspace.as_deref())))
        .map_err(|problem| raise(&problem, py))?;
    Ok(arrays::of_colours(py, light.radiance().clone()))
}

/// Reads a normal map.
#[pyfunction]
pub(crate) fn read_normals(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let normals = py.detach(|| gonio_io::normals::read_normals(&path)).map_err(|e| raise(&e.into(), py))?;
    Ok(arrays::of_colours(py, normals))
}

/// Returns the names and aliases of the colour spaces.
#[pyfunction]
pub(crate) fn colour_spaces() -> Vec<&'static str> {
    ColourSpace::ALL
        .iter()
        .flat_map(|space| std::iter::once(space.name()).chain(space.aliases().iter().copied()))
        .collect()
}

/// Converts linear colours of shape (height, width, 3) from one colour space to another.
#[pyfunction]
pub(crate) fn convert_colours<'py>(
    py: Python<'py>,
    rgb: &Bound<'py, PyArray3<f32>>,
    source: &str,
    target: &str,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let [from, to] = [source, target].map(|name| named(Some(name)).unwrap_or_default());
    let matrix = (to.from_rec709() * from.to_rec709()).as_mat3();
    Ok(arrays::of_colours(py, arrays::colours(rgb)?.map(|v| matrix * *v)))
}

/// Writes a picture in the format of its file name: .exr, .hdr or .pfm. `clip` is the clip level
/// stored in an EXR file.
#[pyfunction]
#[pyo3(signature = (path, rgb, alpha, clip, colorspace))]
pub(crate) fn write_image(
    py: Python<'_>,
    path: PathBuf,
    rgb: &Bound<'_, PyArray3<f32>>,
    alpha: Option<&Bound<'_, PyArray2<f32>>>,
    clip: Option<f32>,
    colorspace: Option<String>,
) -> PyResult<()> {
    let (rgb, alpha) = (arrays::colours(rgb)?, alpha.map(arrays::values).transpose()?);
    py.detach(|| {
        let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let bytes = match extension.as_deref() {
            Some("exr") if alpha.as_ref().is_none_or(|a| a.size() == rgb.size()) => {
                let space = named(colorspace.as_deref());
                encode_exr_with(&rgb, &ExrOptions { alpha: alpha.as_ref(), clip_level: clip, space })
            }
            Some("exr") => return Err(AppError::new("colours and coverage must have the same size")),
            Some("hdr") => encode_hdr(&rgb),
            Some("pfm") => encode_pfm(&rgb),
            _ => return Err(AppError::of(path.display(), "the output must be an .exr, .hdr or .pfm file")),
        };
        Ok(write_whole(&path, &bytes)?)
    })
    .map_err(|problem| raise(&problem, py))
}

/// Encodes 8-bit samples of shape (height, width, 3) as PNG bytes.
fn png(samples: &Bound<'_, PyArray3<u8>>) -> PyResult<Vec<u8>> {
    let &[height, width, channels] = samples.shape() else { unreachable!("three axes") };
    if channels != 3 || samples.is_empty() {
        return Err(raise(&AppError::new("an image must have the shape (height, width, 3)"), samples.py()));
    }
    let values: Vec<u8> = samples.readonly().as_array().iter().copied().collect();
    Ok(samples.py().detach(|| encode_png_srgb8(width, height, &values)))
}

/// Encodes 8-bit samples of shape (height, width, 3) as a PNG.
#[pyfunction]
pub(crate) fn encode_png<'py>(py: Python<'py>, samples: &Bound<'py, PyArray3<u8>>) -> PyResult<Bound<'py, PyBytes>> {
    Ok(PyBytes::new(py, &png(samples)?))
}

/// Table over two angles, shape (90, 90, 3), and the full table over three, shape (3, 90, 90, 180).
type ReadBrdf<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray4<f32>>);

/// Reads a MERL table, or with `any` also an RGL file.
#[pyfunction]
pub(crate) fn read_brdf(py: Python<'_>, path: PathBuf, any: bool) -> PyResult<ReadBrdf<'_>> {
    let read = || if any { gonio_app::read_brdf(&path) } else { gonio_io::merl::read(&path) };
    let read = || read().map(|table| (table.to_bivariate(), table));
    let (tables, whole) = py.detach(read).map_err(|e| raise(&e.into(), py))?;
    let values: Vec<f32> = [0, 1, 2].map(|c| whole.channel(c)).concat();
    Ok((arrays::of_tables(py, &tables), arrays::array(py, (3, THETA_H, THETA_D, PHI_D), values)))
}

/// Writes a BRDF in the format of its file name ([`gonio_io::brdf::encode`]).
#[pyfunction]
#[pyo3(signature = (path, table, full, name))]
pub(crate) fn write_brdf(
    py: Python<'_>,
    path: PathBuf,
    table: &Bound<'_, PyArray3<f32>>,
    full: Option<&Bound<'_, PyArray4<f32>>>,
    name: &str,
) -> PyResult<()> {
    let (tables, full) = (arrays::tables(table)?, full.map(merl_table).transpose()?);
    let table = full.unwrap_or_else(|| MerlTable::from_bivariate(tables.each_ref()));
    py.detach(|| Ok(write_whole(&path, &gonio_io::brdf::encode(&path, &table, name)?)?))
        .map_err(|problem: AppError| raise(&problem, py))
}

/// Contents of a result folder, as `gonio infer` writes it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SavedResult<'py> {
    table: Bound<'py, PyArray3<f32>>,
    likelihood: Option<Bound<'py, Likelihood>>,
    light: Option<Bound<'py, PyArray3<f32>>>,
    albedo_map: Option<Bound<'py, PyArray3<f32>>>,
    luminance_quantiles: Option<Bound<'py, PyArray3<f32>>>,
    rgb_quantiles: Option<Bound<'py, PyArray4<f32>>>,
    /// Pictures by name, of 8-bit samples of shape (height, width, 3). Pictures that are not part
    /// of a result folder are ignored.
    pictures: HashMap<String, Bound<'py, PyArray3<u8>>>,
    document: String,
    page: Option<String>,
}

/// Writes a result folder, completely or, on error, not at all.
#[pyfunction]
pub(crate) fn save(py: Python<'_>, folder: PathBuf, result: SavedResult<'_>) -> PyResult<()> {
    let SavedResult {
        table,
        likelihood,
        light,
        albedo_map,
        luminance_quantiles,
        rgb_quantiles,
        pictures,
        document,
        page,
    } = result;
    let held = PICTURES.into_iter().filter_map(|name| pictures.get(name).map(|samples| (name, samples)));
    let files = Files {
        tables: arrays::tables(&table)?,
        quantiles: luminance_quantiles.map(|quantiles| BrdfQuantiles {
            levels: levels(),
            luminance: rows(quantiles.readonly().as_array().iter().copied()),
            channels: rgb_quantiles.map(|quantiles| {
                let values = quantiles.readonly();
                let values = values.as_array();
                [0, 1, 2].map(|c| rows(values.index_axis(Axis(3), c).iter().copied()))
            }),
        }),
        posterior: likelihood.map(|likelihood| likelihood.get().0.encode()),
        light: light.map(|light| arrays::colours(&light)).transpose()?,
        albedo_map: albedo_map.map(|map| arrays::colours(&map)).transpose()?,
        pictures: held.map(|(name, samples)| Ok((name, png(samples)?))).collect::<PyResult<_>>()?,
        page,
        space: space_of(&document).map_err(|error| raise(&error.into(), py))?,
        document,
    };
    let write = || for_results(&folder)?.fill(&files.encode());
    py.detach(write).map_err(|e| raise(&e.into(), py))
}

/// Divides the values of quantiles into one vector for each.
fn rows(values: impl Iterator<Item = f32>) -> Vec<Vec<f32>> {
    values.collect::<Vec<f32>>().chunks(CELLS).map(<[f32]>::to_vec).collect()
}

/// Returns the output colour space that a result states.
fn space_of(result: &str) -> Result<ColourSpace, gonio_io::Error> {
    Ok(match decode(Path::new("the result"), result.as_bytes())? {
        ResultFile::Material(document) => ColourSpace::named(&document.colorspace.output).unwrap_or_default(),
        ResultFile::Regions(_) => ColourSpace::default(),
    })
}

/// Writes a file, completely or not at all.
#[pyfunction]
pub(crate) fn write_file(py: Python<'_>, path: PathBuf, bytes: &[u8]) -> PyResult<()> {
    py.detach(|| write_whole(&path, bytes)).map_err(|e| raise(&e.into(), py))
}

/// Reads the file of a part of a model.
#[pyfunction]
pub(crate) fn read_file(py: Python<'_>, path: PathBuf) -> PyResult<Py<PyBytes>> {
    let bytes = py.detach(|| gonio_io::model::read_part(&path)).map_err(|e| raise(&e.into(), py))?;
    Ok(PyBytes::new(py, &bytes).unbind())
}
