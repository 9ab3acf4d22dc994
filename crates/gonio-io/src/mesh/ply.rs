//! PLY: text and binary of either byte order.

use std::io::ErrorKind;
use std::path::Path;

use glam::DVec3;
use gonio::shape::{Mesh, MeshDefects};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::MAX_TRIANGLES;
use super::parts::MeshBuilder;
use crate::{Error, guard};

/// Longest header in bytes.
const MAX_HEADER_BYTES: usize = 1 << 16;
/// Longest line of text in bytes; reading it takes ten times its length in memory.
const MAX_LINE_LENGTH: usize = 1 << 20;

pub(super) fn decode(path: &Path, bytes: &[u8]) -> Result<(Mesh, MeshDefects), Error> {
    guard::catching(path, "PLY", || {
        let failed = |e: ParseError| explain(path, &e);
        check_header(path, bytes)?;
        let mut reader = Reader::new(bytes);
        let header = Parser::<Other>::new().read_header(&mut reader).map_err(failed)?;
        check_counts(path, &header, reader.get_ref().len())?;
        if header.encoding == Encoding::Ascii {
            check_lines(path, reader.get_ref())?;
        }
        let mut parts = MeshBuilder::new(path);
        let mut normals: Option<Vec<DVec3>> = None;
        let mut faces: Vec<Face> = Vec::new();
        for (name, element) in &header.elements {
            match name.as_str() {
                "vertex" => {
                    let has = |names: [&str; 3]| names.iter().all(|n| element.properties.contains_key(*n));
                    if !has(["x", "y", "z"]) {
                        let problem = "has vertices without x, y and z";
                        return Err(Error::unsupported(path, problem, "export the mesh with positions as x, y and z"));
                    }
                    let vertices: Vec<Vertex> =
                        Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(failed)?;
                    parts.positions = vertices.iter().map(|v| v.place).collect();
                    normals = has(["nx", "ny", "nz"]).then(|| vertices.iter().map(|v| v.normal).collect());
                }
                "face" => {
                    if !FACES.iter().any(|n| element.properties.contains_key(*n)) {
                        let problem = "has faces without vertex_indices";
                        return Err(Error::unsupported(
                            path,
                            problem,
                            "export the faces as lists named vertex_indices",
                        ));
                    }
                    faces = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(failed)?;
                }
                "tristrips" => {
                    return Err(Error::unsupported(
                        path,
                        "contains triangle strips",
                        "export the mesh with plain faces",
                    ));
                }
                _ => {
                    let _: Vec<Other> =
                        Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(failed)?;
                }
            }
        }
        let mut corner_normals = Vec::new();
        for face in &faces {
            corner_normals.clear();
            // An invalid index is detected when the mesh is built.
            let normal = |&i: &u32| normals.as_ref().and_then(|n| n.get(i as usize)).copied().unwrap_or(DVec3::ZERO);
            corner_normals.extend(face.corners.iter().map(normal));
            parts.polygon(&face.corners, &corner_normals)?;
        }
        parts.finish()
    })
}

/// Names of the property with the corners of a face.
const FACES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Checks that the header ends, so that the parser does not search the whole file for its end.
fn check_header(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let start = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    if start.windows(10).any(|w| w == b"end_header") {
        return Ok(());
    }
    Err(Error::damaged(path, "has no end_header in its PLY header"))
}

fn check_lines(path: &Path, text: &[u8]) -> Result<(), Error> {
    if text.split(|b| *b == b'\n').any(|line| line.len() > MAX_LINE_LENGTH) {
        let problem = format!("has a line of more than {MAX_LINE_LENGTH} bytes");
        return Err(Error::limits(path, problem, "export the mesh as binary PLY"));
    }
    Ok(())
}

