//! Tests of photographs with negative values, NaN values, and parts of another colour.

use std::sync::LazyLock;

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;
use gonio_io::picture::{ReadOptions, read};

use crate::support::{Bench, ball_of, encode_normals, exr, normals};

/// Side of the pictures, large enough for some hundreds of faulty pixels.
const SIZE: usize = 128;

static BALL: LazyLock<Picture> = LazyLock::new(|| ball_of(SIZE));

/// Returns the ball with 500 slightly negative pixels and 20 NaN pixels, spread over the ball.
fn spoilt() -> Picture {
    let mut picture = BALL.clone();
    let inside = normals(SIZE);
    let places: Vec<usize> = (0..SIZE * SIZE).filter(|i| inside.as_slice()[*i].z > 0.35).collect();
    for (k, at) in (0..520).map(|k| (k, places[k * places.len() / 520])) {
        picture.rgb.as_mut_slice()[at] = Vec3::splat(if k % 26 == 3 { f32::NAN } else { -0.001 });
    }
    picture
}

#[test]
fn ignores_and_reports_negative_and_nan_pixels() {
    let bench = Bench::new();
    bench.write("clean.exr", &exr(&BALL));
    bench.write("spoilt.exr", &exr(&spoilt()));
    bench.write("normals.npy", &encode_normals(&normals(SIZE)));
    bench.run_with_pictures("infer clean.exr -o clean --grid 8").succeeds();
    assert!(!bench.path("clean/used.png").exists());
    let logs = |table: &BivariateTable| -> Vec<f64> {
        (0..60).flat_map(|h| (0..60).map(move |d| f64::from(table.as_slice()[90 * h + d]).ln())).collect()
    };
    let clean = logs(&bench.luminance("clean"));
    for shape in ["", "--normals normals.npy"] {
        let run = bench.run_with_pictures(&format!("infer spoilt.exr -o spoilt --grid 8 {shape}")).succeeds();
        assert!(
            run.stderr.contains("spoilt.exr: 500 of ") && run.stderr.contains("are negative, and 20 are NaN"),
            "{run:?}"
        );
        let spoilt = logs(&bench.luminance("spoilt"));
        let square: f64 = clean.iter().zip(spoilt).map(|(a, b)| (a - b).powi(2)).sum();
        assert!((square / 3600.0).sqrt() < 0.1, "{shape}: {}", (square / 3600.0).sqrt());
        let result = bench.json("spoilt/result.json");
        let report = &result["observations"]["report"];
        assert_eq!((&report["negative"], &report["not_finite"]), (&500.into(), &20.into()));
        assert!(result["warnings"].to_string().contains("spoilt.exr: 500 of "), "{}", result["warnings"]);
        let used = read(bench.path("spoilt/used.png"), &ReadOptions::default()).unwrap().picture.rgb;
        assert!(used.width() == 512 && used.height() > 512);
    }
}

#[test]
fn rejects_mostly_faulty_photographs() {
    let bench = Bench::new();
    let bad = |value: f32| {
        let mut picture = BALL.clone();
        let half = picture.rgb.as_mut_slice().iter_mut().enumerate().filter(|(i, _)| i % 5 > 1);
        half.for_each(|(_, colour)| *colour = Vec3::splat(value));
        exr(&picture)
    };
    bench.write("nan.exr", &bad(f32::NAN));
    bench.write("infinite.exr", &bad(f32::INFINITY));
    bench.write("negative.exr", &bad(-0.1));
    bench.write("normals.npy", &encode_normals(&normals(SIZE)));
    for (image, message) in [
        ("nan.exr", " 0 are negative and "),
        ("infinite.exr", " are NaN or infinite"),
        ("negative.exr", " are negative and 0 are NaN"),
    ] {
        for shape in ["", "--normals normals.npy"] {
            bench.refuses(&format!("infer {image} -o out {shape}"), &[image, "too few of the object's ", message]);
        }
    }
}

