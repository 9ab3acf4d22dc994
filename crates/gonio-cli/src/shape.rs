//! Meshes before a camera, for `gonio infer` and `gonio render`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use gonio::shape::{Camera, Form, Mesh, Soundness, Surface, Tracer};
use gonio_io::camera::{read_camera, read_pose};
use gonio_io::mesh::read_mesh;
use serde_json::{Value, json};

/// Share of the smaller side of the picture that is left free around a mesh without a camera.
const MARGIN: f64 = 0.05;

/// Cells along a side from which a shape of our own is made.
const FORM_CELLS: usize = 96;

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

/// A surface, in coordinates of the camera that sees it.
pub(crate) struct Placed {
    pub(crate) surface: Box<dyn Surface>,
    pub(crate) camera: Camera,
    /// For result.json.
    pub(crate) notes: Value,
}

impl MeshOptions {
    /// The camera of the file, if one is given.
    pub(crate) fn camera(&self, size: (usize, usize)) -> Result<Option<Camera>> {
        Ok(self.camera.as_ref().map(|path| read_camera(path, size)).transpose()?)
    }

    /// The mesh before its camera, for pictures of `size`; `None` if none is given.
    pub(crate) fn place(&self, size: (usize, usize), warnings: &mut Vec<String>) -> Result<Option<Placed>> {
        let Some(path) = &self.mesh else { return Ok(None) };
        let name = path.display();
        let own = [("blob", Form::Blob), ("bunny", Form::Bunny), ("bowl", Form::Bowl)];
        let own = own.into_iter().find(|(name, _)| path.as_os_str() == *name).filter(|_| !path.exists());
        let (mesh, soundness) = match own {
            Some((_, form)) => (form.mesh(FORM_CELLS)?, Soundness::default()),
            None => read_mesh(path)?,
        };
        warnings.extend(oddities(&soundness).map(|odd| format!("{name}: {odd}")));
        let posed = match &self.pose {
            Some(pose) => {
                let by = read_pose(pose)?;
                mesh.transformed(&by).with_context(|| pose.display().to_string())?
            }
            None => mesh,
        };
        let camera = match self.camera(size)? {
            Some(camera) => camera,
            None => {
                let (centre, radius) = posed.bounds();
                Camera::framing(centre, radius, size, MARGIN).with_context(|| name.to_string())?
            }
        };
        let seen: Mesh = posed.transformed(&camera.to_world.inverse()).with_context(|| name.to_string())?;
        let notes = json!({
            "mesh": name.to_string(), "soundness": soundness, "projection": camera.projection, "principal_point": camera.principal,
            "camera_to_world": camera.to_world.transpose().to_cols_array_2d(),
        });
        let surface = Box::new(Tracer::new(seen));
        if !sees_anything(surface.as_ref(), &camera) {
            bail!(
                "{name}: the camera sees nothing of the mesh; check --pose and --camera (the camera looks along -z, y is up; see docs/camera.md)"
            );
        }
        Ok(Some(Placed { surface, camera, notes }))
    }
}

/// Whether one of some hundred rays through the picture meets the surface, or failing that any pixel's.
fn sees_anything(surface: &dyn Surface, camera: &Camera) -> bool {
    let (width, height) = camera.size;
    let step = (width.max(height) / 24).max(1);
    let met = |x: usize, y: usize| gonio::shape::hit_at(surface, camera, x, y).is_some();
    let coarse = (0..height).step_by(step).any(|y| (0..width).step_by(step).any(|x| met(x, y)));
    coarse || (0..height).any(|y| (0..width).any(|x| met(x, y)))
}

/// What is odd about a mesh, in words.
fn oddities(soundness: &Soundness) -> Option<String> {
    let Soundness {
        triangles, degenerate, non_manifold_edges, inconsistent_edges, inside_out, normals_against, ..
    } = *soundness;
    let count = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}"));
    let odd: Vec<String> = [
        count(degenerate, "triangles without an area (left out)"),
        count(non_manifold_edges, "edges of more than two triangles"),
        count(inconsistent_edges, "edges between triangles that are turned to different sides"),
        count(
            if 20 * normals_against > triangles { normals_against } else { 0 },
            "triangles whose normals point to their back (taken on the side that is seen)",
        ),
        inside_out.then(|| "all triangles are turned inwards (taken on the side that is seen)".to_owned()),
    ]
    .into_iter()
    .flatten()
    .collect();
    (!odd.is_empty()).then(|| format!("the mesh of {triangles} triangles has {}", odd.join(", ")))
}
