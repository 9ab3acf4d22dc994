//! Tests of photographs with several materials.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio_io::picture::encode_png;

use crate::support::{Bench, SIZE, WITH_PAGES, ball, exr, mask};

/// Returns two copies of the ball side by side; the right one is 0.4 times as bright.
fn two_balls() -> Picture {
    let one = ball();
    let at = |x: usize| if x < SIZE { (x, 1.0) } else { (x - SIZE, 0.4) };
    let rgb = Plane::from_fn(2 * SIZE, SIZE, |x, y| one.rgb[(at(x).0, y)] * at(x).1);
    let alpha = one.alpha.as_ref().map(|alpha| Plane::from_fn(2 * SIZE, SIZE, |x, y| alpha[(at(x).0, y)]));
    Picture { rgb, alpha }
}

fn labels(width: usize, height: usize) -> Vec<u8> {
    encode_png(&Plane::from_fn(width, height, |x, _| if x < width / 2 { Vec3::X } else { Vec3::Y }))
}

#[test]
fn separates_balls_that_do_not_touch() {
    let bench = Bench::new();
    bench.write("balls.exr", &exr(&two_balls()));
    let run = bench.run_with_pictures("infer balls.exr -o out --grid 8").succeeds();
    assert_eq!(bench.names("out"), ["1", "2", "materials.png", "result.json"]);
    let result = bench.json("out/result.json");
    assert_eq!(result["regions"].as_array().unwrap().len(), 2);
    for name in ["1", "2"] {
        assert!(bench.names(&format!("out/{name}")).contains(&"brdf.npz".to_owned()));
    }
    // Each region has its verdict, and its own exports.
    assert!(result["regions"][1]["verdict"].as_str().unwrap().contains("roughness"), "{result}");
    assert!(run.stdout.contains("region 2: "), "{run:?}");
    bench.run("export out --to ward --draws 0").succeeds();
    assert!(bench.names("out/1/export").contains(&"ward.json".to_owned()));
    bench.refuses("convert out a.binary", &["several regions", "out/1"]);
    // Under one light, the relative albedo of the darker ball is 0.4.
    let albedo = |at: usize| result["regions"][at]["relative_albedo"].as_f64().unwrap();
    let (low, high) = (albedo(0).min(albedo(1)), albedo(0).max(albedo(1)));
    assert!((low - 0.4).abs() < 0.04 && high == 1.0, "{low} {high}");
    // Specified circles give the same regions in the same folder, without the old picture.
    let (half, radius) = (SIZE as f64 / 2.0, SIZE as f64 / 2.0 - 2.0);
    let circles = format!("--circle {half},{half},{radius} --circle {},{half},{radius}", half + SIZE as f64);
    bench.run(&format!("infer balls.exr -o out --grid 8 {circles}")).succeeds();
    assert_eq!(bench.names("out"), ["1", "2", "result.json"]);
}

#[test]
fn labels_name_the_regions() {
    let bench = Bench::with_ball();
    bench.write("labels.png", &labels(SIZE, SIZE));
    bench.write("mask.png", &mask(SIZE / 2));
    let line = "infer ball.exr -o out --grid 8 --regions labels.png --mask mask.png";
    let run = bench.run_with(line, &WITH_PAGES).succeeds();
    assert_eq!(bench.names("out"), ["00ff00", "ff0000", "materials.png", "report.html", "result.json"]);
    let page = String::from_utf8(bench.read("out/report.html")).unwrap();
    assert!(page.contains("./ff0000/report.html"));
    // Warnings about the whole photograph.
    assert!(run.stderr.contains("gonio scales the mask") && page.contains("gonio scales the mask"), "{run:?}");
}

#[test]
fn rejects_invalid_labels() {
    let bench = Bench::with_ball();
    bench.write("small.png", &labels(SIZE / 2, SIZE));
    bench.write("black.png", &encode_png(&Plane::from_fn(SIZE, SIZE, |_, _| Vec3::ZERO)));
    bench.write("many.png", &encode_png(&Plane::from_fn(SIZE, SIZE, |x, _| Vec3::splat((x as f32 + 1.0) / 50.0))));
    let indices = Plane::from_fn(SIZE, SIZE, |x, _| Vec3::splat(if x < SIZE / 2 { 1.0 } else { 2.0 } / 65535.0));
    bench.write("indices.exr", &exr(&Picture { rgb: indices, alpha: None }));
    for (labels, message) in [
        ("indices.exr", "indices.exr: contains values that are not 8-bit codes"),
        ("small.png", "small.png: the labels are"),
        ("black.png", "black.png: is black"),
        ("many.png", "many.png: contains"),
        ("none.png", "none.png: cannot open"),
    ] {
        bench.refuses(&format!("infer ball.exr -o out --regions {labels}"), &[message]);
    }
    bench.write("labels.png", &labels(SIZE, SIZE));
    bench.refuses("infer ball.exr -o out --regions labels.png --method joint-map", &["several materials"]);
    bench.refuses(&format!("infer ball.exr -o out {}", "--circle 9,9,5 ".repeat(17)), &["17 circles: the limit is 16"]);
}

#[test]
fn ignores_other_objects_beside_a_ball() {
    let bench = Bench::new();
    let one = ball();
    // A board beside the ball, smaller than the ball.
    let board = |x: usize, y: usize| (SIZE + 4..SIZE + 20).contains(&x) && (8..24).contains(&y);
    let beside = |x: usize, y: usize| f32::from(u8::from(board(x, y)));
    let rgb = Plane::from_fn(2 * SIZE, SIZE, |x, y| if x < SIZE { one.rgb[(x, y)] } else { Vec3::splat(beside(x, y)) });
    let alpha = one
        .alpha
        .as_ref()
        .map(|alpha| Plane::from_fn(2 * SIZE, SIZE, |x, y| if x < SIZE { alpha[(x, y)] } else { beside(x, y) }));
    bench.write("board.exr", &exr(&Picture { rgb, alpha }));
    bench.run("infer board.exr -o out --grid 8").succeeds();
    assert!(bench.names("out").contains(&"brdf.npz".to_owned()), "{:?}", bench.names("out"));
}

#[test]
fn rejects_masks_of_another_aspect_ratio() {
    let bench = Bench::with_ball();
    bench.write("small.png", &encode_png(&Plane::from_fn(SIZE / 2, SIZE, |_, _| Vec3::ONE)));
    bench.write("labels.png", &labels(SIZE, SIZE));
    for options in ["", "--regions labels.png"] {
        bench.refuses(&format!("infer ball.exr -o out --mask small.png {options}"), &["small.png: the mask is"]);
    }
}
