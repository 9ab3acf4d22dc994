//! Tests of `gonio train`.

use gonio::lighting::studio_light;
use gonio::reflectance::{CELLS, THETA_D, THETA_H};
use gonio_io::npy;
use gonio_io::picture::encode_hdr;

use crate::support::{Bench, grey, material, merl};

/// Writes three lights to the folder `lights`.
pub(crate) fn lights(bench: &Bench) {
    std::fs::create_dir(bench.path("lights")).unwrap();
    for (i, turn) in [0, 5, 11].into_iter().enumerate() {
        let mut light = studio_light(16).shifted_columns(turn).radiance().clone();
        let width = light.width();
        for (at, p) in light.as_mut_slice().iter_mut().enumerate() {
            *p *= 1.0 + 0.5 * ((at % width) as f32 * 0.4 + (i * (at / width)) as f32 * 0.3).sin();
        }
        bench.write(&format!("lights/{i}.hdr"), &encode_hdr(&light));
    }
}

/// Writes three materials to the folder `materials`.
pub(crate) fn materials(bench: &Bench) {
    std::fs::create_dir(bench.path("materials")).unwrap();
    for (name, diffuse, width) in [("matt", 0.3, 0.6), ("satin", 0.2, 0.3), ("gloss", 0.05, 0.3)] {
        let table = merl(&material(diffuse, width));
        gonio_io::merl::write(bench.path("materials").join(name).with_extension("binary"), &table).unwrap();
    }
}

#[test]
fn trains_joins_and_uses_a_model() {
    let bench = Bench::with_ball();
    lights(&bench);
    materials(&bench);
    bench.run("train lighting lights -o light.model --grid 16 --rotations 2").succeeds();
    bench.run("train reflectance materials -o brdf.model --rank 2 --starts 2").succeeds();
    let run = bench.run("train model --lighting light.model --reflectance brdf.model -o joined.model").succeeds();
    assert!(run.stdout.contains("3 maps") && run.stdout.contains("3 materials"), "{run:?}");
    let model = gonio_io::model::read_model(bench.path("joined.model")).unwrap();
    assert_eq!((model.reflectance.len(), model.light.scales, model.light.lights), (2, 4, 3));
    // Parts that are not given are those of the embedded model.
    let run = bench.run("train model --lighting light.model -o lighting.model").succeeds();
    assert!(run.stdout.contains("3 maps") && run.stdout.contains("of 100 materials"), "{run:?}");
    let mixed = gonio_io::model::read_model(bench.path("lighting.model")).unwrap();
    assert_eq!((mixed.reflectance.len(), mixed.light.scales), (10, 4));

    bench.refuses(
        "infer ball.exr -o out --normals normals.npy --model joined.model --grid 8",
        &["joined.model: has no posterior of materials", "gonio train posterior"],
    );
    let infer =
        "infer ball.exr -o out --method variational --starts 1 --all-observations --normals normals.npy --model";
    bench.run(&format!("{infer} joined.model --grid 8")).succeeds();
    let result = bench.json("out/result.json");
    assert_eq!(result["reflectance"]["coefficients"].as_array().unwrap().len(), 2);
    assert_eq!(result["model"]["provenance"], model.provenance);

    bench.refuses(&format!("{infer} joined.model --grid 32"), &["grid 32: must be a power of two from 4 to 16"]);
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
fn rejects_unsuitable_lights() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("empty")).unwrap();
    let line = |rest: &str| format!("train lighting -o x.model --rotations 2 {rest}");
    bench.refuses(&line("empty"), &["empty: contains no .hdr"]);
    bench.refuses(&line("none"), &["none: cannot list"]);
    bench.write("file", b"x");
    bench.refuses(&line("file"), &["file: cannot list"]);
    lights(&bench);
    bench.refuses(&line("lights --grid 17"), &["--grid 17"]);
    bench.refuses(&line("lights --rotations 0"), &["--rotations"]);
    bench.refuses(&line("lights --grid 8 --cap 0.5"), &["--cap: must be above 1"]);
    bench.run(&line("lights --grid 8 --cap 30")).succeeds();
    bench.refuses("train lighting lights -o none/x.model --grid 8 --rotations 1", &["none/x.model"]);
    let good = bench.read("lights/1.hdr");
    bench.write("lights/1.hdr", &good[..good.len() / 2]);
    bench.refuses(&line("lights --grid 8"), &["lights/1.hdr"]);
    bench.write("lights/1.hdr", &good);
    bench.write("lights/2.exr", &grey(1.0, 16, 9));
    bench.refuses(&line("lights --grid 8"), &["lights/2.exr: a lat-long map"]);
    std::fs::create_dir(bench.path("flat")).unwrap();
    bench.write("flat/grey.exr", &grey(1.0, 16, 8));
    bench.refuses(&line("flat --grid 8"), &["flat: the lights have no variation"]);
}

