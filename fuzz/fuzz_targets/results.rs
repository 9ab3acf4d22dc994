#![no_main]
//! Result folders that are read and replaced. The input contains `result.json`,
//! `export/export.json` and `posterior.json`, separated by lines of `---`. Files outside the folder
//! must not be removed.

use std::fs;
use std::sync::LazyLock;

use gonio_app::{combine, export, folder};
use gonio_fuzz::Scratch;
use gonio_io::result;
use gonio_io::picture::encode_exr;
use libfuzzer_sys::fuzz_target;

/// A small environment map of the results.
static LIGHT: LazyLock<Vec<u8>> =
    LazyLock::new(|| encode_exr(&gonio::picture::Plane::from_fn(8, 4, |x, _| glam::Vec3::splat(x as f32)), None));

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    let mut parts = text.split("\n---\n");
    let scratch = Scratch::folder("results");
    let (keep, out) = (scratch.path().join("keep"), scratch.path().join("out"));
    fs::create_dir_all(out.join("export")).unwrap();
    fs::write(&keep, "foreign").unwrap();
    fs::write(out.join("light.exr"), &*LIGHT).unwrap();
    for name in ["result.json", "export/export.json", "posterior.json"] {
        if let Some(part) = parts.next() {
            fs::write(out.join(name), part).unwrap();
        }
    }
    let _ = result::read(&out.join("result.json"));
    let _ = export::ResultProperties::of(&out);
    let _ = combine::read_posteriors(std::slice::from_ref(&out));
    let holds = folder::holds_results(&out);
    let _ = folder::for_results(&out).unwrap().fill(&[("brdf.npz".to_owned(), Vec::new())]);
    assert!(keep.is_file() && out.join("brdf.npz").is_file());
    assert!(!(holds && out.join("result.json").exists()), "earlier results stay");
});
