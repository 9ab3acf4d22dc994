//! glTF 2.0: the meshes of the default scene, transformed by its nodes.

mod buffers;
mod morph;

use std::path::Path;

use glam::{DMat3, DMat4, DQuat, DVec3, Mat4, Quat, Vec3};
use gltf::json::Root;
use gltf::json::validation::Checked;
use gltf::mesh::Mode;
use gltf::scene::Transform;
use gltf::{Document, Node, Primitive, Semantic};
use gonio::shape::{Mesh, MeshDefects};

use self::buffers::Buffers;
use self::morph::Vertices;
use super::Fetch;
use super::parts::MeshBuilder;
use crate::{Error, Kind, guard};

pub(super) use buffers::read_sibling;

/// Largest number of JSON objects (nodes, accessors and so on). In memory, an object takes a
/// hundred times more than its minimum of two bytes in the file.
const MAX_OBJECTS: usize = 1 << 18;
/// Largest number of values in lists and objects, for the same reason.
const MAX_VALUES: usize = 1 << 22;
/// Extensions that do not affect the shape, and the one for integer positions, which this module
/// reads.
const ALLOWED: [&str; 6] =
    ["KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "EXT_lights_", "KHR_mesh_quantization"];
/// Advice for compressed meshes. `gltf-transform copy` decodes Draco and meshopt.
const DECOMPRESS: &str = "decompress the mesh: gltf-transform copy in.glb out.glb";

pub(super) fn decode(path: &Path, bytes: &[u8], fetch: Fetch<'_>) -> Result<(Mesh, MeshDefects), Error> {
    guard::catching(path, "glTF", || {
        let (json, bin) = if bytes.starts_with(b"glTF") { split(path, bytes)? } else { (bytes, None) };
        let (document, compressed) = parse(path, json)?;
        let buffers = Buffers::load(path, &document, bin, fetch);
        let buffers = buffers.map_err(|e| match &compressed {
            // Compressed meshes may have a buffer without data for other readers.
            Some(name) if e.kind() == Kind::Damaged => is_compressed(path, name),
            _ => e,
        })?;
        let mut parts = MeshBuilder::new(path);
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let Some(scene) = scene else {
            return Err(Error::invalid(path, "has no scene", "export the scene with the object"));
        };
        // Nodes form trees, but a damaged file may have cycles.
        let mut hidden: Option<Error> = None;
        let mut seen = vec![false; document.nodes().len()];
        let mut waiting: Vec<(Node<'_>, DMat4)> = scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
        while let Some((node, outer)) = waiting.pop() {
            if std::mem::replace(&mut seen[node.index()], true) {
                return Err(Error::damaged(path, format!("has a node with two parents (node {})", node.index())));
            }
            let pose = outer * matrix(&node.transform());
            if let Some(mesh) = node.mesh() {
                if node.skin().is_some() {
                    let problem = "has a skin, which is not supported";
                    return Err(Error::unsupported(path, problem, "apply the armature before exporting"));
                }
                let placed = match Placed::new(path, &node, pose) {
                    Ok(placed) => placed,
                    // A node of scale zero is invisible; some programs hide helper objects this
                    // way.
                    Err(error) if pose.is_finite() => {
                        hidden.get_or_insert(error);
                        waiting.extend(node.children().map(|child| (child, pose)));
                        continue;
                    }
                    Err(error) => return Err(error),
                };
                for primitive in mesh.primitives() {
                    placed.add(&primitive, &buffers, &mut parts)?;
                }
            }
            waiting.extend(node.children().map(|child| (child, pose)));
        }
        match hidden {
            Some(error) if parts.is_empty() => Err(error),
            _ => parts.finish(),
        }
    })
}

/// Splits a `.glb` file into the JSON and the binary chunk.
fn split<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), Error> {
    let number = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize);
    let cut = || Error::damaged(path, "is a truncated or damaged GLB file");
    let version = number(4).ok_or_else(cut)?;
    if version != 2 {
        let problem = format!("has glTF version {version}");
        return Err(Error::unsupported(path, problem, "export the mesh as glTF 2.0"));
    }
    let length = number(8).filter(|&length| length <= bytes.len()).ok_or_else(cut)?;
    let mut at = 12;
    let mut json = None;
    while at < length {
        let size = number(at).ok_or_else(cut)?;
        let kind = bytes.get(at + 4..at + 8).ok_or_else(cut)?;
        let data = bytes[..length].get(at + 8..at + 8 + size).ok_or_else(cut)?;
        match (kind, json) {
            (b"JSON", None) => json = Some(data),
            (b"BIN\0", Some(json)) => return Ok((json, Some(data))),
            // Chunks of other kinds may follow.
            (_, Some(_)) => {}
            (_, None) => return Err(cut()),
        }
        let end = at + 8 + size;
        // Chunks begin at multiples of four, but some programs do not pad the JSON.
        let follows = |at: usize| {
            let fits = number(at).is_some_and(|size| size <= length.saturating_sub(at + 8));
            fits && bytes.get(at + 4..at + 8) == Some(b"BIN\0")
        };
        at = if follows(end) { end } else { end.next_multiple_of(4) };
    }
    Ok((json.ok_or_else(cut)?, None))
}

