//! Tests of `gonio merge`, and of `gonio infer` with exposures.

use std::io::Cursor;
use std::sync::LazyLock;

use glam::Vec3;
use gonio::lighting::studio_light;
use gonio::picture::{Picture, Plane, luminance};
use gonio::render::{LightTree, SphereSettings, render_sphere};
use gonio_io::picture::{Decoded, ReadOptions, decode};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat, RgbImage};

use crate::support::{Bench, exr, material, merl};

/// Side of the picture.
const SIDE: usize = 128;
/// Reciprocals of the exposure times, in 1/s.
const TIMES: [u32; 6] = [512, 128, 32, 8, 2, 1];

/// A glossy ball in front of a dim wall, with the dynamic range of a photograph.
static SCENE: LazyLock<Picture> = LazyLock::new(|| {
    let settings = SphereSettings { size: SIDE, ..SphereSettings::default() };
    let light = LightTree::of_map(&studio_light(32));
    let ball = render_sphere(&merl(&material(0.1, 0.15)), &light, &settings, &|_| ());
    let alpha = ball.alpha.clone().unwrap();
    let tint = Vec3::new(1.0, 0.8, 0.6);
    let rgb = Plane::from_fn(SIDE, SIDE, |x, y| {
        ball.rgb[(x, y)] * tint + (1.0 - alpha[(x, y)]) * Vec3::new(2e-3, 3e-3, 4e-3) * (0.5 + x as f32 / 40.0)
    });
    let largest = rgb.as_slice().iter().fold(0.0, |a: f32, v| a.max(v.max_element()));
    // The brightest pixels are clipped in the shortest exposure.
    let scale = 1.6 * TIMES[0] as f32 / largest;
    Picture { rgb: rgb.map(|v| scale * *v), alpha: Some(alpha) }
});

/// Maps an exposure in 0..=1 to a code in 0..=1. The curves of the channels differ, and none is
/// sRGB.
fn camera(channel: usize, exposure: f32) -> f32 {
    let c = exposure.clamp(0.0, 1.0).powf([1.0 / 2.0, 1.0 / 2.4, 1.0 / 1.8][channel]);
    0.7 * c + 0.3 * c * c * (3.0 - 2.0 * c)
}

/// Encodes the curves of the camera for `--response`.
fn curves() -> String {
    let invert = |channel: usize, code: f64| {
        let (mut low, mut high) = (0.0_f64, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if f64::from(camera(channel, middle as f32)) < code { low = middle } else { high = middle }
        }
        (0.5 * (low + high)).ln()
    };
    let line = |code: i32| {
        let part = f64::from(code).max(0.25) / 255.0;
        format!("{code},{},{},{}\n", invert(0, part), invert(1, part), invert(2, part))
    };
    (0..256).map(line).collect()
}

fn expose(scene: &Plane<Vec3>, seconds: f32) -> RgbImage {
    let codes =
        scene.as_slice().iter().flat_map(|v| [0, 1, 2].map(|c| (255.0 * camera(c, v[c] * seconds)).round() as u8));
    RgbImage::from_vec(scene.width() as u32, scene.height() as u32, codes.collect()).unwrap()
}

/// Encodes EXIF data with an exposure time of 1/`fraction` seconds.
fn exif(fraction: u32, orientation: u16, iso: Option<u16>) -> Vec<u8> {
    let entry = |tag: u16, kind: u16, value: u32| {
        let mut bytes = [tag.to_le_bytes(), kind.to_le_bytes()].concat();
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
        bytes
    };
    let mut bytes = b"II\x2a\0\x08\0\0\0\x02\0".to_vec();
    bytes.extend(entry(0x112, 3, orientation.into()));
    bytes.extend(entry(0x8769, 4, 38));
    bytes.extend(0_u32.to_le_bytes());
    // The second directory is at offset 38: its entries, then the rational number.
    let count = 1 + u16::from(iso.is_some());
    bytes.extend(count.to_le_bytes());
    let end = 38 + 2 + 12 * u32::from(count) + 4;
    bytes.extend(entry(0x829a, 5, end));
    iso.iter().for_each(|iso| bytes.extend(entry(0x8827, 3, (*iso).into())));
    bytes.extend(0_u32.to_le_bytes());
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend(fraction.to_le_bytes());
    bytes
}

