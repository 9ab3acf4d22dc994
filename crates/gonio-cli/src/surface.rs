//! Meshes before a camera, for `gonio infer` and `gonio render`.

use std::path::PathBuf;

use gonio_app::{Form, Shape, Source};

/// Options that say what the object is and where the camera stands.
#[derive(clap::Args)]
pub(crate) struct SurfaceOptions {
    /// The object as a triangle mesh: OBJ, PLY, glTF, or blob, bunny, bowl for one of our own
    #[arg(long, value_name = "FILE")]
    pub(crate) mesh: Option<PathBuf>,
    /// Where the mesh is in the world (docs/camera.md); as its file has it if not given
    #[arg(long, value_name = "FILE.json", requires = "mesh")]
    pose: Option<PathBuf>,
    /// The camera (docs/camera.md); if not given an orthographic one along -z that frames the mesh
    #[arg(long, value_name = "FILE.json")]
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
