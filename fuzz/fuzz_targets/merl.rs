#![no_main]
//! Tables of the MERL database, with the length of the input and with that of a complete file.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let _ = gonio_io::merl::decode(Path::new("a"), bytes, bytes.len() as u64);
    let _ = gonio_io::merl::decode(Path::new("a"), bytes, gonio_io::merl::FILE_BYTES);
});
