//! Rendering and evaluation of a BRDF.

use gonio::gloss::{GgxWidths, Glossmeter};
use gonio::inference::learnt::peak_height;
use gonio::lighting::{EnvironmentMap, studio_light};
use gonio::picture::Picture;
use gonio::reflectance::{BivariateTable, MerlTable, THETA_D, THETA_H};
use gonio::render::{
    Accuracy, Brdf, IntegratorSettings, LightTree, SphereSettings, SurfaceSettings, render_sphere, render_surface,
};
use gonio_app::AppError;
use numpy::{PyArray1, PyArray3, PyArray4, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays;
use crate::error::{raise, worded};
use crate::scene::take_shape;
use crate::work::{self, Listeners};

/// Settings of a picture.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct RenderSettings {
    width: usize,
    height: usize,
    samples: usize,
    tolerance: Option<f64>,
    shadows: bool,
}

/// Radiance of shape (height, width, 3), coverage of shape (height, width), and warnings.
type Rendered<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, numpy::PyArray2<f32>>, Vec<String>);

/// Renders a sphere or a mesh with a BRDF under a lat-long light. The BRDF is given by its full
/// table over three angles, or else by its table over two.
#[pyfunction]
#[pyo3(signature = (table, full, light, shape, settings, listeners))]
pub(crate) fn render<'py>(
    py: Python<'py>,
    table: &Bound<'py, PyArray3<f32>>,
    full: Option<&Bound<'py, PyArray4<f32>>>,
    light: &Bound<'py, PyArray3<f32>>,
    shape: &Bound<'py, PyAny>,
    settings: RenderSettings,
    listeners: Listeners,
) -> PyResult<Rendered<'py>> {
    let brdf: Box<dyn Brdf + Send> = match full {
        Some(full) => Box::new(merl_table(full)?),
        None => Box::new(arrays::tables(table)?),
    };
    let light = arrays::colours(light)?;
    let shape = take_shape(shape)?;
    let (picture, warnings) = work::run(py, listeners, move |reporter| {
        let light = EnvironmentMap::new(light).map_err(|e| AppError::of("the light", e))?;
        let tree = LightTree::of_map(&light);
        let mut warnings = Vec::new();
        let RenderSettings { width, height, samples, tolerance, shadows } = settings;
        let placed = shape.surface((width, height), &mut warnings)?;
        let bound = |tolerance| Accuracy::Bound(IntegratorSettings { tolerance, ..IntegratorSettings::default() });
        let accuracy = tolerance.map_or_else(Accuracy::default, bound);
        let report = |x| reporter.at("rendering", x);
        let picture = match &placed {
            Some(placed) => {
                let settings = SurfaceSettings { samples, accuracy, shadows };
                render_surface(&*brdf, &tree, placed.surface.as_ref(), &placed.camera, &settings, &report)
            }
            None => {
                let settings = SphereSettings { size: width, samples, accuracy };
                render_sphere(&*brdf, &tree, &settings, &report)
            }
        };
        Ok((picture, warnings))
    })?;
    let Picture { rgb, alpha } = picture;
    let (width, height) = rgb.size();
    let alpha = alpha.map_or_else(|| vec![1.0; width * height], gonio::picture::Plane::into_vec);
    Ok((arrays::of_colours(py, rgb), arrays::array(py, (height, width), alpha), worded(&warnings)))
}

/// Returns the table in an array of shape (3, 90, 90, 180).
pub(crate) fn merl_table(array: &Bound<'_, PyArray4<f32>>) -> PyResult<MerlTable> {
    let values = array.readonly();
    let values = values.as_array();
    if values.shape() != [3, THETA_H, THETA_D, gonio::reflectance::PHI_D] {
        let problem = AppError::new("a full MERL table must have the shape (3, 90, 90, 180)");
        return Err(raise(&problem, array.py()));
    }
    Ok(MerlTable::from_channels(
        [0, 1, 2].map(|c| values.index_axis(numpy::ndarray::Axis(0), c).iter().copied().collect()),
    ))
}

/// Returns the studio light in which results are shown, of shape (height, 2 height, 3).
#[pyfunction]
pub(crate) fn studio(py: Python<'_>, height: usize) -> Bound<'_, PyArray3<f32>> {
    arrays::of_colours(py, studio_light(height).radiance().clone())
}

/// Returns the albedo of the luminance of a table at normal incidence.
#[pyfunction]
pub(crate) fn normal_albedo(table: &Bound<'_, PyArray3<f32>>) -> PyResult<f64> {
    Ok(BivariateTable::luminance(&arrays::tables(table)?).normal_albedo())
}

/// Returns the ratio of peak to body, the GGX alpha (1 without a highlight), and gloss units at 20
/// and 60 degrees. The luminance tables have the shape (count, 90, 90), the result (count, 4).
#[pyfunction]
pub(crate) fn highlights<'py>(
    py: Python<'py>,
    tables: &Bound<'py, PyArray3<f32>>,
) -> PyResult<Bound<'py, numpy::PyArray2<f64>>> {
    let values = tables.readonly();
    let values = values.as_array();
    let &[count, rows, columns] = values.shape() else { unreachable!("three axes") };
    if (rows, columns) != (THETA_H, THETA_D) || values.iter().any(|v| !v.is_finite() || *v < 0.0) {
        let problem = "luminance tables must have the shape (count, 90, 90) and non-negative values";
        return Err(raise(&AppError::new(problem), py));
    }
    let all: Vec<BivariateTable> =
        values.outer_iter().map(|table| BivariateTable::from_vec(table.iter().copied().collect())).collect();
    let numbers = py.detach(|| {
        let (widths, meters) = (GgxWidths::new(), [Glossmeter::at_20(), Glossmeter::at_60()]);
        let of = |table: &BivariateTable| {
            let alpha = widths.alpha_of(table).unwrap_or(1.0).min(1.0);
            [peak_height(table), alpha, meters[0].read(table), meters[1].read(table)]
        };
        all.iter().flat_map(of).collect::<Vec<f64>>()
    });
    Ok(arrays::array(py, (count, 4), numbers))
}

/// Returns the values of a table at half and difference angles in radians, of shape (n, 3).
#[pyfunction]
pub(crate) fn eval<'py>(
    py: Python<'py>,
    table: &Bound<'py, PyArray3<f32>>,
    theta_h: &Bound<'py, PyArray1<f64>>,
    theta_d: &Bound<'py, PyArray1<f64>>,
) -> PyResult<Bound<'py, numpy::PyArray2<f64>>> {
    let tables = arrays::tables(table)?;
    let (h, d) = (theta_h.readonly(), theta_d.readonly());
    let angles = h.as_array().into_iter().copied().zip(d.as_array().into_iter().copied());
    let values: Vec<f64> = angles.flat_map(|(h, d)| tables.each_ref().map(|t| t.eval(h, d))).collect();
    Ok(arrays::array(py, (values.len() / 3, 3), values))
}
