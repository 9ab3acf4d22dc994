//! Tests of the colours of an inferred BRDF.

use glam::Vec3;
use gonio::picture::{Picture, luminance};

use crate::support::{Bench, ball, exr};

/// Encodes a photograph of the ball in one colour.
fn tinted(colour: Vec3) -> Vec<u8> {
    let ball = ball();
    exr(&Picture { rgb: ball.rgb.map(|p| luminance(*p) * colour), ..ball })
}

#[test]
fn colour_options_preserve_the_luminance() {
    let bench = Bench::new();
    bench.write("red.exr", &tinted(Vec3::new(1.6, 0.7, 0.5)));
    bench.run("infer red.exr -o grey --grid 8 --color none").succeeds();
    bench.run("infer red.exr -o median --grid 8 --color median").succeeds();
    bench.run("infer red.exr -o estimate --grid 8").succeeds();
    bench.run("infer red.exr -o given --grid 8 --light-color 3.2,1.4,1").succeeds();
    let [r, g, b] = bench.channels("grey");
    assert!(r == g && g == b);
    for out in ["median", "estimate", "given"] {
        let same = bench.luminance(out);
        let near = same.as_slice().iter().zip(g.as_slice()).all(|(a, b)| (a / b - 1.0).abs() < 1e-4);
        assert!(near, "the luminance of {out} differs");
    }
    // As in the paper, the BRDF has the median colour of the photograph.
    let [r, g, _] = bench.channels("median");
    assert!(r.as_slice().iter().zip(g.as_slice()).all(|(r, g)| (r / g - 1.6 / 0.7).abs() < 1e-3));
    let colour = |out: &str| bench.json(&format!("{out}/result.json"))["colour"].clone();
    let body = |out: &str| colour(out)["body"]["log_chroma"][0].as_f64().unwrap();
    assert_eq!(colour("grey")["source"], "none");
    assert_eq!(colour("estimate")["source"], "estimate");
    // The BRDF is red under white light, and grey under red light.
    assert!(body("estimate") > 0.3 && body("given").abs() < 0.25, "{} {}", body("estimate"), body("given"));
    let low = colour("estimate")["body"]["interval_90"][0][0].as_f64().unwrap();
    assert!(low < body("estimate"), "{low}");
}

#[test]
fn a_grey_photograph_gives_a_grey_brdf() {
    let bench = Bench::new();
    bench.write("grey.exr", &tinted(Vec3::ONE));
    bench.run("infer grey.exr -o out --grid 8").succeeds();
    let [r, g, b] = bench.channels("out");
    assert!(r == g && g == b);
    assert_eq!(bench.json("out/result.json")["colour"]["source"], "grey photograph");
}

#[test]
fn rejects_invalid_colours() {
    let bench = Bench::with_ball();
    bench.refuses(
        "infer ball.exr -o out --light-color 1,1,1 --color median",
        &["--light-color requires --color estimate"],
    );
    for wrong in ["1,1", "1,0,1", "white"] {
        let run = bench.run(&format!("infer ball.exr -o out --light-color {wrong}"));
        assert_eq!(run.code, Some(2), "{run:?}");
        assert!(run.stderr.contains("three positive linear numbers"), "{run:?}");
    }
}
