//! Tests of `--colorspace` and `--output-colorspace`.

use glam::Vec3;
use gonio::picture::Picture;
use gonio::reflectance::BivariateTable;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{ExrOptions, ReadOptions, SpaceSource, encode_exr_in, encode_exr_with, encode_hdr, read};

use crate::support::{Bench, ball};

/// Returns a ball of one colour in linear Rec. 709.
fn tinted() -> Picture {
    let Picture { rgb, alpha } = ball();
    Picture { rgb: rgb.map(|v| *v * Vec3::new(1.3, 0.9, 0.6)), alpha }
}

/// Encodes the ball in ACEScg, with chromaticities if `stated`.
fn in_aces(stated: bool) -> Vec<u8> {
    let Picture { rgb, alpha } = tinted();
    let rgb = rgb.map(|v| ColourSpace::AcesCg.encode(*v));
    let space = stated.then_some(ColourSpace::AcesCg);
    encode_exr_with(&rgb, &ExrOptions { alpha: alpha.as_ref(), clip_level: None, space })
}

/// Returns the largest relative difference of two tables in the first 60 rows and columns.
fn difference(a: &BivariateTable, b: &BivariateTable) -> f32 {
    let cells = (0..60).flat_map(|i| (0..60).map(move |j| (i, j)));
    cells.map(|(i, j)| (a.cell(i, j) / b.cell(i, j) - 1.0).abs()).fold(0.0, f32::max)
}

#[test]
fn a_photograph_in_acescg_gives_the_same_brdf() {
    let bench = Bench::new();
    let Picture { rgb, alpha } = tinted();
    bench.write("plain.exr", &encode_exr_with(&rgb, &ExrOptions { alpha: alpha.as_ref(), ..ExrOptions::default() }));
    bench.write("unstated.exr", &in_aces(false));
    bench.write("stated.exr", &in_aces(true));
    bench.run("infer plain.exr -o plain --grid 8 --color median").succeeds();
    bench.run("infer unstated.exr -o given --grid 8 --color median --colorspace acescg").succeeds();
    bench.run("infer unstated.exr -o wrong --grid 8 --color median").succeeds();
    let run = bench.run("infer stated.exr -o out --grid 8 --color median --colorspace rec2020 --output-colorspace ap1");
    let run = run.succeeds();
    let message = "stated.exr: states the colour space acescg (chromaticities of the file); the specified space rec2020 has no effect";
    assert!(run.stderr.contains(message), "{run:?}");

    let (plain, given, wrong) = (bench.channels("plain"), bench.channels("given"), bench.channels("wrong"));
    for channel in 0..3 {
        assert!(difference(&given[channel], &plain[channel]) < 1e-3, "{channel}");
    }
    assert!(difference(&wrong[2], &plain[2]) > 0.1);
    // The ACES matrix converts the results in ACEScg to those in Rec. 709.
    let out = bench.channels("out");
    let cell = |tables: &[BivariateTable; 3]| Vec3::from([0, 1, 2].map(|c| tables[c].cell(20, 20)));
    let back = ColourSpace::AcesCg.to_rec709().as_mat3() * cell(&out);
    assert!((back / cell(&plain) - Vec3::ONE).abs().max_element() < 1e-3, "{back} {}", cell(&plain));
    let light = read(bench.path("out/light.exr"), &ReadOptions::default()).unwrap();
    assert_eq!((light.input.name.as_str(), light.input.source), ("acescg", SpaceSource::Chromaticities));
    let before = read(bench.path("plain/light.exr"), &ReadOptions::default()).unwrap();
    assert_eq!(before.input.name, "rec709");
    let pixel = |light: &gonio_io::picture::Decoded| light.picture.rgb[(40, 30)];
    assert!((pixel(&light) - pixel(&before)).abs().max_element() < 1e-3 * pixel(&before).max_element());

    let space = |out: &str| bench.json(&format!("{out}/result.json"))["colorspace"].clone();
    for (out, input, source, output) in [
        ("plain", "rec709", "assumed", "rec709"),
        ("given", "acescg", "given", "rec709"),
        ("out", "acescg", "chromaticities of the file", "acescg"),
    ] {
        let space = space(out);
        assert_eq!(
            (&space["input"], &space["source"], &space["output"]),
            (&input.into(), &source.into(), &output.into())
        );
    }

    // `gonio export` reads the space of the results, and states the space of each export.
    // With the albedo of the result, the export is not scaled.
    bench.run("export out --to merl,mtlx --draws 0 --output-colorspace rec2020 --albedo 0.5").succeeds();
    let summary = bench.json("out/export/export.json");
    assert_eq!(summary["exports"]["merl"]["colorspace"], "rec2020");
    assert_eq!(summary["exports"]["mtlx"]["colorspace"], "rec709");
    let exported = gonio_io::brdf::read(bench.path("out/export/brdf.binary")).unwrap();
    let back = ColourSpace::Rec2020.to_rec709().as_mat3() * cell(&exported.to_bivariate());
    assert!((back / cell(&plain) - Vec3::ONE).abs().max_element() < 2e-3, "{back} {}", cell(&plain));
}

#[test]
fn light_maps_have_a_colour_space() {
    let bench = Bench::with_light_and_material();
    let light = gonio::lighting::studio_light(16).radiance().map(|v| *v * Vec3::new(1.0, 0.7, 0.4));
    bench.write("light.hdr", &encode_hdr(&light));
    bench.write("aces.hdr", &encode_hdr(&light.map(|v| ColourSpace::AcesCg.encode(*v))));
    bench.write("stated.exr", &encode_exr_in(&light, None, ColourSpace::Xyz));
    bench.run("render --brdf in.binary --light light.hdr -o a.exr --size 24").succeeds();
    bench.run("render --brdf in.binary --light aces.hdr --colorspace acescg -o b.exr --size 24").succeeds();
    bench.run("render --brdf in.binary --light stated.exr -o c.exr --size 24").succeeds();
    let centre = |name: &str| read(bench.path(name), &ReadOptions::default()).unwrap().picture.rgb[(12, 12)];
    for name in ["b.exr", "c.exr"] {
        // Radiance HDR files have a relative precision of 1/256.
        assert!((centre(name) / centre("a.exr") - Vec3::ONE).abs().max_element() < 0.02, "{name}: {}", centre(name));
    }
    bench.refuses("render --brdf in.binary --light light.hdr --colorspace cmyk -o d.exr", &["'cmyk'", "acescg"]);
}
