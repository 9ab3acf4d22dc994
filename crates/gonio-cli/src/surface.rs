//! Options for meshes and cameras of `gonio infer` and `gonio render`.

use std::path::PathBuf;

use gonio_app::{Shape, ShapeKind, Source};

/// Options for the mesh, its pose and the camera.
#[derive(clap::Args)]
pub(crate) struct SurfaceOptions {
    /// Triangle mesh of the object: OBJ, PLY or glTF
    ///
    /// FILE can also be the name of a built-in mesh: blob, bunny or bowl.
    #[arg(long, value_name = "FILE", help_heading = "Shape")]
    pub(crate) mesh: Option<PathBuf>,
    /// Pose of the mesh in world coordinates (docs/camera.md)
    ///
    /// By default, the coordinates in the mesh file are world coordinates.
    #[arg(long, value_name = "FILE.json", requires = "mesh", help_heading = "Shape")]
    pose: Option<PathBuf>,
    /// Camera parameters (docs/camera.md) [default: an orthographic camera]
    ///
    /// The default camera looks along -z and, with --mesh, frames the mesh.
    #[arg(long, value_name = "FILE.json", help_heading = "Camera")]
    pub(crate) camera: Option<PathBuf>,
}

impl SurfaceOptions {
    /// The files of the options.
    pub(crate) fn files(&self) -> [&Option<PathBuf>; 3] {
        [&self.mesh, &self.pose, &self.camera]
    }

    /// Returns the mesh with its pose and camera, if --mesh is given.
    pub(crate) fn mesh(&self) -> Option<Shape> {
        let file = |path: &Option<PathBuf>| path.clone().map(Source::File);
        let mesh = self.mesh.clone()?;
        Some(Shape { kind: ShapeKind::Mesh(Source::File(mesh)), camera: file(&self.camera), pose: file(&self.pose) })
    }
}
