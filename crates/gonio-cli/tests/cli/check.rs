//! Tests of `gonio check`.

use glam::Vec3;
use gonio::picture::Picture;
use gonio_io::picture::{ExrOptions, ReadOptions, encode_exr_with, read};

use crate::support::{Bench, SIZE, ball, exr, grey, mask, normals};

/// Encodes the ball with twelve clipped pixels, a negative pixel and a NaN pixel.
fn faulty() -> Vec<u8> {
    let Picture { mut rgb, alpha } = ball();
    (0..12).for_each(|x| rgb[(18 + x, 24)] = Vec3::splat(50.0));
    rgb[(20, 30)] = Vec3::splat(-1.0);
    rgb[(28, 30)] = Vec3::splat(f32::NAN);
    encode_exr_with(&rgb, &ExrOptions { alpha: alpha.as_ref(), clip_level: Some(50.0), space: None })
}

#[test]
fn describes_and_draws_the_detection() {
    let bench = Bench::with_ball();
    bench.write("faulty.exr", &faulty());
    let run = bench.run("check faulty.exr").succeeds();
    assert!(run.stdout.contains("faulty.exr: 48x48 pixels"), "{run:?}");
    assert!(run.stdout.contains("ball, circle 24.0,24.0,2"), "{run:?}");
    assert!(run.stdout.contains("12 clipped, 2 invalid"), "{run:?}");
    assert!(run.stdout.ends_with("see faulty.exr-check.png\n"), "{run:?}");
    assert!(run.stderr.contains("faulty.exr: gonio ignores 12 of"), "{run:?}");
    let drawn =
        read(bench.path("faulty.exr-check.png"), &ReadOptions { linear: true, ..ReadOptions::default() }).unwrap();
    let drawn = drawn.picture.rgb;
    // Each pixel of the photograph is drawn as a square of 10 x 10 pixels.
    let at = |x: usize, y: usize| drawn[(10 * x + 5, 10 * y + 5)];
    let is_red = |c: Vec3| c.x > 0.9 && c.y < 0.4 && c.z < 0.4;
    assert!(is_red(at(20, 24)) && is_red(at(29, 24)) && !is_red(at(30, 24)) && !is_red(at(20, 23)));
    for (x, y) in [(20, 30), (28, 30)] {
        assert!(at(x, y).x > 0.8 && at(x, y).z > 0.7 && at(x, y).y < 0.3, "{}", at(x, y));
    }
    // The outline is at the edge of the ball.
    let outline = (0..240).filter(|x| drawn[(*x, 240)].y > 0.85 && drawn[(*x, 240)].x < 0.5);
    assert!(outline.clone().count() > 0 && outline.clone().all(|x| (10..40).contains(&x)), "{:?}", outline.max());
}

#[test]
fn json_contains_the_detection() {
    let bench = Bench::with_ball();
    let run = bench.run("check ball.exr -o x.png --json").succeeds();
    let found: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&found["output"], &found["image"], &found["width"]), (&"x.png".into(), &"ball.exr".into(), &48.into()));
    let ball = &found["objects"][0];
    assert!((ball["shape"]["circle"]["radius"].as_f64().unwrap() - 22.6).abs() < 1.5, "{ball}");
    assert!((ball["coverage"].as_f64().unwrap() - 0.75).abs() < 0.15, "{ball}");
    assert_eq!(ball["report"]["clipped_pixels"], 0);
    assert_eq!(bench.names("."), ["ball.exr", "normals.npy", "x.png"]);
}

#[test]
fn describes_every_object() {
    let bench = Bench::with_ball();
    let run = bench.run("check ball.exr --circle 14,24,9 --circle 34,24,9").succeeds();
    assert!(run.stdout.contains("region 1: ball, circle 14.0,24.0,9.0"), "{run:?}");
    assert!(run.stdout.contains("region 2: ball, circle 34.0,24.0,9.0"), "{run:?}");
    for (options, message) in
        [("--normals normals.npy", "shape from a normal map"), ("--shape ellipsoid", "ellipsoid, semi-axes 2")]
    {
        let run = bench.run(&format!("check ball.exr {options}")).succeeds();
        assert!(run.stdout.contains(message), "{run:?}");
    }
}

#[test]
fn photographs_of_one_stem_have_different_images() {
    let bench = Bench::with_ball();
    let dim = normals(SIZE).map(|n| 0.4 * Vec3::splat(n.z));
    bench.write("ball.png", &gonio_io::picture::encode_png(&dim));
    for image in ["ball.exr", "ball.png"] {
        let run = bench.run(&format!("check {image}")).succeeds();
        assert!(run.stdout.ends_with(&format!("see {image}-check.png\n")), "{run:?}");
    }
    assert_ne!(bench.read("ball.exr-check.png"), bench.read("ball.png-check.png"));
}

#[test]
fn replaces_only_its_own_images() {
    let bench = Bench::with_ball();
    bench.write("ball.exr-check.png", &mask(SIZE));
    bench.refuses("check ball.exr", &["ball.exr-check.png: exists and was not written by gonio check", "-o X.png"]);
    std::fs::remove_file(bench.path("ball.exr-check.png")).unwrap();
    bench.run("check ball.exr").succeeds();
    bench.run("check ball.exr").succeeds();
    bench.refuses("check ball.exr -o x.jpg", &["x.jpg: the output must be a .png file"]);
    bench.write("photo.png", &mask(SIZE));
    bench.refuses("check photo.png -o photo.png", &["photo.png: the output would overwrite the photograph"]);
}

#[test]
fn failed_detections_suggest_options() {
    let bench = Bench::with_ball();
    bench.write("constant.exr", &grey(0.5, SIZE, SIZE));
    bench.write("plain.exr", &exr(&Picture { alpha: None, ..ball() }));
    bench.refuses("check constant.exr", &["constant.exr: no object found", "--mask FILE", "--circle X,Y,RADIUS"]);
    bench.refuses("check none.exr", &["none.exr: cannot open"]);
    bench.refuses("check - -o x.png --depth-axis 3", &["--depth-axis requires --shape ellipsoid"]);
    let run = bench.run_reading("check - -o x.png", "ball.exr").succeeds();
    assert!(run.stdout.starts_with("standard input: 48x48 pixels"), "{run:?}");
}
