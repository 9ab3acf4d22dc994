//! Triangle meshes: Wavefront OBJ, PLY (text and binary) and glTF 2.0 (`.glb`, `.gltf`).
//!
//! The format is recognised by content, never by the name. Only the surface of a file is read:
//! positions, faces and normals. Faces of more than three corners are triangulated; several objects
//! become one mesh.
//! * OBJ: objects and groups are joined; material files are never opened.
//! * PLY: `x y z` and `nx ny nz` of `vertex`, the list `vertex_indices` or `vertex_index` of
//!   `face`, of any types.
//! * glTF: all meshes of the default scene (the first, if none is marked as default) with the
//!   transformations of their nodes. Buffers may be embedded, or files in the folder of the file or
//!   below. Morph targets have the weights of their node or mesh. Positions and normals may be
//!   quantised (`KHR_mesh_quantization`). Compressed geometry and skins are rejected.
//!
//! Axes and units are those of the file; a pose (`docs/camera.md`) puts the object in front of the
//! camera.

mod gltf;
mod obj;
mod parts;
mod ply;

use std::path::Path;

use gonio::shape::{BuiltInShape, Mesh, MeshDefects};

use crate::{Error, guard};

/// Longest file read, 512 MiB.
const MAX_BYTES: u64 = 1 << 29;
/// Largest number of triangles, and of vertices: 2^23 (8.4 million). Building a mesh takes about
/// 200 bytes per triangle.
const MAX_TRIANGLES: usize = 1 << 23;

/// Function that reads a file referenced by a mesh. Its arguments are the name in the mesh and the
/// largest allowed number of bytes.
type Fetch<'a> = &'a dyn Fn(&str, u64) -> Result<Vec<u8>, Error>;

/// Reads a mesh; [`MeshDefects`] lists its defects.
///
/// # Errors
/// If the file cannot be read, has another format, is damaged, contains no surface, or has more
/// than 2^23 triangles or vertices.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<(Mesh, MeshDefects), Error> {
    let path = path.as_ref();
    let bytes = guard::read_whole(path, MAX_BYTES)?;
    decode_with(path, &bytes, &|name, length| gltf::read_sibling(path, name, length))
}

/// Reads a mesh, or builds the built-in shape of that name if there is no such file.
/// [`BuiltInShape::named`] defines the names.
///
/// # Errors
/// Like [`read_mesh`].
pub fn read_shape(path: impl AsRef<Path>) -> Result<(Mesh, MeshDefects), Error> {
    let path = path.as_ref();
    match path.to_str().and_then(BuiltInShape::named).filter(|_| !path.exists()) {
        Some(form) => {
            let mesh =
                form.mesh(BuiltInShape::CELLS).expect("BuiltInShape::CELLS is fine enough for every built-in shape");
            Ok((mesh, MeshDefects::default()))
        }
        None => read_mesh(path),
    }
}

/// Decodes a mesh held in memory; `path` is only used in error messages. A glTF file must contain
/// all its buffers.
///
/// # Errors
/// Like [`read_mesh`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<(Mesh, MeshDefects), Error> {
    decode_with(path, bytes, &|name, _| {
        Err(Error::unsupported(
            path,
            format!("stores its geometry in another file, {name:?}"),
            "export the mesh as one .glb file",
        ))
    })
}

fn decode_with(path: &Path, bytes: &[u8], fetch: Fetch<'_>) -> Result<(Mesh, MeshDefects), Error> {
    match Format::of(path, bytes)? {
        Format::Obj => obj::decode(path, bytes),
        Format::Ply => ply::decode(path, bytes),
        Format::Glb | Format::Gltf => gltf::decode(path, bytes, fetch),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Obj,
    Ply,
    Glb,
    Gltf,
}

impl Format {
    fn of(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
        match bytes {
            [b'g', b'l', b'T', b'F', ..] => return Ok(Self::Glb),
            [b'p', b'l', b'y', b'\r' | b'\n' | b' ', ..] => return Ok(Self::Ply),
            _ if text.starts_with(b"{") => return Ok(Self::Gltf),
            _ => {}
        }
        // OBJ files begin with any of their keywords.
        let word = text.split(|b| b.is_ascii_whitespace()).next().unwrap_or_default();
        let keyword = matches!(word, b"v" | b"vn" | b"vt" | b"f" | b"o" | b"g" | b"s" | b"mtllib" | b"usemtl");
        if keyword || word.starts_with(b"#") {
            return Ok(Self::Obj);
        }
        Err(match extension.as_str() {
            "obj" | "ply" | "glb" | "gltf" => {
                Error::damaged(path, format!("does not have the header of a .{extension} file"))
            }
            "" => Error::unsupported(path, "has an unknown mesh format", "export the mesh as OBJ, PLY or glTF"),
            other => {
                let problem = format!("is a .{other} file, which is not a supported mesh format");
                Error::unsupported(path, problem, "export the mesh as OBJ, PLY or glTF")
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    #[test]
    fn formats_are_recognised_by_content() {
        let of = |name: &str, bytes: &[u8]| Format::of(Path::new(name), bytes);
        for (bytes, format) in [
            (&b"# Blender\nv 0 0 0"[..], Format::Obj),
            (b"\xef\xbb\xbf\r\no Cube", Format::Obj),
            (b"v 1 2 3", Format::Obj),
            (b"ply\nformat ascii 1.0", Format::Ply),
            (b"ply\r\nformat", Format::Ply),
            (b"glTF\x02\0\0\0", Format::Glb),
            (b" \n{\"asset\": 1}", Format::Gltf),
        ] {
            assert_eq!(of("x.stl", bytes).unwrap(), format);
        }
        for (name, kind, message) in [
            ("a.obj", Kind::Damaged, "does not have the header of a .obj file"),
            ("a.stl", Kind::Unsupported, "is a .stl file"),
            ("a", Kind::Unsupported, "OBJ, PLY or glTF"),
        ] {
            let error = of(name, b"solid thing").unwrap_err();
            assert_eq!(error.kind(), kind);
            assert!(error.to_string().contains(message), "{error}");
        }
    }

    #[test]
    fn built_in_shapes_need_no_file() {
        let (mesh, defects) = read_shape("bowl").unwrap();
        assert!(mesh.triangles().len() > 1000 && defects == MeshDefects::default());
        assert!(read_shape("cup").unwrap_err().to_string().starts_with("cup: "));
    }
}
