//! Converts photographs and objects from Python to types of `gonio_app`.

use std::path::PathBuf;

use glam::DVec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::{Circle, Correction};
use gonio::shape::{DepthKind, MeshParts};
use gonio_app::{
    AppError, Curve, NormalSource, PhotographSource, PositionSource, Reading, Reference, ReferenceTarget, Scene, Shape,
    ShapeKind, Source,
};
use gonio_io::colour_space::ColourSpace;
use gonio_io::geometry::{depth_of, position_of};
use numpy::{PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays;
use crate::error::raise;

/// A picture, in memory or in a file.
#[derive(FromPyObject)]
pub(crate) enum PictureArg<'py> {
    Array(Bound<'py, PyArray3<f32>>),
    WithAlpha((Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<f32>>)),
    File(PathBuf),
}

/// A photograph: a picture, or the files of the exposures of one scene, or the bytes of a file.
#[derive(FromPyObject)]
pub(crate) enum PhotographArg<'py> {
    Picture(PictureArg<'py>),
    Bytes(Vec<u8>),
    Exposures(Vec<PathBuf>),
}

/// Options for reading the files of a photograph.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ReadingArg {
    linear: bool,
    layer: Option<String>,
    times: Option<Vec<f64>>,
    response: Option<String>,
    align: bool,
    trust_times: bool,
    black_level: Option<f64>,
    flat: Option<PathBuf>,
    colorspace: Option<String>,
}

impl ReadingArg {
    pub(crate) fn take(self) -> Reading {
        let Self { linear, layer, times, response, align, trust_times, black_level, flat, colorspace } = self;
        let response = response.map(|name| match name.as_str() {
            "srgb" => Curve::Srgb,
            "linear" => Curve::Linear,
            path => Curve::File(path.into()),
        });
        // The package has checked the name.
        let colour_space = colorspace.as_deref().and_then(ColourSpace::named);
        let no_align = !align;
        Reading { linear, times, response, no_align, trust_times, black_level, flat, layer, colour_space }
    }
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

/// Depths, in memory or in a file.
#[derive(FromPyObject)]
enum GivenDepths<'py> {
    Array(Bound<'py, PyArray2<f64>>),
    File(PathBuf),
}

/// Positions, in memory or in a file.
#[derive(FromPyObject)]
enum GivenPositions<'py> {
    Array(Bound<'py, PyArray3<f64>>),
    File(PathBuf),
}

/// A camera or a pose, as JSON or as a JSON file.
#[derive(FromPyObject)]
enum Json {
    Bytes(Vec<u8>),
    File(PathBuf),
}

impl Json {
    fn source(self) -> Source<Vec<u8>> {
        match self {
            Self::Bytes(json) => Source::Memory(json),
            Self::File(path) => Source::File(path),
        }
    }
}

/// Normals with their conventions and positions.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct NormalsArg<'py> {
    picture: PictureArg<'py>,
    order: String,
    flip_x: bool,
    flip_y: bool,
    flip_z: bool,
    trusted: bool,
    error: f64,
    depth: Option<GivenDepths<'py>>,
    depth_range: Option<(f64, f64)>,
    depth_along_rays: bool,
    positions: Option<GivenPositions<'py>>,
}

/// The shape of an object; `mesh` or `normals` take precedence over the name.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct ShapeArg<'py> {
    shape: String,
    mesh: Option<GivenMesh<'py>>,
    normals: Option<NormalsArg<'py>>,
    camera: Option<Json>,
    pose: Option<Json>,
    circle: Option<(f64, f64, f64)>,
    depth_axis: Option<f64>,
}

/// A neutral reference in a photograph: `white`, `grey_card`, `grey_ball`, or else a chart. The
/// chart is detected if `corners` is empty.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct ReferenceArg<'py> {
    white: Option<(f64, f64, f64)>,
    grey_card: Option<GivenMask<'py>>,
    grey_ball: Option<(f64, f64, f64)>,
    corners: Option<Vec<(f64, f64)>>,
    reflectance: Option<f64>,
    color_only: bool,
}

/// A photograph and the known properties of its object.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SceneArg<'py> {
    name: String,
    image: PhotographArg<'py>,
    reading: ReadingArg,
    mask: Option<GivenMask<'py>>,
    clip: Option<f32>,
    one_material: bool,
    force: bool,
    object: ShapeArg<'py>,
    reference: Option<ReferenceArg<'py>>,
}

impl SceneArg<'_> {
    pub(crate) fn take(self) -> PyResult<Scene> {
        let shots = match self.image {
            PhotographArg::Picture(PictureArg::Array(rgb)) => {
                PhotographSource::Memory(Picture { rgb: arrays::colours(&rgb)?, alpha: None })
            }
            PhotographArg::Picture(PictureArg::WithAlpha((rgb, alpha))) => {
                PhotographSource::Memory(Picture { rgb: arrays::colours(&rgb)?, alpha: Some(arrays::values(&alpha)?) })
            }
            PhotographArg::Picture(PictureArg::File(path)) => PhotographSource::Files(vec![path]),
            PhotographArg::Bytes(bytes) => PhotographSource::Bytes(self.name.clone(), bytes),
            PhotographArg::Exposures(paths) => PhotographSource::Files(paths),
        };
        Ok(Scene {
            name: self.name,
            photograph: shots,
            reading: self.reading.take(),
            mask: self.mask.map(GivenMask::source).transpose()?,
            clip: self.clip,
            one_material: self.one_material,
            force: self.force,
            shape: self.object.take()?,
            reference: self.reference.map(ReferenceArg::take).transpose()?,
        })
    }
}

