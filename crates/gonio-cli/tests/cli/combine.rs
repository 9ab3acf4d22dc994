//! Tests of `gonio combine`.

use std::path::Path;

use gonio::lighting::{EnvironmentMap, studio_light};
use gonio_io::picture::encode_hdr;

use crate::support::{Bench, material, merl};

/// Infers three balls under known lights: two of one material, and one of another material.
fn seen() -> Bench {
    let bench = Bench::new();
    gonio_io::merl::write(bench.path("shiny.binary"), &merl(&material(0.1, 0.3))).unwrap();
    gonio_io::merl::write(bench.path("dull.binary"), &merl(&material(0.5, 0.02))).unwrap();
    let light: EnvironmentMap = studio_light(32);
    for (name, turn) in [("a", 0), ("b", 25)] {
        bench.write(&format!("{name}.hdr"), &encode_hdr(light.shifted_columns(turn).radiance()));
    }
    for (name, brdf, light) in [("one", "shiny", "a"), ("two", "shiny", "b"), ("other", "dull", "b")] {
        bench.run(&format!("render --brdf {brdf}.binary --light {light}.hdr -o {name}.exr --size 64")).succeeds();
        bench.run(&format!("infer {name}.exr -o {name} --light {light}.hdr --align-light fixed")).succeeds();
    }
    bench
}

#[test]
fn combines_one_material_and_rejects_others() {
    let bench = seen();
    bench.run("combine one two -o both").succeeds();
    let files = ["brdf.npz", "combined.png", "posterior.json", "relit.png", "report.html", "result.json"];
    assert!(files.iter().all(|file| bench.names("both").contains(&(*file).to_owned())), "{:?}", bench.names("both"));
    let page = String::from_utf8(bench.read("both/report.html")).unwrap();
    assert!(page.contains("Parameters for renderers") && page.contains("agreement"));
    let result = bench.json("both/result.json");
    assert!(
        result["colour"]["body"]["interval_90"][0][0].as_f64() < result["colour"]["body"]["log_chroma"][0].as_f64()
    );
    let photographs = &result["photographs"];
    for at in 0..2 {
        assert!(photographs[at]["agreement"].as_f64().unwrap() > 0.0, "{photographs}");
    }
    bench.refuses("combine one other -o out", &["does not show the same material"]);
    bench.refuses("combine one one -o out", &["one: has the same photograph as one"]);
    bench.refuses("combine one -o out", &["2 values"]);
    bench.refuses("combine one none -o out", &["none: cannot open"]);
    bench.refuses("combine one . -o out", &[".: does not contain posterior.json"]);
    std::fs::create_dir(bench.path("bad")).unwrap();
    bench.write("bad/posterior.json", b"{}");
    bench.refuses("combine one bad -o out", &["posterior.json: is not a posterior"]);
    assert!(!Path::new(&bench.path("out")).exists());
}
