//! Tests of the report of `gonio infer`.

use std::fs;
use std::sync::LazyLock;

use gonio::lighting::studio_light;
use gonio_io::picture::encode_hdr;
use serde_json::Value;

use crate::support::{Bench, WITH_PAGES};

/// Returns all values of an attribute.
fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    let start = format!(" {name}=\"");
    page.split(&start).skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

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

/// The report of the ball, and its `result.json`.
static PAGE: LazyLock<(String, Value)> = LazyLock::new(|| {
    let bench = Bench::with_ball();
    // This name would end a text or an attribute if it were not escaped.
    let name = "<b>&\"x.exr";
    fs::rename(bench.path("ball.exr"), bench.path(name)).unwrap();
    bench.run_with(&format!("infer {name} -o out --grid 8"), &WITH_PAGES).succeeds();
    (String::from_utf8(bench.read("out/report.html")).unwrap(), bench.json("out/result.json"))
});

#[test]
fn the_report_is_self_contained() {
    let page = &PAGE.0;
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
    let page = &PAGE.0;
    // The pictures of maps are in SVG elements, which use `href` instead of `src`.
    let maps = attributes(page, "href").into_iter().filter(|link| link.starts_with("data:image")).count();
    assert!(maps == 2 && attributes(page, "src").len() + maps >= 13);
    assert!(attributes(page, "alt").iter().all(|words| words.len() > 10));
    for id in ["found", "photograph", "reflectance", "trust", "renderers", "making"] {
        assert!(page.contains(&format!("<section id=\"{id}\">")), "{id}");
    }
    assert!(page.contains("Material of &lt;b&gt;&amp;&quot;x") && !page.contains("<b>"));
    for word in ["principled", "BSDF_PRINCIPLED", "open_pbr_surface", "pbrMetallicRoughness"] {
        assert!(page.contains(word), "{word}");
    }
}

#[test]
fn the_report_contains_materials_and_warnings() {
    let (page, result) = &*PAGE;
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
fn the_report_of_a_known_light_omits_the_uncertainty() {
    let bench = Bench::with_ball();
    bench.write("light.hdr", &encode_hdr(studio_light(32).radiance()));
    let line = "infer ball.exr -o out --starts 1 --normals normals.npy --method known-light-basis --light light.hdr";
    bench.run_with(line, &WITH_PAGES).succeeds();
    let page = String::from_utf8(bench.read("out/report.html")).unwrap();
    assert!(!page.contains("id=\"trust\"") && page.contains("id=\"renderers\""));
    assert_eq!(names(&sphere(&page)["materials"]), ["estimate"]);
    assert_eq!(names(&sphere(&page)["lights"])[3], "known light");
    assert!(!says_nan(&page));
}
