//! Output to full and read-only disks must leave no partial files.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

use gonio_io::atomic::{StagedFolder, write_file};

/// A disk of 256 kB in memory, unmounted on drop.
struct TinyDisk(tempfile::TempDir);

impl TinyDisk {
    /// Mounts the disk; `None` if mounting is not permitted.
    fn mount() -> Option<Self> {
        let dir = tempfile::tempdir().unwrap();
        let mounted =
            Command::new("mount").args(["-t", "tmpfs", "-o", "size=256k", "gonio-test"]).arg(dir.path()).output();
        if mounted.is_ok_and(|out| out.status.success()) {
            Some(Self(dir))
        } else {
            eprintln!("skipped: no permission to mount a tiny disk");
            None
        }
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn names(&self) -> Vec<PathBuf> {
        fs::read_dir(self.path()).unwrap().map(|e| e.unwrap().path()).collect()
    }

    fn remount(&self, options: &str) {
        let remounted =
            Command::new("mount").args(["-o", &format!("remount,{options}")]).arg(self.path()).status().unwrap();
        assert!(remounted.success());
    }
}

impl Drop for TinyDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[test]
fn a_full_disk_leaves_no_partial_file() {
    let Some(disk) = TinyDisk::mount() else { return };
    let path = disk.path().join("a");
    write_file(&path, b"old").unwrap();
    let error = write_file(&path, &vec![1; 1 << 20]).unwrap_err();
    assert_eq!(error.io_kind(), Some(ErrorKind::StorageFull), "{error}");
    assert!(error.to_string().contains("free disk space"), "{error}");
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(disk.names(), [path]);
}

#[test]
fn a_full_disk_leaves_no_partial_folder() {
    let Some(disk) = TinyDisk::mount() else { return };
    let staged = StagedFolder::create(disk.path().join("new/out")).unwrap();
    write_file(staged.path("small"), b"x").unwrap();
    let error = write_file(staged.path("large"), &vec![1; 1 << 20]).unwrap_err();
    assert_eq!(error.io_kind(), Some(ErrorKind::StorageFull));
    drop(staged);
    assert!(disk.names().is_empty(), "{:?}", disk.names());
}

#[test]
fn errors_report_a_read_only_disk() {
    let Some(disk) = TinyDisk::mount() else { return };
    disk.remount("ro");
    for error in [
        write_file(disk.path().join("a"), b"x").unwrap_err(),
        StagedFolder::create(disk.path().join("b")).unwrap_err(),
        StagedFolder::create(disk.path().join("c/d")).unwrap_err(),
    ] {
        assert_eq!(error.io_kind(), Some(ErrorKind::ReadOnlyFilesystem), "{error}");
        assert!(error.to_string().ends_with("write to another folder"), "{error}");
    }
    disk.remount("rw");
}
