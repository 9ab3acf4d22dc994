#![no_main]
//! Measured BSDFs of MDL, read and evaluated.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    if let Ok(material) = gonio_io::mbsdf::decode(Path::new("a"), bytes) {
        let direction = glam::DVec3::new(0.3, 0.2, 0.9).normalize();
        let _ = material.eval(direction, glam::DVec3::new(-0.5, 0.1, 0.6).normalize());
    }
});
