//! Tests of options, help texts and messages.

use gonio::lighting::studio_light;
use gonio_io::picture::{encode_hdr, encode_pfm};

use crate::support::{ANSWER, Bench, ball, exr};

#[test]
fn short_help_fits_a_screen_and_long_help_has_headings() {
    let bench = Bench::new();
    let headings = ["Input", "Object detection", "Shape", "Camera", "Light", "Method", "Colour", "Output", "General"];
    let short = bench.run("infer -h").succeeds().stdout;
    assert!(short.lines().count() <= 40, "{}", short.lines().count());
    assert!(short.lines().all(|line| line.chars().count() <= 100), "{short}");
    assert!(short.contains("--mask") && !short.contains("--normals-flip-y"), "{short}");
    let long = bench.run("infer --help").succeeds().stdout;
    let at = |heading: &str| long.find(&format!("\n{heading}:\n")).unwrap_or_else(|| panic!("{heading}: {long}"));
    assert!(headings.windows(2).all(|pair| at(pair[0]) < at(pair[1])));
    assert!(!long.contains("\nOptions:\n"), "{long}");
    assert!(long.contains("--normals-flip-y") && at("Examples") > at("General"));
    // `--help` lists the options of methods under the heading Method.
    for option in ["--starts", "--solver", "--seed", "--grid", "--paper"] {
        let place = long.find(&format!(" {option}")).unwrap();
        assert!(at("Method") < place && place < at("Colour"), "{option}");
    }
}

#[test]
fn reports_options_that_do_not_apply_to_a_file() {
    let bench = Bench::with_ball();
    bench.write("ball.pfm", &encode_pfm(&ball().rgb));
    let printed = bench.run("check ball.exr --linear").succeeds().stderr;
    assert!(printed.contains("ball.exr: is already linear"), "{printed}");
    bench.refuses("check ball.pfm --layer diffuse", &["ball.pfm: has no layers, because it is not an OpenEXR file"]);
}

#[test]
fn rejects_options_that_the_method_does_not_use() {
    let bench = Bench::with_ball();
    bench.write("light.hdr", &encode_hdr(studio_light(16).radiance()));
    bench.write("labels.png", b"");
    for (options, message) in [
        ("--solver blocks", "--solver is for --method variational; method learnt does not use it"),
        ("--starts 2", "--starts is for --method variational, joint-map, known-light-basis"),
        ("--seed 2", "--seed is for"),
        ("--all-observations", "--all-observations is for --method variational, joint-map; method learnt"),
        (
            "--method joint-map --solver blocks",
            "--solver is for --method variational; method joint-map does not use it",
        ),
        ("--light light.hdr --starts 2", "method known-light does not use it"),
        ("--light light.hdr --grid 16", "--grid is for --method learnt, variational, joint-map; method known-light"),
        ("--light light.hdr --method known-light-basis --all-observations", "--all-observations is for"),
        ("--light light.hdr --method known-light-basis --absolute", "--absolute is for --method known-light"),
        ("--light light.hdr --method known-light-basis --align-light", "--align-light is for --method known-light"),
        ("--depth-axis 20", "--depth-axis requires --shape ellipsoid"),
        ("--normals normals.npy --depth-axis 20", "--depth-axis requires --shape ellipsoid"),
        ("--shape ellipsoid --circle 24,24,20", "--circle is the outline of a ball"),
        (
            "--circle 14,24,9 --circle 34,24,9 --mask ball.exr",
            "--mask and several --circle options both define the balls",
        ),
        (
            "--circle 14,24,9 --circle 34,24,9 --regions labels.png",
            "--regions and several --circle options both define the regions",
        ),
        ("--circle 14,24,9 --circle 34,24,9 --one-material", "--one-material applies to photographs of one material"),
        // The range of the grid is the same for all methods.
        ("--grid 256", "grid 256: must be a power of two from 4 to 128"),
        ("--light light.hdr --normals normals.npy --grid 256", "grid 256: must be a power of two from 4 to 128"),
        ("--method joint-map --grid 256", "grid 256: must be a power of two from 4 to 128"),
    ] {
        bench.refuses(&format!("infer ball.exr -o out {options}"), &[message]);
    }
}