impl GivenMask<'_> {
    fn source(self) -> PyResult<Source<Plane<f32>>> {
        Ok(match self {
            Self::Array(array) => Source::Memory(arrays::values(&array)?),
            Self::File(path) => Source::File(path),
        })
    }
}

impl ReferenceArg<'_> {
    fn take(self) -> PyResult<Reference> {
        let circle = |(x, y, radius)| Circle { x, y, radius };
        let target = match (self.white, self.grey_card, self.grey_ball) {
            (Some(disk), _, _) => ReferenceTarget::White(circle(disk)),
            (None, Some(mask), _) => ReferenceTarget::GreyCard(mask.source()?),
            (None, None, Some(ball)) => ReferenceTarget::GreyBall(circle(ball)),
            (None, None, None) => ReferenceTarget::Chart(self.corners.and_then(|corners| corners.try_into().ok())),
        };
        Ok(Reference { target, reflectance: self.reflectance, colour_only: self.color_only })
    }
}

impl ShapeArg<'_> {
    fn take(self) -> PyResult<Shape> {
        let form = if let Some(mesh) = self.mesh {
            ShapeKind::Mesh(match mesh {
                GivenMesh::Arrays((positions, faces)) => Source::Memory(MeshParts {
                    positions: positions
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
            ShapeKind::Normals(Box::new(normals.take()?))
        } else if self.shape == "ellipsoid" {
            ShapeKind::Ellipsoid(self.depth_axis)
        } else if self.shape == "outline" {
            ShapeKind::Outline
        } else {
            ShapeKind::Sphere(self.circle.map(|(x, y, radius)| Circle { x, y, radius }))
        };
        Ok(Shape { kind: form, camera: self.camera.map(Json::source), pose: self.pose.map(Json::source) })
    }
}

impl NormalsArg<'_> {
    fn take(self) -> PyResult<NormalSource> {
        let picture = match self.picture {
            PictureArg::Array(array) | PictureArg::WithAlpha((array, _)) => Source::Memory(arrays::colours(&array)?),
            PictureArg::File(path) => Source::File(path),
        };
        // The package has checked the order.
        let order = Correction::order_named(&self.order).unwrap_or([0, 1, 2]);
        let correction = Correction { order, flip_x: self.flip_x, flip_y: self.flip_y, flip_z: self.flip_z };
        let kind = if self.depth_along_rays { DepthKind::AlongRay } else { DepthKind::AlongAxis };
        let depth =
            self.depth.map(|depth| depth.source().map(|depth| PositionSource::Depth(depth, self.depth_range, kind)));
        let positions = self.positions.map(|positions| positions.source().map(PositionSource::Positions));
        Ok(NormalSource {
            picture,
            correction,
            trusted: self.trusted,
            error: self.error,
            positions: depth.or(positions).transpose()?,
        })
    }
}

impl GivenDepths<'_> {
    fn source(self) -> PyResult<Source<Plane<Option<f64>>>> {
        Ok(match self {
            Self::File(path) => Source::File(path),
            Self::Array(array) => {
                let values = array.readonly().as_array().iter().map(|v| depth_of(*v)).collect();
                Source::Memory(surface(
                    &array,
                    array.py(),
                    "the depths: contain no surface: all are zero, infinite or too large",
                    values,
                )?)
            }
        })
    }
}

impl GivenPositions<'_> {
    fn source(self) -> PyResult<Source<Plane<Option<DVec3>>>> {
        Ok(match self {
            Self::File(path) => Source::File(path),
            Self::Array(array) => {
                let rows = array.readonly();
                let positions = rows.as_array().into_iter().copied().collect::<Vec<f64>>();
                let positions = positions.chunks_exact(3).map(|p| position_of(DVec3::from_slice(p))).collect();
                Source::Memory(surface(
                    &array,
                    array.py(),
                    "the positions: contain no surface: all are zero, infinite or too large",
                    positions,
                )?)
            }
        })
    }
}

/// Returns the values of an array of shape (height, width, ...) as a picture. Fails with `problem`
/// if all values are `None`.
fn surface<'py, T>(
    array: &impl PyUntypedArrayMethods<'py>,
    py: Python<'py>,
    problem: &str,
    values: Vec<Option<T>>,
) -> PyResult<Plane<Option<T>>> {
    if values.iter().all(Option::is_none) {
        return Err(raise(&AppError::new(problem), py));
    }
    let shape = array.shape();
    Ok(Plane::from_vec(shape[1], shape[0], values))
}

/// Extracts the shape for `render`.
pub(crate) fn take_shape(given: &Bound<'_, PyAny>) -> PyResult<Shape> {
    given.extract::<ShapeArg<'_>>()?.take()
}
