//! Tests of `gonio infer` with invalid input.

use std::fs;

use glam::Vec3;
use gonio::picture::{Picture, Plane};

use crate::support::{Bench, SIZE, ball, encode_normals, exr, grey, normals};

#[test]
fn rejects_invalid_photographs() {
    let bench = Bench::with_ball();
    let good = bench.read("ball.exr");
    bench.write("short.exr", &good[..good.len() * 2 / 3]);
    bench.write("text.exr", b"no picture at all\n");
    bench.write("notes.txt", b"no picture at all\n");
    bench.write("empty.exr", b"");
    let black = Picture { rgb: ball().rgb.map(|_| Vec3::ZERO), ..ball() };
    bench.write("black.exr", &exr(&black));
    bench.write("constant.exr", &grey(0.5, SIZE, SIZE));
    let uneven = Plane::from_fn(SIZE, SIZE, |x, y| Vec3::splat((x + SIZE * y) as f32));
    bench.write("uneven.pfm", &gonio_io::picture::encode_pfm(&uneven));
    bench.write("one.exr", &grey(0.5, 1, 1));
    fs::create_dir(bench.path("folder")).unwrap();
    for (image, message) in [
        ("none.exr", "none.exr: cannot open"),
        ("folder", "folder: cannot read"),
        ("short.exr", "short.exr: "),
        ("text.exr", "text.exr: does not have the header of a .exr file"),
        ("notes.txt", "notes.txt: is a .txt file"),
        ("empty.exr", "empty.exr: is empty"),
        ("black.exr", "black.exr: the object is entirely black"),
        ("constant.exr", "constant.exr: no object found"),
        ("uneven.pfm", "uneven.pfm: no object found"),
        ("one.exr", "one.exr: no object found"),
    ] {
        bench.refuses(&format!("infer {image} -o out"), &[message]);
    }
    bench.refuses("infer black.exr -o deep/er/out", &["black.exr: the object is entirely black"]);
    bench.refuses("infer", &["<IMAGE>"]);
}

#[test]
fn help_succeeds() {
    let bench = Bench::new();
    for line in ["--help", "train lighting --help"] {
        let run = bench.run(line).succeeds();
        assert!(run.stderr.is_empty() && run.stdout.contains("gonio"), "{run:?}");
    }
}

#[cfg(unix)]
#[test]
fn rejects_unreadable_photographs() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::with_ball();
    fs::set_permissions(bench.path("ball.exr"), fs::Permissions::from_mode(0o000)).unwrap();
    if fs::read(bench.path("ball.exr")).is_ok() {
        eprintln!("skipped: this user has permission to read all files");
        return;
    }
    bench.refuses("infer ball.exr -o out", &["ball.exr: cannot open", "check the permissions"]);
}

#[test]
fn rejects_invalid_masks() {
    let bench = Bench::with_ball();
    bench.write("empty.exr", &grey(0.0, SIZE, SIZE));
    bench.write("full.exr", &grey(1.0, SIZE, SIZE));
    bench.write("odd.exr", &grey(3.0, SIZE, SIZE));
    bench.write("tall.exr", &grey(1.0, SIZE / 2, SIZE));
    let shape = |inside: &dyn Fn(f64, f64) -> bool| {
        let white = |x: usize, y: usize| inside(x as f64 - 23.5, y as f64 - 23.5);
        let plane = Plane::from_fn(SIZE, SIZE, |x, y| if white(x, y) { Vec3::ONE } else { Vec3::ZERO });
        gonio_io::picture::encode_png(&plane)
    };
    bench.write("bar.png", &shape(&|x, y| x.abs() < 20.0 && y.abs() < 5.0));
    bench.write("oval.png", &shape(&|x, y| (x / 20.0).hypot(y / 16.0) < 1.0));
    for (mask, message) in [
        ("none.png", "none.png: cannot open"),
        ("empty.exr", "empty.exr: the mask is empty"),
        ("full.exr", "full.exr: the mask covers the whole image"),
        ("odd.exr", "odd.exr: contains the value 3"),
        ("tall.exr", "tall.exr: the mask is 24x48 pixels, but the photograph is 48x48"),
        ("bar.png", "bar.png: the outline is not a circle"),
        ("oval.png", "oval.png: the outline is an ellipse"),
        ("normals.npy", "normals.npy: "),
    ] {
        bench.refuses(&format!("infer ball.exr -o out --mask {mask}"), &[message]);
    }
    bench.refuses(
        "infer ball.exr -o out --mask empty.exr --normals normals.npy",
        &["normals.npy and empty.exr: no covered"],
    );
}

