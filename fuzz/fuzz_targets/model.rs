#![no_main]
//! Trained models. A wrong hash would reject every input, so it is corrected first.

use std::path::Path;

use gonio_io::model;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let bytes = signed(bytes);
    let _ = model::decode_model(Path::new("a"), &bytes);
    let _ = model::decode_lighting(Path::new("a"), &bytes);
    let _ = model::decode_reflectance(Path::new("a"), &bytes);
    let _ = model::decode_posterior(Path::new("a"), &bytes);
});

/// Returns the file with its correct hash (`docs/model-format.md`).
fn signed(bytes: &[u8]) -> Vec<u8> {
    const KEY: &[u8] = b"\"blake3\":\"";
    let mut bytes = bytes.to_vec();
    let start = bytes.windows(KEY.len()).position(|w| w == KEY).map(|at| at + KEY.len());
    if let Some(start) = start.filter(|start| start + 64 <= bytes.len()) {
        bytes[start..start + 64].fill(b'0');
        let hash = blake3::hash(&bytes).to_hex();
        bytes[start..start + 64].copy_from_slice(hash.as_bytes());
    }
    bytes
}
