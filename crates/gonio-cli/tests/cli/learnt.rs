//! Tests of `gonio infer` with its default method.

use std::io::Read;

use glam::Vec3;
use gonio::model::Model;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio_io::picture::{ReadOptions, decode};
use gonio_io::{npy, result_brdf};

use crate::support::{ANSWER, Bench, SIZE, encode_normals, normals};

const OUTPUT: [&str; 7] =
    ["brdf.npz", "light.exr", "posterior.json", "relit.png", "result.json", "summary.png", "uncertainty.png"];

#[test]
fn writes_all_files_and_readable_pictures() {
    assert!(ANSWER.0.keys().eq(OUTPUT), "{:?}", ANSWER.0.keys());
    for name in ["relit.png", "summary.png", "uncertainty.png"] {
        decode(name.as_ref(), &ANSWER.0[name], &ReadOptions::default()).unwrap();
    }
}

#[test]
fn reports_the_posterior_of_materials() {
    let result = ANSWER.json("result.json");
    assert_eq!(result["method"], "learnt");
    let posterior = &result["posterior"];
    let materials = posterior["materials"].as_array().unwrap();
    assert!((1..=10).contains(&materials.len()), "{materials:?}");
    let weights: Vec<f64> = materials.iter().map(|m| m["weight"].as_f64().unwrap()).collect();
    assert!(weights.is_sorted_by(|a, b| a >= b) && weights.iter().all(|w| (0.005..=1.0).contains(w)), "{weights:?}");
    assert!(materials.iter().all(|m| !m["name"].as_str().unwrap().is_empty()));
    for share in ["undetermined", "out_of_distribution"] {
        assert!(posterior[share].as_f64().is_some_and(|x| (0.0..=1.0).contains(&x)), "{posterior}");
    }
    assert!(posterior["filled_cells"].as_u64().unwrap() < posterior["disk_cells"].as_u64().unwrap());
    for measure in ["roughness", "peak_height"] {
        let [low, median, high] = ["5", "50", "95"].map(|q| posterior["highlight"][measure][q].as_f64().unwrap());
        assert!(0.0 < low && low <= median && median <= high, "{measure}: {low} {median} {high}");
    }
    let misfit = result["residual"]["misfit"].as_f64().unwrap();
    assert!((0.0..0.4).contains(&misfit), "{misfit}");
    assert_eq!(result["light"]["coefficients"].as_array().unwrap().len(), 64);
}

#[test]
fn seconds_of_the_stages_sum_to_the_total() {
    let result = ANSWER.json("result.json");
    let stages = ["model", "reading", "posterior", "transfer", "light", "colour", "drawing"];
    let seconds = |stage: &str| result["seconds"][stage].as_f64().unwrap();
    let sum: f64 = stages.iter().map(|stage| seconds(stage)).sum();
    assert!((sum - seconds("total")).abs() < 1e-9, "{}", result["seconds"]);
}

#[test]
fn albedo_is_one_half_and_quantiles_are_ordered() {
    let brdf = &ANSWER.0["brdf.npz"];
    assert!(brdf.len() < 2 << 20);
    let tables = result_brdf::decode("brdf.npz".as_ref(), brdf).unwrap();
    assert!((BivariateTable::luminance(&tables).normal_albedo() - 0.5).abs() < 0.01);
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(brdf)).unwrap();
    let mut array = |name: &str| {
        let mut bytes = Vec::new();
        archive.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
        npy::decode(name.as_ref(), &bytes).unwrap()
    };
    assert_eq!(array("levels.npy").values, [0.05, 0.25, 0.75, 0.95]);
    for (name, axes) in [("luminance_quantiles.npy", &[4, 90, 90][..]), ("quantiles.npy", &[4, 90, 90, 3])] {
        let quantiles = array(name);
        assert_eq!(quantiles.shape, axes);
        let levels: Vec<&[f32]> = quantiles.values.chunks_exact(quantiles.values.len() / 4).collect();
        for pair in levels.windows(2) {
            assert!(pair[0].iter().zip(pair[1]).all(|(a, b)| 0.0 < *a && a <= b));
        }
    }
}

#[test]
fn rejects_models_without_a_posterior() {
    let bench = Bench::with_ball();
    let model = Model { learnt: None, ..gonio_io::model::embedded().unwrap() };
    bench.write("bare.model", &gonio_io::model::encode_model(&model));
    let message =
        ["bare.model: has no posterior", "gonio train posterior", "gonio train model --posterior", "--method"];
    bench.refuses("infer ball.exr -o out --model bare.model", &message);
    let training = "train posterior --lights none --materials none -o x.posterior --initial bare.model";
    bench.refuses(training, &["bare.model: has no posterior", "use a model with one"]);
}

#[test]
fn warns_about_half_a_ball() {
    let bench = Bench::with_ball();
    let whole = normals(SIZE);
    let half = Plane::from_fn(SIZE, SIZE, |x, y| if x > SIZE / 2 { Vec3::ZERO } else { whole[(x, y)] });
    bench.write("half.npy", &encode_normals(&half));
    let run = bench.run("infer ball.exr -o out --grid 8 --normals half.npy").succeeds();
    assert!(
        run.stderr.lines().any(|l| l.starts_with("warning: ball.exr: ") && l.contains("gonio interpolated")),
        "{run:?}"
    );
    let warnings = bench.json("out/result.json")["warnings"].to_string();
    assert!(warnings.contains("gonio interpolated"), "{warnings}");
}

#[test]
fn exported_parameters_have_intervals() {
    let bench = Bench::new();
    bench.write_answer("out");
    let printed = bench.run("export out -o fitted --to mtlx,merl").succeeds().stdout;
    let entries = &bench.json("fitted/export.json")["exports"];
    let ends = [0, 1].map(|end| entries["mtlx"]["intervals"]["roughness"][end].as_f64().unwrap());
    assert!(0.0 <= ends[0] && ends[0] < ends[1] && ends[1] <= 1.0, "{ends:?}");
    assert!(printed.contains(&format!("({:.2} to {:.2})", ends[0], ends[1])), "{printed}");
    let file = String::from_utf8(bench.read("fitted/openpbr.mtlx")).unwrap();
    assert!(file.contains(&format!("interval of the roughness: {:.2} to {:.2}", ends[0], ends[1])), "{file}");
    assert!(entries["merl"]["intervals"].is_null());
    bench.run("export out -o plain --to mtlx --draws 0").succeeds();
    assert!(bench.json("plain/export.json")["exports"]["mtlx"]["intervals"].is_null());
    // Without a posterior or a fitted model there are no intervals; only --draws needs them.
    bench.run("export out/brdf.npz -o file --to mtlx").succeeds();
    bench.run("export out -o table --to merl").succeeds();
    bench.refuses("export out/brdf.npz -o none --to mtlx --draws 8", &["posterior", "--draws"]);
    bench.refuses("export out -o none --to merl --draws 8", &["fitted", "--draws"]);
    bench.write("out/posterior.json", b"{}");
    bench.refuses("export out -o none --to mtlx", &["posterior.json"]);
}
