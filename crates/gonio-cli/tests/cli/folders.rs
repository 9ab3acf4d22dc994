//! Tests of result folders: gonio replaces earlier results, keeps all other files, and removes
//! unfinished output.

use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::support::{Bench, SIZE, ball, exr, grey, mask};

#[test]
fn new_results_replace_earlier_results() {
    let bench = Bench::with_ball();
    bench.write_answer("out");
    bench.write("out/report.html", b"old");
    bench.run("export out --to ward,gltf").succeeds();
    bench.write("out/notes.txt", b"mine");
    bench.write("out/export/scene.blend", b"mine");
    let before = bench.names("out");
    for name in ["report.html", "brdf.npz", "posterior.json", "uncertainty.png"] {
        assert!(before.iter().any(|n| n == name), "{name} in {before:?}");
    }
    // The paper's method estimates neither quantiles nor a posterior of materials.
    bench
        .run_with_pictures("infer ball.exr -o out --grid 4 --method variational --starts 1 --all-observations")
        .succeeds();
    let after = ["brdf.npz", "export", "light.exr", "notes.txt", "relit.png", "result.json", "summary.png"];
    assert_eq!(bench.names("out"), after);
    assert_eq!(bench.names("out/export"), ["scene.blend"]);
    assert_eq!(bench.json("out/result.json")["method"], "variational");
}

#[test]
fn a_failure_keeps_earlier_results() {
    let bench = Bench::new();
    bench.write_answer("out");
    bench.write("black.exr", &grey(0.0, SIZE, SIZE));
    bench.refuses("infer black.exr -o out", &["black.exr"]);
}

#[test]
fn new_results_replace_folders_of_regions() {
    let bench = Bench::with_ball();
    bench.write("circles.exr", &exr(&ball()));
    bench.run_with_pictures("infer circles.exr -o out --grid 8 --circle 14,24,9 --circle 34,24,9").succeeds();
    assert_eq!(bench.names("out"), ["1", "2", "materials.png", "result.json"]);
    bench.write("out/2/notes.txt", b"mine");
    bench.run("infer ball.exr -o out --grid 8").succeeds();
    let names = bench.names("out");
    assert!(names.iter().any(|n| n == "brdf.npz"), "{names:?}");
    assert!(!names.iter().any(|n| n == "1" || n == "materials.png"), "{names:?}");
    assert_eq!(bench.names("out/2"), ["notes.txt"]);
}

#[test]
fn new_exports_replace_earlier_exports() {
    let bench = Bench::with_light_and_material();
    bench.run("export in.binary -o out --to ward,mitsuba").succeeds();
    bench.write("out/notes.txt", b"mine");
    bench.run("export in.binary -o out --to gltf").succeeds();
    let files = &bench.json("out/export.json")["exports"]["gltf"]["files"];
    let mut expected: Vec<String> = files.as_array().unwrap().iter().map(|f| f.as_str().unwrap().to_owned()).collect();
    expected.extend(["export.json".to_owned(), "notes.txt".to_owned()]);
    expected.sort();
    assert_eq!(bench.names("out"), expected);
}

#[test]
fn results_do_not_overwrite_their_inputs() {
    let bench = Bench::with_ball();
    bench.write("light.exr", &exr(&ball()));
    bench.write("used.png", &mask(SIZE));
    for (options, file) in [
        ("light.exr", "light.exr"),
        ("ball.exr --light light.exr", "light.exr"),
        ("ball.exr --mask used.png", "used.png"),
    ] {
        bench.refuses(&format!("infer {options} -o ."), &[&format!("{file}: results in . would overwrite this input")]);
    }
    bench.write_answer("out");
    let light = bench.read("out/light.exr");
    bench.refuses("export out -o out", &["out: contains results of gonio infer", "-o DIR"]);
    assert_eq!(bench.read("out/light.exr"), light);
}

/// Starts a long inference, and waits until its hidden folder exists in `dir`.
fn started(bench: &Bench, line: &str, dir: &str) -> Child {
    let mut child = bench.command(line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while hidden(bench, dir).is_empty() {
        assert!(start.elapsed() < Duration::from_secs(60), "no hidden folder was created");
        assert!(child.try_wait().unwrap().is_none(), "the program ended before the signal");
        sleep(Duration::from_millis(5));
    }
    child
}

fn hidden(bench: &Bench, dir: &str) -> Vec<String> {
    if !bench.path(dir).is_dir() {
        return Vec::new();
    }
    bench.names(dir).into_iter().filter(|name| name.starts_with(".gonio-")).collect()
}

/// Sends a signal, and returns the signal that ended the program.
#[cfg(unix)]
fn told(child: &mut Child, signal: &str) -> Option<i32> {
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    std::os::unix::process::ExitStatusExt::signal(&child.wait().unwrap())
}

/// A long inference on one thread, which leaves the other processors to other tests.
const LONG: &str = "infer ball.exr --method variational --solver printed --starts 1000 --grid 32 --threads 1 -o";

#[cfg(unix)]
#[test]
fn signals_remove_unfinished_output() {
    let bench = Bench::with_ball();
    let before = bench.tree();
    for (signal, number) in [("-INT", 2), ("-TERM", 15)] {
        for (output, dir) in [("out", "."), ("deep/er/out", "deep/er")] {
            let mut child = started(&bench, &format!("{LONG} {output}"), dir);
            assert_eq!(told(&mut child, signal), Some(number));
            assert_eq!(bench.tree(), before, "{signal} {output}");
        }
    }
}

#[cfg(unix)]
#[test]
fn the_next_run_removes_output_of_a_killed_run() {
    let bench = Bench::with_ball();
    let mut child = started(&bench, &format!("{LONG} out"), ".");
    // A concurrent run keeps a hidden folder that is in use.
    bench.write_answer("done");
    bench.run("export done -o other --to ward --draws 0").succeeds();
    assert_eq!(hidden(&bench, ".").len(), 1);
    assert_eq!(told(&mut child, "-KILL"), Some(9));
    assert_eq!(hidden(&bench, ".").len(), 1);
    bench.run("infer ball.exr -o out --grid 8").succeeds();
    assert_eq!(hidden(&bench, "."), Vec::<String>::new());
}
