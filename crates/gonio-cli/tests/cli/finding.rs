//! Tests of object detection: textured backgrounds, JPEG files, several objects, and masks of
//! another size.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio_io::picture::encode_png;
use serde_json::Value;

use crate::support::{Bench, SIZE, ball_of, exr};

/// Returns a pseudo-random number in 0..=1 for a cell of a grid.
fn hashed(x: usize, y: usize) -> f32 {
    let mixed = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2c1b_3c6d);
    ((mixed ^ (mixed >> 13)) & 0xffff) as f32 / 65_535.0
}

/// Returns a background of 12 x 12 pixel cells with pseudo-random grey values.
fn texture(x: usize, y: usize) -> Vec3 {
    Vec3::splat(0.02 + 0.06 * hashed(x / 12, y / 12))
}

/// Composites balls with a diameter of 200 pixels over a background of 500 x 300 pixels. `corners`
/// are the top left corners of the balls.
fn photograph(corners: &[(usize, usize)], behind: impl Fn(usize, usize) -> Vec3) -> Plane<Vec3> {
    let Picture { rgb, alpha } = ball_of(204);
    let alpha = alpha.unwrap();
    Plane::from_fn(500, 300, |x, y| {
        let of_ball = corners.iter().find_map(|&(left, top)| {
            let at = (x.checked_sub(left)?, y.checked_sub(top)?);
            (at.0 < 204 && at.1 < 204).then(|| rgb[at] + behind(x, y) * (1.0 - alpha[at]))
        });
        of_ball.unwrap_or_else(|| behind(x, y))
    })
}

/// Encodes a picture as an sRGB JPEG file of quality 75.
fn jpeg(rgb: &Plane<Vec3>) -> Vec<u8> {
    let coded = |v: f32| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    let code = |v: f32| (255.0 * coded(v.clamp(0.0, 1.0))).round() as u8;
    let bytes: Vec<u8> = rgb.as_slice().iter().flat_map(|v| v.to_array().map(code)).collect();
    let mut out = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 75);
    encoder.encode(&bytes, rgb.width() as u32, rgb.height() as u32, image::ExtendedColorType::Rgb8).unwrap();
    out
}

fn exr_of(rgb: Plane<Vec3>) -> Vec<u8> {
    exr(&Picture { rgb, alpha: None })
}

#[track_caller]
fn circle_of(notes: &Value) -> [f64; 3] {
    ["x", "y", "radius"].map(|name| notes["shape"]["circle"][name].as_f64().unwrap_or_else(|| panic!("{notes}")))
}

#[track_caller]
fn assert_near(got: [f64; 3], want: [f64; 3]) {
    assert!(got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1.0), "{got:?} {want:?}");
}

#[test]
fn detects_a_ball_on_a_texture_and_reports_the_confidence() {
    let bench = Bench::new();
    bench.write("ball.exr", &exr_of(photograph(&[(120, 50)], texture)));
    let run = bench.run("infer ball.exr -o out --grid 8").succeeds();
    assert!(run.stdout.contains("ball detected by its edges, along "), "{run:?}");
    let observations = &bench.json("out/result.json")["observations"];
    assert_near(circle_of(observations), [222.0, 152.0, 100.0]);
    assert!(observations["detection"]["support"].as_f64().unwrap() > 0.6, "{observations}");
    let run = bench.run("check ball.exr").succeeds();
    assert!(run.stdout.contains("detected by its edges, along "), "{run:?}");
    // On a plain background, the detection does not use edges.
    bench.write("plain.exr", &exr_of(photograph(&[(120, 50)], |_, _| Vec3::splat(0.05))));
    let run = bench.run("check plain.exr --json").succeeds();
    let found: Value = serde_json::from_str(&run.stdout).unwrap();
    assert!(found["objects"][0].get("detection").is_none(), "{found}");
    assert_near(circle_of(&found["objects"][0]), [222.0, 152.0, 100.0]);
}

#[test]
fn detects_a_ball_in_a_jpeg_file() {
    let bench = Bench::new();
    let noisy = |x: usize, y: usize| Vec3::splat(0.02 + 0.002 * hashed(x, y));
    bench.write("ball.jpg", &jpeg(&photograph(&[(120, 50)], noisy).map(|v| 0.5 * *v)));
    let run = bench.run("check ball.jpg --json").succeeds();
    let found: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_near(circle_of(&found["objects"][0]), [222.0, 152.0, 100.0]);
}

#[test]
fn lists_and_draws_candidates_of_ambiguous_detections() {
    let bench = Bench::new();
    bench.write("balls.exr", &exr_of(photograph(&[(20, 40), (260, 60)], texture)));
    let message = ["balls.exr: the ball was not reliably detected", "(1) --circle ", "(2) --circle ", "--mask FILE"];
    bench.refuses("infer balls.exr -o out", &message);
    let run = bench.run("check balls.exr").fails(&[&message[..], &["; see balls.exr-check.png"]].concat());
    assert_eq!(bench.names("."), ["balls.exr", "balls.exr-check.png"]);
    assert_eq!(&bench.read("balls.exr-check.png")[1..4], b"PNG");
    // The suggested option works.
    let at = run.stderr.find("(1) ").unwrap() + 4;
    let option = run.stderr[at..].split([',', ';']).take(3).collect::<Vec<_>>().join(",");
    bench.run(&format!("check balls.exr {option}")).succeeds();
}

