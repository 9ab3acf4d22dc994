//! Photographs and objects as Python gives them, for `gonio_app`.

use std::path::PathBuf;

use gonio::picture::Picture;
use gonio::scene::{Circle, Correction};
use gonio::shape::MeshParts;
use gonio_app::{Form, Normals, Reading, Scene, Shape, Shots, Source};
use numpy::{PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays;

/// A picture, in memory or in a file.
#[derive(FromPyObject)]
pub(crate) enum GivenPicture<'py> {
    Array(Bound<'py, PyArray3<f32>>),
    WithAlpha((Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<f32>>)),
    File(PathBuf),
}

/// A mask, in memory or in a file.
#[derive(FromPyObject)]
enum GivenMask<'py> {
    Array(Bound<'py, PyArray2<f32>>),
    File(PathBuf),
}

/// A mesh, in memory or in a file.
#[derive(FromPyObject)]
enum GivenMesh<'py> {
    Arrays((Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>)),
    File(PathBuf),
}

/// A camera or a pose: JSON, or a file of it.
#[derive(FromPyObject)]
enum Json {
    Bytes(Vec<u8>),
    File(PathBuf),
}

impl Json {
    fn source(self) -> Source<Vec<u8>> {
        match self {
            Self::Bytes(json) => Source::Here(json),
            Self::File(path) => Source::File(path),
        }
    }
}

/// The shape of an object, as Python gives it; `mesh` or `normals` take precedence over the name.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct GivenShape<'py> {
    shape: String,
    mesh: Option<GivenMesh<'py>>,
    normals: Option<GivenPicture<'py>>,
    camera: Option<Json>,
    pose: Option<Json>,
    circle: Option<(f64, f64, f64)>,
    depth_axis: Option<f64>,
    trust_normals: bool,
}

/// A photograph and what is known of its object.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct GivenScene<'py> {
    name: String,
    image: GivenPicture<'py>,
    linear: bool,
    layer: Option<String>,
    mask: Option<GivenMask<'py>>,
    clip: Option<f32>,
    keep_colors: bool,
    object: GivenShape<'py>,
}

impl GivenScene<'_> {
    pub(crate) fn take(self) -> PyResult<Scene> {
        let shots = match self.image {
            GivenPicture::Array(rgb) => Shots::Here(Picture { rgb: arrays::colours(&rgb)?, alpha: None }),
            GivenPicture::WithAlpha((rgb, alpha)) => {
                Shots::Here(Picture { rgb: arrays::colours(&rgb)?, alpha: Some(arrays::values(&alpha)?) })
            }
            GivenPicture::File(path) => Shots::Files(vec![path]),
        };
        let mask = self.mask.map(|mask| {
            Ok::<_, PyErr>(match mask {
                GivenMask::Array(array) => Source::Here(arrays::values(&array)?),
                GivenMask::File(path) => Source::File(path),
            })
        });
        Ok(Scene {
            name: self.name,
            shots,
            reading: Reading { linear: self.linear, layer: self.layer, ..Reading::default() },
            mask: mask.transpose()?,
            clip: self.clip,
            keep_colours: self.keep_colors,
            shape: self.object.take()?,
        })
    }
}

impl GivenShape<'_> {
    fn take(self) -> PyResult<Shape> {
        let form = if let Some(mesh) = self.mesh {
            Form::Mesh(match mesh {
                GivenMesh::Arrays((places, faces)) => Source::Here(MeshParts {
                    positions: places
                        .readonly()
                        .as_array()
                        .rows()
                        .into_iter()
                        .map(|r| [r[0], r[1], r[2]].into())
                        .collect(),
                    triangles: faces.readonly().as_array().rows().into_iter().map(|r| [r[0], r[1], r[2]]).collect(),
                    normals: None,
                }),
                GivenMesh::File(path) => Source::File(path),
            })
        } else if let Some(normals) = self.normals {
            let source = match normals {
                GivenPicture::Array(array) | GivenPicture::WithAlpha((array, _)) => {
                    Source::Here(arrays::colours(&array)?)
                }
                GivenPicture::File(path) => Source::File(path),
            };
            let (correction, places) = (Correction::default(), None);
            Form::Normals(Box::new(Normals { picture: source, correction, trusted: self.trust_normals, places }))
        } else if self.shape == "ellipsoid" {
            Form::Ellipsoid(self.depth_axis)
        } else {
            Form::Sphere(self.circle.map(|(x, y, radius)| Circle { x, y, radius }))
        };
        Ok(Shape { form, camera: self.camera.map(Json::source), pose: self.pose.map(Json::source) })
    }
}

/// Extracts the shape that `render` shows.
pub(crate) fn take_shape(given: &Bound<'_, PyAny>) -> PyResult<Shape> {
    given.extract::<GivenShape<'_>>()?.take()
}