/// Checks that the bytes after the header can hold as many elements as it declares.
fn check_counts(path: &Path, header: &Header, bytes: usize) -> Result<(), Error> {
    let mut least = 0_usize;
    for element in header.elements.values() {
        if element.count > MAX_TRIANGLES {
            let problem = format!("has {} elements {:?}, more than {MAX_TRIANGLES}", element.count, element.name);
            return Err(Error::limits(path, problem, "simplify the mesh"));
        }
        least = least.saturating_add(element.count.saturating_mul(least_size(element, header.encoding)));
    }
    // The last line of a text file may lack its line break.
    if least > bytes.saturating_add(1) {
        let problem = format!("declares elements of at least {least} bytes, but has {bytes} after its header");
        return Err(Error::damaged(path, problem));
    }
    Ok(())
}

/// Returns the smallest size of an element in bytes, at least one.
fn least_size(element: &ElementDef, encoding: Encoding) -> usize {
    let size = |t: &ScalarType| match (encoding, t) {
        // A digit and a separator.
        (Encoding::Ascii, _) => 2,
        (_, ScalarType::Char | ScalarType::UChar) => 1,
        (_, ScalarType::Short | ScalarType::UShort) => 2,
        (_, ScalarType::Int | ScalarType::UInt | ScalarType::Float) => 4,
        (_, ScalarType::Double) => 8,
    };
    let sizes = element.properties.values().map(|p| match &p.data_type {
        PropertyType::Scalar(t) | PropertyType::List(t, _) => size(t),
    });
    sizes.sum::<usize>().max(1)
}

fn explain(path: &Path, error: &ParseError) -> Error {
    // Later lines of the message quote the line of the file, which may be long.
    let text = error.to_string();
    let first = text.lines().next().unwrap_or_default();
    match error.kind() {
        ErrorKind::UnexpectedEof => Error::damaged(path, format!("is a truncated PLY file ({first})")),
        _ => Error::damaged(path, format!("cannot be read as PLY ({first})")),
    }
}