fn png(image: &RgbImage, exif: Option<Vec<u8>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = PngEncoder::new(&mut bytes);
    exif.into_iter().for_each(|exif| encoder.set_exif_metadata(exif).unwrap());
    encoder.write_image(image, image.width(), image.height(), ExtendedColorType::Rgb8).unwrap();
    bytes
}

fn jpeg(image: &RgbImage, exif: Vec<u8>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 95);
    encoder.set_exif_metadata(exif).unwrap();
    encoder.write_image(image, image.width(), image.height(), ExtendedColorType::Rgb8).unwrap();
    bytes
}

/// Creates a bench with the exposures 0.png ... 5.png, 0.jpg ... 5.jpg, 0.tif ... 5.tif (without
/// exposure times) and curve.csv. Also returns the scene.
fn bench() -> (Bench, &'static Picture) {
    let (bench, scene) = (Bench::new(), &*SCENE);
    for (i, fraction) in TIMES.iter().enumerate() {
        let image = expose(&scene.rgb, 1.0 / *fraction as f32);
        bench.write(&format!("{i}.png"), &png(&image, Some(exif(*fraction, 1, Some(1)))));
        bench.write(&format!("{i}.jpg"), &jpeg(&image, exif(*fraction, 1, None)));
        let mut tiff = Cursor::new(Vec::new());
        image.write_to(&mut tiff, ImageFormat::Tiff).unwrap();
        bench.write(&format!("{i}.tif"), &tiff.into_inner());
    }
    bench.write("curve.csv", curves().as_bytes());
    (bench, scene)
}

fn names(extension: &str) -> String {
    (0..TIMES.len()).map(|i| format!("{i}.{extension} ")).collect()
}

fn read(bench: &Bench, name: &str) -> Decoded {
    decode(name.as_ref(), &bench.read(name), &ReadOptions::default()).unwrap()
}

/// Returns the sorted relative errors of all channels of the unclipped pixels. If `free_scale`,
/// each channel is divided by its median ratio first.
fn errors(got: &Decoded, scene: &Plane<Vec3>, free_scale: bool) -> Vec<f32> {
    let level = got.full_scale.unwrap();
    let known = || got.picture.rgb.as_slice().iter().zip(scene.as_slice()).filter(|(v, _)| v.max_element() < level);
    let mut all = Vec::new();
    for c in 0..3 {
        let mut ratios: Vec<f32> = known().map(|(got, want)| got[c] / want[c]).collect();
        ratios.sort_by(f32::total_cmp);
        let scale = if free_scale { ratios[ratios.len() / 2] } else { 1.0 };
        all.extend(ratios.iter().map(|r| (r / scale - 1.0).abs()));
    }
    all.sort_by(f32::total_cmp);
    all
}

fn at(sorted: &[f32], part: f64) -> f32 {
    sorted[((sorted.len() - 1) as f64 * part) as usize]
}

#[test]
fn merged_brackets_reproduce_the_radiance() {
    let (bench, scene) = bench();
    let times = "--times 1/512,1/128,1/32,1/8,1/2,1";
    for (name, line, free_scale, part, bound) in [
        ("png", format!("{} --response curve.csv", names("png")), false, 1.0, 0.02),
        ("tif", format!("{} --response curve.csv {times}", names("tif")), false, 1.0, 0.02),
        ("jpg", format!("{} --response curve.csv", names("jpg")), false, 0.95, 0.08),
        ("png-recovered", names("png"), true, 0.99, 0.05),
    ] {
        let run = bench.run(&format!("merge {line} -o {name}.exr --save-response {name}.csv")).succeeds();
        let got = read(&bench, &format!("{name}.exr"));
        let level = got.full_scale.unwrap();
        let clipped = got.picture.rgb.as_slice().iter().filter(|v| v.max_element() >= level).count();
        let errors = errors(&got, &scene.rgb, free_scale);
        assert!(at(&errors, part) < bound, "{name}: {}", at(&errors, part));
        assert!(clipped > 10 && clipped < SIDE * SIDE / 12, "{clipped}");
        assert!(run.stdout.contains(&format!("6 exposures, {SIDE}x{SIDE} pixels; ")), "{run:?}");
        gonio_io::picture::read_response(bench.path(&format!("{name}.csv"))).unwrap();
    }
    // The saved curve gives the same picture as the recovered curve.
    bench.run(&format!("merge {} -o again.exr --response png-recovered.csv", names("png"))).succeeds();
    let (a, b) = (read(&bench, "again.exr").picture.rgb, read(&bench, "png-recovered.exr").picture.rgb);
    assert!(a.as_slice().iter().zip(b.as_slice()).all(|(a, b)| (*a - *b).length() <= 1e-5 * a.length()));
}

