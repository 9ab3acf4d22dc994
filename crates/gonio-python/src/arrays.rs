//! Converts between NumPy arrays and pictures without copying their values.

use std::sync::Arc;

use bytemuck::allocation::cast_vec;
use bytemuck::{AnyBitPattern, cast_slice};
use glam::Vec3;
use gonio::picture::{Plane, srgb_decode, srgb_encode};
use gonio::reflectance::{BivariateTable, THETA_D, THETA_H, indices_of};
use gonio_app::AppError;
use numpy::ndarray::{Array, Dimension};
use numpy::{Element, IntoPyArray, PyArray, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::error::raise;

/// Borrowed values of an array, which is kept alive.
struct Borrowed {
    start: *const f32,
    length: usize,
    /// The array that owns the values.
    _owner: Py<PyAny>,
}

// SAFETY: the memory belongs to an array that `_owner` keeps alive, and this module never writes to
// it. The caller must not write to the array meanwhile, as with every NumPy function that lets
// other threads run; the documentation of the package states this.
#[expect(unsafe_code, reason = "a picture in the memory of an array outlives the call that received it")]
unsafe impl Send for Borrowed {}
// SAFETY: as above; all accesses are reads.
#[expect(unsafe_code, reason = "many threads read one picture")]
unsafe impl Sync for Borrowed {}

impl<T: AnyBitPattern> AsRef<[T]> for Borrowed {
    fn as_ref(&self) -> &[T] {
        // SAFETY: `of` has checked that `length` aligned, contiguous values start here; `_owner`
        // keeps them alive.
        #[expect(unsafe_code, reason = "the only access to values that Python owns")]
        let values = unsafe { std::slice::from_raw_parts(self.start, self.length) };
        cast_slice(values)
    }
}

impl Borrowed {
    fn of<D: Dimension>(array: &Bound<'_, PyArray<f32, D>>) -> PyResult<Self> {
        let start: *const f32 = array.data();
        if !array.is_c_contiguous() || !start.is_aligned() || array.is_empty() {
            let problem =
                AppError::new("an array is empty, or not contiguous float32 in C order and native byte order");
            return Err(raise(&problem, array.py()));
        }
        Ok(Self { start, length: array.len(), _owner: array.clone().into_any().unbind() })
    }
}

/// Returns the picture in an array of shape (height, width, 3).
pub(crate) fn colours(array: &Bound<'_, PyArray3<f32>>) -> PyResult<Plane<Vec3>> {
    let &[height, width, channels] = array.shape() else { unreachable!("three axes") };
    if channels != 3 {
        let problem = AppError::new(format!("an array has {channels} channels; its shape must be (height, width, 3)"));
        return Err(raise(&problem, array.py()));
    }
    Ok(Plane::from_shared(width, height, Arc::new(Borrowed::of(array)?)))
}

/// Returns the picture in an array of shape (height, width).
pub(crate) fn values(array: &Bound<'_, PyArray2<f32>>) -> PyResult<Plane<f32>> {
    let &[height, width] = array.shape() else { unreachable!("two axes") };
    Ok(Plane::from_shared(width, height, Arc::new(Borrowed::of(array)?)))
}

/// Creates an array that takes ownership of the values.
pub(crate) fn array<'py, T: Element, D: Dimension>(
    py: Python<'py>,
    shape: impl numpy::ndarray::ShapeBuilder<Dim = D>,
    values: Vec<T>,
) -> Bound<'py, PyArray<T, D>> {
    Array::from_shape_vec(shape, values).expect("the number of values matches the shape").into_pyarray(py)
}

/// Converts a picture to an array of shape (height, width, 3) without a copy.
pub(crate) fn of_colours(py: Python<'_>, picture: Plane<Vec3>) -> Bound<'_, PyArray3<f32>> {
    let (width, height) = picture.size();
    array(py, (height, width, 3), cast_vec(picture.into_vec()))
}

/// Converts linear display values to 8-bit sRGB samples of shape (height, width, 3).
pub(crate) fn coded<'py>(py: Python<'py>, picture: &Plane<Vec3>) -> Bound<'py, PyArray3<u8>> {
    let (width, height) = picture.size();
    let code = |v: f32| (srgb_encode(v.max(0.0)) * 255.0).round() as u8;
    let samples: Vec<u8> = picture.as_slice().iter().flat_map(|v| v.to_array().map(code)).collect();
    array(py, (height, width, 3), samples)
}

/// Converts 8-bit sRGB samples of shape (height, width, 3) to linear display values, the inverse of
/// [`coded`].
pub(crate) fn decoded(array: &Bound<'_, PyArray3<u8>>) -> PyResult<Plane<Vec3>> {
    let samples = array.readonly();
    let samples = samples.as_array();
    let (height, width, channels) = samples.dim();
    if channels != 3 {
        let problem = AppError::new(format!("a picture must have 3 channels, not {channels}"));
        return Err(raise(&problem, array.py()));
    }
    let value = |x: usize, y: usize, c: usize| srgb_decode(f32::from(samples[(y, x, c)]) / 255.0);
    Ok(Plane::from_fn(width, height, |x, y| Vec3::new(value(x, y, 0), value(x, y, 1), value(x, y, 2))))
}

/// Returns the tables of the three channels of an array of shape (90, 90, 3).
pub(crate) fn tables(array: &Bound<'_, PyArray3<f32>>) -> PyResult<[BivariateTable; 3]> {
    let plane = colours(array)?;
    if plane.size() != (THETA_D, THETA_H) {
        let (width, height) = plane.size();
        let problem =
            AppError::new(format!("a BRDF must have the shape ({THETA_H}, {THETA_D}, 3), not ({height}, {width}, 3)"));
        return Err(raise(&problem, array.py()));
    }
    let cells = plane.as_slice();
    if let Some(wrong) = cells.iter().position(|c| !c.is_finite() || c.min_element() < 0.0) {
        let (i, j) = indices_of(wrong);
        let problem = AppError::new(format!("the BRDF is negative or not finite at [{i}, {j}]"));
        return Err(raise(&problem, array.py()));
    }
    Ok([0, 1, 2].map(|c| BivariateTable::from_vec(cells.iter().map(|v| v[c]).collect())))
}

/// Converts the tables of three channels to an array of shape (90, 90, 3).
pub(crate) fn of_tables<'py>(py: Python<'py>, tables: &[BivariateTable; 3]) -> Bound<'py, PyArray3<f32>> {
    let [r, g, b] = tables.each_ref().map(BivariateTable::as_slice);
    let values = r.iter().zip(g).zip(b).flat_map(|((r, g), b)| [*r, *g, *b]).collect();
    array(py, (THETA_H, THETA_D, 3), values)
}
