#![no_main]
//! Lists of directional lights.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let _ = gonio_io::lights::decode_lights(Path::new("a"), bytes);
});
