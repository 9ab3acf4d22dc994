#![no_main]
//! Posteriors of single photographs.

use std::path::Path;

use gonio_io::posterior::SavedPosterior;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    if let Ok(saved) = SavedPosterior::decode(Path::new("a"), bytes) {
        assert!(SavedPosterior::decode(Path::new("a"), &saved.encode()).is_ok());
    }
});
