//! Guards against untrusted files: limits on file sizes, and capture of panics in decoders.

use std::fs::File;
use std::io::{self, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::Error;

/// Opens a regular file (or a pipe) for reading and returns its length, 0 for a pipe.
pub(crate) fn open(path: &Path) -> Result<(File, u64), Error> {
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let meta = file.metadata().map_err(|e| Error::io(path, "open", e))?;
    if meta.is_dir() {
        return Err(Error::io(path, "read", io::ErrorKind::IsADirectory.into()));
    }
    Ok((file, meta.len()))
}

/// Reads a whole file of at most `max` bytes. A longer file is rejected before any allocation.
pub(crate) fn read_whole(path: &Path, max: u64) -> Result<Vec<u8>, Error> {
    let (file, length) = open(path)?;
    if length > max {
        return Err(too_long(path, max));
    }
    let capacity = usize::try_from(length).map_err(|_| too_long(path, max))?;
    read_limited(path, file, max, Vec::with_capacity(capacity))
}

/// Reads a whole stream of at most `max` bytes; `name` is its name in error messages.
pub(crate) fn read_stream(name: &Path, stream: impl Read, max: u64) -> Result<Vec<u8>, Error> {
    read_limited(name, stream, max, Vec::new())
}

fn too_long(name: &Path, max: u64) -> Error {
    Error::limits(name, format!("is larger than the limit of {max} bytes"), "use a smaller file")
}

/// Appends a stream to `bytes`.
fn read_limited(name: &Path, stream: impl Read, max: u64, mut bytes: Vec<u8>) -> Result<Vec<u8>, Error> {
    // One byte more than allowed, to detect a pipe or a growing file that is too long.
    stream.take(max.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| Error::io(name, "read", e))?;
    if bytes.len() as u64 > max {
        return Err(too_long(name, max));
    }
    if bytes.is_empty() {
        return Err(Error::damaged(name, "is empty"));
    }
    Ok(bytes)
}

/// Runs a third-party decoder and converts a panic into an error. Only damaged files cause such
/// panics.
pub(crate) fn catching<T>(path: &Path, format: &str, decode: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    // Unwinding drops everything that the decoder held, so no inconsistent state remains.
    catch_unwind(AssertUnwindSafe(decode))
        .unwrap_or_else(|_| Err(Error::damaged(path, format!("is an inconsistent {format} file"))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    #[test]
    fn empty_and_long_streams_are_rejected() {
        let read = |bytes: &[u8]| read_stream(Path::new("stream"), bytes, 5);
        assert_eq!(read(b"12345").unwrap(), b"12345");
        assert_eq!(read(b"123456").unwrap_err().kind(), Kind::Limits);
        assert_eq!(read(b"").unwrap_err().to_string().split(';').next(), Some("stream: is empty"));
    }

    #[test]
    fn folders_and_empty_or_long_files_are_rejected() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("f");
        std::fs::write(&file, b"12345").unwrap();
        assert_eq!(read_whole(&file, 5).unwrap(), b"12345");
        assert_eq!(read_whole(&file, 4).unwrap_err().kind(), Kind::Limits);
        assert_eq!(read_whole(dir.path(), 9).unwrap_err().io_kind(), Some(io::ErrorKind::IsADirectory));
        std::fs::write(&file, b"").unwrap();
        assert_eq!(read_whole(&file, 4).unwrap_err().kind(), Kind::Damaged);
        assert_eq!(read_whole(&dir.path().join("g"), 4).unwrap_err().io_kind(), Some(io::ErrorKind::NotFound));
    }

    #[test]
    fn a_panic_becomes_an_error() {
        let got: Result<(), _> = catching(Path::new("x"), "EXR", || panic!("expected by the test"));
        assert_eq!(got.unwrap_err().kind(), Kind::Damaged);
    }
}