#[test]
fn reports_two_objects() {
    let bench = Bench::new();
    let card = |x: usize, y: usize| {
        let inside = (360..470).contains(&x) && (60..220).contains(&y);
        Vec3::splat(if inside { 0.6 } else { 0.02 } + 0.001 * hashed(x, y))
    };
    bench.write("two.exr", &exr_of(photograph(&[(60, 50)], card)));
    let run = bench.run("infer two.exr -o out").fails(&[
        "two.exr: detected 2 separate objects",
        "(1) a ball in columns",
        "(2) another shape in columns",
    ]);
    let at = run.stderr.find("--circle ").unwrap();
    let option = run.stderr[at..].split(' ').take(2).collect::<Vec<_>>().join(" ");
    let run = bench.run(&format!("check two.exr {option} --json")).succeeds();
    let found: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_near(circle_of(&found["objects"][0]), [162.0, 152.0, 100.0]);
}

#[test]
fn suggests_options_for_shapes_other_than_balls() {
    let bench = Bench::new();
    let bar =
        |x: usize, y: usize| Vec3::splat(if (60..420).contains(&x) && (120..190).contains(&y) { 0.6 } else { 0.02 });
    bench.write("bar.exr", &exr_of(Plane::from_fn(500, 300, bar)));
    bench.refuses("infer bar.exr -o out", &["--normals FILE", "--mesh FILE"]);
    bench.refuses("infer bar.exr -o out --shape ellipsoid", &["--normals FILE", "--mesh FILE"]);
}

#[test]
fn scales_masks_of_another_size() {
    let bench = Bench::with_ball();
    // The photograph has a margin of two pixels around the ball.
    let white = |size: usize| {
        let (middle, radius) = (0.5 * size as f32, (0.5 - 2.0 / SIZE as f32) * size as f32);
        let inside = |x: usize, y: usize| (x as f32 + 0.5 - middle).hypot(y as f32 + 0.5 - middle) < radius;
        encode_png(&Plane::from_fn(size, size, |x, y| Vec3::splat(f32::from(inside(x, y)))))
    };
    bench.write("small.png", &white(SIZE / 2));
    bench.write("large.png", &white(4 * SIZE));
    let same = bench.run("check ball.exr -o x.png --json").succeeds();
    let same: Value = serde_json::from_str(&same.stdout).unwrap();
    for (name, size) in [("small.png", SIZE / 2), ("large.png", 4 * SIZE)] {
        let run = bench.run(&format!("check ball.exr -o x.png --mask {name} --json")).succeeds();
        let found: Value = serde_json::from_str(&run.stdout).unwrap();
        assert_near(circle_of(&found["objects"][0]), circle_of(&same["objects"][0]));
        let warned = found["warnings"].as_array().unwrap();
        let message = format!(
            "{name}: the mask is {size}x{size} pixels, but the photograph is {SIZE}x{SIZE}; gonio scales the mask"
        );
        assert!(warned.iter().filter(|warning| **warning == *message).count() == 1, "{warned:?}");
    }
}

#[test]
fn ignores_grey_rims_of_masks() {
    let bench = Bench::with_ball();
    // The mask is 1 up to 14 pixels from the centre, and 0.9 from there to 22 pixels.
    let grey = Plane::from_fn(SIZE, SIZE, |x, y| {
        let off = (x as f32 - 23.5).hypot(y as f32 - 23.5);
        Vec3::splat(if off < 14.0 {
            1.0
        } else if off < 22.0 {
            0.9
        } else {
            0.0
        })
    });
    // Mask values are read as linear codes, not as sRGB.
    let bytes: Vec<u8> = grey.as_slice().iter().map(|v| (255.0 * v.x) as u8).collect();
    let mut png = std::io::Cursor::new(Vec::new());
    image::GrayImage::from_vec(SIZE as u32, SIZE as u32, bytes)
        .unwrap()
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    bench.write("grey.png", &png.into_inner());
    bench.write("white.png", &encode_png(&grey.map(|v| v.map(f32::ceil))));
    let observed = |mask: &str| {
        let run = bench.run(&format!("check ball.exr -o x.png --mask {mask} --json")).succeeds();
        let found: Value = serde_json::from_str(&run.stdout).unwrap();
        assert!((circle_of(&found["objects"][0])[2] - 22.0).abs() < 0.7, "{found}");
        found["objects"][0]["report"]["observed_pixels"].as_f64().unwrap()
    };
    let (grey, white) = (observed("grey.png"), observed("white.png"));
    let want = std::f64::consts::PI * 14.0 * 14.0;
    assert!((grey / want - 1.0).abs() < 0.05 && white > 1.8 * grey, "{grey} {white}");
}
