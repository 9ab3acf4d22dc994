//! Tests of `gonio compare`, and of the page that `gonio batch` writes.

use std::fs::{self, File};

use gonio_io::result_brdf::{self, ResultBrdf};
use serde_json::{Value, json};

use crate::support::{ANSWER, Bench, WITH_PAGES, attributes};

/// Writes the result of the ball to a folder, and applies `change` to its `result.json`.
fn result(bench: &Bench, folder: &str, change: impl FnOnce(&mut Value)) {
    bench.write_answer(folder);
    let mut notes = ANSWER.json("result.json");
    change(&mut notes);
    bench.write(&format!("{folder}/result.json"), notes.to_string().as_bytes());
}

fn page(bench: &Bench, name: &str) -> String {
    String::from_utf8(bench.read(name)).unwrap()
}

/// Sets the interval of the peak far above that of the ball.
fn polished(notes: &mut Value) {
    notes["posterior"]["highlight"]["peak_height"] = json!({ "5": 1e6, "50": 2e6, "95": 3e6, "factor": 3 });
}

#[test]
fn compares_two_results() {
    let bench = Bench::new();
    result(&bench, "one", |_| ());
    result(&bench, "two", |_| ());
    bench.write("one/report.html", b"");
    let run = bench.run("compare one two").succeeds();
    assert!(run.stdout.starts_with("compare.html: compares 2 results\none and two agree within their"), "{run:?}");
    let page = page(&bench, "compare.html");
    for id in ["results", "intervals", "brdfs", "agreement"] {
        assert!(page.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
    // The page shows the photograph and the sphere of each result.
    let pictures = attributes(&page, "src");
    assert!(pictures.len() == 4 && pictures.iter().all(|source| source.starts_with("data:image/png;base64,")));
    assert!(page.contains("alt=\"The photograph of one\"") && page.contains("alt=\"A sphere of the material of two\""));
    let links: Vec<&str> = attributes(&page, "href").into_iter().filter(|link| !link.starts_with('#')).collect();
    assert_eq!(links, ["data:,", "./one/report.html"]);
    assert!(page.contains("default-src 'none'") && !page.contains("<script") && page.contains("url(data:font/ttf"));
    let notes = ANSWER.json("result.json");
    let nearest = notes["posterior"]["materials"][0]["name"].as_str().unwrap();
    let verdict = notes["posterior"]["highlight"]["verdict"].as_str().unwrap();
    assert_eq!((page.matches(nearest).count(), page.matches(verdict).count()), (2, 2));
    assert!(page.contains("Shown: one; two.") && page.matches(">0.00<").count() == 2);
    assert_eq!(page.matches("class=\"bar\"").count(), 4, "roughness and peak of each result");
}

#[test]
fn json_contains_the_agreement_of_pairs() {
    let bench = Bench::new();
    result(&bench, "one", |_| ());
    result(&bench, "two", polished);
    let table = crate::support::material(0.01, 0.05);
    let brdf = ResultBrdf { tables: [table.clone(), table.clone(), table], quantiles: None };
    bench.write("two/brdf.npz", &result_brdf::encode(&brdf));
    let run = bench.run("compare one two -o page.html --json").succeeds();
    let printed: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&printed["output"], &printed["results"]), (&json!("page.html"), &json!(2)));
    let pair = &printed["pairs"][0];
    assert_eq!((&pair["of"], &pair["agreement"]), (&json!(["one", "two"]), &json!("differ")));
    let distance = gonio::reflectance::log_distance(&bench.luminance("one"), &bench.luminance("two"));
    assert!((pair["distance"].as_f64().unwrap() - distance).abs() < 1e-9 && distance > 0.2, "{pair}");
    assert!(page(&bench, "page.html").contains("<p class=\"answer\">one and two differ"));
}

#[test]
fn escapes_names_and_notes() {
    let bench = Bench::new();
    let name = "<img,src=x>&\"'\u{202e}\u{1b}[31m";
    result(&bench, name, |notes| {
        notes["image"] = json!("</td><script>alert(1)</script>");
        notes["posterior"]["materials"][0]["name"] = json!("<svg onload=alert(2)>");
        notes["warnings"] = json!(["<b>\u{202e}"]);
    });
    result(&bench, "two", |_| ());
    let run = bench.run(&format!("compare two {name}")).succeeds();
    assert!(!run.stdout.contains(['\u{202e}', '\u{1b}']), "{run:?}");
    let page = page(&bench, "compare.html");
    for text in ["&lt;img,src=x&gt;&amp;&quot;'", "&lt;script&gt;alert(1)", "&lt;svg onload=alert(2)&gt;", "&lt;b&gt;"]
    {
        assert!(page.contains(text), "{text}");
    }
    for markup in ["<img,", "<script", "<svg onload", "<b>"] {
        assert!(!page.contains(markup), "{markup}");
    }
    assert!(!page.contains(['\u{202e}', '\u{1b}']));
}