#[test]
fn default_folder_is_beside_the_photograph() {
    let bench = Bench::with_ball();
    std::fs::create_dir(bench.path("photos")).unwrap();
    std::fs::rename(bench.path("ball.exr"), bench.path("photos/ball.exr")).unwrap();
    for _ in 0..2 {
        let run = bench.run("infer photos/ball.exr --grid 8").succeeds();
        assert!(run.stdout.starts_with("photos/ball-gonio: "), "{run:?}");
    }
    assert_eq!(bench.names("photos"), ["ball-gonio", "ball.exr"]);
    std::fs::remove_file(bench.path("photos/ball-gonio/result.json")).unwrap();
    bench.refuses("infer photos/ball.exr", &["photos/ball-gonio: exists and does not contain results", "-o DIR"]);
}

#[test]
fn reads_a_photograph_from_standard_input() {
    let bench = Bench::with_ball();
    bench.run_reading("infer - -o piped --grid 8", "ball.exr").succeeds();
    assert!(bench.read("piped/brdf.npz") == ANSWER.0["brdf.npz"], "the same bytes give another BRDF");
    assert_eq!(bench.json("piped/result.json")["image"], "standard input");
    bench.write("text", b"no picture");
    bench.write("empty", b"");
    for (line, file, message) in [
        ("infer - -o x", "text", "standard input: has an unknown image format"),
        ("infer - -o x", "empty", "standard input: is empty"),
        ("infer -", "ball.exr", "specify one with -o DIR"),
        ("infer - ball.exr -o x", "ball.exr", "pass exposures as files"),
        (
            "infer - -o x --response srgb",
            "ball.exr",
            "standard input: a response curve applies only to exposures in files",
        ),
    ] {
        bench.run_reading(line, file).fails(&[message]);
        assert!(!bench.path("x").exists());
    }
    bench.run_reading("light - -o probe.exr --rows 16", "ball.exr").succeeds();
}

#[test]
fn options_without_pictures_override_the_variables() {
    let bench = Bench::with_ball();
    let wanted = [("GONIO_NO_REPORT", "0"), ("GONIO_NO_PICTURES", "0")];
    let run = bench.run_with("infer ball.exr -o out --no-report --grid 8", &wanted).succeeds();
    assert!(run.stdout.contains("BRDF, light, pictures and result.json"), "{run:?}");
    assert!(bench.path("out/summary.png").exists() && !bench.path("out/report.html").exists());
    let run = bench.run_with("infer ball.exr -o out --no-pictures --grid 8", &wanted).succeeds();
    assert!(run.stdout.contains("BRDF, light and result.json"), "{run:?}");
    assert_eq!(bench.names("out"), ["brdf.npz", "light.exr", "posterior.json", "result.json"]);
    bench.run_with("infer ball.exr -o out", &[("GONIO_NO_REPORT", "perhaps")]).fails(&["perhaps", "1 or 0"]);
}

#[test]
fn errors_contain_a_hint() {
    let bench = Bench::with_light_and_material();
    bench.write("a.exr", &exr(&ball()));
    bench.write("b.exr", &exr(&ball()));
    std::fs::create_dir_all(bench.path("empty")).unwrap();
    for (line, message) in [
        ("a.exr", "gonio infer a.exr"),
        ("none.exr --json=x", "gonio infer none.exr"),
        ("infr", "'infer'"),
        ("infer a.exr b.exr -o x", "gonio batch IMAGE... -o DIR"),
        ("render --brdf empty --light light.hdr -o x.png", "empty: is a folder without brdf.npz"),
        ("export none", "none: file or folder not found; specify a result folder of gonio infer"),
    ] {
        bench.refuses(line, &[message]);
    }
}

