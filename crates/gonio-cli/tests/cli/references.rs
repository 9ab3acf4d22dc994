//! Tests of neutral references, which determine the colour of the light and the scale of the BRDF.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, Vec3};
use gonio::colour::{Chroma, white_chroma};
use gonio::estimate::irradiance;
use gonio::lighting::studio_light;
use gonio::picture::{Picture, Plane};
use gonio::reference::patch_colours;
use gonio::reflectance::BivariateTable;
use gonio::render::{LightTree, SphereSettings, render_sphere};
use gonio::sphere::OctahedralMap;

use crate::support::{Bench, SIZE, ball, exr, material, merl};

/// Colour of the light, with a luminance near 1.
const LIGHT: Vec3 = Vec3::new(1.5, 1.0, 0.55);

/// Factor on the reflectance of the ball. Without it, the ball reflects more light than it
/// receives.
const DARKER: f32 = 0.3;

/// Distance of the patches of the chart, in pixels.
const PITCH: usize = 12;

const CIRCLE: &str = "--circle 24,24,22.08";

/// Returns the radiance of a white surface that faces the camera in the light of the ball.
fn white() -> Vec3 {
    let settings = SphereSettings { size: SIZE, ..SphereSettings::default() };
    let matte = merl(&BivariateTable::from_fn(|_, _| PI.recip()));
    let ball = render_sphere(&matte, &LightTree::of_map(&studio_light(32)), &settings, &|_| ());
    ball.rgb[(SIZE / 2, SIZE / 2)] * LIGHT
}

/// Renders the ball in coloured light, and to the right of it a surface of `width` pixels. `beside`
/// returns the reflectance of a pixel of this surface; its x counts from the edge of the ball's
/// picture.
fn scene(width: usize, beside: impl Fn(usize, usize) -> Option<Vec3>) -> Picture {
    let (ball, white) = (ball(), white());
    let rgb = Plane::from_fn(SIZE + width, SIZE.max(4 * PITCH + 20), |x, y| {
        let grain = 1.0 + 0.02 * (1e4 * ((x + 331 * y) as f32 * 0.37).sin()).sin();
        match x.checked_sub(SIZE) {
            None if y < SIZE => DARKER * ball.rgb[(x, y)] * LIGHT,
            None => Vec3::ZERO,
            Some(x) => beside(x, y).map_or(Vec3::ZERO, |reflectance| grain * reflectance * white),
        }
    });
    Picture { rgb, alpha: None }
}

/// Renders the ball beside a patch of a reflectance.
fn patch(reflectance: f32) -> Picture {
    scene(40, |x, y| ((5..35).contains(&x) && (10..40).contains(&y)).then_some(Vec3::splat(reflectance)))
}

/// Renders the ball beside a matte ball of reflectance 0.18.
fn grey_ball() -> Picture {
    let settings = SphereSettings { size: SIZE, ..SphereSettings::default() };
    let matte = merl(&BivariateTable::from_fn(|_, _| 0.18 / PI));
    let grey = render_sphere(&matte, &LightTree::of_map(&studio_light(32)), &settings, &|_| ());
    let mut picture = scene(SIZE, |_, _| None);
    for y in 0..SIZE {
        for x in 0..SIZE {
            picture.rgb[(SIZE + x, y)] = grey.rgb[(x, y)] * LIGHT;
        }
    }
    picture
}

/// Renders the ball beside a chart.
fn chart() -> Picture {
    let colours = patch_colours();
    scene(6 * PITCH + 20, |x, y| {
        let (column, row) = (x.wrapping_sub(10) / PITCH, y.wrapping_sub(10) / PITCH);
        let inside = |at: usize| (1..PITCH - 1).contains(&(at.wrapping_sub(10) % PITCH));
        if column >= 6 || row >= 4 {
            return (x > 5 && y > 5 && x < 6 * PITCH + 15 && y < 4 * PITCH + 15).then_some(Vec3::splat(0.035));
        }
        let colour = colours[6 * row + column].max(DVec3::splat(1e-3)).as_vec3();
        Some(if inside(x) && inside(y) { colour } else { Vec3::splat(0.035) })
    })
}

