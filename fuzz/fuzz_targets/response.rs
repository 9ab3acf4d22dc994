#![no_main]
//! Response curves. A decoded curve must survive encoding and decoding.

use std::path::Path;

use gonio_io::picture::{decode_response, encode_response};
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    if let Ok(response) = decode_response(Path::new("a"), bytes) {
        let again = decode_response(Path::new("a"), &encode_response(&response));
        assert_eq!(again.map(|again| again.max()).ok(), Some(response.max()));
    }
});