#[test]
fn aligns_a_shifted_exposure_unless_disabled() {
    let (bench, scene) = bench();
    let shifted = Plane::from_fn(SIDE, SIDE, |x, y| scene.rgb[((x + 9) % SIDE, y)]);
    bench.write("shifted.png", &png(&expose(&shifted, 0.125), Some(exif(8, 1, Some(1)))));
    let line = "merge 1.png 2.png shifted.png 4.png --response curve.csv -o out.exr";
    let run = bench.run(line).succeeds();
    assert!(run.stdout.contains("4 exposures (1 aligned by up to 9 pixels)"), "{run:?}");
    let errors = errors(&read(&bench, "out.exr"), &scene.rgb, false);
    assert!(at(&errors, 0.99) < 0.02, "{}", at(&errors, 0.99));
    let run = bench.run(&format!("{line} --no-align")).succeeds();
    assert!(run.stderr.contains("shifted.png: contradicts the other exposures and is left out"), "{run:?}");
    let run = bench.run(&format!("{line} --no-align --trust-times")).succeeds();
    assert!(!run.stderr.contains("left out"), "{run:?}");
}

#[test]
fn infer_ignores_and_counts_clipped_pixels() {
    let (bench, scene) = bench();
    let white = scene.alpha.as_ref().unwrap().map(|a| Vec3::splat(*a));
    bench.write("mask.png", &gonio_io::picture::encode_png(&white));
    bench.run(&format!("merge {} -o hdr.exr --response curve.csv", names("png"))).succeeds();
    let settings = "--mask mask.png --grid 8";
    bench.run(&format!("infer hdr.exr -o one {settings}")).succeeds();
    bench.run(&format!("infer {} -o two --response curve.csv {settings}", names("png"))).succeeds();
    let (one, two) = (bench.json("one/result.json"), bench.json("two/result.json"));
    let report = &one["observations"]["report"];
    assert_eq!(report, &two["observations"]["report"]);
    assert!(report["clipped_pixels"].as_u64().unwrap() > 10, "{report}");
    assert_eq!(two["bracket"]["report"]["pixels"], SIDE * SIDE);
    assert_eq!(bench.read("one/brdf.npz"), bench.read("two/brdf.npz"));
}

