//! Tests of shapes other than balls: meshes, depth maps, ellipsoids, and perspective cameras.

use std::sync::LazyLock;

use glam::{DVec3, Vec3};
use gonio::reflectance::BivariateTable;
use gonio::shape::{BuiltInShape, Camera, Ellipsoid, GeometryBuffer, Mesh, Surface, Tracer};
use gonio_io::npy;
use gonio_io::picture::{ReadOptions, read};
use serde_json::Value;

use crate::support::{Bench, SIZE, encode_normals, grey, merl, normals};

/// A matte bowl, its picture in the light of the bench, and the result of `gonio infer`.
struct Bowl {
    obj: Vec<u8>,
    picture: Vec<u8>,
    answer: Value,
    said: String,
}

const RENDER: &str = "render --brdf in.binary --light light.hdr --mesh bowl.obj --size 64 --tolerance 1";

/// Creates a bench with a light and a matte material, because self-shadowing changes its picture
/// most.
fn with_matte() -> Bench {
    let bench = Bench::with_light_and_material();
    let matte = BivariateTable::from_fn(|_, _| 0.3);
    gonio_io::merl::write(bench.path("in.binary"), &merl(&matte)).unwrap();
    bench
}

/// Encodes OBJ with a normal for each corner of each triangle.
fn encode_obj(mesh: &Mesh) -> String {
    let numbers = |kind: &str, v: &DVec3| format!("{kind} {} {} {}\n", v.x, v.y, v.z);
    let face = |(i, [a, b, c]): (usize, &[u32; 3])| {
        format!("f {}//{} {}//{} {}//{}\n", a + 1, 3 * i + 1, b + 1, 3 * i + 2, c + 1, 3 * i + 3)
    };
    let positions = mesh.positions().iter().map(|p| numbers("v", p));
    let normals = mesh.normals().iter().flatten().map(|n| numbers("vn", n));
    positions.chain(normals).chain(mesh.triangles().iter().enumerate().map(face)).collect()
}

static BOWL: LazyLock<Bowl> = LazyLock::new(|| {
    let bench = with_matte();
    let obj = encode_obj(&BuiltInShape::Bowl.mesh(30).unwrap()).into_bytes();
    bench.write("bowl.obj", &obj);
    bench.run(&format!("{RENDER} -o bowl.exr")).succeeds();
    let said = bench.run("infer bowl.exr --mesh bowl.obj -o out --grid 8").succeeds().stderr;
    Bowl { obj, picture: bench.read("bowl.exr"), answer: bench.json("out/result.json"), said }
});

/// Creates a bench with a light, a material, the mesh `bowl.obj` and its picture `bowl.exr`.
fn with_bowl() -> Bench {
    let bench = with_matte();
    bench.write("bowl.obj", &BOWL.obj);
    bench.write("bowl.exr", &BOWL.picture);
    bench
}

#[test]
fn renders_a_mesh_with_self_shadowing() {
    let bench = with_bowl();
    let picture = |name: &str| read(bench.path(name), &ReadOptions::default()).unwrap().picture;
    bench.run(&format!("{RENDER} --no-shadows -o open.exr")).succeeds();
    let (shadowed, open) = (picture("bowl.exr"), picture("open.exr"));
    let sum = |p: &gonio::picture::Picture| p.rgb.as_slice().iter().map(|c| c.x).sum::<f32>();
    assert!(sum(&shadowed) < 0.9 * sum(&open), "{} {}", sum(&shadowed), sum(&open));
    assert!(shadowed.rgb.as_slice().iter().zip(open.rgb.as_slice()).all(|(a, b)| a.x <= 1.1 * b.x + 1e-4));
}