/// Reads the chroma of the light, and the albedo at normal incidence with its interval, from a
/// folder of results.
fn reference(bench: &Bench, folder: &str) -> ([f64; 2], f64, [f64; 2]) {
    let result = bench.json(&format!("{folder}/result.json"));
    let number = |pointer: &str| result.pointer(pointer).and_then(serde_json::Value::as_f64).unwrap();
    let chroma = [0, 1].map(|i| number(&format!("/colour/light/log_chroma/{i}")));
    let interval = [0, 1].map(|i| number(&format!("/reference/scale/normal_albedo_interval_90/{i}")));
    (chroma, number("/reference/scale/normal_albedo"), interval)
}

#[track_caller]
fn finds_light_and_albedo(bench: &Bench, folder: &str) {
    let (chroma, albedo, [low, high]) = reference(bench, folder);
    let white = white();
    let want = [(white.x / white.y).ln(), (white.z / white.y).ln()].map(f64::from);
    assert!((chroma[0] - want[0]).abs() < 0.02 && (chroma[1] - want[1]).abs() < 0.02, "{chroma:?} {want:?}");
    let truth = f64::from(DARKER) * material(0.1, 0.3).normal_albedo();
    assert!(low < truth && truth < high, "{albedo} ({low} to {high}), {truth}");
    // The BRDF file has this albedo, and the light has the matching scale.
    let written = bench.luminance(folder).normal_albedo();
    assert!((written / albedo - 1.0).abs() < 1e-3, "{written} {albedo}");
    let map = gonio::lighting::EnvironmentMap::new(
        gonio_io::picture::read(bench.path(folder).join("light.exr"), &Default::default()).unwrap().picture.rgb,
    );
    let light = irradiance(&map.unwrap().to_grid(OctahedralMap::EqualArea, 32));
    let true_light = PI * f64::from(gonio::picture::luminance(white));
    assert!((light / true_light - 1.0).abs() < 0.02, "{light} {true_light}");
}

#[test]
fn a_grey_ball_determines_colour_and_scale() {
    let bench = Bench::new();
    bench.write("ball.exr", &exr(&grey_ball()));
    bench.run(&format!("infer ball.exr -o out {CIRCLE} --grid 8 --grey-ball 72,24,22")).succeeds();
    let (chroma, albedo, [low, high]) = reference(&bench, "out");
    let light = studio_light(32).to_grid(OctahedralMap::EqualArea, 32);
    let (of_map, of_filter) = (white_chroma(&light, DQuat::IDENTITY).0, Chroma::of(LIGHT.as_dvec3()).0);
    let want = [0, 1].map(|i| of_map[i] + of_filter[i]);
    assert!((chroma[0] - want[0]).abs() < 0.01 && (chroma[1] - want[1]).abs() < 0.01, "{chroma:?} {want:?}");
    let truth = f64::from(DARKER) * material(0.1, 0.3).normal_albedo();
    assert!(low < truth && truth < high, "{albedo} ({low} to {high}), {truth}");
    assert!((bench.luminance("out").normal_albedo() / albedo - 1.0).abs() < 1e-3);
    // The grey ball is not taken for a second object.
    let checked = bench.run("check ball.exr --grey-ball 72,24,22 --json").succeeds();
    let printed: serde_json::Value = serde_json::from_str(&checked.stdout).unwrap();
    assert_eq!(printed["objects"].as_array().map(Vec::len), Some(1), "{checked:?}");
    bench.run("infer ball.exr -o detected --grid 8 --grey-ball 72,24,22").succeeds();
    let detected = reference(&bench, "detected");
    assert!((detected.1 / albedo - 1.0).abs() < 0.05, "{} {albedo}", detected.1);
}

