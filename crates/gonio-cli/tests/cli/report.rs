//! The page that `gonio infer` writes.

use std::fs;
use std::sync::LazyLock;

use gonio::lighting::studio_light;
use gonio_io::picture::encode_hdr;
use serde_json::Value;

use crate::support::Bench;

/// Runs that write the page; others leave it out for speed.
const WITH_REPORT: [(&str, &str); 1] = [("GONIO_NO_REPORT", "false")];

/// Every quoted value of an attribute.
fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    let start = format!(" {name}=\"");
    page.split(&start).skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

/// The data of the sphere to turn.
fn sphere(page: &str) -> Value {
    let from = page.split("id=\"sphere-data\"").nth(1).unwrap();
    let text = from.split_once('>').unwrap().1.split("</script>").next().unwrap();
    serde_json::from_str(text).unwrap()
}

/// Whether NaN stands in the page as a word; encoded pictures may hold the same letters.
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

/// The page of the ball, and the result that it shows.
static PAGE: LazyLock<(String, Value)> = LazyLock::new(|| {
    let bench = Bench::with_ball();
    // A name that would break out of text or attributes.
    let name = "<b>&\"x.exr";
    fs::rename(bench.path("ball.exr"), bench.path(name)).unwrap();
    bench.run_with(&format!("infer {name} -o out --grid 8"), &WITH_REPORT).succeeds();
    (String::from_utf8(bench.read("out/report.html")).unwrap(), bench.json("out/result.json"))
});

#[test]
fn a_result_comes_with_a_page_that_needs_nothing_else() {
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
fn the_page_has_its_sections_and_says_what_each_picture_shows() {
    let page = &PAGE.0;
    // Those of the maps lie in drawings, which call the address of a picture otherwise.
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
fn what_the_result_says_the_page_says() {
    let (page, result) = &*PAGE;
    let data = sphere(page);
    assert_eq!(names(&data["materials"]).len(), 3);
    assert_eq!(names(&data["lights"]), ["studio", "clear sky", "lamps at night", "estimated light"]);
    for material in result["posterior"]["materials"].as_array().unwrap() {
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
fn the_page_of_a_known_light_says_nothing_of_what_it_does_not_know() {
    let bench = Bench::with_ball();
    bench.write("light.hdr", &encode_hdr(studio_light(32).radiance()));
    let line = "infer ball.exr -o out --starts 1 --normals normals.npy --method known-light-basis --light light.hdr";
    bench.run_with(line, &WITH_REPORT).succeeds();
    let page = String::from_utf8(bench.read("out/report.html")).unwrap();
    assert!(!page.contains("id=\"trust\"") && page.contains("id=\"renderers\""));
    assert_eq!(names(&sphere(&page)["materials"]), ["estimate"]);
    assert_eq!(names(&sphere(&page)["lights"])[3], "known light");
    assert!(!says_nan(&page));
}
