//! Atomic output: single files and folders that appear complete or not at all.
//!
//! On a signal, a process calls [`abandon`], which removes unfinished output. A killed process can
//! leave a hidden file or folder named `.gonio-*`, which the next [`StagedFolder`] in the same
//! place removes.

mod folder;
mod unfinished;

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

pub use folder::StagedFolder;
pub use unfinished::abandon;

use crate::Error;

/// Prefix of the names of unfinished files and folders.
const PREFIX: &str = ".gonio-";

/// Writes a file: all of `bytes` or, on error, nothing.
///
/// An existing file is replaced, also through a symbolic link; devices and pipes are written in
/// place. The folder must exist.
///
/// # Errors
/// If the folder is missing or not writable, the target is a folder or read-only, or the disk is
/// full.
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), Error> {
    let path = path.as_ref();
    write(path, bytes).map_err(|e| {
        // Writing creates the target, so this error means that its folder is missing.
        let action =
            if e.kind() == io::ErrorKind::NotFound { "write, because its folder does not exist" } else { "write" };
        Error::io(path, action, e)
    })
}

fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let target = match fs::metadata(path) {
        Ok(meta) if meta.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
        // Devices such as `/dev/null` must not be replaced by a file.
        Ok(meta) if !meta.is_file() => return File::options().write(true).open(path)?.write_all(bytes),
        Ok(meta) if meta.permissions().readonly() => return Err(io::ErrorKind::PermissionDenied.into()),
        Ok(_) => fs::canonicalize(path)?,
        Err(e) if e.kind() == io::ErrorKind::NotFound => path.to_owned(),
        Err(e) => return Err(e),
    };
    let folder = folder_of(&target);
    let _writing = unfinished::writing();
    // Dropping the temporary file on any of the errors below removes it.
    let mut file = temporary(0o666).tempfile_in(&folder)?;
    let _unfinished = unfinished::Unfinished::file(file.path());
    file.write_all(bytes)?;
    // A full disk may cause an error only here. Without the sync, a crash could leave an empty file
    // under the final name.
    file.as_file().sync_all()?;
    file.persist(&target).map_err(|e| e.error)?;
    sync_folder(&folder);
    Ok(())
}

/// Returns the folder that contains `path`.
fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Configures temporary files and folders with ordinary permissions. `mode` is the mode before the
/// user's mask applies: 0o666 for files and 0o777 for folders.
fn temporary(mode: u32) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(mode));
    #[cfg(not(unix))]
    let _ = mode;
    builder
}

/// Syncs a folder, so that a rename survives a power cut. Errors are ignored: not all file systems
/// support this, and the file is intact either way.
fn sync_folder(folder: &Path) {
    let _ = File::open(folder).and_then(|f| f.sync_all());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn files_appear_and_are_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        for content in ["one", "another"] {
            write_file(&path, content.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), content);
        }
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn failure_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        let missing = write_file(dir.path().join("no/a"), b"x").unwrap_err();
        assert!(missing.to_string().contains("its folder does not exist"), "{missing}");
        fs::create_dir(dir.path().join("d")).unwrap();
        let folder = write_file(dir.path().join("d"), b"x").unwrap_err();
        assert_eq!(folder.io_kind(), Some(io::ErrorKind::IsADirectory));
        assert_eq!(names(dir.path()), ["d"]);
    }

    #[cfg(unix)]
    #[test]
    fn links_devices_and_permissions_are_respected() {
        use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let (real, link) = (dir.path().join("real"), dir.path().join("link"));
        fs::write(&real, "old").unwrap();
        symlink(&real, &link).unwrap();
        write_file(&link, b"new").unwrap();
        assert_eq!(fs::read(&real).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        // The file has the permissions of any other new file.
        let plain = dir.path().join("plain");
        fs::write(&plain, "").unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&real), mode(&plain));
        fs::set_permissions(&real, fs::Permissions::from_mode(0o444)).unwrap();
        assert_eq!(write_file(&real, b"x").unwrap_err().io_kind(), Some(io::ErrorKind::PermissionDenied));
        write_file("/dev/null", b"gone").unwrap();
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    }
}