fn is_compressed(path: &Path, extension: &str) -> Error {
    Error::unsupported(path, format!("is compressed with {extension}"), DECOMPRESS)
}

/// Parses the document without materials, textures and animations. Also returns the name of the
/// extension that compresses it, if any.
fn parse(path: &Path, json: &[u8]) -> Result<(Document, Option<String>), Error> {
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    // Base64 text contains neither braces nor commas.
    let more_than = |byte: u8, most: usize| json.iter().filter(|b| **b == byte).nth(most).is_some();
    if more_than(b'{', MAX_OBJECTS) || more_than(b',', MAX_VALUES) {
        let problem = format!("has more than {MAX_OBJECTS} parts or {MAX_VALUES} values");
        return Err(Error::limits(path, problem, "export only the object"));
    }
    let mut root: Root = gltf::json::deserialize::from_slice(json)
        .map_err(|e| Error::damaged(path, format!("cannot be read as glTF ({e})")))?;
    for name in std::mem::take(&mut root.extensions_required) {
        if name.ends_with("_compression") {
            return Err(is_compressed(path, &name));
        }
        if !ALLOWED.iter().any(|prefix| name.starts_with(prefix)) {
            let advice = "export the mesh without this extension";
            return Err(Error::unsupported(path, format!("requires the extension {name}"), advice));
        }
    }
    let compressed = root.extensions_used.iter().find(|name| name.ends_with("_compression")).cloned();
    // Errors in materials must not prevent reading the shape.
    for primitive in root.meshes.iter_mut().flat_map(|mesh| &mut mesh.primitives) {
        primitive.material = None;
        primitive.attributes.retain(|name, _| matches!(name, Checked::Valid(Semantic::Positions | Semantic::Normals)));
        // The bounds are redundant, and some programs do not write them.
        let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
        if let Some(accessor) = positions.and_then(|index| root.accessors.get_mut(index.value())) {
            let bounds = Some(serde_json::json!([0.0, 0.0, 0.0]));
            (accessor.min, accessor.max) = (bounds.clone(), bounds);
        }
    }
    root.materials.clear();
    root.textures.clear();
    root.images.clear();
    root.samplers.clear();
    root.animations.clear();
    let document = Document::from_json(root).map_err(|e| match (e, &compressed) {
        (gltf::Error::Validation(_), Some(name)) => is_compressed(path, name),
        (gltf::Error::Validation(faults), None) => {
            let text = faults.first().map(|(place, fault)| format!("{place}: {fault}")).unwrap_or_default();
            Error::damaged(path, format!("is an inconsistent glTF file ({text})"))
        }
        (e, _) => Error::damaged(path, format!("cannot be read as glTF ({e})")),
    })?;
    Ok((document, compressed))
}

