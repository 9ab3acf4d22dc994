//! Wavefront OBJ: `v`, `vn` and `f`; everything else (materials, groups, texture coordinates,
//! lines, curves) is ignored.
//!
//! This parser replaces the crate `tobj`. That crate invents normals for faces without normals,
//! treats lines as faces, rejects comments that are not UTF-8, and does not report the line of an
//! error.

use std::path::Path;

use glam::DVec3;
use gonio::shape::{Mesh, MeshDefects};

use super::parts::MeshBuilder;
use crate::Error;

/// Largest number of bytes of a line that an error message quotes.
const QUOTED: usize = 60;
/// Message for an invalid face, after the number of its line.
const INVALID_FACE: &str = "is not a valid face, or refers to a missing vertex";

pub(super) fn decode(path: &Path, bytes: &[u8]) -> Result<(Mesh, MeshDefects), Error> {
    let mut parts = MeshBuilder::new(path);
    let mut normals: Vec<DVec3> = Vec::new();
    let mut early: Vec<(Vec<Corner>, usize)> = Vec::new();
    let mut joined = Vec::new();
    let mut first = 1;
    // Old Macintosh programs end lines with CR alone.
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    for (i, line) in bytes.split(|b| *b == end).enumerate() {
        let comment = line.iter().position(|b| *b == b'#').unwrap_or(line.len());
        let line = line[..comment].trim_ascii();
        // A backslash continues a line.
        if let Some(start) = line.strip_suffix(b"\\") {
            if joined.is_empty() {
                first = i + 1;
            }
            joined.extend_from_slice(start);
            joined.push(b' ');
            continue;
        }
        let (number, line) = if joined.is_empty() {
            (i + 1, line)
        } else {
            joined.extend_from_slice(line);
            (first, joined.as_slice())
        };
        let bad = |what: &str| {
            let quoted = String::from_utf8_lossy(&line[..line.len().min(QUOTED)]);
            Error::damaged(path, format!("line {number} {what}: {quoted}"))
        };
        let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => {
                parts.room_for(1)?;
                // Further numbers are a weight, which only rational curves use, or a colour.
                parts.positions.push(three(&mut words).ok_or_else(|| bad("is not a valid vertex"))?);
            }
            Some(b"vn") => {
                parts.room_for(normals.len() as u64 / 3)?;
                normals.push(three(&mut words).ok_or_else(|| bad("is not a valid normal"))?);
            }
            Some(b"f") => {
                let face: Option<Vec<Corner>> =
                    words.map(|word| corner(word, parts.positions.len(), normals.len())).collect();
                let face = face.ok_or_else(|| bad(INVALID_FACE))?;
                if face.iter().all(|(vertex, _)| (*vertex as usize) < parts.positions.len()) {
                    add(&mut parts, &normals, &face)?;
                } else {
                    // Faces may precede their vertices.
                    parts.room_for(early.len() as u64)?;
                    early.push((face, number));
                }
            }
            _ => {}
        }
        joined.clear();
    }
    for (face, number) in early {
        if face.iter().any(|(vertex, _)| *vertex as usize >= parts.positions.len()) {
            return Err(Error::damaged(path, format!("line {number} {INVALID_FACE}")));
        }
        add(&mut parts, &normals, &face)?;
    }
    parts.finish()
}

/// Indices, from 0, of a corner's vertex and of its normal, if it has one.
type Corner = (u32, Option<usize>);

/// Adds a face. Normals that the file does not contain are computed.
fn add(parts: &mut MeshBuilder<'_>, normals: &[DVec3], face: &[Corner]) -> Result<(), Error> {
    let (corners, of_corners): (Vec<u32>, Vec<DVec3>) = face
        .iter()
        .map(|(vertex, normal)| (*vertex, normal.and_then(|n| normals.get(n)).copied().unwrap_or(DVec3::ZERO)))
        .unzip();
    parts.polygon(&corners, &of_corners)
}

fn number_of(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

fn three<'a>(words: &mut impl Iterator<Item = &'a [u8]>) -> Option<DVec3> {
    let mut next = || words.next().and_then(number_of);
    Some(DVec3::new(next()?, next()?, next()?))
}