#[test]
fn quiet_prints_only_errors() {
    let bench = Bench::with_light_and_material();
    bench.write("ball.exr", &exr(&ball()));
    let run = bench.run("infer ball.exr -o out --grid 8 --quiet").succeeds();
    assert_eq!((run.stdout.as_str(), run.stderr.as_str()), ("", ""));
    let run = bench.run("-q batch ball.exr -o many").succeeds();
    assert_eq!((run.stdout.as_str(), run.stderr.as_str()), ("", ""));
    assert!(bench.path("many/ball/result.json").exists());
    bench.run("infer none.exr -o x -q").fails(&["none.exr: cannot open"]);
    assert!(!bench.run("completions bash -q").succeeds().stdout.is_empty());
    bench.refuses("infer ball.exr -o x -q -v", &["--quiet", "--verbose"]);
}

#[test]
fn verbose_prints_the_seconds_of_each_stage() {
    let bench = Bench::with_light_and_material();
    bench.write("ball.exr", &exr(&ball()));
    let run = bench.run_with_pictures("infer ball.exr -o out --grid 8 --verbose").succeeds();
    let seconds = |stage: &str| -> f64 {
        let line = run.stderr.lines().find_map(|line| line.strip_prefix(&format!("{stage}: ")));
        line.unwrap_or_else(|| panic!("{stage}: {run:?}")).trim_end_matches(" s").parse().unwrap()
    };
    let noted = &bench.json("out/result.json")["seconds"];
    for stage in ["model", "reading", "drawing"] {
        assert!((seconds(stage) - noted[stage].as_f64().unwrap()).abs() < 0.2, "{stage}: {noted} {run:?}");
    }
    let run = bench.run("render --brdf in.binary --light studio -o a.png --size 16 -v").succeeds();
    assert!(run.stderr.starts_with("rendering: ") && run.stderr.lines().count() == 1, "{run:?}");
}

#[test]
fn rejects_invalid_numbers_of_threads() {
    let bench = Bench::with_ball();
    for wrong in ["0", "x", "-1", "100000"] {
        bench.refuses(&format!("infer ball.exr -o x --threads {wrong}"), &["--threads"]);
    }
}

#[test]
fn built_in_lights_have_names() {
    let bench = Bench::with_light_and_material();
    for light in ["studio", "sky", "lamp"] {
        bench.run(&format!("render --brdf in.binary --light {light} -o {light}.exr --size 16")).succeeds();
    }
    assert!(bench.read("studio.exr") != bench.read("sky.exr"));
    // A file with that name takes precedence over the built-in light.
    bench.write("sky", &encode_hdr(studio_light(256).radiance()));
    bench.run("render --brdf in.binary --light sky -o file.exr --size 16").succeeds();
    assert!(bench.read("file.exr") != bench.read("sky.exr"));
    bench.refuses("render --brdf in.binary --light moon -o x.exr --size 16", &["moon: cannot open"]);
}

#[test]
fn batch_accepts_photographs_without_a_table() {
    let bench = Bench::with_ball();
    for name in ["a.exr", "b.exr"] {
        bench.write(name, &exr(&ball()));
    }
    let run = bench.run("batch a.exr -o many").succeeds();
    assert!(run.stdout.contains("1 rows inferred"), "{run:?}");
    assert!(bench.run("batch a.exr b.exr -o many").succeeds().stdout.contains("1 rows inferred, 1 rows skipped"));
    assert_eq!(bench.names("many"), ["a", "b", "batch.csv", "rows"]);
    std::fs::create_dir(bench.path("c")).unwrap();
    bench.write("c/a.exr", &exr(&ball()));
    bench.refuses("batch a.exr c/a.exr -o x", &["c/a.exr: another photograph is also named a"]);
    bench.refuses("batch a.exr list.csv -o x", &["list.csv: the extension is not that of an image", "one table"]);
}
