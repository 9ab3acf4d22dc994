//! `gonio train`.

use gonio::lighting::studio_light;
use gonio::reflectance::{CELLS, THETA_D, THETA_H};
use gonio_io::npy;
use gonio_io::picture::encode_hdr;

use crate::support::{Bench, grey, material, merl};

/// Three lights in `lights`.
fn lights(bench: &Bench) {
    std::fs::create_dir(bench.path("lights")).unwrap();
    for (i, turn) in [0, 5, 11].into_iter().enumerate() {
        let mut light = studio_light(16).turned(turn).radiance().clone();
        let width = light.width();
        for (at, p) in light.as_mut_slice().iter_mut().enumerate() {
            *p *= 1.0 + 0.5 * ((at % width) as f32 * 0.4 + (i * (at / width)) as f32 * 0.3).sin();
        }
        bench.write(&format!("lights/{i}.hdr"), &encode_hdr(&light));
    }
}

/// Three materials in `materials`.
fn materials(bench: &Bench) {
    std::fs::create_dir(bench.path("materials")).unwrap();
    for (name, diffuse, width) in [("matt", 0.3, 0.6), ("satin", 0.2, 0.3), ("gloss", 0.05, 0.3)] {
        let table = merl(&material(diffuse, width));
        gonio_io::merl::write(bench.path("materials").join(name).with_extension("binary"), &table).unwrap();
    }
}

#[test]
fn a_model_is_learnt_joined_and_used() {
    let bench = Bench::with_ball();
    lights(&bench);
    materials(&bench);
    bench.run("train lighting lights -o light.model --grid 16 --turns 2").succeeds();
    bench.run("train reflectance materials -o brdf.model --rank 2 --restarts 2").succeeds();
    let run = bench.run("train model --lighting light.model --reflectance brdf.model -o joined.model").succeeds();
    assert!(run.stdout.contains("3 maps") && run.stdout.contains("3 materials"), "{run:?}");
    let model = gonio_io::model::read_model(bench.path("joined.model")).unwrap();
    assert_eq!((model.reflectance.len(), model.light.scales, model.light.lights), (2, 4, 3));

    bench.refuses(
        "infer ball.exr -o out --normals normals.npy --model joined.model --grid 8",
        &["joined.model: has no posterior of materials", "gonio train posterior"],
    );
    let infer = "infer ball.exr -o out --method variational --starts 1 --normals normals.npy --model";
    bench.run(&format!("{infer} joined.model --grid 8")).succeeds();
    let result = bench.json("out/result.json");
    assert_eq!(result["reflectance"]["coefficients"].as_array().unwrap().len(), 2);
    assert_eq!(result["model"]["provenance"], model.provenance);

    bench.refuses(&format!("{infer} joined.model --grid 32"), &["grid 32: give a power of two from 4 to 16"]);
    bench.refuses(&format!("{infer} light.model"), &["light.model", "a light prior alone", "gonio train model"]);
    let join = "train model -o x.model --lighting";
    bench.refuses(&format!("{join} brdf.model --reflectance brdf.model"), &["brdf.model", "gonio train lighting"]);
    bench.refuses(&format!("{join} light.model --reflectance none"), &["none: cannot open"]);
    bench.refuses(&format!("{join} light.model --reflectance normals.npy"), &["normals.npy: is not a model"]);
    let half = bench.read("light.model");
    bench.write("half.model", &half[..half.len() / 2]);
    bench.refuses(&format!("{join} half.model --reflectance brdf.model"), &["half.model", "damaged"]);
}

#[test]
fn lights_that_cannot_be_learnt_from_are_refused() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("empty")).unwrap();
    let line = |rest: &str| format!("train lighting -o x.model --turns 2 {rest}");
    bench.refuses(&line("empty"), &["empty: no .hdr"]);
    bench.refuses(&line("none"), &["none: cannot list"]);
    bench.write("file", b"x");
    bench.refuses(&line("file"), &["file: cannot list"]);
    lights(&bench);
    bench.refuses(&line("lights --grid 17"), &["--grid 17"]);
    bench.refuses(&line("lights --turns 0"), &["--turns"]);
    bench.refuses(&line("lights --grid 8 --cap 0.5"), &["--cap: give a number above 1"]);
    bench.run(&line("lights --grid 8 --cap 30")).succeeds();
    bench.refuses("train lighting lights -o none/x.model --grid 8 --turns 1", &["none/x.model"]);
    let good = bench.read("lights/1.hdr");
    bench.write("lights/1.hdr", &good[..good.len() / 2]);
    bench.refuses(&line("lights --grid 8"), &["lights/1.hdr"]);
    bench.write("lights/1.hdr", &good);
    bench.write("lights/2.exr", &grey(1.0, 16, 9));
    bench.refuses(&line("lights --grid 8"), &["lights/2.exr: a lat-long map"]);
    std::fs::create_dir(bench.path("flat")).unwrap();
    bench.write("flat/grey.exr", &grey(1.0, 16, 8));
    bench.refuses(&line("flat --grid 8"), &["flat: the lights have no structure"]);
}

#[test]
fn materials_that_cannot_be_learnt_from_are_refused() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("empty")).unwrap();
    let line = |rest: &str| format!("train reflectance -o x.model --restarts 1 {rest}");
    bench.refuses(&line("empty"), &["empty: "]);
    bench.refuses(&line("none"), &["none: "]);
    materials(&bench);
    bench.refuses(&line("materials --rank 4"), &["--rank 4", "materials holds 3 materials", "1 to 3"]);
    bench.refuses(&line("materials --rank 0"), &["--rank 0"]);
    bench.refuses("train reflectance materials -o x.model --rank 2 --restarts 0", &["--restarts 0"]);
    let good = bench.read("materials/satin.binary");
    bench.write("materials/satin.binary", &good[..1000]);
    bench.refuses(&line("materials --rank 2"), &["materials/satin.binary: is cut short"]);
    let black = merl(&material(0.0, 0.3)).bivariate(0).as_slice().iter().map(|_| 0.0).collect();
    let black = gonio::reflectance::BivariateTable::from_vec(black);
    gonio_io::merl::write(bench.path("materials/satin.binary"), &merl(&black)).unwrap();
    bench.refuses(&line("materials --rank 2"), &["materials: material satin is zero"]);

    std::fs::create_dir(bench.path("set")).unwrap();
    let array = npy::Array { shape: vec![1, THETA_H, THETA_D, 3], values: vec![0.1; 3 * CELLS] };
    bench.write("set/bivariate_rgb_f32.npy", &npy::encode(&array));
    bench.refuses(&line("set --rank 1"), &["set/materials.txt"]);
    bench.write("set/materials.txt", b"one\ntwo\n");
    bench.refuses(&line("set --rank 1"), &["set/bivariate_rgb_f32.npy", "shape"]);
}