#[test]
fn estimates_the_first_of_two_paints() {
    let bench = Bench::new();
    let size = 160;
    let inside = normals(size);
    let picture = |albedo: f32| {
        let value = |n: Vec3| {
            let is_second = (5.0 * (0.8 * n.y + 0.6 * n.x)).floor() as i32 % 2 == 0;
            let lamp = |from: Vec3| n.dot(from.normalize()).max(0.0);
            let light = 0.2 + lamp(Vec3::new(0.5, 0.7, 0.5)) + 0.4 * lamp(Vec3::new(-0.8, 0.1, 0.3));
            if n == Vec3::ZERO { n } else { Vec3::splat(light * if is_second { albedo } else { 0.6 }) }
        };
        Picture { rgb: inside.map(|n| value(*n)), alpha: Some(inside.map(|n| f32::from(u8::from(*n != Vec3::ZERO)))) }
    };
    bench.write("striped.exr", &exr(&picture(0.15)));
    bench.write("plain.exr", &exr(&picture(0.6)));
    let peak = |folder: &str| {
        bench.json(&format!("{folder}/result.json"))["posterior"]["highlight"]["peak_height"]["50"].as_f64().unwrap()
    };
    let run = bench.run("infer striped.exr -o out --grid 8").succeeds();
    assert!(run.stderr.contains("two paints") && run.stderr.contains("--one-material"), "{run:?}");
    let ratio = bench.json("out/result.json")["observations"]["report"]["pattern_ratio"].as_f64().unwrap();
    // Which paint covers more is a matter of a few pixels.
    assert!((ratio.ln().abs() - 4.0_f64.ln()).abs() < 0.1, "{ratio}");
    let albedo = gonio_io::picture::read(bench.path("out/albedo.exr"), &Default::default()).unwrap().picture;
    let [corner, middle] = [(0, 0), (size / 2, size / 2)].map(|at| albedo.alpha.as_ref().unwrap()[at]);
    assert_eq!((corner, middle), (0.0, 1.0));
    let stripes = |y: usize| albedo.rgb[(size / 2, y)].y;
    let (mut low, mut high) = (f32::MAX, 0.0_f32);
    (size / 4..3 * size / 4).for_each(|y| (low, high) = (low.min(stripes(y)), high.max(stripes(y))));
    assert!((low == 1.0 || high == 1.0) && (high / low / 4.0 - 1.0).abs() < 0.1, "{low} {high}");
    let kept = bench.run("infer striped.exr -o kept --grid 8 --one-material").succeeds();
    assert!(!kept.stderr.contains("two paints"), "{kept:?}");
    assert!(!bench.run("infer plain.exr -o plain --grid 8").succeeds().stderr.contains("paint"));
    assert!(!bench.path("plain/albedo.exr").exists());
    let (striped, plain, kept) = (peak("out"), peak("plain"), peak("kept"));
    assert!(striped < 3.0 * plain && kept > 5.0 * plain, "{striped} {plain} {kept}");
}

#[test]
fn ignores_paint_unless_colours_are_kept() {
    let bench = Bench::new();
    let size = 128;
    let inside = normals(size);
    let spot = |n: Vec3| n.dot(Vec3::new(-0.25, 0.3, 0.92).normalize()) > 0.95;
    let rgb = Plane::from_fn(size, size, |x, y| {
        let n = inside[(x, y)];
        let paint = if spot(n) { Vec3::new(0.1, 0.2, 0.5) } else { Vec3::new(0.6, 0.25, 0.1) };
        let lamp = |from: Vec3| n.dot(from.normalize()).max(0.0);
        if n == Vec3::ZERO {
            n
        } else {
            paint * (0.2 + lamp(Vec3::new(0.5, 0.7, 0.5)) + 0.4 * lamp(Vec3::new(-0.8, 0.1, 0.3)))
        }
    });
    let alpha = inside.map(|n| if *n == Vec3::ZERO { 0.0 } else { 1.0 });
    bench.write("painted.exr", &exr(&Picture { rgb, alpha: Some(alpha) }));
    let run = bench.run_with_pictures("infer painted.exr -o out --grid 8").succeeds();
    assert!(run.stderr.contains("have another colour") && run.stderr.contains("--one-material"), "{run:?}");
    let report = bench.json("out/result.json")["observations"]["report"].clone();
    let (lost, points) = (report["other_colour"].as_f64().unwrap(), report["points"].as_f64().unwrap());
    assert!((0.02..0.1).contains(&(lost / points)), "{report}");
    assert!(bench.path("out/used.png").exists());
    let kept = bench.run_with_pictures("infer painted.exr -o kept --grid 8 --one-material").succeeds();
    assert!(!kept.stderr.contains("another colour") && !bench.path("kept/used.png").exists(), "{kept:?}");
}

#[test]
fn dust_does_not_make_a_satin_ball_glossy() {
    let bench = Bench::new();
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/../../samples/ball.exr");
    let Picture { rgb, alpha } = read(sample, &ReadOptions::default()).unwrap().picture;
    let (width, height) = rgb.size();
    // Soft specks as bright as the ball around them, on a spiral around its centre.
    let specks: Vec<(f32, f32)> = (0..12)
        .map(|i| (0.2 + 0.05 * i as f32, 2.4 * i as f32))
        .map(|(radius, angle)| (0.5 + 0.5 * radius * angle.cos(), 0.5 + 0.5 * radius * angle.sin()))
        .map(|(x, y)| (x * width as f32, y * height as f32))
        .collect();
    let dusty = Plane::from_fn(width, height, |x, y| {
        let speck = |(u, v): &(f32, f32)| (-((x as f32 - u).powi(2) + (y as f32 - v).powi(2)) / 5.0).exp();
        rgb[(x, y)] * (1.0 + 1.5 * specks.iter().map(speck).sum::<f32>())
    });
    bench.write("dusty.exr", &exr(&Picture { rgb: dusty, alpha }));
    let roughness = |folder: &str| {
        let result = bench.json(&format!("{folder}/result.json"));
        result["posterior"]["highlight"]["roughness"]["50"].as_f64().unwrap()
    };
    let run = bench.run("infer dusty.exr -o out --grid 8").succeeds();
    assert!(run.stderr.contains("small spots") && run.stderr.contains("--one-material"), "{run:?}");
    assert!((0.34..0.5).contains(&roughness("out")), "{}", roughness("out"));
    let kept = bench.run("infer dusty.exr -o kept --grid 8 --one-material").succeeds();
    assert!(!kept.stderr.contains("small spots"), "{kept:?}");
    assert!(roughness("kept") < 0.8 * roughness("out"), "{} {}", roughness("kept"), roughness("out"));
}
