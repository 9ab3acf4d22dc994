//! Meshes before a camera, for `gonio infer` and `gonio render`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use gonio::shape::{Camera, Placed, PlacedError};
use gonio_io::camera::{read_camera, read_pose};
use gonio_io::mesh::read_shape;
use serde_json::Value;

/// Options that say what the object is and where the camera stands.
#[derive(clap::Args)]
pub(crate) struct MeshOptions {
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

impl MeshOptions {
    /// The camera of the file, if one is given.
    pub(crate) fn camera(&self, size: (usize, usize)) -> Result<Option<Camera>> {
        Ok(self.camera.as_ref().map(|path| read_camera(path, size)).transpose()?)
    }

    /// The mesh before its camera, for pictures of `size`, and what result.json says of it; `None`
    /// if none is given.
    pub(crate) fn place(&self, size: (usize, usize), warnings: &mut Vec<String>) -> Result<Option<(Placed, Value)>> {
        let Some(path) = &self.mesh else { return Ok(None) };
        let name = path.display();
        let (mesh, soundness) = read_shape(path)?;
        warnings.extend(soundness.complaint().map(|odd| format!("{name}: {odd}")));
        let posed = match &self.pose {
            Some(pose) => {
                let by = read_pose(pose)?;
                mesh.transformed(&by).with_context(|| pose.display().to_string())?
            }
            None => mesh,
        };
        let placed = match Placed::of_mesh(&posed, self.camera(size)?, size) {
            Err(PlacedError::Unseen) => bail!(
                "{name}: the camera sees nothing of the mesh; check --pose and --camera (the camera looks along -z, y is up; see docs/camera.md)"
            ),
            placed => placed.with_context(|| name.to_string())?,
        };
        let notes = gonio_report::notes::mesh(&name.to_string(), &soundness, &placed.camera);
        Ok(Some((placed, notes)))
    }
}