/// Parses the indices of vertex and normal in `7`, `7/8`, `7/8/9` or `7//9`; returns them from 0.
///
/// In the file, indices count from 1, and negative ones count backwards from the last element read
/// so far. A normal of index 0 is missing.
fn corner(word: &[u8], vertices: usize, normals: usize) -> Option<Corner> {
    let mut fields = word.split(|b| *b == b'/');
    let number = |field: &[u8]| -> Option<i64> { std::str::from_utf8(field).ok()?.parse().ok() };
    let index = |given: i64, count: usize| -> Option<usize> {
        usize::try_from(if given < 0 { given.checked_add(count as i64)? } else { given - 1 }).ok()
    };
    let vertex = index(number(fields.next()?)?, vertices)?;
    let _texture = fields.next();
    let normal = match fields.next() {
        None | Some(b"") => None,
        Some(field) => index(number(field)?, normals),
    };
    fields.next().is_none().then_some((u32::try_from(vertex).ok()?, normal))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    fn read(text: &str) -> Result<(Mesh, MeshDefects), Error> {
        decode(Path::new("a.obj"), text.as_bytes())
    }

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn faces_of_all_kinds_are_read() {
        for (faces, triangles) in [
            ("f 1 2 3\n", 1),
            ("f 1 2 3 4\n", 2),
            ("f 1 2 3\nf 1 3 4", 2),
            ("f -4 -3 -2 -1", 2),
            ("g one\nf 1 2 3\no two\nusemtl\nmtllib /dev/zero\nf 1 3 4\n", 2),
            ("vt 0 0\nf 1/1 2/1 3/1\n", 1),
            ("f 1 \\\r\n 2 3 \\\n4\r\n", 2),
            ("f 1 2 3\nl 1 2 3 4\np 1 2 3\nf 1\nf 1 2\n", 1),
        ] {
            let (mesh, defects) = read(&format!("# a\n{SQUARE}{faces}")).unwrap();
            assert_eq!((defects.triangles, defects.normals_computed), (triangles, true), "{faces}");
            assert!(mesh.normals().iter().flatten().all(|n| (*n - DVec3::Z).length() < 1e-12), "{faces}");
        }
    }

    #[test]
    fn normals_belong_to_corners() {
        let with = "vn 0 0 2\nvn 0 1 1\nf 1//1 2//1 3//2\nf 1//-2 3//-1 4//1\n";
        let (mesh, defects) = read(&format!("{SQUARE}{with}")).unwrap();
        assert!(!defects.normals_computed);
        let half = DVec3::new(0.0, 0.5, 0.5).normalize();
        for (got, want) in mesh.normals().iter().flatten().zip([DVec3::Z, DVec3::Z, half, DVec3::Z, half, DVec3::Z]) {
            assert!((*got - want).length() < 1e-12, "{got}");
        }
        // If one face has no normals, all normals are computed.
        let (_, defects) = read(&format!("{SQUARE}vn 0 1 1\nf 1//1 2//1 3//1\nf 1 3 4\n")).unwrap();
        assert!(defects.normals_computed);
    }

    #[test]
    fn ignores_weights_colours_and_comments() {
        let text = b"# caf\xe9\nv 0 0 0 1\nv 1 0 0 2 # wide\nv 1 1 0 0.5 0.5 0.5\nf 1 2 3 # side\n";
        let (mesh, _) = decode(Path::new("a.obj"), text).unwrap();
        assert_eq!(mesh.positions(), [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)]);
    }

    #[test]
    fn faces_may_come_first_and_lines_may_end_in_cr() {
        let (mesh, _) = read("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 1 1 0\n").unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2]]);
        let (mesh, _) = read("v 0 0 0\rv 1 0 0\rv 1 1 0\rf 1 2 3\r").unwrap();
        assert_eq!(mesh.triangles().len(), 1);
    }

    #[test]
    fn missing_normals_are_computed() {
        for face in ["f 1//1 2//1 3//1", "f 1//0 2//0 3//0"] {
            let (_, defects) = read(&format!("{SQUARE}{face}\n")).unwrap();
            assert!(defects.normals_computed, "{face}");
        }
    }

    #[test]
    fn errors_name_the_line() {
        for (text, message) in [
            ("f 1 2 5", "line 5 is not a valid face"),
            ("f 0 1 2", "line 5"),
            ("f 1 2 -5", "line 5"),
            ("f 1 2 -9223372036854775808", "line 5"),
            ("f 1 2 99999999999999999999", "line 5"),
            ("f 1/2/3/4 2 3", "line 5"),
            ("f a b c", "f a b c"),
            ("vn 0 1", "not a valid normal"),
            ("v 1 2", "line 5 is not a valid vertex: v 1 2"),
            ("v 1 2 x", "not a valid vertex"),
        ] {
            let error = read(&format!("{SQUARE}{text}\nf 1 2 3")).unwrap_err();
            assert_eq!(error.kind(), Kind::Damaged);
            assert!(error.to_string().contains(message), "{error}");
        }
        let error = read(SQUARE).unwrap_err();
        assert_eq!(
            error.to_string(),
            "a.obj: the mesh is empty (4 vertices, 0 triangles); export the surface with its faces"
        );
        assert!(
            read("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3")
                .unwrap_err()
                .to_string()
                .contains("coordinates that are not finite")
        );
        assert!(read("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3").unwrap_err().to_string().contains("zero area"));
    }
}
