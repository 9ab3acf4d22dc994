//! Tests of `gonio light`.

use glam::{DQuat, DVec3, Vec3};
use gonio::lighting::{EnvironmentMap, studio_light};
use gonio::picture::{Picture, Plane};
use gonio::probe::{MirrorBall, Reflectance};
use gonio::reflectance::{BivariateTable, THETA_D};
use gonio::scene::Circle;
use gonio::shape::{Camera, Projection};
use gonio_io::picture::{ReadOptions, encode_exr, encode_hdr, encode_png, read};

use crate::support::{Bench, exr, material, merl};

const SIZE: (usize, usize) = (200, 190);

fn far() -> MirrorBall {
    MirrorBall::of_circle(Circle { x: 103.0, y: 94.0, radius: 80.0 }, SIZE).unwrap()
}

/// Renders a mirror ball exactly, from a camera that is rotated around the ball by `degrees`.
fn photograph(ball: &MirrorBall, light: &EnvironmentMap, degrees: f64) -> Picture {
    let turn = DQuat::from_rotation_y(degrees.to_radians());
    let mirror = Reflectance::new([0.6; 3]).unwrap();
    let samples = 4;
    let pixel = |x: usize, y: usize| {
        let (mut sum, mut covered) = (Vec3::ZERO, 0.0);
        for i in 0..samples * samples {
            let at = |whole: usize, part: usize| whole as f64 + (part as f64 + 0.5) / samples as f64;
            if let Some(seen) = ball.reflection_at((at(x, i % samples), at(y, i / samples))) {
                sum += mirror.at(seen.cosine).as_vec3() * light.at(turn * seen.direction);
                covered += 1.0;
            }
        }
        let count = (samples * samples) as f32;
        (sum / count, covered / count)
    };
    let (rgb, alpha) = (0..SIZE.0 * SIZE.1).map(|i| pixel(i % SIZE.0, i / SIZE.0)).unzip();
    let plane = |values| Plane::from_vec(SIZE.0, SIZE.1, values);
    Picture { rgb: plane(rgb), alpha: Some(Plane::from_vec(SIZE.0, SIZE.1, alpha)) }
}

/// Returns the light of a dim room with four lamps: red on the right, blue above, green beside the
/// camera, and white at the back left.
fn room() -> EnvironmentMap {
    let lamps = [
        (DVec3::X, Vec3::X),
        (DVec3::Y, Vec3::Z),
        (DVec3::new(0.3, 0.2, 1.0).normalize(), Vec3::Y),
        (DVec3::new(-0.8, 0.1, -1.0).normalize(), Vec3::ONE),
    ];
    let wall = studio_light(128);
    EnvironmentMap::new(Plane::from_fn(256, 128, |x, y| {
        let d = gonio::sphere::direction_of_lat_long((x as f64 + 0.5) / 256.0, (y as f64 + 0.5) / 128.0);
        let lamp = |(at, colour): &(DVec3, Vec3)| if d.angle_between(*at) < 0.08 { 50.0 * *colour } else { Vec3::ZERO };
        0.2 * wall.at(d) + lamps.iter().map(lamp).sum::<Vec3>()
    }))
    .unwrap()
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("chrome.exr", &exr(&photograph(&far(), &room(), 0.0)));
    bench.write("side.exr", &exr(&photograph(&far(), &room(), 90.0)));
    bench
}

fn map(bench: &Bench, name: &str) -> EnvironmentMap {
    EnvironmentMap::new(read(bench.path(name), &ReadOptions::default()).unwrap().picture.rgb).unwrap()
}

