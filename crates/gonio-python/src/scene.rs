//! From what Python says of a photograph and an object to what the library observes.

use std::path::{Path, PathBuf};

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::{Circle, NormalPicture, Object, ObservationSettings, Oddity, SceneError, Sighting};
use gonio::shape::{Camera, Mesh, MeshParts, Placed, Visibility};
use gonio::sphere::OctahedralMap;
use gonio_io::camera::{decode_camera, decode_pose, read_camera, read_pose};
use gonio_io::picture::{Decoded, Encoding, ReadOptions};
use numpy::{PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::arrays;
use crate::error::Problem;
use crate::work::Reporter;

/// A picture, in a file or in memory.
#[derive(FromPyObject)]
enum GivenPicture<'py> {
    Array(Bound<'py, PyArray3<f32>>),
    WithAlpha((Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<f32>>)),
    File(PathBuf),
}

/// One channel of a picture.
#[derive(FromPyObject)]
enum GivenMask<'py> {
    Array(Bound<'py, PyArray2<f32>>),
    File(PathBuf),
}

/// Triangles.
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

/// The shape of an object, as Python gives it; `mesh` or `normals` go before the name.
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

/// A value, or the file that holds it.
enum Source<T> {
    Here(T),
    File(PathBuf),
}

/// The same, free of Python.
pub(crate) struct Scene {
    /// How messages call the photograph.
    pub(crate) name: String,
    image: Source<Picture>,
    pub(crate) linear: bool,
    layer: Option<String>,
    mask: Option<Source<Plane<f32>>>,
    clip: Option<f32>,
    keep_colours: bool,
    shape: Shape,
}

/// What is known of a shape.
pub(crate) struct Shape {
    form: ShapeForm,
    camera: Option<Json>,
    pose: Option<Json>,
}

enum ShapeForm {
    Sphere(Option<Circle>),
    Ellipsoid(Option<f64>),
    Mesh(Source<MeshParts>),
    Normals(Source<Plane<Vec3>>, bool),
}

impl GivenScene<'_> {
    pub(crate) fn take(self) -> PyResult<Scene> {
        let image = match self.image {
            GivenPicture::Array(rgb) => Source::Here(Picture { rgb: arrays::colours(&rgb)?, alpha: None }),
            GivenPicture::WithAlpha((rgb, alpha)) => {
                Source::Here(Picture { rgb: arrays::colours(&rgb)?, alpha: Some(arrays::values(&alpha)?) })
            }
            GivenPicture::File(path) => Source::File(path),
        };
        let mask = self.mask.map(|mask| {
            Ok::<_, PyErr>(match mask {
                GivenMask::Array(array) => Source::Here(arrays::values(&array)?),
                GivenMask::File(path) => Source::File(path),
            })
        });
        Ok(Scene {
            name: self.name,
            image,
            linear: self.linear,
            layer: self.layer,
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
            ShapeForm::Mesh(match mesh {
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
            ShapeForm::Normals(source, self.trust_normals)
        } else if self.shape == "ellipsoid" {
            ShapeForm::Ellipsoid(self.depth_axis)
        } else {
            ShapeForm::Sphere(self.circle.map(|(x, y, radius)| Circle { x, y, radius }))
        };
        Ok(Shape { form, camera: self.camera, pose: self.pose })
    }
}

/// A scene that was looked at.
pub(crate) struct Observed {
    pub(crate) picture: Picture,
    pub(crate) sighting: Sighting,
    /// The section `observations` of the notes.
    pub(crate) notes: Value,
}

impl Scene {
    /// Reads what is in files, finds the object and samples the picture on it.
    pub(crate) fn observe(
        self,
        shadows: Option<(OctahedralMap, usize)>,
        warnings: &mut Vec<String>,
        reporter: &Reporter,
    ) -> Result<Observed, Problem> {
        let (picture, clip) = self.photograph(warnings)?;
        let size = picture.rgb.size();
        let mask_name = match &self.mask {
            Some(Source::File(path)) => Some(path.display().to_string()),
            Some(Source::Here(_)) => Some("the mask".to_owned()),
            None => None,
        };
        let mask = match self.mask {
            Some(Source::File(path)) => Some(gonio_io::picture::read_mask(path)?),
            Some(Source::Here(mask)) => Some(mask),
            None => None,
        };
        if let (Some(mask), Some(name)) = (&mask, &mask_name)
            && mask.size() != size
        {
            let ((w, h), (pw, ph)) = (mask.size(), size);
            let problem = format!("the mask is {w}x{h}, the photograph {pw}x{ph}; give one of the same size");
            return Err(if name == "the mask" { Problem::new(problem) } else { Problem::of(name, problem) });
        }
        reporter.at("reading", 0.5);
        let shape_name = self.shape.name();
        let (object, own_notes) = self.shape.object(size, warnings)?;
        let whole = match &shape_name {
            Some(shape) => format!("{} with {shape}", self.name),
            None => self.name.clone(),
        };
        let settings = ObservationSettings { clip, keep_colours: self.keep_colours, ..Default::default() };
        let mut sighting = Sighting::of(&picture, mask, object, &settings).map_err(|error| {
            let origin = match &error {
                error if error.is_of_outline() => mask_name.as_ref().unwrap_or(&self.name),
                SceneError::Contradiction(_) => shape_name.as_ref().unwrap_or(&self.name),
                _ => &whole,
            };
            Problem::of(origin, error)
        })?;
        warnings.extend(sighting.oddities.iter().map(|odd| match odd {
            Oddity::Depth(_) => odd.to_string(),
            Oddity::Clipped { .. } | Oddity::Faulty { .. } => format!("{}: {odd}", self.name),
            Oddity::OtherColour { .. } => format!("{}: {odd}; keep_colors=True uses them", self.name),
            Oddity::Contradiction(_) => format!("{}: {odd}", shape_name.as_ref().unwrap_or(&self.name)),
            Oddity::Misplaced { .. } | Oddity::Inside { .. } => format!("{whole}: {odd}"),
        }));
        reporter.at("reading", 1.0);
        if let Some(grid) = shadows.filter(|_| sighting.placed.is_some()) {
            let report = |x| reporter.at("shadows", x);
            sighting.shadow(grid, &report).map_err(|error| Problem::of(&whole, error))?;
        }
        let mut notes = gonio_report::notes::sighting(&sighting);
        if sighting.placed.is_some() && shadows.is_some() {
            let visibility = sighting.observations.visibility.as_ref();
            notes["visibility"] = json!({ "hidden": visibility.is_some(), "bytes": visibility.map(Visibility::bytes) });
        }
        if let Some(shape) = notes.get_mut("shape") {
            gonio_report::notes::extend(shape, own_notes);
        }
        Ok(Observed { picture, sighting, notes })
    }

    /// The photograph, and the radiance at or above which nothing is known.
    fn photograph(&self, warnings: &mut Vec<String>) -> Result<(Picture, Option<f32>), Problem> {
        let path = match &self.image {
            Source::Here(picture) => return Ok((picture.clone(), self.clip)),
            Source::File(path) => path,
        };
        let decoded = read_image(path, self.linear, self.layer.clone(), warnings)?;
        Ok((decoded.picture, self.clip.or(decoded.full_scale)))
    }
}

/// Reads a picture; what is odd about it goes to the warnings.
pub(crate) fn read_image(
    path: &Path,
    linear: bool,
    layer: Option<String>,
    warnings: &mut Vec<String>,
) -> Result<Decoded, Problem> {
    let options = ReadOptions { linear, layer, ..ReadOptions::default() };
    let decoded = gonio_io::picture::read(path, &options)?;
    let name = path.display();
    if let Encoding::Srgb { bits } = decoded.encoding {
        warnings.push(format!(
            "{name}: {bits}-bit sRGB-coded picture, decoded as such; its highlights are probably clipped and its tone curve unknown: prefer an HDR \
             picture, or give linear=True if its values are linear radiance"
        ));
    }
    if let (Some(layer), None) = (&decoded.layer, &options.layer) {
        let others = layer.others.join(", ");
        warnings.push(format!(
            "{name}: holds several pictures, {} was taken; layer=NAME takes another: {others}",
            layer.name
        ));
    }
    Ok(decoded)
}

impl Shape {
    /// How messages call the file of a shape.
    fn name(&self) -> Option<String> {
        match &self.form {
            ShapeForm::Mesh(Source::File(path)) | ShapeForm::Normals(Source::File(path), _) => {
                Some(path.display().to_string())
            }
            ShapeForm::Mesh(Source::Here(_)) => Some("the mesh".into()),
            ShapeForm::Normals(Source::Here(_), _) => Some("the normals".into()),
            ShapeForm::Sphere(_) | ShapeForm::Ellipsoid(_) => None,
        }
    }

    fn camera(&self, size: (usize, usize)) -> Result<Option<Camera>, Problem> {
        Ok(match &self.camera {
            None => None,
            Some(Json::File(path)) => Some(read_camera(path, size)?),
            Some(Json::Bytes(bytes)) => Some(decode_camera(Path::new("the camera"), bytes, size)?),
        })
    }

    /// What the notes say of the shape goes with it.
    fn object(self, size: (usize, usize), warnings: &mut Vec<String>) -> Result<(Object, Value), Problem> {
        let camera = self.camera(size)?;
        let object = match (self.form, camera) {
            (ShapeForm::Sphere(circle), None) => Object::Sphere(circle),
            (ShapeForm::Sphere(None), Some(camera)) => Object::Ball(camera),
            (ShapeForm::Sphere(Some(_)), Some(_)) => {
                return Err(Problem::new("circle and camera do not go together: before a camera the ball is found"));
            }
            (ShapeForm::Ellipsoid(depth), None) => Object::Ellipsoid(depth),
            (ShapeForm::Ellipsoid(_), Some(_)) => {
                let problem = "an ellipsoid and a camera do not go together: an ellipsoid is fitted under an orthographic camera; give a mesh";
                return Err(Problem::new(problem));
            }
            (ShapeForm::Normals(source, trusted), camera) => {
                let normals = match source {
                    Source::Here(normals) => normals,
                    Source::File(path) => gonio_io::normals::read_normals(path)?,
                };
                Object::Normals(Box::new(NormalPicture { normals, camera, relief: None, trusted }))
            }
            (ShapeForm::Mesh(source), camera) => {
                let (placed, notes) = place(source, self.pose.as_ref(), camera, size, warnings)?;
                return Ok((Object::Surface(placed), notes));
            }
        };
        Ok((object, Value::Null))
    }

    /// The surface of a shape that is one before a camera, for pictures of `size`; `None` for a
    /// sphere seen from far away.
    pub(crate) fn surface(self, size: (usize, usize), warnings: &mut Vec<String>) -> Result<Option<Placed>, Problem> {
        match self.object(size, warnings)?.0 {
            Object::Surface(placed) => Ok(Some(placed)),
            Object::Sphere(None) => Ok(None),
            _ => Err(Problem::new("render a sphere or a mesh")),
        }
    }
}

/// The shape that `render` shows.
pub(crate) fn take_shape(given: &Bound<'_, PyAny>) -> PyResult<Shape> {
    given.extract::<GivenShape<'_>>()?.take()
}

/// A mesh before its camera.
fn place(
    source: Source<MeshParts>,
    pose: Option<&Json>,
    camera: Option<Camera>,
    size: (usize, usize),
    warnings: &mut Vec<String>,
) -> Result<(Placed, Value), Problem> {
    let (name, (mesh, soundness)) = match source {
        Source::Here(parts) => ("the mesh".to_owned(), Mesh::new(parts).map_err(|e| Problem::of("the mesh", e))?),
        Source::File(path) => {
            let mesh = gonio_io::mesh::read_shape(&path)?;
            (path.display().to_string(), mesh)
        }
    };
    // What has no file is called by the complaint itself.
    let complaint = |odd: String| if odd.starts_with(&name) { odd } else { format!("{name}: {odd}") };
    warnings.extend(soundness.complaint().map(complaint));
    let mesh = match pose {
        None => mesh,
        Some(pose) => {
            let by = match pose {
                Json::File(path) => read_pose(path)?,
                Json::Bytes(bytes) => decode_pose(Path::new("the pose"), bytes)?,
            };
            mesh.transformed(&by).map_err(|e| Problem::of("the pose", e))?
        }
    };
    let placed = Placed::of_mesh(&mesh, camera, size).map_err(|e| Problem::of(&name, e))?;
    let notes = gonio_report::notes::mesh(&name, &soundness, &placed.camera);
    Ok((placed, notes))
}