#[test]
fn rejects_invalid_normals() {
    let bench = Bench::with_ball();
    let good = normals(SIZE);
    bench.write("small.npy", &encode_normals(&normals(SIZE / 2)));
    bench.write("long.npy", &encode_normals(&good.map(|n| 1.5 * n)));
    bench.write("away.npy", &encode_normals(&good.map(|n| Vec3::new(n.x, n.y, -n.z))));
    bench.write("none.npy", &encode_normals(&good.map(|_| Vec3::ZERO)));
    bench.write("flat.npy", &encode_normals(&good.map(|_| Vec3::Z)));
    let bytes = bench.read("normals.npy");
    bench.write("short.npy", &bytes[..bytes.len() - 8]);
    for (normals, message) in [
        ("missing.npy", "missing.npy: cannot open"),
        ("small.npy", "small.npy: the normal map is 24x24"),
        ("long.npy", "long.npy: "),
        ("away.npy", "face away from the camera"),
        ("none.npy", "none.npy: no covered pixel has a normal"),
        ("flat.npy", "flat.npy: the shape is too flat to separate light and reflectance"),
        ("short.npy", "short.npy: has"),
    ] {
        bench.refuses(&format!("infer ball.exr -o out --normals {normals}"), &[message]);
    }
    bench.refuses("infer ball.exr -o out --normals long.npy", &["are not unit vectors"]);
    bench.refuses("infer ball.exr -o out --normals normals.npy --circle 9,9,9", &["--circle", "--normals"]);
}

#[test]
fn rejects_invalid_models() {
    let bench = Bench::with_ball();
    let mut bytes = gonio_io::model::encode_model(&gonio_io::model::embedded().unwrap());
    *bytes.last_mut().unwrap() ^= 1;
    bench.write("flipped.model", &bytes);
    for (model, message) in [
        ("none.model", "none.model: cannot open"),
        ("flipped.model", "flipped.model: does not match its checksum"),
        ("ball.exr", "ball.exr: is not a model"),
    ] {
        bench.refuses(&format!("infer ball.exr -o out --model {model}"), &[message]);
    }
}

#[test]
fn rejects_invalid_lights_and_options() {
    let bench = Bench::with_ball();
    bench.write("square.exr", &grey(1.0, 8, 8));
    for (options, message) in [
        ("--method known-light", "--light"),
        ("--absolute", "--light"),
        ("--method learnt --light square.exr", "--light MAP is for --method known-light"),
        ("--method joint-map --light square.exr", "--light MAP is for --method known-light"),
        ("--method known-light --light none.exr", "none.exr: cannot open"),
        ("--method known-light --light square.exr", "square.exr: a lat-long map must be twice as wide as high"),
        ("--method guess", "--method"),
        ("--grid 48", "grid 48: must be a power of two"),
        ("--grid 0", "grid 0"),
        ("--grid 1", "grid 1"),
        ("--grid x", "--grid"),
        ("--starts 0", "--starts"),
        ("--clip 0", "clip 0"),
        ("--clip nan", "clip NaN"),
        ("--circle nonsense", "--circle"),
        ("--circle 1,2", "--circle"),
        ("--circle 1,2,3,4", "--circle"),
        ("--circle 24,24,20,x", "--circle"),
        ("--circle 24,24,-20", "--circle"),
        ("--circle 24,24,nan", "--circle"),
        ("--circle 24,24,inf", "ball.exr: the circle"),
        ("--circle 24,24,3", "ball.exr: the circle"),
        ("--circle 240,24,20", "ball.exr: only 0 points on the object are usable"),
        ("--shape cube", "--shape"),
        ("--sed 3", "'--seed'"),
    ] {
        bench.refuses(&format!("infer ball.exr -o out {options}"), &[message]);
    }
}

#[test]
fn rejects_folders_that_cannot_be_created() {
    let bench = Bench::with_ball();
    bench.write("file", b"x");
    bench.refuses("infer ball.exr -o file", &["file: cannot create the folder", "a file with this name exists"]);
    bench.refuses("infer ball.exr -o file/out", &["file/out: cannot create the folder"]);
    bench.refuses("infer ball.exr -o file/deep/out", &["file/deep/out: cannot create the folder"]);
}
