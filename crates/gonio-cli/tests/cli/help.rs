//! Tests of completions, manual pages, JSON output and the version.

use std::process::Command;

use crate::support::Bench;

#[test]
fn prints_completions_of_each_shell() {
    let bench = Bench::new();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = bench.run(&format!("completions {shell}")).succeeds().stdout;
        assert!(script.contains("gonio") && script.contains("infer"), "{shell}");
        if shell == "bash" {
            bench.write("gonio.bash", script.as_bytes());
            let asked =
                "source gonio.bash; COMP_WORDS=(gonio inf); COMP_CWORD=1; _gonio gonio inf gonio; echo ${COMPREPLY[@]}";
            let out = Command::new("bash").args(["-c", asked]).current_dir(bench.path("")).output().unwrap();
            assert_eq!(String::from_utf8(out.stdout).unwrap().trim(), "infer", "{:?}", String::from_utf8(out.stderr));
        }
    }
    bench.refuses("completions tcsh", &["tcsh"]);
}

#[test]
fn every_command_has_a_manual_page() {
    let bench = Bench::new();
    bench.run("man -o pages").succeeds();
    let names = bench.names("pages");
    for page in ["gonio.1", "gonio-infer.1", "gonio-batch.1", "gonio-train-lighting.1"] {
        assert!(names.iter().any(|n| n == page), "{page} in {names:?}");
    }
    let page = String::from_utf8(bench.read("pages/gonio-infer.1")).unwrap();
    assert!(page.starts_with(".ie") && page.contains("\\-\\-mask"), "{page}");
}

#[test]
fn json_output_is_one_object() {
    let bench = Bench::with_ball();
    let object = |line: &str, code: i32| -> serde_json::Value {
        let run = bench.run(line);
        assert_eq!((run.code, run.stderr.as_str()), (Some(code), ""), "{line}");
        serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{line}: {e}: {}", run.stdout))
    };
    let found = object("infer ball.exr -o out --grid 8 --json", 0);
    assert_eq!((found["output"].as_str(), found["method"].as_str()), (Some("out"), Some("learnt")));
    assert!(found["posterior"]["materials"][0]["weight"].as_f64().unwrap() > 0.0);
    assert!(found["warnings"].is_array());
    let exported = object("export out --to ward --json", 0);
    assert!(exported["exports"]["ward"]["relight"].is_number());
    assert_eq!(exported["exports"]["ward"]["intervals"]["diffuse"].as_array().map(Vec::len), Some(3));
    assert_eq!(object("convert out/brdf.npz x.bsdf --json", 0)["output"], "x.bsdf");
    assert_eq!(object("infer none.exr -o x --json", 2)["error"].as_str().unwrap().split(':').next(), Some("none.exr"));
    assert!(object("--json render --nonsense", 2)["error"].as_str().unwrap().contains("--nonsense"));
    assert!(object("completions bash --json", 0)["script"].is_string());
}

#[test]
fn version_separates_the_licences_of_code_and_model() {
    let bench = Bench::new();
    let short = format!("gonio {}\n", env!("CARGO_PKG_VERSION"));
    assert_eq!(bench.run("-V").succeeds().stdout, short);
    let long = bench.run("--version").succeeds().stdout;
    assert!(long.starts_with(&short), "{long}");
    let (code, model) = long.split_once("Model: gonio-1.model").unwrap();
    assert!(code.contains("Code: MIT OR Apache-2.0"), "{long}");
    assert_eq!(code.contains("rawler, LGPL-2.1"), cfg!(feature = "raw"), "{long}");
    assert!(model.contains(gonio_io::model::EMBEDDED_SOURCES) && model.contains("docs/licences.md"), "{long}");
    for terms in ["CC0", "CC BY-NC-SA 3.0 US", "CC BY-SA 4.0", "unknown"] {
        assert!(model.contains(terms) && !code.contains(terms), "{terms} in {long}");
    }
    assert!(long.lines().all(|line| line.len() <= 100), "{long}");
}