#[test]
fn converts_a_mirror_ball_to_a_light() {
    let bench = bench();
    let run = bench.run("light chrome.exr -o probe.exr --reflectance 0.6").succeeds();
    assert!(
        run.stdout.starts_with("probe.exr: environment map of 128x64 pixels from a ball with a radius of 80 pixels")
            && run.stderr.is_empty(),
        "{run:?}"
    );
    assert_eq!(bench.names("."), ["chrome.exr", "probe.exr", "probe.light.png", "side.exr"]);
    let probe = map(&bench, "probe.exr");
    for (at, channel) in [(DVec3::X, 0), (DVec3::Y, 2), (DVec3::new(0.3, 0.2, 1.0), 1)] {
        let seen = probe.at(at);
        assert!(seen[channel] > 40.0 && seen[(channel + 1) % 3] < 3.0, "{at} {seen}");
    }
    assert!(probe.at(DVec3::new(-0.8, 0.1, -1.0)).min_element() > 40.0);
    assert!(probe.at(DVec3::NEG_X).max_element() < 3.0);
    if let Ok(folder) = std::env::var("GONIO_LIGHT_PICTURES") {
        std::fs::copy(bench.path("probe.light.png"), format!("{folder}/one.png")).unwrap();
    }
    // The default reflectance is 1; `--rows` sets the size of the map.
    bench.run("light chrome.exr -o dim.exr --circle 103,94,80 --rows 32").succeeds();
    let dim = map(&bench, "dim.exr");
    assert_eq!(dim.radiance().size(), (64, 32));
    assert!((dim.at(DVec3::NEG_X) / probe.at(DVec3::NEG_X) - Vec3::splat(0.6)).abs().max_element() < 0.1);
}

#[test]
fn combines_two_views() {
    let bench = bench();
    let run = bench.run("light chrome.exr --second side.exr -o text.exr --reflectance 0.6").succeeds();
    assert!(run.stdout.contains("(estimated)") && !run.stdout.contains("view at 0.0"), "{run:?}");
    let line = "light chrome.exr --second side.exr -o probe.exr --reflectance 0.6 --json";
    let found: serde_json::Value = serde_json::from_str(&bench.run(line).succeeds().stdout).unwrap();
    let views = &found["views"];
    assert!((views["azimuth_degrees"].as_f64().unwrap() - 90.0).abs() < 0.5 && views["estimated"] == true, "{found}");
    assert!(found["unseen"].as_f64().unwrap() < 1e-6 && views["difference"].as_f64().unwrap() < 0.05, "{found}");
    assert_eq!((&found["output"], &found["picture"]), (&"probe.exr".into(), &"probe.light.png".into()));
    assert_eq!(
        (found["second"]["image"].as_str(), found["photograph"]["clipped"].as_u64()),
        (Some("side.exr"), Some(0))
    );
    assert!((found["photograph"]["circle"]["radius"].as_f64().unwrap() - 80.0).abs() < 0.1);
    assert_eq!(found["warnings"], serde_json::json!([]));
    if let Ok(folder) = std::env::var("GONIO_LIGHT_PICTURES") {
        std::fs::copy(bench.path("probe.light.png"), format!("{folder}/two.png")).unwrap();
    }
    let given = bench.run("light chrome.exr --second side.exr --second-azimuth -45 -o wrong.exr").succeeds();
    assert!(given.stderr.contains("chrome.exr and side.exr: the two views differ by"), "{given:?}");
}

