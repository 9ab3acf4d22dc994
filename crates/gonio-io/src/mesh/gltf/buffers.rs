//! Buffers of a glTF file and the numbers in them; every offset and length in the file is checked.

use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gltf::accessor::{Accessor, DataType, Dimensions};
use gltf::buffer::{Source, View};
use gltf::{Document, accessor};

use crate::mesh::{Fetch, MAX_BYTES};
use crate::{Error, guard};

/// All buffers of a file.
pub(super) struct Buffers<'a> {
    path: &'a Path,
    buffers: Vec<Vec<u8>>,
    /// Total length of the buffers.
    bytes: usize,
}

impl<'a> Buffers<'a> {
    /// Loads the buffers; `bin` is the chunk after the JSON of a `.glb` file.
    pub(super) fn load(
        path: &'a Path,
        document: &Document,
        bin: Option<&[u8]>,
        fetch: Fetch<'_>,
    ) -> Result<Self, Error> {
        let mut buffers = Vec::new();
        let mut room = MAX_BYTES;
        for buffer in document.buffers() {
            let index = buffer.index();
            let length = buffer.length();
            if length as u64 > room {
                let problem = format!("has buffers of more than {MAX_BYTES} bytes");
                return Err(Error::limits(path, problem, "simplify the mesh"));
            }
            let mut bytes = match buffer.source() {
                Source::Bin => match bin {
                    Some(bin) if index == 0 => bin.to_vec(),
                    _ => return Err(Error::damaged(path, format!("has no data for buffer {index}"))),
                },
                Source::Uri(uri) => match uri.strip_prefix("data:") {
                    Some(data) => embedded(data)
                        .ok_or_else(|| Error::damaged(path, format!("has invalid base64 in buffer {index}")))?,
                    None => fetch(uri, room)?,
                },
            };
            if bytes.len() < length {
                let problem = format!("has {} bytes in buffer {index}, but declares {length}", bytes.len());
                return Err(Error::damaged(path, problem));
            }
            room = room.saturating_sub(bytes.len() as u64);
            bytes.truncate(length);
            buffers.push(bytes);
        }
        let bytes = buffers.iter().map(Vec::len).sum();
        Ok(Self { path, buffers, bytes })
    }

    fn beyond(&self, accessor: &Accessor<'_>) -> Error {
        Error::damaged(self.path, format!("has data beyond the end of its buffers (accessor {})", accessor.index()))
    }

    /// Returns `count` items of `size` bytes each, without gaps.
    fn items(&self, view: &View<'_>, offset: usize, count: usize, size: usize) -> Option<Vec<u8>> {
        let buffer = self.buffers.get(view.buffer().index())?;
        let data = buffer.get(view.offset()..view.offset().checked_add(view.length())?)?.get(offset..)?;
        let stride = view.stride().unwrap_or(size);
        let Some(last) = count.checked_sub(1) else { return Some(Vec::new()) };
        // Overlapping items would give more data than the file has.
        if stride < size || last.checked_mul(stride)?.checked_add(size)? > data.len() {
            return None;
        }
        if stride == size {
            return Some(data[..count * size].to_vec());
        }
        Some((0..count).flat_map(|i| &data[i * stride..][..size]).copied().collect())
    }

    /// Returns all bytes of an accessor without gaps, with sparse values applied.
    fn bytes_of(&self, accessor: &Accessor<'_>) -> Result<Vec<u8>, Error> {
        let beyond = || self.beyond(accessor);
        let (count, size) = (accessor.count(), accessor.size());
        let mut bytes = match (accessor.view(), accessor.sparse()) {
            (Some(view), _) => self.items(&view, accessor.offset(), count, size).ok_or_else(beyond)?,
            // Implicit zeros, for which the file holds no bytes.
            (None, Some(_)) if count <= self.bytes => vec![0; count * size],
            (None, Some(_)) => return Err(beyond()),
            (None, None) => {
                let problem = format!("has geometry without data (accessor {})", accessor.index());
                return Err(Error::damaged(self.path, problem));
            }
        };
        if let Some(sparse) = accessor.sparse() {
            let (indices, values) = (sparse.indices(), sparse.values());
            let kind = indices.index_type();
            let places =
                self.items(&indices.view(), indices.offset(), sparse.count(), kind.size()).ok_or_else(beyond)?;
            let values = self.items(&values.view(), values.offset(), sparse.count(), size).ok_or_else(beyond)?;
            for (place, value) in places.chunks_exact(kind.size()).zip(values.chunks_exact(size)) {
                let at = little_endian(place) as usize;
                let target = bytes.chunks_exact_mut(size).nth(at).ok_or_else(beyond)?;
                target.copy_from_slice(value);
            }
        }
        Ok(bytes)
    }

    /// Reads an accessor of vectors of three floats, or of integers of 8 or 16 bits
    /// (`KHR_mesh_quantization`).
    pub(super) fn vectors(&self, accessor: &Accessor<'_>, what: &str) -> Result<Vec<[f32; 3]>, Error> {
        let (kind, dimensions) = (accessor.data_type(), accessor.dimensions());
        if dimensions != Dimensions::Vec3 || kind == DataType::U32 {
            let problem = format!("has {what} of type {dimensions:?} of {kind:?}");
            return Err(Error::unsupported(self.path, problem, "export the mesh with vectors of three floats"));
        }
        let bytes = self.bytes_of(accessor)?;
        let numbers = bytes.chunks_exact(kind.size()).map(|b| number(kind, accessor.normalized(), b));
        let numbers: Vec<f32> = numbers.collect();
        Ok(numbers.as_chunks().0.to_vec())
    }

