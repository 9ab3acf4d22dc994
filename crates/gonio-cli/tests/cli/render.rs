//! Tests of `gonio render`.

use gonio_io::picture::{ReadOptions, read};

use crate::support::{Bench, grey};

#[test]
fn pictures_have_the_specified_size() {
    let bench = Bench::with_light_and_material();
    for (name, size) in [("a.exr", 33), ("a.png", 40)] {
        bench.run(&format!("render --brdf in.binary --light light.hdr -o {name} --size {size}")).succeeds();
        let picture = read(bench.path(name), &ReadOptions::default()).unwrap().picture;
        assert_eq!(picture.rgb.size(), (size, size));
        assert_eq!(picture.alpha.is_some(), name == "a.exr");
        assert!(picture.rgb[(size / 2, size / 2)].min_element() > 0.0);
    }
}

#[test]
fn rejects_invalid_input() {
    let bench = Bench::with_light_and_material();
    let good = bench.read("in.binary");
    bench.write("short.binary", &good[..good.len() / 2]);
    bench.write("square.exr", &grey(1.0, 8, 8));
    bench.write("black.exr", &grey(0.0, 16, 8));
    bench.write("negative.exr", &grey(-1.0, 16, 8));
    std::fs::create_dir(bench.path("folder.exr")).unwrap();
    for (brdf, light, output, message) in [
        ("in.binary", "light.hdr", "x.jpg", "x.jpg"),
        ("in.binary", "light.hdr", "x", ".exr or .png"),
        ("none.binary", "light.hdr", "x.exr", "none.binary"),
        ("in.binary", "none.hdr", "x.exr", "none.hdr"),
        ("short.binary", "light.hdr", "x.exr", "short.binary: is truncated"),
        ("light.hdr", "light.hdr", "x.exr", "light.hdr"),
        ("in.binary", "in.binary", "x.exr", "in.binary"),
        ("in.binary", "square.exr", "x.exr", "square.exr: a lat-long map must be twice as wide as high"),
        ("in.binary", "black.exr", "x.exr", "black.exr"),
        ("in.binary", "negative.exr", "x.exr", "negative.exr"),
        ("in.binary", "light.hdr", "none/x.exr", "none/x.exr"),
        ("in.binary", "light.hdr", "in.binary/x.png", "in.binary/x.png"),
        ("in.binary", "light.hdr", "folder.exr", "folder.exr"),
    ] {
        bench.refuses(&format!("render --brdf {brdf} --light {light} -o {output} --size 8"), &[message]);
    }
    for (option, message) in [
        ("--size 7", "--size"),
        ("--size many", "--size"),
        ("--samples 0", "--samples"),
        ("--tolerance 0", "--tolerance"),
        ("--tolerance nan", "--tolerance"),
        ("--odd", "--odd"),
    ] {
        bench.refuses(&format!("render --brdf in.binary --light light.hdr -o x.exr {option}"), &[message]);
    }
    bench.refuses("render --brdf in.binary -o x.exr", &["--light"]);
}

#[test]
fn draws_show_the_uncertainty_of_the_result() {
    let bench = Bench::with_light_and_material();
    bench.write_answer("out");
    let layer = |name: &str| {
        let options = ReadOptions { layer: Some(name.to_owned()), ..ReadOptions::default() };
        read(bench.path("x.exr"), &options).unwrap().picture
    };
    bench.run("render --brdf out --draws 8 --light light.hdr -o x.exr --size 24").succeeds();
    let plain = read(bench.path("x.exr"), &ReadOptions::default()).unwrap().picture;
    let (low, high) = (layer("low"), layer("high"));
    let alpha = plain.alpha.as_ref().unwrap().as_slice();
    let mut wide = 0;
    for i in (0..24 * 24).filter(|i| alpha[*i] > 0.99) {
        let [low, middle, high] = [&low, &plain, &high].map(|picture| picture.rgb.as_slice()[i].y);
        assert!(low <= middle && middle <= high, "{i}: {low} {middle} {high}");
        wide += usize::from(high > 1.2 * low);
    }
    assert!(wide > 50, "{wide}");
    // The median resembles the rendering of the estimate.
    bench.run("render --brdf out/brdf.npz --light light.hdr -o y.exr --size 24").succeeds();
    let estimate = read(bench.path("y.exr"), &ReadOptions::default()).unwrap().picture.rgb;
    let sum = |f: &dyn Fn(usize) -> f32| (0..24 * 24).map(f).sum::<f32>();
    let difference = sum(&|i| (plain.rgb.as_slice()[i] - estimate.as_slice()[i]).length_squared());
    let ratio = (difference / sum(&|i| estimate.as_slice()[i].length_squared())).sqrt();
    assert!(ratio < 0.3, "{ratio}");
    // The file of the BRDF may be in the current folder.
    bench.write_answer(".");
    bench.run("render --brdf brdf.npz --draws 5 --light light.hdr -o y.exr --size 24").succeeds();
    // A picture for display has five draws side by side, those of the same seed.
    for name in ["a.png", "b.png"] {
        let brdf = if name == "a.png" { "out" } else { "out/brdf.npz" };
        bench.run(&format!("render --brdf {brdf} --draws 8 --light light.hdr -o {name} --size 24")).succeeds();
    }
    assert_eq!(bench.read("a.png"), bench.read("b.png"));
    assert_eq!(read(bench.path("a.png"), &ReadOptions::default()).unwrap().picture.rgb.size(), (120, 24));

    bench.refuses("render --brdf in.binary --draws 8 --light light.hdr -o z.exr", &["posterior.json"]);
    bench.refuses("render --brdf out --draws 4 --light light.hdr -o z.exr", &["--draws"]);
    bench.refuses("render --brdf out --draws 500 --light light.hdr -o z.exr --size 2048", &["25 GB", "fewer draws"]);
    bench.refuses("render --brdf out --seed 8 --light light.hdr -o z.exr", &["--draws"]);
    std::fs::remove_file(bench.path("out/posterior.json")).unwrap();
    bench.refuses(
        "render --brdf out --draws 8 --light light.hdr -o z.exr",
        &["out: does not contain", "posterior.json"],
    );
}