#[test]
fn unwraps_a_near_ball_with_its_camera() {
    let bench = Bench::new();
    let camera = Camera::new(Projection::Perspective { focal: 400.0 }, (100.0, 95.0), SIZE).unwrap();
    let ball = MirrorBall::new(camera, DVec3::new(0.02, -0.01, -1.0), 0.2).unwrap();
    bench.write("near.exr", &exr(&photograph(&ball, &room(), 0.0)));
    bench.write("camera.json", br#"{"projection": "perspective", "focal_pixels": 400}"#);
    bench.run("light near.exr --camera camera.json -o probe.exr --reflectance 0.6").succeeds();
    let probe = map(&bench, "probe.exr");
    assert!(probe.at(DVec3::X).x > 40.0 && probe.at(DVec3::Y).z > 40.0);
}

#[test]
fn infers_a_brdf_with_the_light() {
    let bench = Bench::new();
    let light = studio_light(128);
    bench.write("light.hdr", &encode_hdr(light.radiance()));
    bench.write("chrome.exr", &exr(&photograph(&far(), &light, 0.0)));
    gonio_io::merl::write(bench.path("in.binary"), &merl(&material(0.1, 0.3))).unwrap();
    bench.run("render --brdf in.binary --light light.hdr -o matte.exr --size 160").succeeds();
    bench.run("light chrome.exr -o probe.exr --reflectance 0.6").succeeds();
    let found = |light: &str, out: &str| {
        let line = format!("infer matte.exr --light {light} --align-light fixed -o {out}");
        bench.run(&line).succeeds();
        let brdf = gonio_io::brdf::read(bench.path(&format!("{out}/brdf.npz"))).unwrap();
        BivariateTable::luminance(&brdf.to_bivariate())
    };
    let (exact, unwrapped) = (found("light.hdr", "exact"), found("probe.exr", "out"));
    // Cells with both angles below 80 degrees; cells beyond are not observed.
    let cells = (0..84).flat_map(|h| (0..80).map(move |d| THETA_D * h + d));
    let squares = cells.map(|cell| f64::from((unwrapped.as_slice()[cell] / exact.as_slice()[cell]).ln()).powi(2));
    let off = (squares.sum::<f64>() / (84.0 * 80.0)).sqrt();
    assert!(off < 0.05, "{off}");
}

/// A picture of the mirror ball, with a rendered ball to its right.
fn beside(bench: &Bench, matte: &str, light: &EnvironmentMap) -> Vec<u8> {
    let mirror = photograph(&far(), light, 0.0);
    let other = read(bench.path(matte), &ReadOptions::default()).unwrap().picture;
    let rgb = Plane::from_fn(SIZE.0 + other.rgb.width(), SIZE.1, |x, y| {
        if x < SIZE.0 {
            mirror.rgb[(x, y)]
        } else if y < other.rgb.height() {
            other.rgb[(x - SIZE.0, y)]
        } else {
            Vec3::ZERO
        }
    });
    encode_exr(&rgb, None)
}

#[test]
fn infers_a_brdf_with_a_mirror_ball_in_the_photograph() {
    let bench = Bench::new();
    let light = studio_light(128);
    bench.write("light.hdr", &encode_hdr(light.radiance()));
    gonio_io::merl::write(bench.path("in.binary"), &merl(&material(0.1, 0.3).scaled(0.5))).unwrap();
    bench.run("render --brdf in.binary --light light.hdr -o ball.exr --size 64").succeeds();
    bench.write("both.exr", &beside(&bench, "ball.exr", &light));
    let line = "infer both.exr --mirror-ball 103,94,80 --mirror-reflectance 0.6";
    bench.run(&format!("{line} -o out")).succeeds();
    let result = bench.json("out/result.json");
    assert_eq!(result["method"], "known-light");
    assert_eq!(result["known_light"]["map"], "the mirror ball in the photograph");
    assert_eq!(result["reflectance"]["absolute"], true);
    assert_eq!(result["warnings"], serde_json::json!([]), "{}", result["warnings"]);
    let circle = &result["observations"]["shape"]["circle"];
    assert!(
        (circle["x"].as_f64().unwrap() - 232.0).abs() < 0.5 && circle["radius"].as_f64().unwrap() < 33.0,
        "{circle}"
    );
    let table = |name: &str| {
        let brdf = gonio_io::brdf::read(bench.path(name)).unwrap();
        BivariateTable::luminance(&brdf.to_bivariate())
    };
    let (found, truth) = (table("out/brdf.npz"), table("in.binary"));
    let ratio = found.normal_albedo() / truth.normal_albedo();
    // The environment map from a ball of 80 pixels is blurred.
    assert!((ratio - 1.0).abs() < 0.1, "absolute albedo: {ratio}");
    // Without a reflectance, the scale is unknown.
    bench.run("infer both.exr --mirror-ball 103,94,80 -o grey").succeeds();
    let result = bench.json("grey/result.json");
    assert_eq!(
        (&result["reflectance"]["absolute"], &result["reflectance"]["normal_albedo"]),
        (&false.into(), &0.5.into())
    );
    // A circle far from the mirror ball.
    bench
        .run("infer both.exr --mirror-ball 900,94,80 -o wrong")
        .fails(&["both.exr: mirror ball: ", "check --mirror-ball"]);
    bench
        .run("infer both.exr --mirror-ball 103,94,80 --method joint-map -o wrong")
        .fails(&["--mirror-ball is for --method known-light"]);
    bench
        .run("infer both.exr --mirror-ball 103,94,80 --shape outline -o wrong")
        .fails(&["requires a mask of the object"]);
    bench
        .run("infer both.exr --mirror-ball 103,94,80 --circle 104,94,70 -o wrong")
        .fails(&["the mirror ball is a part of the object"]);
    assert!(!bench.path("wrong").exists());
}

#[test]
fn warns_about_clipped_and_matte_balls() {
    let bench = bench();
    let mut clipped = photograph(&far(), &room(), 0.0);
    clipped.rgb = clipped.rgb.map(|v| v.min(Vec3::splat(5.0)));
    bench.write("clipped.exr", &exr(&clipped));
    let run = bench.run("light clipped.exr -o probe.exr").succeeds();
    assert!(run.stderr.contains("clipped.exr: ") && run.stderr.contains("pixels on the ball are clipped"), "{run:?}");
    // The smooth shading of a matte ball.
    let matte = Plane::from_fn(SIZE.0, SIZE.1, |x, y| {
        let seen = far().reflection_at((x as f64 + 0.5, y as f64 + 0.5));
        Vec3::splat(seen.map_or(0.0, |seen| 0.2 + seen.normal.dot(DVec3::new(0.5, 0.6, 0.6)).max(0.0) as f32))
    });
    bench.write("matte.exr", &encode_exr(&matte, None));
    let run = bench.run("light matte.exr -o probe.exr").succeeds();
    assert!(run.stderr.contains("matte.exr: the ball appears matte"), "{run:?}");
}

#[test]
fn rejects_invalid_input_without_output() {
    let bench = bench();
    let wavy = Plane::from_fn(64, 64, |x, y| Vec3::splat((1 + x + 100 * y) as f32));
    bench.write("wall.exr", &encode_exr(&wavy, None));
    bench.write(
        "square.png",
        &encode_png(&Plane::from_fn(200, 190, |x, y| {
            Vec3::splat(if (40..160).contains(&x) && (40..160).contains(&y) { 1.0 } else { 0.0 })
        })),
    );
    bench.write("small.png", &encode_png(&wavy.map(|_| Vec3::ONE)));
    let black = photograph(&far(), &room(), 0.0);
    bench.write("black.exr", &exr(&Picture { rgb: black.rgb.map(|_| Vec3::ZERO), ..black }));
    std::fs::create_dir(bench.path("folder.light.png")).unwrap();
    for (line, message) in [
        ("none.exr -o x.exr", &["none.exr: cannot open"][..]),
        ("chrome.exr -o x.png", &["x.png: the output must be an .exr file"]),
        ("chrome.exr -o chrome.exr", &["chrome.exr: the output would overwrite the photograph"]),
        ("chrome.exr -o none/x.exr", &["none/x.exr"]),
        ("chrome.exr -o folder.exr", &["folder.light.png"]),
        ("wall.exr -o x.exr", &["wall.exr: no object found", "--circle X,Y,RADIUS"]),
        ("chrome.exr --mask square.png -o x.exr", &["square.png: the outline is not a circle", "--circle"]),
        ("chrome.exr --mask small.png -o x.exr", &["small.png: the mask is 64x64"]),
        ("chrome.exr --circle 1,2,3 -o x.exr", &["chrome.exr: the circle with centre (1, 2) and radius 3"]),
        ("chrome.exr --circle=-75,94,80 -o x.exr", &["chrome.exr: the ball shows only"]),
        ("chrome.exr --circle 1,2 -o x.exr", &["--circle"]),
        ("chrome.exr --circle 103,94,80 --camera c.json -o x.exr", &["--camera"]),
        ("chrome.exr --camera none.json -o x.exr", &["none.json: cannot open"]),
        ("chrome.exr --reflectance 0 -o x.exr", &["--reflectance", "above 0"]),
        ("chrome.exr --rows 100 -o x.exr", &["100 rows: must be a power of two"]),
        ("chrome.exr --second-azimuth 90 -o x.exr", &["--second"]),
        ("chrome.exr --second side.exr --second-azimuth nan -o x.exr", &["a finite number of degrees"]),
        ("chrome.exr --second wall.exr -o x.exr", &["wall.exr: no object found", "--second-mask", "--second-circle"]),
        (
            "chrome.exr --second black.exr -o x.exr",
            &["chrome.exr and black.exr: the angle between the two cameras cannot be estimated", "--second-azimuth"],
        ),
        ("black.exr -o x.exr", &["black.exr: the ball is entirely black"]),
        ("chrome.exr --clip 0 -o x.exr", &["clip 0"]),
        ("chrome.exr side.exr -o x.exr", &["chrome.exr: contains radiance"]),
        ("chrome.exr", &["--output"]),
    ] {
        bench.refuses(&format!("light {line}"), message);
    }
}