#[test]
fn self_shadowing_reduces_the_misfit_of_a_mesh() {
    let (bench, result) = (with_bowl(), &BOWL.answer);
    let observations = &result["observations"];
    assert_eq!(observations["visibility"]["occluded"], true, "{observations}");
    assert!(observations["shape"]["mesh"].as_str().unwrap().ends_with("bowl.obj"));
    assert!(observations["report"]["used"].as_u64().unwrap() > 1000, "{observations}");
    assert!(result["posterior"]["self_shadowing"].as_f64().unwrap() > 0.05, "{}", result["posterior"]);
    bench.run("infer bowl.exr --mesh bowl.obj -o plain --grid 8 --no-shadows").succeeds();
    let plain = bench.json("plain/result.json");
    assert_eq!(plain["posterior"]["self_shadowing"], 0.0);
    // Self-shadowing explains a part of the picture.
    let misfit = |r: &Value| r["residual"]["misfit"].as_f64().unwrap();
    assert!(misfit(result) < 0.8 * misfit(&plain), "{} {}", misfit(result), misfit(&plain));
}

#[test]
fn self_shadowing_reduces_the_misfit_under_a_known_light() {
    let bench = with_bowl();
    let run = "infer bowl.exr --mesh bowl.obj --light light.hdr --align-light fixed";
    bench.run(&format!("{run} -o out")).succeeds();
    bench.run(&format!("{run} -o plain --no-shadows")).succeeds();
    let [shadowed, plain] =
        ["out", "plain"].map(|out| bench.json(&format!("{out}/result.json"))["residual"]["misfit"].as_f64().unwrap());
    assert!(shadowed < 0.6 * plain, "{shadowed} {plain}");
}

#[test]
fn normals_with_depths_have_self_shadowing() {
    let bench = with_bowl();
    let mesh = BuiltInShape::Bowl.mesh(30).unwrap();
    let (centre, radius) = mesh.bounds();
    let camera = Camera::framing(centre, radius, (64, 64), 0.05).unwrap();
    let surface = Tracer::new(mesh.transformed(&camera.to_world.inverse()).unwrap());
    let buffer = GeometryBuffer::of(&surface, &camera);
    let gonio::shape::Projection::Orthographic { pixels_per_unit } = camera.projection else { panic!("orthographic") };
    bench.write("normals.npy", &encode_normals(&buffer.normals));
    // Without a camera, depths are in pixels.
    let depths =
        buffer.distances.as_slice().iter().map(|d| if d.is_finite() { d * pixels_per_unit as f32 } else { 0.0 });
    bench.write("depth.npy", &npy::encode(&npy::Array { shape: vec![64, 64], values: depths.collect() }));
    bench.run("infer bowl.exr --normals normals.npy --depth depth.npy -o out --grid 8").succeeds();
    let result = bench.json("out/result.json");
    assert_eq!(result["observations"]["visibility"]["occluded"], true);
    assert!(result["posterior"]["self_shadowing"].as_f64().unwrap() > 0.05);
    bench.refuses(
        "infer bowl.exr --normals normals.npy --positions depth.npy -o x",
        &["depth.npy: a position map requires a camera"],
    );
    bench.write("small.npy", &npy::encode(&npy::Array { shape: vec![32, 32], values: vec![1.0; 1024] }));
    bench.refuses("infer bowl.exr --normals normals.npy --depth small.npy -o x", &["small.npy", "32x32"]);
}

#[test]
fn detects_and_corrects_flipped_normals() {
    let bench = Bench::with_ball();
    let write = |name: &str, f: fn(&Vec3) -> Vec3| bench.write(name, &encode_normals(&normals(SIZE).map(f)));
    write("flipped.npy", |n| Vec3::new(n.x, -n.y, n.z));
    write("swapped.npy", |n| Vec3::new(n.z, n.y, n.x));
    write("both.npy", |n| Vec3::new(n.z, -n.y, n.x));
    bench.refuses("infer ball.exr --normals flipped.npy -o x", &["flipped.npy", "y flipped", "--normals-flip-y"]);
    bench.refuses("infer ball.exr --normals swapped.npy -o x", &["--normals-order zyx"]);
    bench.run("infer ball.exr --normals both.npy --normals-flip-y --normals-order zyx -o out --grid 8").succeeds();
    bench.run("infer ball.exr --normals normals.npy -o want --grid 8").succeeds();
    assert!(bench.channels("out") == bench.channels("want"));
    let trusted = bench.run("infer ball.exr --normals flipped.npy --trust-normals -o trusted --grid 8").succeeds();
    assert!(trusted.stderr.contains("y flipped"), "{trusted:?}");
}

