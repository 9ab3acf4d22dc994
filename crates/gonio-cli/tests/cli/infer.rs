//! Tests of `gonio infer`.

use gonio::lighting::studio_light;
use gonio::reflectance::BivariateTable;
use gonio_io::picture::{ReadOptions, encode_hdr, read};

use crate::support::{Bench, SIZE, ball, encode_normals, mask, material, merl, normals};

/// Files of the methods of the paper.
const OUTPUT: [&str; 5] = ["brdf.npz", "light.exr", "relit.png", "result.json", "summary.png"];

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn infers_the_brdf_of_a_rendered_ball() {
    let bench = Bench::new();
    bench.write("light.hdr", &encode_hdr(studio_light(64).radiance()));
    gonio_io::merl::write(bench.path("in.binary"), &merl(&material(0.1, 0.3))).unwrap();
    bench.run("render --brdf in.binary --light light.hdr -o ball.exr --size 48").succeeds();
    let run = bench.run_with_pictures("infer ball.exr -o deep/out --method variational --starts 1 --grid 8").succeeds();
    assert!(run.stdout.starts_with("deep/out: ") && run.stdout.lines().count() == 1, "{run:?}");
    assert_eq!(bench.names("deep/out"), OUTPUT);
    assert_eq!(bench.names("deep"), ["out"]);
    assert_eq!(bench.names("."), ["ball.exr", "deep", "in.binary", "light.hdr"]);

    let brdf = gonio_io::brdf::read(bench.path("deep/out/brdf.npz")).unwrap();
    let luminance = BivariateTable::luminance(&brdf.to_bivariate());
    assert!((luminance.normal_albedo() - 0.5).abs() < 0.01);
    let light = read(bench.path("deep/out/light.exr"), &ReadOptions::default()).unwrap().picture.rgb;
    assert_eq!(light.width(), 2 * light.height());
    // It is an environment map, although the posterior mean has negative texels.
    assert!(light.as_slice().iter().all(|p| p.is_finite() && p.min_element() >= 0.0));
    for name in ["relit.png", "summary.png"] {
        read(bench.path("deep/out").join(name), &ReadOptions::default()).unwrap();
    }

    let result = bench.json("deep/out/result.json");
    assert_eq!(result["format"], "gonio-result");
    assert_eq!((&result["version"], &result["gonio"]), (&2.into(), &env!("CARGO_PKG_VERSION").into()));
    assert_eq!((&result["image"], &result["method"]), (&"ball.exr".into(), &"variational".into()));
    let coefficients = numbers(&result["reflectance"]["coefficients"]);
    assert!(coefficients.len() == 10 && coefficients.iter().all(|c| c.is_finite() && *c >= 0.0), "{coefficients:?}");
    assert_eq!(numbers(&result["light"]["coefficients"]).len(), 64);
    assert_eq!(result["cost"]["name"], "C_KL");
    let trace = numbers(&result["cost"]["trace"]);
    assert!(trace.len() > 1);
    for pair in trace.windows(2) {
        assert!(pair[1] <= pair[0] + 1e-9 * pair[0].abs(), "{pair:?}");
    }
    for stage in ["reading", "plan", "inference", "drawing", "total"] {
        assert!(result["seconds"][stage].as_f64().is_some_and(|s| s >= 0.0), "{}", result["seconds"]);
    }
}

#[test]
fn joint_map_writes_to_an_existing_folder() {
    let bench = Bench::with_ball();
    std::fs::create_dir(bench.path("out")).unwrap();
    bench.write("out/result.json", b"old");
    bench.write("out/notes", b"kept");
    bench
        .run_with_pictures(
            "infer ball.exr -o out --starts 1 --grid 8 --all-observations --method joint-map --normals normals.npy",
        )
        .succeeds();
    assert_eq!(bench.names("out").len(), OUTPUT.len() + 1);
    assert_eq!(bench.read("out/notes"), b"kept");
    assert_eq!(bench.json("out/result.json")["cost"]["name"], "minus log posterior");
}