#[test]
fn rejects_invalid_brackets() {
    let (bench, scene) = bench();
    let image = expose(&scene.rgb, 0.125);
    bench.write("untimed.png", &png(&image, None));
    bench.write("turned.png", &png(&image, Some(exif(8, 6, Some(1)))));
    bench.write("other.png", &png(&image, Some(exif(8, 1, None))));
    bench.write("small.png", &png(&RgbImage::new(64, 32), Some(exif(8, 1, Some(1)))));
    bench.write("hdr.exr", &exr(scene));
    let mirrored = Plane::from_fn(SIDE, SIDE, |x, y| scene.rgb[(SIDE - 1 - x, y)]);
    bench.write("mirrored.png", &png(&expose(&mirrored, 0.125), Some(exif(8, 1, Some(1)))));
    bench.write("full.csv", b"x");
    for (files, message) in [
        (
            "2.png untimed.png",
            &["untimed.png: has no exposure time in its EXIF data; specify the times", "--times"][..],
        ),
        ("2.png turned.png", &["turned.png: has another orientation tag than 2.png"]),
        ("2.png other.png", &["other.png: has no ISO sensitivity"]),
        ("2.png small.png", &["small.png: has 64x32 pixels, but 2.png has 128x128"]),
        ("2.png hdr.exr", &["hdr.exr: contains radiance"]),
        ("2.png none.png", &["none.png: cannot open"]),
        ("2.png 3.png --times 1", &["3.png: has no time"]),
        ("2.png 3.png --times 1,2,3", &["3 times are specified"]),
        ("2.png 3.png --times 1,0", &["--times"]),
        ("2.png 3.png --times 1/32,1 --response curve.csv", &["contradict their times"]),
        ("2.png 4.png mirrored.png --response curve.csv", &["2.png and 2 more: ", "exposures"]),
        ("2.png 3.png --response none.csv", &["none.csv: cannot open"]),
        ("2.png 2.png", &["the exposures have the same time", "--response"]),
        ("2.png 3.png --response srgb --black-level 5", &["black level"]),
        ("2.png 3.png --linear --black-level 300", &["black level 300"]),
        ("2.png 3.png --linear --response srgb", &["--linear", "--response"]),
        ("2.png 3.png --response curve.csv --flat small.png", &["small.png: is a flat field of 64x32"]),
        ("2.png 3.png --layer x", &["a layer applies only to OpenEXR files"]),
    ] {
        bench.refuses(&format!("merge {files} -o out.exr"), message);
    }
    // All commands read brackets in the same way.
    bench.refuses("infer 2.png untimed.png -o out", &["untimed.png: has no exposure time", "--times"]);
    bench.refuses("infer 2.png hdr.exr -o out", &["hdr.exr: contains radiance"]);
    bench.refuses("merge 2.png 3.png -o out.png", &["out.png: the output must be an .exr file"]);
    bench.refuses("merge -o out.exr", &["IMAGE"]);
    bench.refuses(
        "infer hdr.exr --layer diffuse --times 1 -o out",
        &["hdr.exr: exposure times apply only to several exposures"],
    );
    bench.refuses("infer hdr.exr --black-level 5 -o out", &["hdr.exr: a black level"]);
    // If the second file cannot be written, the first is removed.
    bench.refuses(
        "merge 2.png 3.png --response curve.csv --save-response full.csv/x.csv -o out.exr",
        &["full.csv/x.csv"],
    );
}

#[test]
fn corrects_black_level_and_flat_field() {
    let (bench, scene) = bench();
    let grey = |v: f32| Plane::from_fn(SIDE, SIDE, |_, _| Vec3::splat(v));
    // A linear 16-bit picture with a black level of 4096 and vignetting.
    let shade = |x: usize, y: usize| 1.0 - 0.5 * ((x as f32 - 64.0).hypot(y as f32 - 64.0) / 91.0).powi(2);
    let largest = scene.rgb.as_slice().iter().fold(0.0, |a: f32, v| a.max(v.max_element()));
    let plane = Plane::from_fn(SIDE, SIDE, |x, y| 0.9 * scene.rgb[(x, y)] / largest * shade(x, y));
    let code = |v: f32| (4096.0 + 61439.0 * v).round() as u16;
    let samples: Vec<u16> = plane.as_slice().iter().flat_map(|v| v.to_array().map(code)).collect();
    let image = image::ImageBuffer::<image::Rgb<u16>, _>::from_vec(SIDE as u32, SIDE as u32, samples).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Tiff).unwrap();
    bench.write("pedestal.tif", &bytes.into_inner());
    bench.write(
        "flat.exr",
        &gonio_io::picture::encode_exr(&Plane::from_fn(SIDE, SIDE, |x, y| Vec3::splat(shade(x, y))), None),
    );
    bench.run("merge pedestal.tif --linear --black-level 4096 --flat flat.exr -o clean.exr").succeeds();
    let got = read(&bench, "clean.exr").picture.rgb;
    let (x, y) = (64, 30);
    let ratio = |x, y| luminance(got[(x, y)]) / luminance(scene.rgb[(x, y)]);
    let (middle, edge): (f32, f32) = (ratio(64, 64), ratio(x, y));
    assert!((edge / middle - 1.0).abs() < 0.01, "{edge} {middle}");
    bench.write("flat.png", &gonio_io::picture::encode_png(&grey(0.5)));
    bench.run("merge pedestal.tif --linear --black-level 4096 --flat flat.png -o same.exr").succeeds();
}
