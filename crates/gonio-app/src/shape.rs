//! Reads the shape of an object and its camera from files or memory.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use gonio::picture::Plane;
use gonio::scene::{Circle, Correction, NormalMap, ObjectShape, PositionMap};
use gonio::shape::{
    Camera, DepthKind, Mesh, MeshDefects, MeshParts, PoseError, PosedSurface, Projection, positions_of_depth,
};
use gonio::suggestion::Suggestion;
use gonio_io::camera::{decode_camera, decode_pose, read_camera, read_pose};
use gonio_io::geometry::{DepthOptions, read_depth, read_positions};

use crate::document::ShapeOrigin;
use crate::{AppError, Warning};

/// A value, or the file that contains it.
#[derive(Clone, Debug)]
pub enum Source<T> {
    /// In memory.
    Memory(T),
    /// In a file.
    File(PathBuf),
}

impl<T> Source<T> {
    /// Returns the name in messages: the file, or `unnamed`.
    pub fn name(&self, unnamed: &str) -> String {
        match self {
            Self::Memory(_) => unnamed.to_owned(),
            Self::File(path) => path.display().to_string(),
        }
    }
}

/// Shape of an object, with camera and pose.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Its form.
    pub kind: ShapeKind,
    /// The camera: JSON (docs/camera.md). Without one it is orthographic.
    pub camera: Option<Source<Vec<u8>>>,
    /// Pose of a mesh in the world: JSON (docs/camera.md).
    pub pose: Option<Source<Vec<u8>>>,
}

/// Shape of an object.
#[derive(Clone, Debug)]
pub enum ShapeKind {
    /// Ball with this outline; detected if `None`.
    Sphere(Option<Circle>),
    /// Ellipsoid with this semi-axis towards the camera in pixels, if known.
    Ellipsoid(Option<f64>),
    /// Any smooth shape, inflated from its outline.
    Outline,
    /// Triangle mesh; a file can be the name of a built-in mesh.
    Mesh(Source<MeshParts>),
    /// Any shape, given by a normal map.
    Normals(Box<NormalSource>),
}

/// A normal map and its conventions.
#[derive(Clone, Debug)]
pub struct NormalSource {
    /// The normal map.
    pub picture: Source<Plane<Vec3>>,
    /// Correction of the order and signs of its channels.
    pub correction: Correction,
    /// Skip the consistency checks.
    pub trusted: bool,
    /// Expected error in radians; zero for measured normals.
    pub error: f64,
    /// Positions of the surface, for self-shadowing.
    pub positions: Option<PositionSource>,
}

/// A depth or position map of a surface.
#[derive(Clone, Debug)]
pub enum PositionSource {
    /// Depths, `None` without surface; the depths of the smallest and the largest code of a file;
    /// and the direction of the depths.
    Depth(Source<Plane<Option<f64>>>, Option<(f64, f64)>, DepthKind),
    /// Positions in camera coordinates, `None` without surface.
    Positions(Source<Plane<Option<DVec3>>>),
}

/// Error for the outline of a ball before a camera.
pub(crate) const CIRCLE_AND_CAMERA: &str =
    "circle and camera cannot be combined; remove the circle, because gonio detects the ball in perspective";

impl Shape {
    /// Creates a shape with the default camera.
    pub fn of(form: ShapeKind) -> Self {
        Self { kind: form, camera: None, pose: None }
    }

    /// Returns the name in messages; `None` for shapes without an input.
    pub fn name(&self) -> Option<String> {
        match &self.kind {
            ShapeKind::Mesh(mesh) => Some(mesh.name("the mesh")),
            ShapeKind::Normals(normals) => Some(normals.picture.name("the normals")),
            ShapeKind::Sphere(_) | ShapeKind::Ellipsoid(_) | ShapeKind::Outline => None,
        }
    }

