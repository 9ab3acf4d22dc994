//! JSON files in a folder of results.

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::Error;
use crate::guard::read_whole;

/// Longest file in bytes. Files of gonio have about ten thousand bytes; in memory, a value takes at
/// most sixteen times its text.
const MAX_BYTES: u64 = 16 << 20;

/// Reads a JSON file.
///
/// # Errors
/// If it cannot be read, is longer than 16 MiB, or does not have the form of `T`.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    decode(path, &read_whole(path, MAX_BYTES)?)
}

/// Decodes a JSON file held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read`].
pub fn decode<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, Error> {
    serde_json::from_slice(bytes).map_err(|error| Error::damaged(path, format!("is not valid JSON: {error}")))
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use serde_json::Value;

    use super::*;
    use crate::Kind;

    #[test]
    fn long_and_deep_files_are_rejected() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("result.json");
        // A sparse file of 8 TB.
        File::create(&path).unwrap().set_len(1 << 43).unwrap();
        assert_eq!(read::<Value>(&path).unwrap_err().kind(), Kind::Limits);
        std::fs::write(&path, "[".repeat(1 << 20)).unwrap();
        assert_eq!(read::<Value>(&path).unwrap_err().kind(), Kind::Damaged);
        std::fs::write(&path, "{\"a\": 1}").unwrap();
        assert_eq!(read::<Value>(&path).unwrap()["a"], 1);
    }
}