#[test]
fn accepts_normals_and_a_mask() {
    let bench = Bench::new();
    bench.write("ball.exr", &gonio_io::picture::encode_exr(&ball().rgb, None));
    bench.write("normals.npy", &encode_normals(&normals(SIZE)));
    bench.write("normals.exr", &gonio_io::picture::encode_exr(&normals(SIZE), None));
    bench.write("mask.png", &mask(SIZE));
    for form in ["npy", "exr"] {
        let line = format!("infer ball.exr -o {form} --grid 8 --normals normals.{form} --mask mask.png");
        bench.run(&line).succeeds();
    }
    assert!(bench.json("npy/result.json")["observations"]["shape"]["circle"].is_null());
    assert!(bench.read("npy/brdf.npz") == bench.read("exr/brdf.npz"), "the same normals give another BRDF");
}

#[test]
fn warns_about_8_bit_images_unless_linear() {
    let bench = Bench::with_ball();
    let picture = ball().rgb;
    let largest = picture.as_slice().iter().map(|p| p.max_element()).fold(0.0, f32::max);
    bench.write("ball.png", &gonio_io::picture::encode_png(&picture.map(|p| *p * (0.8 / largest))));
    for (options, warned) in [("-o coded", true), ("-o linear --linear", false)] {
        let line = format!("infer ball.png {options} --grid 8 --normals normals.npy");
        let run = bench.run(&line).succeeds();
        let warning = run.stderr.lines().any(|l| l.starts_with("warning: ball.png: 8-bit image, decoded as sRGB"));
        assert_eq!(warning, warned, "{run:?}");
    }
}

#[test]
fn paper_conflicts_with_other_options() {
    let bench = Bench::with_ball();
    for other in ["--method joint-map", "--solver blocks", "--grid 16", "--normals normals.npy"] {
        bench.refuses(&format!("infer ball.exr -o out --paper {other}"), &["--paper", "cannot be used with"]);
    }
}

/// Creates a bench with the photograph of a ball under the studio light, and a map of the light.
fn lit_ball() -> Bench {
    let bench = Bench::with_ball();
    bench.write("light.hdr", &encode_hdr(studio_light(32).radiance()));
    bench
}

#[test]
fn a_light_selects_the_known_light_method() {
    let bench = lit_ball();
    bench.run("infer ball.exr -o out --light light.hdr").succeeds();
    let result = bench.json("out/result.json");
    assert_eq!(result["method"], "known-light");
    assert_eq!(result["reflectance"]["normal_albedo"], 0.5);
    assert!(result["known_light"]["map"] == "light.hdr" && result["residual"]["smooth_error"].is_number());
    let arrays = gonio_io::result_brdf::read(bench.path("out/brdf.npz")).unwrap();
    assert!((BivariateTable::luminance(&arrays).normal_albedo() - 0.5).abs() < 0.01);
    bench.run("infer ball.exr -o absolute --light light.hdr --absolute --align-light fixed").succeeds();
    let albedo = &bench.json("absolute/result.json")["reflectance"]["normal_albedo"];
    assert_eq!(*albedo, result["exposure"]["albedo"]);
    assert!(bench.read("absolute/brdf.npz") != bench.read("out/brdf.npz"));
}

#[test]
fn rejects_contradicting_lights_without_force() {
    let bench = lit_ball();
    bench.write("lights.txt", b"# three lamps\n1 1 1 1 1 1\n-1 0.5 1 0.5 0.5 0.5\n0 -1 0.2 0.2 0.2 0.2\n");
    bench.refuses("infer ball.exr -o out --light lights.txt", &["the misfit is", "--align-light", "--force"]);
    assert!(!bench.names("").contains(&"out".to_owned()));
    bench.run("infer ball.exr -o out --light lights.txt --force").succeeds();
    let warnings = bench.json("out/result.json")["warnings"].clone();
    let misfit = warnings.as_array().unwrap().iter().find(|w| w.to_string().contains("RMS residual")).unwrap();
    assert!(misfit.as_str().unwrap().starts_with("ball.exr: "), "{misfit}");
    assert!(
        misfit.to_string().contains("search for the rotation of the environment map with --align-light"),
        "{misfit}"
    );
    bench.write("bad.txt", b"1 1 1 1 1 1\n1 2 3\n");
    bench.refuses("infer ball.exr -o bad --light bad.txt", &["bad.txt", "line 2", "x y z r g b"]);
}