#[test]
fn patches_and_charts_determine_colour_and_scale() {
    let bench = Bench::new();
    bench.write("white.exr", &exr(&patch(0.9)));
    bench.write("grey.exr", &exr(&patch(0.3)));
    bench.write("chart.exr", &exr(&chart()));
    let card = patch(1.0).rgb.map(|pixel| Vec3::splat(if pixel.x > 0.0 { 1.0 } else { 0.0 }));
    let card = Plane::from_fn(card.width(), card.height(), |x, y| if x > SIZE { card[(x, y)] } else { Vec3::ZERO });
    bench.write("card.png", &gonio_io::picture::encode_png(&card));
    let run = bench.run(&format!("infer white.exr -o white {CIRCLE} --grid 8 --white 68,25,12")).succeeds();
    assert!(run.stdout.contains("albedo at normal incidence 0."), "{run:?}");
    bench
        .run(&format!("infer grey.exr -o grey {CIRCLE} --grid 8 --grey-card card.png --reference-reflectance 0.3"))
        .succeeds();
    bench.run(&format!("infer chart.exr -o chart {CIRCLE} --grid 8 --color-checker")).succeeds();
    let at = |column: usize, row: usize| format!("{},{}", SIZE + 16 + PITCH * column, 16 + PITCH * row);
    let corners = [at(0, 0), at(5, 0), at(5, 3), at(0, 3)].join(",");
    bench.run(&format!("infer chart.exr -o corners {CIRCLE} --grid 8 --color-checker {corners}")).succeeds();
    for folder in ["white", "grey", "chart", "corners"] {
        finds_light_and_albedo(&bench, folder);
    }
    let checked = bench.run(&format!("check chart.exr {CIRCLE} --color-checker")).succeeds();
    assert!(checked.stdout.contains("colour chart: linear RGB colour of the light 1."), "{checked:?}");
    // Without a scale, the albedo is the default.
    bench
        .run(&format!("infer white.exr -o colour {CIRCLE} --grid 8 --white 68,25,12 --reference-color-only"))
        .succeeds();
    assert!(bench.json("colour/result.json")["reference"]["scale"].is_null());
    assert!((bench.luminance("colour").normal_albedo() - 0.5).abs() < 1e-3);
}

#[test]
fn rejects_unusable_references() {
    let bench = Bench::new();
    bench.write("white.exr", &exr(&patch(0.9)));
    let clipped = patch(0.9);
    let level = clipped.rgb[(68, 25)].max_element() * 0.8;
    let clipped = Picture { rgb: clipped.rgb.map(|pixel| pixel.min(Vec3::splat(level))), ..clipped };
    bench.write("clipped.exr", &exr(&clipped));
    bench.write("chart.exr", &exr(&chart()));
    bench.write("light.exr", &exr(&Picture { rgb: studio_light(16).radiance().clone(), alpha: None }));
    for (options, message) in [
        ("white.exr --white 300,25,12", &["white.exr: ", "outside the image of 88x68"][..]),
        ("white.exr --white 24,24,12", &["lie on the object"]),
        ("white.exr --white 68,25,2", &["usable pixels, but at least 25 are required"]),
        ("white.exr --white 80,25,7", &["not uniform"]),
        ("clipped.exr --white 68,25,12", &["are clipped; reduce the exposure", "--clip"]),
        ("chart.exr --grey-ball 94,34,25", &["not a matte ball: its shading deviates by"]),
        ("white.exr --color-checker", &["no 24-patch colour chart", "--color-checker X,Y"]),
        ("white.exr --color-checker 49,10,87,10,87,60,49,60", &["not those of a ColorChecker Classic"]),
        ("white.exr --color-checker 50,10,50,10,80,40,50,40", &["convex quadrilateral"]),
        ("white.exr --grey-card none.png", &["none.png"]),
        ("white.exr --white 68,25,12 --light-color 1,1,1", &["both specified"]),
        (
            "white.exr --white 68,25,12 --light light.exr",
            &["the environment map and the reference both determine the colour"],
        ),
        ("white.exr --white 68,25,12 --color none", &["a reference requires estimated colours"]),
        ("white.exr --color-checker --reference-reflectance 0.2", &["reflectances of a colour chart are published"]),
        ("white.exr --reference-color-only", &["--reference-color-only requires"]),
    ] {
        bench.refuses(&format!("infer {options} -o out {CIRCLE}"), message);
    }
    for line in ["--color-checker white.exr", "white.exr --white 1,1,1 --grey-card a.png"] {
        assert_eq!(bench.run(&format!("infer {line}")).code, Some(2), "{line}");
    }
}