#[test]
fn accepts_missing_files() {
    let bench = Bench::new();
    result(&bench, "whole", |_| ());
    result(&bench, "bare", |notes| {
        notes.as_object_mut().unwrap().retain(|name, _| ["format", "version", "posterior"].contains(&&**name));
    });
    result(&bench, "damaged", |notes| *notes = json!({ "format": "gonio-result" }));
    for file in ["brdf.npz", "relit.png", "summary.png"] {
        fs::remove_file(bench.path("bare").join(file)).unwrap();
        bench.write(&format!("damaged/{file}"), b"cut short");
    }
    let run = bench.run("compare whole bare damaged").succeeds();
    assert!(run.stdout.contains("whole and bare agree within their intervals"), "{run:?}");
    assert!(run.stdout.contains("Agreement of whole and damaged is unknown: damaged has no intervals"), "{run:?}");
    let page = page(&bench, "compare.html");
    assert_eq!(attributes(&page, "src").len(), 2);
    assert!(
        page.contains("bare: does not contain brdf.npz") && page.contains("damaged/brdf.npz: "),
        "the page reports the faults"
    );
    assert!(page.contains("damaged/relit.png: "));
    // Sparse files of 8 TiB.
    File::create(bench.path("bare/brdf.npz")).unwrap().set_len(1 << 43).unwrap();
    File::create(bench.path("bare/relit.png")).unwrap().set_len(1 << 43).unwrap();
    bench.run("compare whole bare").succeeds();
    File::create(bench.path("bare/result.json")).unwrap().set_len(1 << 43).unwrap();
    bench.refuses("compare whole bare", &["bare/result.json: is larger than"]);
}

#[test]
fn rejects_folders_without_results() {
    let bench = Bench::new();
    result(&bench, "one", |_| ());
    fs::create_dir(bench.path("empty")).unwrap();
    fs::create_dir_all(bench.path("batch/rows")).unwrap();
    result(&bench, "other", |notes| *notes = json!({ "format": "gonio-export" }));
    bench.write("file.exr", b"");
    let give = "specify result folders of gonio infer or gonio batch";
    bench.refuses("compare one empty", &["empty: does not contain result.json", give]);
    bench.refuses("compare one none", &["none: folder not found", give]);
    bench.refuses("compare one file.exr", &["file.exr: is not a folder", give]);
    bench.refuses("compare one other", &["other/result.json: is not a result of gonio infer"]);
    bench.refuses("compare one batch", &["batch: contains no results of gonio batch"]);
    bench.refuses("compare one", &["one: contains only one result"]);
    bench.refuses("compare", &["<DIR>"]);
    bench.refuses("compare one one -o page.txt", &["page.txt: the output must be an .html file"]);
    bench.write("one/result.json", b"{");
    bench.refuses("compare one one", &["one/result.json: is not valid JSON"]);
    // The existing page was not written by gonio.
    result(&bench, "one", |_| ());
    bench.write("compare.html", b"<!DOCTYPE html><title>mine</title>");
    bench.refuses("compare one one", &["compare.html: exists and was not written by gonio"]);
    bench.run("compare one one -o compare.html").succeeds();
    bench.run("compare one one").succeeds();
}

#[test]
fn batch_writes_and_updates_a_page_of_all_rows() {
    let bench = Bench::with_ball();
    bench.write("list.csv", b"name,image,grid\na b,ball.exr,8\nbad,none.exr,8\nc,ball.exr,4\n");
    assert_eq!(bench.run("batch list.csv -o out").code, Some(2));
    assert!(!bench.path("out/compare.html").exists(), "pages are disabled");
    bench.run_with("batch list.csv -o out --collect", &WITH_PAGES).succeeds();
    let first = page(&bench, "out/compare.html");
    assert!(first.contains("Comparison of 3 results") && first.contains("1 of 3 results are missing"));
    assert!(first.contains("No result: </strong>none.exr: ") && first.contains("a b and c "));
    // Once the image exists, only the failed row is inferred.
    fs::copy(bench.path("ball.exr"), bench.path("none.exr")).unwrap();
    bench.run_with("batch list.csv -o out", &WITH_PAGES).succeeds();
    let second = page(&bench, "out/compare.html");
    assert!(!second.contains("No result") && second.contains("Shown: a b; bad; c."));
    assert!(second.contains("href=\"./bad/report.html\""));
    // `gonio compare` accepts a batch together with another result.
    let run = bench.run("compare out out/c -o all.html --json").succeeds();
    let printed: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&printed["results"], &printed["pairs"][0]["of"]), (&json!(4), &json!(["out/a b", "out/bad"])));
    // A page that gonio did not write is kept.
    bench.write("out/compare.html", b"mine");
    let run = bench.run_with("batch list.csv -o out", &WITH_PAGES).succeeds();
    assert!(run.stderr.contains("out/compare.html: exists and was not written by gonio"), "{run:?}");
    assert_eq!(bench.read("out/compare.html"), b"mine");
    for name in ["compare.html", "batch.csv"] {
        bench.write("bad.csv", format!("name,image\n{name},ball.exr\n").as_bytes());
        bench.refuses("batch bad.csv -o x", &[&format!("\"{name}\" is not a valid folder name")]);
    }
}
