#![no_main]
//! Meshes: PLY.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let bytes = bytes.strip_prefix(b"ply\n").unwrap_or(bytes);
    let _ = gonio_io::mesh::decode(Path::new("a"), &[b"ply\n", bytes].concat());
});
