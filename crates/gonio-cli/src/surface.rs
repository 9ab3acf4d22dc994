//! Meshes before a camera, for `gonio infer` and `gonio render`.

use std::path::PathBuf;

use gonio_app::{Form, Shape, Source};

/// Options that say what the object is and where the camera stands.
#[derive(clap::Args)]
pub(crate) struct SurfaceOptions {
    /// The object as a triangle mesh: OBJ, PLY, glTF
    ///
    /// Or one of our own: blob, bunny, bowl.
    #[arg(long, value_name = "FILE", help_heading = "Shape")]
    pub(crate) mesh: Option<PathBuf>,
    /// Where the mesh is in the world (docs/camera.md)
    ///
    /// It is where its file has it if not given.
    #[arg(long, value_name = "FILE.json", requires = "mesh", help_heading = "Shape")]
    pose: Option<PathBuf>,
    /// The camera (docs/camera.md); far away if not given
    ///
    /// Without one it is orthographic, looks along -z, and frames the mesh if there is one.
    #[arg(long, value_name = "FILE.json", help_heading = "Camera")]
    pub(crate) camera: Option<PathBuf>,
}

impl SurfaceOptions {
    /// The mesh before its camera, if there is one.
    pub(crate) fn mesh(&self) -> Option<Shape> {
        let file = |path: &Option<PathBuf>| path.clone().map(Source::File);
        let mesh = self.mesh.clone()?;
        Some(Shape { form: Form::Mesh(Source::File(mesh)), camera: file(&self.camera), pose: file(&self.pose) })
    }
}
