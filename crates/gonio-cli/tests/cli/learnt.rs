//! `gonio infer` by its default method.

use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio_io::npy;
use gonio_io::picture::{ReadOptions, read};
use serde_json::Value;

use crate::support::{Bench, SIZE, ball, encode_normals, exr, normals};

const OUTPUT: [&str; 8] = [
    "brdf.binary",
    "brdf_quantiles.npy",
    "light.exr",
    "posterior.json",
    "relit.png",
    "result.json",
    "summary.png",
    "uncertainty.png",
];

/// A result without what depends on the clock.
fn timeless(mut result: Value) -> Value {
    result.as_object_mut().unwrap().remove("seconds").unwrap();
    result
}

#[test]
fn a_photograph_becomes_a_posterior_of_materials() {
    let bench = Bench::with_ball();
    bench.run("infer ball.exr -o out --grid 8").succeeds();
    assert_eq!(bench.names("out"), OUTPUT);
    let result = bench.json("out/result.json");
    assert_eq!(result["method"], "learnt");
    let posterior = &result["posterior"];
    let materials = posterior["materials"].as_array().unwrap();
    assert!((1..=10).contains(&materials.len()), "{materials:?}");
    let weights: Vec<f64> = materials.iter().map(|m| m["weight"].as_f64().unwrap()).collect();
    assert!(weights.is_sorted_by(|a, b| a >= b) && weights.iter().all(|w| (0.005..=1.0).contains(w)), "{weights:?}");
    assert!(materials.iter().all(|m| !m["name"].as_str().unwrap().is_empty()));
    for share in ["undetermined", "strangeness"] {
        assert!(posterior[share].as_f64().is_some_and(|x| (0.0..=1.0).contains(&x)), "{posterior}");
    }
    assert!(posterior["filled"].as_u64().unwrap() < posterior["normals"].as_u64().unwrap());
    let gloss = ["5", "50", "95"].map(|q| posterior["gloss"][q].as_f64().unwrap());
    assert!(0.0 < gloss[0] && gloss[0] <= gloss[1] && gloss[1] <= gloss[2], "{gloss:?}");
    let misfit = result["noise"]["misfit"].as_f64().unwrap();
    assert!((0.0..0.4).contains(&misfit), "{misfit}");
    assert_eq!(result["light"]["coefficients"].as_array().unwrap().len(), 64);
    let stages = ["model", "reading", "posterior", "transfer", "light", "colour", "drawing"];
    let seconds = |stage: &str| result["seconds"][stage].as_f64().unwrap();
    let sum: f64 = stages.iter().map(|stage| seconds(stage)).sum();
    assert!((sum - seconds("total")).abs() < 1e-9, "{}", result["seconds"]);

    let brdf = gonio_io::merl::read(bench.path("out/brdf.binary")).unwrap();
    let luminance = BivariateTable::luminance(&[0, 1, 2].map(|c| brdf.bivariate(c)));
    assert!((luminance.normal_albedo() - 0.5).abs() < 0.01);
    let quantiles = npy::read(bench.path("out/brdf_quantiles.npy")).unwrap();
    assert_eq!(quantiles.shape, [4, 90, 90]);
    let tables: Vec<&[f32]> = quantiles.values.chunks_exact(90 * 90).collect();
    for pair in tables.windows(2) {
        assert!(pair[0].iter().zip(pair[1]).all(|(a, b)| 0.0 < *a && a <= b));
    }
    for name in ["relit.png", "summary.png", "uncertainty.png"] {
        read(bench.path("out").join(name), &ReadOptions::default()).unwrap();
    }
}

#[test]
fn the_answer_is_the_same_every_time_on_any_number_of_threads() {
    let bench = Bench::with_ball();
    for (out, threads) in [("one", "1"), ("two", "2"), ("three", "2")] {
        bench.run_with(&format!("infer ball.exr -o {out} --grid 8"), &[("RAYON_NUM_THREADS", threads)]).succeeds();
    }
    for name in OUTPUT.into_iter().filter(|name| !["result.json", "summary.png"].contains(name)) {
        let [one, two, three] = ["one", "two", "three"].map(|out| bench.read(&format!("{out}/{name}")));
        assert!(one == two && two == three, "another {name}");
    }
    let [one, two, three] = ["one", "two", "three"].map(|out| timeless(bench.json(&format!("{out}/result.json"))));
    assert_eq!(one, two);
    assert_eq!(two, three);
}

#[test]
fn a_model_without_a_posterior_is_refused_but_by_other_methods() {
    let bench = Bench::with_ball();
    let model = Model { learnt: None, ..gonio_io::model::embedded().unwrap() };
    bench.write("bare.model", &gonio_io::model::encode_model(&model));
    let says = ["bare.model: has no posterior", "gonio train posterior", "gonio train model --posterior", "--method"];
    bench.refuses("infer ball.exr -o out --model bare.model", &says);
}

#[test]
fn half_a_ball_is_warned_of() {
    let bench = Bench::new();
    bench.write("ball.exr", &exr(&ball()));
    let mut half = normals(SIZE);
    let side = half.width();
    half.as_mut_slice()
        .iter_mut()
        .enumerate()
        .filter(|(i, _)| i % side > side / 2)
        .for_each(|(_, n)| *n = glam::Vec3::ZERO);
    bench.write("half.npy", &encode_normals(&half));
    let run = bench.run("infer ball.exr -o out --grid 8 --normals half.npy").succeeds();
    assert!(run.stderr.lines().any(|l| l.starts_with("warning: ") && l.contains("filled in")), "{run:?}");
    let warnings = bench.json("out/result.json")["warnings"].to_string();
    assert!(warnings.contains("filled in"), "{warnings}");
}
