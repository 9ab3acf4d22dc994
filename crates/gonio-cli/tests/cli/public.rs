//! Tests of public files in `gonio-io/tests/corpus/public`: deviations from formats that programs
//! and cameras cause (docs/reliability.md). Each variant of a photograph must give the estimate of
//! `ball.exr`.

use gonio_io::picture::{ReadOptions, read};

use crate::support::Bench;

/// Creates a bench with files of the corpus.
fn with(files: &[&str]) -> Bench {
    let bench = Bench::new();
    let corpus = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../gonio-io/tests/corpus/public");
    files.iter().for_each(|file| bench.write(file, &std::fs::read(corpus.join(file)).unwrap()));
    bench
}

/// Returns the median roughness of an inference.
fn roughness(bench: &Bench, line: &str) -> f64 {
    bench.run(&format!("infer {line} -o out --grid 8")).succeeds();
    bench.json("out/result.json")["posterior"]["highlight"]["roughness"]["50"].as_f64().unwrap()
}

#[test]
fn variants_of_a_photograph_give_its_estimate() {
    // `gonio-io/tests/io/public.rs` compares the pixels of the other variants.
    let variants = [
        ("hot-pixel.exr", &["hot-pixel.exr"][..]),
        ("chromaticities-ap0.exr", &["chromaticities-ap0.exr"]),
        (
            "ball-clutter.exr --normals normals-flat-background.png",
            &["ball-clutter.exr", "normals-flat-background.png"],
        ),
        (
            "ball.exr --normals normals-averaged.npy --mask mask-averaged.png",
            &["normals-averaged.npy", "mask-averaged.png"],
        ),
    ];
    let files: Vec<&str> = variants.iter().flat_map(|(_, files)| files.iter().copied()).chain(["ball.exr"]).collect();
    let bench = with(&files);
    let want = roughness(&bench, "ball.exr");
    assert!((want - 0.44).abs() < 0.01, "{want}");
    for (line, _) in variants {
        let got = roughness(&bench, line);
        assert!((got / want - 1.0).abs() < 0.06, "{line}: {got}, not {want}");
    }
    // The coding of 8 bits clips the highlight, so only the detection is that of the photograph.
    let bench = with(&["ball.exr", "alpha-opaque.png"]);
    let circle = |image: &str| {
        let run = bench.run(&format!("check {image}")).succeeds();
        run.stdout.lines().nth(1).unwrap().to_owned()
    };
    assert_eq!(circle("alpha-opaque.png"), circle("ball.exr"));
}

#[test]
fn brackets_merge_whether_shifted_or_still() {
    let names = |name: &str| (1..=4).map(|i| format!("bracket-{name}-{i}.jpg")).collect::<Vec<_>>();
    let files = [names("still"), names("one-pixel")].concat();
    let bench = with(&files.iter().map(String::as_str).collect::<Vec<_>>());
    let run = bench.run(&format!("merge {} -o still.exr", names("still").join(" "))).succeeds();
    assert!(!run.stdout.contains("aligned"), "{run:?}");
    let run = bench.run(&format!("merge {} -o shifted.exr", names("one-pixel").join(" "))).succeeds();
    assert!(run.stdout.contains("(2 aligned by up to 1 pixels)"), "{run:?}");
    let [still, shifted] =
        ["still.exr", "shifted.exr"].map(|name| read(bench.path(name), &ReadOptions::default()).unwrap());
    let pairs = still.picture.rgb.as_slice().iter().zip(shifted.picture.rgb.as_slice());
    let mut ratios: Vec<f32> = pairs.filter(|(a, b)| a.y > 0.0 && b.y > 0.0).map(|(a, b)| (b.y / a.y).ln()).collect();
    ratios.sort_by(f32::total_cmp);
    // The recovered responses differ by a scale.
    let quantile = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
    assert!(quantile(0.9) - quantile(0.1) < 0.08, "{} {}", quantile(0.1), quantile(0.9));
}

#[test]
fn exif_variants_merge_or_state_the_cause() {
    let pointer = ["exif-no-next-pointer-1.jpg", "exif-no-next-pointer-2.jpg"];
    let bench = with(&[&pointer[..], &["exif-equal-times-1.jpg", "exif-equal-times-2.jpg"]].concat());
    bench.run(&format!("merge {} -o out.exr", pointer.join(" "))).succeeds();
    bench.refuses(
        "merge exif-equal-times-1.jpg exif-equal-times-2.jpg -o equal.exr",
        &["the exposures have the same time", "--times", "--response"],
    );
}

#[test]
fn exposure_of_a_light_map_does_not_change_the_albedo() {
    let bench = with(&["ball-in-light.exr", "light.hdr", "light-exposure-4.hdr"]);
    let albedo = |light: &str| {
        bench.run(&format!("infer ball-in-light.exr --light {light} --absolute -o out")).succeeds();
        bench.json("out/result.json")["reflectance"]["normal_albedo"].as_f64().unwrap()
    };
    let (plain, scaled) = (albedo("light.hdr"), albedo("light-exposure-4.hdr"));
    assert!((plain - 0.512).abs() < 0.02 && (scaled / plain - 1.0).abs() < 1e-3, "{plain} {scaled}");
}
