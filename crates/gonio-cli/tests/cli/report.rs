//! Tests of the report of `gonio infer`.

use std::sync::LazyLock;

use gonio::lighting::studio_light;
use gonio_io::picture::{ReadOptions, encode_hdr, read};
use serde_json::Value;

use crate::support::{Bench, WITH_PAGES, attributes, ball, exr, has_controls};

/// Returns the data of the interactive sphere.
fn sphere(page: &str) -> Value {
    let from = page.split("id=\"sphere-data\"").nth(1).unwrap();
    let text = from.split_once('>').unwrap().1.split("</script>").next().unwrap();
    serde_json::from_str(text).unwrap()
}

/// Whether the page contains the word NaN; encoded pictures can contain the same letters.
fn says_nan(page: &str) -> bool {
    let within = |c: Option<char>| c.is_some_and(|c| c.is_ascii_alphanumeric() || c == '+' || c == '/');
    page.match_indices("NaN").any(|(at, word)| {
        let (before, after) = (&page[..at], &page[at + word.len()..]);
        !within(before.chars().next_back()) && !within(after.chars().next())
    })
}

fn names(list: &Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|entry| entry["name"].as_str().unwrap()).collect()
}

/// File name with markup and terminal control characters.
const NAME: &str = "<img src=x onerror=alert(1)>\u{1b}[31m\u{202e}&\"'.exr";

/// Results of the ball.
struct Page {
    report: String,
    result: Value,
    /// Standard output and standard error of the program.
    printed: String,
}

static PAGE: LazyLock<Page> = LazyLock::new(|| {
    let bench = Bench::new();
    bench.write(NAME, &exr(&ball()));
    let output = bench.command("infer --grid 8").envs(WITH_PAGES).arg(NAME).output().unwrap();
    let [stdout, stderr] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    let printed = stdout + &stderr;
    assert!(output.status.success(), "{printed}");
    // The default folder is beside the photograph.
    let folder = format!("{}-gonio", NAME.trim_end_matches(".exr"));
    let report = String::from_utf8(bench.read(&format!("{folder}/report.html"))).unwrap();
    Page { report, result: bench.json(&format!("{folder}/result.json")), printed }
});

#[test]
fn messages_and_the_report_escape_malicious_names() {
    let Page { report, printed, .. } = &*PAGE;
    assert!(printed.contains("<img src=x") && !has_controls(printed), "{printed:?}");
    assert!(report.contains("Material of &lt;img src=x onerror=alert(1)&gt;") && !report.contains("<img src=x"));
    assert!(report.contains("&amp;&quot;'"), "the page does not escape & and \"");
    assert!(!report.contains('\u{1b}'), "the page contains an escape code");
}

#[test]
fn the_report_is_self_contained() {
    let page = &PAGE.report;
    assert!((500_000..4_000_000).contains(&page.len()), "{} bytes", page.len());
    for source in attributes(page, "src") {
        assert!(source.starts_with("data:image/png;base64,"), "{source:.80}");
    }
    for link in attributes(page, "href") {
        let within = link == "data:," || link.starts_with("data:image/png;base64,");
        assert!(link.starts_with('#') || within, "{link:.80}");
    }
    assert!(page.contains("default-src 'none'") && !page.contains("@import"));
}

#[test]
fn the_report_has_all_sections_and_alt_texts() {
    let page = &PAGE.report;
    // The pictures of maps are in SVG elements, which use `href` instead of `src`.
    let maps = attributes(page, "href").into_iter().filter(|link| link.starts_with("data:image")).count();
    assert!(maps == 2 && attributes(page, "src").len() + maps >= 13);
    assert!(attributes(page, "alt").iter().all(|words| words.len() > 10));
    for id in ["found", "photograph", "reflectance", "trust", "renderers", "making"] {
        assert!(page.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
    for word in ["principled", "BSDF_PRINCIPLED", "open_pbr_surface", "pbrMetallicRoughness"] {
        assert!(page.contains(word), "{word}");
    }
}

#[test]
fn the_report_contains_materials_and_warnings() {
    let Page { report: page, result, .. } = &*PAGE;
    let data = sphere(page);
    assert_eq!(names(&data["materials"]).len(), 3);
    assert_eq!(names(&data["lights"]), ["studio", "clear sky", "lamps at night", "estimated light"]);
    for material in result["posterior"]["materials"].as_array().unwrap().iter().take(4) {
        assert!(page.contains(material["name"].as_str().unwrap()));
    }
    for warning in result["warnings"].as_array().unwrap() {
        let escaped = warning
            .as_str()
            .unwrap()
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('>', "&gt;")
            .replace('"', "&quot;");
        assert!(page.contains(&escaped), "{escaped}");
    }
}

#[test]
fn the_result_of_a_known_light_keeps_the_light_and_omits_the_uncertainty() {
    let bench = Bench::with_ball();
    bench.write("light.hdr", &encode_hdr(studio_light(32).radiance()));
    let line = "infer ball.exr -o out --starts 1 --normals normals.npy --method known-light-basis --light light.hdr";
    bench.run_with(line, &WITH_PAGES).succeeds();
    let files = ["brdf.npz", "light.exr", "relit.png", "report.html", "result.json", "summary.png"];
    assert_eq!(bench.names("out"), files);
    let light = |name: &str| read(bench.path(name), &ReadOptions::default()).unwrap().picture.rgb;
    assert_eq!(light("out/light.exr"), light("light.hdr"));
    assert_eq!(bench.json("out/result.json")["light"]["coefficients"], serde_json::json!([1.0]));
    let page = String::from_utf8(bench.read("out/report.html")).unwrap();
    assert!(!page.contains("id=\"trust\"") && page.contains("id=\"renderers\""));
    assert_eq!(names(&sphere(&page)["materials"]), ["estimate"]);
    assert_eq!(names(&sphere(&page)["lights"])[3], "known light");
    assert!(!says_nan(&page));
}