    /// Returns the name of the depth or position map in messages.
    pub(crate) fn positions_name(&self) -> Option<String> {
        match &self.kind {
            ShapeKind::Normals(normals) => normals.positions.as_ref().map(PositionSource::name),
            _ => None,
        }
    }

    /// Reads the camera for images of `size`; `None` without one.
    pub(crate) fn camera(&self, size: (usize, usize)) -> Result<Option<Camera>, AppError> {
        Ok(match &self.camera {
            None => None,
            Some(Source::File(path)) => Some(read_camera(path, size)?),
            Some(Source::Memory(json)) => Some(decode_camera(Path::new("the camera"), json, size)?),
        })
    }

    /// Returns the object to detect in an image of `size`, and the origin of its shape. `image` is
    /// the name of the image in messages.
    ///
    /// # Errors
    /// If a file cannot be read, or form and camera conflict.
    pub fn object(
        self,
        image: &str,
        size: (usize, usize),
        warnings: &mut Vec<Warning>,
    ) -> Result<(ObjectShape, ShapeOrigin), AppError> {
        let camera = self.camera(size)?;
        self.object_before(camera, image, size, warnings)
    }

    /// Returns the object like [`Self::object`], with the camera that was read.
    pub(crate) fn object_before(
        self,
        camera: Option<Camera>,
        image: &str,
        size: (usize, usize),
        warnings: &mut Vec<Warning>,
    ) -> Result<(ObjectShape, ShapeOrigin), AppError> {
        let object = match (self.kind, camera) {
            (ShapeKind::Sphere(circle), None) => ObjectShape::Sphere(circle),
            (ShapeKind::Sphere(None), Some(camera)) => ObjectShape::Ball(camera),
            (ShapeKind::Sphere(Some(_)), Some(_)) => return Err(AppError::new(CIRCLE_AND_CAMERA)),
            (ShapeKind::Ellipsoid(depth), None) => ObjectShape::Ellipsoid(depth),
            (ShapeKind::Ellipsoid(_), Some(_)) => {
                let problem = "ellipsoid and camera cannot be combined, because gonio fits an ellipsoid under an \
                               orthographic camera; specify a mesh";
                return Err(AppError::new(problem));
            }
            (ShapeKind::Outline, None) => ObjectShape::Outline,
            (ShapeKind::Outline, Some(_)) => {
                let problem = "outline and camera cannot be combined, because gonio inflates outlines under an \
                               orthographic camera; specify a mesh or normals";
                return Err(AppError::new(problem));
            }
            (ShapeKind::Normals(normals), camera) => return normals.object(image, camera, size),
            (ShapeKind::Mesh(mesh), camera) => {
                let (placed, mesh) = pose_mesh(mesh, self.pose.as_ref(), camera, size, warnings)?;
                return Ok((ObjectShape::Surface(placed), ShapeOrigin { mesh: Some(mesh), geometry: None }));
            }
        };
        Ok((object, ShapeOrigin::default()))
    }

    /// Returns the surface of a mesh with its camera, for images of `size`; `None` for a sphere
    /// under an orthographic camera.
    ///
    /// # Errors
    /// If [`Self::object`] fails, or the form is neither a mesh nor an orthographic sphere.
    pub fn surface(self, size: (usize, usize), warnings: &mut Vec<Warning>) -> Result<Option<PosedSurface>, AppError> {
        match self.object("the picture", size, warnings)?.0 {
            ObjectShape::Surface(placed) => Ok(Some(placed)),
            ObjectShape::Sphere(None) => Ok(None),
            _ => Err(AppError::new("only meshes and orthographic spheres can be rendered")),
        }
    }
}

