//! Container of the RGL files: named arrays of numbers.
//!
//! A file starts with `tensor_file` and a zero byte, the version 1 0, and the number of fields (32
//! bits). Each field has the length of its name (16 bits), the name, the number of axes (16 bits)
//! and the type (8 bits). The offset of its values in the file (64 bits) and the length of each
//! axis (64 bits) follow. All numbers are little-endian; the last axis varies fastest.

use std::collections::BTreeMap;
use std::path::Path;

use crate::{Error, little_endian};

/// First bytes of every such file.
pub(crate) const MAGIC: &[u8] = b"tensor_file\0";
/// Type of unsigned bytes.
pub(super) const UINT8: u8 = 1;
/// Type of single precision.
pub(super) const FLOAT32: u8 = 10;

/// One array with its values as bytes.
#[derive(Clone, Debug)]
struct Field<'a> {
    kind: u8,
    shape: Vec<usize>,
    bytes: &'a [u8],
}

/// All arrays of a file by name.
#[derive(Clone, Debug)]
pub(super) struct Tensors<'a> {
    path: &'a Path,
    fields: BTreeMap<String, Field<'a>>,
}

impl<'a> Tensors<'a> {
    /// Parses the arrays of a file held in memory; `path` is only used in error messages.
    ///
    /// # Errors
    /// If the header is invalid or refers to bytes beyond the end of the file.
    pub(super) fn parse(path: &'a Path, bytes: &'a [u8]) -> Result<Self, Error> {
        let Some(rest) = bytes.strip_prefix(MAGIC) else {
            return Err(Error::damaged(path, "does not have the header of an RGL tensor file"));
        };
        let short = || Error::damaged(path, "is truncated in its header");
        let mut header = Cursor(rest);
        let version = header.take::<2>().ok_or_else(short)?;
        if version != [1, 0] {
            let problem = format!("has tensor file version {}.{}", version[0], version[1]);
            return Err(Error::unsupported(path, problem, "use files of version 1.0"));
        }
        let count = u32::from_le_bytes(header.take().ok_or_else(short)?);
        let mut fields = BTreeMap::new();
        // If the count is too large, the loop fails at the end of the header.
        for _ in 0..count {
            let (name, field) = field(path, bytes, &mut header).ok_or_else(short)??;
            if fields.contains_key(&name) {
                return Err(Error::damaged(path, format!("contains the field {name} twice")));
            }
            fields.insert(name, field);
        }
        Ok(Self { path, fields })
    }

    /// Returns the path for error messages.
    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    /// Returns the bytes of a field; `None` if it is absent or of another type.
    pub(super) fn bytes(&self, name: &str) -> Option<&'a [u8]> {
        self.fields.get(name).filter(|f| f.kind == UINT8).map(|f| f.bytes)
    }

    /// Reads shape and values of a field.
    ///
    /// # Errors
    /// If there is no field of this name with `AXES` axes in single precision, it is empty, or a
    /// value is not finite.
    pub(super) fn floats<const AXES: usize>(&self, name: &str) -> Result<([usize; AXES], Vec<f32>), Error> {
        let Some(field) = self.fields.get(name) else {
            let advice = "use an RGB file of the RGL material database (NAME_rgb.bsdf)";
            return Err(Error::invalid(self.path, format!("contains no field {name}"), advice));
        };
        if field.kind != FLOAT32 {
            let problem = format!("contains {name} in a type other than single precision");
            return Err(Error::unsupported(self.path, problem, "write the file in single precision"));
        }
        let shape = <[usize; AXES]>::try_from(field.shape.as_slice());
        let Some(shape) = shape.ok().filter(|s| !s.contains(&0)) else {
            let problem = format!("has the shape {:?} for {name} instead of {AXES} non-empty axes", field.shape);
            return Err(Error::damaged(self.path, problem));
        };
        let values = little_endian::f32s(field.bytes);
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::damaged(self.path, format!("has a value that is not finite at index {at} of {name}")));
        }
        Ok((shape, values))
    }
}

/// Reads the next field; `None` if the header is truncated.
fn field<'a>(path: &Path, file: &'a [u8], header: &mut Cursor<'a>) -> Option<Result<(String, Field<'a>), Error>> {
    let length = u16::from_le_bytes(header.take()?);
    let name = String::from_utf8_lossy(header.slice(length.into())?).into_owned();
    let axes = u16::from_le_bytes(header.take()?);
    let [kind] = header.take()?;
    let offset = u64::from_le_bytes(header.take()?);
    let shape: Vec<u64> = little_endian::u64s(header.slice(8 * usize::from(axes))?);
    let Some(size) = size_of(kind) else {
        return Some(Err(Error::damaged(path, format!("has values of the unknown type {kind} in {name}"))));
    };
    let bytes = shape.iter().try_fold(size, |n, axis| n.checked_mul(*axis));
    let range = bytes.and_then(|n| Some(usize::try_from(offset).ok()?..usize::try_from(offset.checked_add(n)?).ok()?));
    let Some(bytes) = range.and_then(|r| file.get(r)) else {
        let problem = format!("is truncated: {name} with the shape {shape:?} exceeds its {} bytes", file.len());
        return Some(Err(Error::damaged(path, problem)));
    };
    // Each axis of a non-empty array is below the length of the file; axes of empty arrays may have
    // any length.
    let shape = shape.iter().map(|n| usize::try_from(*n).unwrap_or(usize::MAX)).collect();
    Some(Ok((name, Field { kind, shape, bytes })))
}

/// Returns the size of one value in bytes. Kinds 1 to 8 are integers of 8 to 64 bits, 9 to 11
/// floats of 16 to 64 bits.
fn size_of(kind: u8) -> Option<u64> {
    match kind {
        1 | 2 => Some(1),
        3 | 4 | 9 => Some(2),
        5 | 6 | 10 => Some(4),
        7 | 8 | 11 => Some(8),
        _ => None,
    }
}

/// Unread rest of a header.
struct Cursor<'a>(&'a [u8]);

impl<'a> Cursor<'a> {
    fn slice(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.slice(N).map(|s| s.try_into().expect("the slice has N bytes"))
    }
}
