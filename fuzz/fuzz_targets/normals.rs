#![no_main]
//! Pictures of normals, depths and positions.

use std::path::Path;

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let read = gonio_io::picture::ReadOptions { linear: true, max_pixels: 1 << 14, ..Default::default() };
    let _ = gonio_io::normals::decode(Path::new("a"), bytes, &read);
    let _ = gonio_io::geometry::decode_positions(Path::new("a"), bytes, &read);
    let depth = gonio_io::geometry::DepthOptions { range: Some((1.0, 2.0)), read };
    let _ = gonio_io::geometry::decode_depth(Path::new("a"), bytes, &depth);
});