impl NormalSource {
    fn object(
        self,
        image: &str,
        camera: Option<Camera>,
        size: (usize, usize),
    ) -> Result<(ObjectShape, ShapeOrigin), AppError> {
        let normals = match self.picture {
            Source::Memory(normals) => normals,
            Source::File(path) => gonio_io::normals::read_normals(&path)?,
        };
        let normals = if self.correction.is_none() { normals } else { self.correction.apply_to(&normals) };
        let (positions, geometry) = match self.positions {
            None => (None, None),
            Some(source) => {
                let name = source.name();
                (Some(source.read(&name, image, camera, size)?), Some(name))
            }
        };
        let picture = NormalMap { normals, camera, positions, trusted: self.trusted, error: self.error };
        Ok((ObjectShape::Normals(Arc::new(picture)), ShapeOrigin { mesh: None, geometry }))
    }
}

impl PositionSource {
    fn name(&self) -> String {
        match self {
            Self::Depth(depth, ..) => depth.name("the depths"),
            Self::Positions(positions) => positions.name("the positions"),
        }
    }

    /// Reads the map. `name` and `image` are the names of map and photograph in messages.
    fn read(
        self,
        name: &str,
        image: &str,
        camera: Option<Camera>,
        size: (usize, usize),
    ) -> Result<PositionMap, AppError> {
        let (positions, camera) = match self {
            Self::Depth(depth, range, kind) => {
                let depth = match depth {
                    Source::Memory(depth) => depth,
                    Source::File(path) => read_depth(&path, &DepthOptions { range, ..DepthOptions::default() })?,
                };
                // Without a camera, depths are in pixels.
                let unit = || Camera::new(Projection::Orthographic { pixels_per_unit: 1.0 }, (0.0, 0.0), size);
                let camera = camera.map_or_else(unit, Ok).map_err(|error| AppError::of(image, error))?;
                let positions = positions_of_depth(&depth, &camera, kind).map_err(|error| AppError::of(name, error))?;
                (positions, camera)
            }
            Self::Positions(positions) => {
                let Some(camera) = camera else {
                    return Err(AppError::of(name, "a position map requires a camera").with([Suggestion::Camera]));
                };
                let positions = match positions {
                    Source::Memory(plane) => plane,
                    Source::File(path) => read_positions(&path)?,
                };
                (positions, camera)
            }
        };
        if positions.size() != size {
            let ((w, h), (pw, ph)) = (positions.size(), size);
            return Err(AppError::new(format!(
                "{name} is {w}x{h} pixels, but {image} is {pw}x{ph}; use images of the same size"
            )));
        }
        Ok(PositionMap { positions, camera })
    }
}

/// Places a mesh in front of its camera; also returns its name and its defects.
fn pose_mesh(
    source: Source<MeshParts>,
    pose: Option<&Source<Vec<u8>>>,
    camera: Option<Camera>,
    size: (usize, usize),
    warnings: &mut Vec<Warning>,
) -> Result<(PosedSurface, (String, MeshDefects)), AppError> {
    let name = source.name("the mesh");
    let (mesh, defects) = match source {
        Source::Memory(parts) => Mesh::new(parts).map_err(|error| AppError::of(&name, error))?,
        Source::File(path) => gonio_io::mesh::read_shape(&path)?,
    };
    // Warnings about a mesh in memory already start with its name.
    let complaint = |text: String| if text.starts_with(&name) { text } else { format!("{name}: {text}") };
    warnings.extend(defects.describe().map(complaint).map(Warning::from));
    let mesh = match pose {
        None => mesh,
        Some(pose) => {
            let by = match pose {
                Source::File(path) => read_pose(path)?,
                Source::Memory(json) => decode_pose(Path::new("the pose"), json)?,
            };
            mesh.transformed(&by).map_err(|error| AppError::of(pose.name("the pose"), error))?
        }
    };
    let default_camera = camera.is_none();
    let placed = PosedSurface::of_mesh(&mesh, camera, size).map_err(|error| {
        let problem = AppError::of(&name, &error);
        match error {
            PoseError::Unseen if default_camera => problem.with([Suggestion::Pose, Suggestion::Camera]),
            PoseError::Unseen => problem.with([Suggestion::Pose]),
            _ => problem,
        }
    })?;
    Ok((placed, (name, defects)))
}