/// Encodes a picture of a smooth function of the normals of a surface.
fn picture(surface: &dyn Surface, camera: &Camera) -> Vec<u8> {
    let buffer = GeometryBuffer::of(surface, camera);
    let colour =
        buffer.normals.map(|n| if *n == Vec3::ZERO { Vec3::ZERO } else { Vec3::splat(1.0 + 0.6 * n.y + 0.3 * n.x) });
    let alpha = buffer.normals.map(|n| if *n == Vec3::ZERO { 0.0 } else { 1.0 });
    gonio_io::picture::encode_exr(&colour, Some(&alpha))
}

#[test]
fn fits_ellipsoids_and_balls_in_perspective() {
    let bench = Bench::new();
    let camera = Camera::framing(DVec3::ZERO, 1.0, (90, 90), 0.05).unwrap();
    let axes = glam::DMat3::from_diagonal(DVec3::new(0.95, 0.6, 0.7));
    let centre = camera.to_world.inverse().transform_point3(DVec3::ZERO);
    bench.write("egg.exr", &picture(&Ellipsoid::new(centre, axes).unwrap(), &camera));
    bench.refuses("infer egg.exr -o x", &["egg.exr", "ellipse", "--shape ellipsoid"]);
    let run = bench.run("infer egg.exr --shape ellipsoid -o egg --grid 8").succeeds();
    assert!(run.stderr.contains("--depth-axis"), "{run:?}");
    let found = bench.json("egg/result.json");
    let axes = &found["observations"]["shape"]["ellipse"]["axes"];
    let long = 0.95 * 0.9 * 45.0;
    assert!((axes[0].as_f64().unwrap() - long).abs() < 0.5, "{axes} {long}");

    bench.write("camera.json", br#"{"projection": "perspective", "focal_pixels": 75}"#);
    let camera = gonio_io::camera::read_camera(bench.path("camera.json"), (120, 90)).unwrap();
    let ball = Ellipsoid::sphere(DVec3::new(0.75, 0.1, -1.6), 0.4).unwrap();
    bench.write("near.exr", &picture(&ball, &camera));
    bench.refuses("infer near.exr -o x", &["near.exr", "--camera"]);
    bench.run("infer near.exr --camera camera.json -o near --grid 8").succeeds();
    let found = bench.json("near/result.json");
    let centre = &found["observations"]["shape"]["centre"];
    let want = DVec3::new(0.75, 0.1, -1.6).normalize();
    for (i, want) in want.to_array().into_iter().enumerate() {
        assert!((centre[i].as_f64().unwrap() - want).abs() < 0.01, "{centre} {want}");
    }
}

#[test]
fn renders_and_infers_a_posed_mesh() {
    let bench = with_bowl();
    bench.write("pose.json", br#"{"translation": [10, 0, 0], "rotation_degrees": [0, 20, 0], "scale": 3}"#);
    let camera = br#"{"projection": "perspective", "fov_y_degrees": 30, "pose": {"position": [10, 2, 16], "look_at": [10, 0, 0]}}"#;
    bench.write("camera.json", camera);
    let shape = "--mesh bowl.obj --pose pose.json --camera camera.json";
    bench
        .run(&format!(
            "render --brdf in.binary --light light.hdr {shape} -o posed.exr --size 72 --height 60 --tolerance 1"
        ))
        .succeeds();
    let alpha = read(bench.path("posed.exr"), &ReadOptions::default()).unwrap().picture.alpha.unwrap();
    assert_eq!(alpha.size(), (72, 60));
    let covered = alpha.as_slice().iter().sum::<f32>() / (72.0 * 60.0);
    assert!((0.2..0.8).contains(&covered), "{covered}");
    bench.run(&format!("infer posed.exr {shape} -o out --grid 8")).succeeds();
    assert_eq!(bench.json("out/result.json")["observations"]["shape"]["projection"]["kind"], "perspective");
    // This pose places the mesh elsewhere in the picture.
    bench.write("moved.json", br#"{"translation": [12.5, 0, 0], "scale": 2}"#);
    bench.refuses(
        "infer posed.exr --mesh bowl.obj --pose moved.json --camera camera.json -o x",
        &["posed.exr with bowl.obj", "is not aligned with the object"],
    );
    bench.write("behind.json", br#"{"translation": [10, 0, 60]}"#);
    bench.refuses(
        "infer posed.exr --mesh bowl.obj --pose behind.json --camera camera.json -o x",
        &["bowl.obj: the mesh is not visible to the camera"],
    );
}

#[test]
fn inflates_outlines() {
    let bench = Bench::with_light_and_material();
    let render = "render --brdf in.binary --light light.hdr --size 96 --tolerance 1";
    bench.run(&format!("{render} -o ball.exr")).succeeds();
    bench.run(&format!("{render} --mesh bunny -o bunny.exr")).succeeds();
    let found = || {
        let result = bench.json("out/result.json");
        (
            result["posterior"]["highlight"]["peak_height"]["50"].as_f64().unwrap(),
            result["observations"]["shape"].clone(),
        )
    };
    // The inflated outline of a ball is the ball.
    bench.run("infer ball.exr --grid 8 -o out").succeeds();
    let (as_ball, _) = found();
    bench.run("infer ball.exr --shape outline --grid 8 -o out").succeeds();
    let (as_outline, shape) = found();
    assert!((as_outline / as_ball).ln().abs() < 0.4, "{as_ball} {as_outline}");
    assert!(shape["depth_factor"].as_f64().unwrap() > 0.97, "{shape}");
    bench.run_with_pictures("infer bunny.exr --shape outline --grid 8 -o out").succeeds();
    let (_, shape) = found();
    // The picture of the normals is a normal map.
    let inflated = gonio_io::normals::read_normals(bench.path("out/normals.png")).unwrap();
    assert!((inflated[(48, 60)].length() - 1.0).abs() < 0.02 && inflated[(0, 0)] == Vec3::ZERO);
    bench.run_with_pictures("infer bunny.exr --normals out/normals.png --grid 8 -o again").succeeds();
    assert!(!bench.path("again/normals.png").exists());
    assert!((0.7..0.97).contains(&shape["depth_factor"].as_f64().unwrap()), "{shape}");
    let said = bench.run("check bunny.exr --shape outline").succeeds().stdout;
    assert!(said.contains("surface inflated from the outline"), "{said}");
    bench.write("camera.json", br#"{"projection": "perspective", "focal_pixels": 400}"#);
    for (line, problem) in [
        ("--shape outline --circle 48,48,40", "--circle is the outline of a ball"),
        ("--shape outline --camera camera.json", "outline and camera cannot be combined"),
        ("--normals n.exr --normals-error 50", "expected an angle from 0 to 45 degrees"),
        ("--normals n.exr --normals-error 5 --depth d.exr", "cannot be used with"),
        ("--shape outline --regions bunny.exr", "an outline cannot be inflated for each region"),
    ] {
        bench.run(&format!("infer bunny.exr {line} -o none")).fails(&[problem]);
    }
    assert!(!bench.path("none").exists());
}

#[test]
fn rejects_invalid_shapes() {
    let bench = with_bowl();
    let obj = bench.read("bowl.obj");
    bench.write("short.obj", &obj[..obj.len() / 2]);
    bench.write("bad.json", br#"{"projection": "perspective", "fov": 40}"#);
    bench.write("flat.json", br#"{"scale": 0}"#);
    bench.write("light.json", b"[1, 2");
    for (options, message) in [
        ("--mesh none.ply", "none.ply: cannot open"),
        ("--mesh short.obj", "short.obj: "),
        ("--mesh light.hdr", "light.hdr: "),
        ("--mesh bowl.obj --camera bad.json", "bad.json: "),
        ("--mesh bowl.obj --camera light.json", "light.json: "),
        ("--mesh bowl.obj --pose flat.json", "flat.json: "),
        ("--pose flat.json", "--mesh"),
        ("--mesh bowl.obj --normals normals.npy", "--mesh"),
        ("--shape cube", "cube"),
        ("--normals-flip-y", "--normals"),
        ("--depth-axis -3", "--depth-axis"),
    ] {
        bench.refuses(&format!("infer bowl.exr -o out {options}"), &[message]);
    }
    bench.write("grey.exr", &grey(1.0, 64, 64));
    bench.refuses("infer grey.exr -o out", &["grey.exr: no object found"]);
    let render = "render --brdf in.binary --light light.hdr -o x.exr --size 16";
    bench.refuses(&format!("{render} --mesh short.obj"), &["short.obj: "]);
    bench.refuses(&format!("{render} --camera bad.json"), &["--mesh"]);
}

#[test]
fn warns_about_unusual_meshes() {
    let bench = with_bowl();
    let mesh = BuiltInShape::Bowl.mesh(30).unwrap();
    let text = encode_obj(&mesh);
    // All triangles face inwards, normals are missing, and one triangle has no area.
    let lines = text.lines().filter(|l| !l.starts_with("vn")).map(|l| match l.strip_prefix("f ") {
        Some(corners) => {
            let mut at: Vec<&str> = corners.split_whitespace().map(|c| c.split('/').next().unwrap()).collect();
            at.swap(1, 2);
            format!("f {}\n", at.join(" "))
        }
        None => format!("{l}\n"),
    });
    let odd = lines.collect::<String>() + "f 1 1 2\n";
    bench.write("odd.obj", odd.as_bytes());
    // The paper's methods also print these warnings.
    let run = bench
        .run("infer bowl.exr --mesh odd.obj -o out --method variational --starts 1 --all-observations --grid 8")
        .succeeds();
    for message in ["odd.obj: the mesh of", "1 triangles with zero area", "facing inwards"] {
        assert!(run.stderr.contains(message), "{message}: {run:?}");
    }
    assert!(!BOWL.said.contains("mesh"), "{}", BOWL.said);
    // The same pixels show the mesh, now its inside; a few pixels at thin triangles may differ.
    let (odd, want) = (&bench.json("out/result.json")["observations"], &BOWL.answer["observations"]);
    assert_eq!(odd["visibility"]["occluded"], true);
    let count = |of: &Value, what: [&str; 2]| of[what[0]][what[1]].as_f64().unwrap();
    assert!((count(odd, ["report", "used"]) / count(want, ["report", "used"]) - 1.0).abs() < 0.03, "{odd} {want}");
    let inside = |of: &Value| count(of, ["surface", "back_facing"]) / count(of, ["surface", "pixels"]);
    assert!(inside(odd) > 0.95 && inside(want) < 0.05, "{odd} {want}");
}

#[test]
fn renders_built_in_meshes() {
    let bench = Bench::with_light_and_material();
    for form in ["blob", "bunny"] {
        bench
            .run(&format!(
                "render --brdf in.binary --light light.hdr --mesh {form} -o {form}.png --size 24 --tolerance 2"
            ))
            .succeeds();
        let drawn = read(bench.path(&format!("{form}.png")), &ReadOptions::default()).unwrap().picture.rgb;
        let lit = drawn.as_slice().iter().filter(|c| c.x > 0.0).count();
        assert!(lit > 24 * 24 / 8, "{form}: {lit}");
    }
}
