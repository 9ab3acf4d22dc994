#![no_main]
//! Meshes: glTF, binary and text.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let _ = gonio_io::mesh::decode(Path::new("a"), bytes);
});
