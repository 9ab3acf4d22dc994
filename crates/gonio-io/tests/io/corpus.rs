//! Damaged and hostile files in `tests/corpus/`, including those found by fuzzing.
//!
//! Every reader must handle each file in bounded time and memory.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use gonio_io::geometry::{self, DepthOptions};
use gonio_io::picture::{self, ReadOptions};
use gonio_io::{Error, camera, merl, mesh, model, normals, npy, rgl};

/// Small, so that a valid but highly compressed file is rejected before it is unpacked.
const PIXELS: u64 = 1 << 20;
/// Time limit for one file and all readers, also on a busy machine.
const LONGEST: Duration = Duration::from_secs(20);
/// Address space for the whole replay, with all threads, in kilobytes.
const MEMORY: &str = "3000000";

/// Decodes bytes with every reader of this crate and returns the errors.
pub(crate) fn read_with_all(path: &Path, bytes: &[u8]) -> Vec<Error> {
    let read = ReadOptions { max_pixels: PIXELS, ..ReadOptions::default() };
    let depth = DepthOptions { range: Some((1.0, 2.0)), read: read.clone() };
    let length = bytes.len() as u64;
    let errors = [
        picture::decode(path, bytes, &read).err(),
        normals::decode(path, bytes, &read).err(),
        geometry::decode_depth(path, bytes, &depth).err(),
        geometry::decode_positions(path, bytes, &read).err(),
        npy::decode(path, bytes).err(),
        merl::decode(path, bytes, length).err(),
        merl::decode(path, bytes, merl::FILE_BYTES).err(),
        rgl::decode(path, bytes).err(),
        model::decode_model(path, bytes).err(),
        model::decode_lighting(path, bytes).err(),
        model::decode_reflectance(path, bytes).err(),
        model::decode_posterior(path, bytes).err(),
        mesh::decode(path, bytes).err(),
        camera::decode_camera(path, bytes, (640, 480)).err(),
        camera::decode_pose(path, bytes).err(),
    ];
    errors.into_iter().flatten().collect()
}

/// Checks that an error names its file on one line of limited length.
#[track_caller]
pub(crate) fn check_error(error: &Error, path: &Path) {
    let text = error.to_string();
    assert!(text.starts_with(&format!("{}: ", path.display())) && !text.contains('\n'), "{text}");
    assert!(text.contains("; "), "no advice: {text}");
    assert!(text.len() < 2000, "{} bytes: {text}", text.len());
}

fn files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    // `public` contains valid files.
    files.retain(|path| path.is_file());
    files.sort();
    assert!(files.len() > 40, "{} files", files.len());
    files
}

#[test]
fn every_reader_survives_every_file() {
    for file in files() {
        let bytes = std::fs::read(&file).unwrap();
        let start = Instant::now();
        for error in read_with_all(&file, &bytes) {
            check_error(&error, &file);
        }
        assert!(start.elapsed() < LONGEST, "{}: {:?}", file.display(), start.elapsed());
    }
}

#[test]
fn damaged_files_are_rejected_from_disk() {
    for file in files() {
        let name = file.file_name().unwrap().to_str().unwrap();
        let Some((kind, _)) = name.split_once('-') else { panic!("{name}: name it KIND-WHAT.EXTENSION") };
        let result = match kind {
            "mesh" => mesh::read_mesh(&file).err(),
            "camera" => camera::read_camera(&file, (640, 480)).err(),
            "pose" => camera::read_pose(&file).err(),
            "depth" => geometry::read_depth(&file, &DepthOptions::default()).err(),
            "normals" => normals::read_normals(&file).err(),
            "merl" => merl::read(&file).err(),
            "rgl" => rgl::read(&file).err(),
            "npy" => npy::read(&file).err(),
            "model" => model::read_model(&file).err(),
            "picture" => {
                let read = ReadOptions { max_pixels: PIXELS, ..ReadOptions::default() };
                picture::read(&file, &read).err()
            }
            // Unusual but valid files.
            "odd" => continue,
            other => panic!("{name}: no reader for {other}"),
        };
        check_error(&result.unwrap_or_else(|| panic!("{name} is accepted")), &file);
    }
}

/// Repeats the test with little memory. A reader that allocates the size in a header would abort
/// the process.
#[test]
#[cfg(target_os = "linux")]
fn memory_is_allocated_only_for_existing_data() {
    let test = std::env::current_exe().unwrap();
    let output = std::process::Command::new("sh")
        .args(["-c", &format!("ulimit -v {MEMORY} && exec \"$0\" --exact corpus::every_reader_survives_every_file")])
        .arg(test)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