/// Returns the transformation from a node to its parent.
fn matrix(transform: &Transform) -> DMat4 {
    match transform {
        Transform::Matrix { matrix } => Mat4::from_cols_array_2d(matrix).as_dmat4(),
        Transform::Decomposed { translation, rotation, scale } => {
            let rotation: DQuat = Quat::from_array(*rotation).as_dquat();
            let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
            let (scale, translation) = (Vec3::from_array(*scale), Vec3::from_array(*translation));
            DMat4::from_scale_rotation_translation(scale.as_dvec3(), rotation, translation.as_dvec3())
        }
    }
}

/// A node with a mesh.
struct Placed<'a> {
    path: &'a Path,
    pose: DMat4,
    /// Weights of the morph targets.
    weights: &'a [f32],
    /// Transformation of normals.
    normals: DMat3,
    /// Whether the pose reverses the orientation of triangles.
    mirrored: bool,
}

impl<'a> Placed<'a> {
    fn new(path: &'a Path, node: &Node<'a>, pose: DMat4) -> Result<Self, Error> {
        let linear = DMat3::from_mat4(pose);
        let determinant = linear.determinant();
        let normals = linear.inverse().transpose();
        if determinant == 0.0 || !pose.is_finite() || !normals.is_finite() {
            let problem = format!("has a node {} with a zero scale or a position that is not finite", node.index());
            return Err(Error::invalid(path, problem, "check its transform"));
        }
        Ok(Self { path, pose, weights: morph::weights(node), normals, mirrored: determinant < 0.0 })
    }

    fn add(&self, primitive: &Primitive<'_>, buffers: &Buffers<'_>, parts: &mut MeshBuilder<'_>) -> Result<(), Error> {
        let mode = primitive.mode();
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let accessor = primitive.get(&gltf::Semantic::Positions);
        let accessor = accessor.ok_or_else(|| Error::damaged(self.path, "has triangles without positions"))?;
        parts.room_for(accessor.count() as u64)?;
        let first = parts.positions.len() as u32;
        let positions = buffers.vectors(&accessor, "positions")?;
        let count = positions.len();
        let place = |p: [f32; 3]| self.pose.transform_point3(Vec3::from_array(p).as_dvec3());
        let normals = match primitive.get(&gltf::Semantic::Normals) {
            Some(accessor) if ![0, count].contains(&accessor.count()) => {
                let problem = format!("has {} normals for {count} vertices", accessor.count());
                return Err(Error::damaged(self.path, problem));
            }
            Some(accessor) => buffers.vectors(&accessor, "normals")?,
            None => Vec::new(),
        };
        let mut vertices = Vertices { positions, normals };
        vertices.morph(self.path, primitive, self.weights, buffers, parts)?;
        let Vertices { positions, normals } = vertices;
        let indices = match primitive.indices() {
            Some(accessor) => buffers.indices(&accessor)?,
            None => (0..count as u32).collect(),
        };
        if let Some(index) = indices.iter().find(|&&i| i as usize >= count) {
            let problem = format!("has a triangle that refers to vertex {index}, but there are only {count}");
            return Err(Error::damaged(self.path, problem));
        }
        parts.positions.extend(positions.into_iter().map(place));
        let normal = |i: u32| {
            let normal = normals.get(i as usize).map_or(DVec3::ZERO, |n| Vec3::from_array(*n).as_dvec3());
            (self.normals * normal).normalize_or_zero()
        };
        let mut triangle = |[a, b, c]: [u32; 3]| {
            let corners = if self.mirrored { [a, c, b] } else { [a, b, c] };
            parts.polygon(&corners.map(|i| first + i), &corners.map(normal))
        };
        match mode {
            Mode::Triangles => indices.chunks_exact(3).try_for_each(|t| triangle([t[0], t[1], t[2]])),
            Mode::TriangleStrip => indices
                .windows(3)
                .enumerate()
                .try_for_each(|(i, t)| triangle(if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[0], t[2], t[1]] })),
            _ => indices.windows(2).skip(1).try_for_each(|t| triangle([t[0], t[1], indices[0]])),
        }
    }
}

#[cfg(test)]
mod tests;
