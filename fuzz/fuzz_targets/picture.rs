#![no_main]
//! Photographs, environment maps and masks.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let options = gonio_io::picture::ReadOptions { max_pixels: 1 << 14, ..Default::default() };
    let _ = gonio_io::picture::decode(Path::new("a"), bytes, &options);
});