/// Properties of a vertex that are read.
#[derive(Default)]
struct Vertex {
    place: DVec3,
    normal: DVec3,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => &mut self.place.x,
            "y" => &mut self.place.y,
            "z" => &mut self.place.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            _ => return PropertyAccessResult::Ignored,
        };
        *slot = match value {
            Property::Float(v) => v.into(),
            Property::Double(v) => v,
            Property::Char(v) => v.into(),
            Property::UChar(v) => v.into(),
            Property::Short(v) => v.into(),
            Property::UShort(v) => v.into(),
            Property::Int(v) => v.into(),
            Property::UInt(v) => v.into(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// Corners of a face. Negative indices become `u32::MAX`, which no mesh has.
#[derive(Default)]
struct Face {
    corners: Vec<u32>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if !FACES.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        fn all<T: TryInto<u32>>(list: Vec<T>) -> Vec<u32> {
            list.into_iter().map(|i| i.try_into().unwrap_or(u32::MAX)).collect()
        }
        self.corners = match value {
            Property::ListChar(v) => all(v),
            Property::ListUChar(v) => all(v),
            Property::ListShort(v) => all(v),
            Property::ListUShort(v) => all(v),
            Property::ListInt(v) => all(v),
            Property::ListUInt(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An ignored element.
struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    fn read(bytes: &[u8]) -> Result<(Mesh, MeshDefects), Error> {
        decode(Path::new("a.ply"), bytes)
    }

    const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn reads_text_files_with_all_index_types() {
        for (list, faces, triangles) in [
            ("uchar int vertex_indices", "4 0 1 2 3\n", 2),
            ("uint8 uint32 vertex_index", "4 0 1 2 3", 2),
            ("int uchar vertex_index", "3 0 1 2\r\n", 1),
            ("short short vertex_indices", "4 3 0 1 2 \n", 2),
        ] {
            let text = format!(
                "ply\nformat ascii 1.0\ncomment made by hand\nobj_info none\nelement vertex 4\nproperty float x\nproperty double y\n\
                 property int z\nproperty uchar red\nelement edge 1\nproperty int vertex1\nproperty int vertex2\n\
                 element face 1\nproperty list {list}\nend_header\n0 0 0 9\n1 0 0 9\n1 1e0 0 9\n0 1 0 9\n0 1\n{faces}"
            );
            let (mesh, defects) = read(text.as_bytes()).unwrap();
            assert_eq!((defects.triangles, defects.normals_computed), (triangles, true), "{list}");
            // One triangle leaves the fourth vertex loose.
            assert_eq!(mesh.positions(), &SQUARE.map(DVec3::from_array)[..triangles + 2]);
        }
    }

    /// A square of doubles with normals, and a list of `i32` indices followed by a property.
    fn binary(big: bool) -> Vec<u8> {
        let order = if big { "big" } else { "little" };
        let mut bytes = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
             property float nx\nproperty float ny\nproperty float nz\nelement face 1\nproperty list uchar int vertex_indices\n\
             property ushort flags\nend_header\n"
        )
        .into_bytes();
        fn put<const N: usize>(bytes: &mut Vec<u8>, little: [u8; N], big: bool) {
            if big { bytes.extend(little.iter().rev()) } else { bytes.extend(little) }
        }
        for p in SQUARE {
            p.iter().for_each(|v| put(&mut bytes, v.to_le_bytes(), big));
            [0.0_f32, 3.0, 4.0].iter().for_each(|v| put(&mut bytes, v.to_le_bytes(), big));
        }
        bytes.push(4);
        (0..4_i32).for_each(|i| put(&mut bytes, i.to_le_bytes(), big));
        bytes.extend([0, 7]);
        bytes
    }

    #[test]
    fn reads_binary_files_of_both_byte_orders() {
        for big in [false, true] {
            let (mesh, defects) = read(&binary(big)).unwrap();
            assert_eq!((defects.triangles, defects.normals_computed), (2, false));
            assert_eq!(mesh.positions(), SQUARE.map(DVec3::from_array));
            assert!(mesh.normals().iter().flatten().all(|n| (*n - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-7));
        }
    }

    #[test]
    fn inconsistent_headers_are_rejected_before_allocation() {
        let good = String::from_utf8_lossy(&binary(false)[..300]).into_owned();
        let header = &good[..good.find("end_header").unwrap() + 11];
        for (from, to, kind, message) in [
            ("vertex 4", "vertex 99999999999999", Kind::Limits, "more than"),
            ("vertex 4", "vertex 8000000", Kind::Damaged, "declares elements"),
            ("face 1", "face 18446744073709551615", Kind::Limits, "more than"),
            ("face 1", "face 8000000", Kind::Damaged, "declares elements"),
            ("face 1", "face 99999999999999999999", Kind::Damaged, "cannot be read as PLY"),
            ("double x", "double a", Kind::Unsupported, "without x, y and z"),
            ("vertex_indices", "corners", Kind::Unsupported, "without vertex_indices"),
            ("element face", "element tristrips", Kind::Unsupported, "strips"),
            ("end_header", "end", Kind::Damaged, "no end_header"),
            ("double x", "list uchar double x", Kind::Damaged, "cannot be read"),
        ] {
            let mut bytes = header.replacen(from, to, 1).into_bytes();
            bytes.extend(&binary(false)[header.len()..]);
            let error = read(&bytes).unwrap_err();
            assert_eq!(error.kind(), kind, "{error}");
            assert!(error.to_string().contains(message), "{error}");
        }
        let long =
            format!("ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nend_header\n{}", "1 ".repeat(600_000));
        assert_eq!(read(long.as_bytes()).unwrap_err().kind(), Kind::Limits);
        // Elements without properties take no bytes.
        let empty = b"ply\nformat binary_little_endian 1.0\nelement nothing 8000000\nend_header\n";
        assert!(read(empty).unwrap_err().to_string().contains("declares elements"));
    }

    #[test]
    fn invalid_indices_are_rejected() {
        for corners in ["3 0 1 4", "3 0 1 -1", "5 0 1 2 3 7"] {
            let text = format!(
                "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n{corners}\n"
            );
            let error = read(text.as_bytes()).unwrap_err();
            assert!(error.to_string().contains("there are only 4"), "{error}");
        }
    }
}