    /// Reads an accessor of indices.
    pub(super) fn indices(&self, accessor: &Accessor<'_>) -> Result<Vec<u32>, Error> {
        let unsigned = matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::U32);
        if !unsigned || accessor.dimensions() != accessor::Dimensions::Scalar {
            return Err(Error::damaged(self.path, format!("has invalid indices (accessor {})", accessor.index())));
        }
        Ok(self.bytes_of(accessor)?.chunks_exact(accessor.size()).map(little_endian).collect())
    }
}

/// Reads a component of a vector. Normalised integers become -1..=1, or 0..=1 if unsigned. Source:
/// glTF 2.0, section 3.6.2.2.
fn number(kind: DataType, normalized: bool, bytes: &[u8]) -> f32 {
    let code = little_endian(bytes);
    let (value, largest) = match kind {
        DataType::I8 => (f32::from(code as u8 as i8), 127.0),
        DataType::U8 => (f32::from(code as u8), 255.0),
        DataType::I16 => (f32::from(code as u16 as i16), 32_767.0),
        DataType::U16 => (f32::from(code as u16), 65_535.0),
        DataType::U32 => (code as f32, u32::MAX as f32),
        DataType::F32 => return f32::from_bits(code),
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}

/// Reads an unsigned number of at most four bytes.
fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |n, b| n << 8 | u32::from(*b))
}

/// Decodes the part of a URI after `data:`.
fn embedded(data: &str) -> Option<Vec<u8>> {
    let (kind, text) = data.split_once(',')?;
    kind.ends_with(";base64").then(|| STANDARD.decode(text).ok()).flatten()
}

/// Reads the file `uri` that the glTF file at `path` references, of at most `most` bytes. It must
/// be in the same folder or below.
pub(in crate::mesh) fn read_sibling(path: &Path, uri: &str, most: u64) -> Result<Vec<u8>, Error> {
    let outside = || {
        let problem = format!("refers to {uri:?}, which is outside its folder");
        Error::unsupported(path, problem, "export the mesh as one .glb file")
    };
    let name = percent_decoded(uri).ok_or_else(outside)?;
    let relative = PathBuf::from(name);
    let plain = relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if !plain || uri.contains(':') {
        return Err(outside());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = folder.join(relative);
    // Links may point outside the folder.
    let real = file.canonicalize().map_err(|e| Error::io(&file, "open", e))?;
    if !folder.canonicalize().is_ok_and(|folder| real.starts_with(folder)) {
        return Err(outside());
    }
    guard::read_whole(&file, most)
}

/// Decodes percent signs: `a%20b` becomes `a b`.
fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, tail)) = rest.split_first() {
        rest = tail;
        if first == b'%' {
            let code = std::str::from_utf8(tail.get(..2)?).ok()?;
            bytes.push(u8::from_str_radix(code, 16).ok().filter(|b| *b != 0)?);
            rest = &tail[2..];
        } else {
            bytes.push(first);
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_embedded_buffers_are_decoded() {
        assert_eq!(percent_decoded("a%20b%C3%A9.bin").unwrap(), "a bé.bin");
        for bad in ["%", "%2", "%zz", "%ff", "%00"] {
            assert_eq!(percent_decoded(bad), None, "{bad}");
        }
        assert_eq!(embedded("application/octet-stream;base64,AAEC").unwrap(), [0, 1, 2]);
        assert_eq!((embedded("x;base64,A"), embedded("x,AAEC"), embedded("x")), (None, None, None));
    }

    #[test]
    fn files_outside_of_the_folder_are_not_opened() {
        let dir = tempfile::tempdir().unwrap();
        let inner = dir.path().join("inner");
        std::fs::create_dir_all(inner.join("sub")).unwrap();
        std::fs::write(dir.path().join("secret"), b"secret").unwrap();
        std::fs::write(inner.join("sub/b c.bin"), b"data").unwrap();
        let path = inner.join("a.gltf");
        assert_eq!(read_sibling(&path, "sub/b%20c.bin", 9).unwrap(), b"data");
        assert_eq!(read_sibling(&path, "./sub/b c.bin", 4).unwrap(), b"data");
        assert_eq!(read_sibling(&path, "sub/b c.bin", 3).unwrap_err().kind(), crate::Kind::Limits);
        assert_eq!(read_sibling(&path, "none.bin", 9).unwrap_err().io_kind(), Some(std::io::ErrorKind::NotFound));
        let absolute = dir.path().join("secret");
        for uri in
            ["../secret", "sub/../../secret", "%2e%2e/secret", absolute.to_str().unwrap(), "file:secret", "http://x/y"]
        {
            let error = read_sibling(&path, uri, 9).unwrap_err();
            assert!(error.to_string().contains("outside its folder"), "{error}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&absolute, inner.join("link")).unwrap();
            assert!(read_sibling(&path, "link", 9).unwrap_err().to_string().contains("outside its folder"));
        }
    }
}