#[test]
fn rejects_unsuitable_materials() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("empty")).unwrap();
    let line = |rest: &str| format!("train reflectance -o x.model --starts 1 {rest}");
    bench.refuses(&line("empty"), &["empty: "]);
    bench.refuses(&line("none"), &["none: "]);
    materials(&bench);
    bench.refuses(
        &line("materials --rank 4"),
        &["--rank 4", "must be from 1 to 3, the number of materials in materials"],
    );
    bench.refuses(&line("materials --rank 0"), &["--rank 0"]);
    bench.refuses("train reflectance materials -o x.model --rank 2 --starts 0", &["--starts 0"]);
    let good = bench.read("materials/satin.binary");
    bench.write("materials/satin.binary", &good[..1000]);
    bench.refuses(&line("materials --rank 2"), &["materials/satin.binary: is truncated"]);
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

/// Returns the names in `tools/cc0_lights.txt`.
fn cc0_lights() -> Vec<&'static str> {
    include_str!("../../../../tools/cc0_lights.txt").lines().filter(|line| !line.starts_with('#')).collect()
}

#[test]
fn lights_for_commercial_models_are_cc0() {
    let text = include_str!("../../../gonio-io/model/PROVENANCE.md");
    let (_, poly_haven) = text.split_once("**Poly Haven").unwrap();
    let (poly_haven, others) = poly_haven.split_once("**sIBL").unwrap();
    assert!(poly_haven.contains("CC0"));
    // Each item is a source and its lights. Only the first light of a series has its full name.
    let items: Vec<String> = poly_haven.split("\n* ").skip(1).map(str::to_owned).collect();
    let mut stated = Vec::new();
    for item in items.iter().filter(|item| !item.contains("open3d")) {
        let (_, lights) = item.split_once("):").unwrap();
        let mut series = "";
        for light in lights.split(&[',', '\n'][..]).map(str::trim).filter(|light| !light.is_empty()) {
            if !light.starts_with('_') && light.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
                series = light.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('_');
                stated.push(light.to_owned());
            } else if light.starts_with('_') {
                stated.push(format!("{series}{light}"));
            }
        }
    }
    for light in cc0_lights() {
        assert!(stated.iter().any(|l| l == light), "{light} is not among {stated:?}");
        assert!(!others.contains(light), "{light}");
    }
    assert_eq!(cc0_lights().len(), 51);
}

/// Runs the script with a substitute for gonio that records its input, because training takes too
/// long for a test.
#[cfg(unix)]
#[test]
fn commercial_model_uses_only_the_listed_lights() {
    use std::os::unix::fs::PermissionsExt;
    use std::process::Command;
    let bench = Bench::new();
    let noting = r#"#!/usr/bin/env bash
set -e
case "$2" in
lighting | reflectance) ls "$3" > "$5" ;;
posterior) ls "$4" > "$8"; echo "${@:9}" > options ;;
model) cat "$4" "$6" "$8" > "${10}" ;;
esac
"#;
    bench.write("noting", noting.as_bytes());
    std::fs::set_permissions(bench.path("noting"), std::fs::Permissions::from_mode(0o755)).unwrap();
    let script = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/commercial_model.sh");
    let build = || {
        let mut command = Command::new("bash");
        command.arg(&script).args(["lights", "materials", "own.model", "--steps", "1"]);
        let out = command.current_dir(bench.path("")).env("GONIO", bench.path("noting")).output().unwrap();
        (out.status.success(), String::from_utf8(out.stderr).unwrap())
    };
    for folder in ["lights", "materials"] {
        std::fs::create_dir(bench.path(folder)).unwrap();
    }
    bench.write("materials/one.binary", b"x");
    let mut names: Vec<String> = cc0_lights().iter().map(|name| format!("{name}.hdr")).collect();
    names[1] = names[1].replace(".hdr", ".exr");
    for name in names[1..].iter().map(String::as_str).chain(["sibl_papermill.hdr", "o3d_park.hdr"]) {
        bench.write(&format!("lights/{name}"), b"x");
    }
    let before = bench.tree();
    let (done, message) = build();
    assert!(!done && message.contains(&format!("does not hold {};", cc0_lights()[0])), "{message}");
    assert_eq!(bench.tree(), before);

    bench.write(&format!("lights/{}", names[0]), b"x");
    let (done, message) = build();
    assert!(done, "{message}");
    let made = String::from_utf8(bench.read("own.model")).unwrap();
    let expected = [&names[..], &["one.binary".to_owned()], &names[..]].concat();
    let mut made: Vec<&str> = made.lines().collect();
    let mut expected: Vec<&str> = expected.iter().map(String::as_str).collect();
    made.sort_unstable();
    expected.sort_unstable();
    assert_eq!(made, expected);
    assert_eq!(bench.read("options"), b"--steps 1\n");
}
