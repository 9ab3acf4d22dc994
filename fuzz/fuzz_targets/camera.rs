#![no_main]
//! Cameras.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let _ = gonio_io::camera::decode_camera(Path::new("a"), bytes, (640, 480));
});
