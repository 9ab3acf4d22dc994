//! Sample page with all elements, for the browser test. It requires no data.

use glam::Vec3;
use gonio::picture::Plane;
use maud::html;

use super::chart::{self, Axis, Frame, Histogram, Series};
use super::{Section, document, figure, table};

fn sample() -> String {
    let ball = Plane::from_fn(96, 96, |x, y| {
        let (u, v) = ((x as f32 - 47.5) / 46.0, (y as f32 - 47.5) / 46.0);
        let z = (1.0 - u * u - v * v).max(0.0).sqrt();
        Vec3::new(0.8, 0.5, 0.3) * z
    });
    let curve = |f: fn(f64) -> f64| (0..=60).map(|i| (f64::from(i) / 20.0, f(f64::from(i) / 20.0))).collect();
    let quantiles: Vec<f64> = (0..500).map(|i| -((f64::from(i) + 0.5) / 500.0).ln()).collect();
    let density = Series::line("exponential", curve(|x| (-x).exp()));
    let rows =
        vec![vec!["first".into(), "1.00".into(), "2.00".into()], vec!["second".into(), "3.00".into(), "4.00".into()]];
    let tile = |label: &'static str| (label, figure::picture(&ball, "A shaded ball"));
    let charts = [
        chart::histogram(
            "Histogram",
            "x",
            &Histogram::new(&quantiles, 0.0, 6.0, 24),
            std::slice::from_ref(&density),
            Axis::Log,
        ),
        chart::lines(
            "Lines",
            ("x", Axis::Linear),
            ("y", Axis::Linear),
            &[density.clone(), Series::dashed("other", curve(|x| 0.2 + x))],
        ),
        chart::scatter(
            &Frame { title: "Scatter", x: ("x", Axis::Log), y: ("y", Axis::Log), y_range: None },
            &[Series::dots("a", vec![(0.1, 0.2), (3.0, 2.0)]), Series::dots("b", vec![(0.5, 0.4)])],
            true,
        ),
        chart::ecdf("Distribution", "x", Axis::Log, &[("a", quantiles.clone()), ("b", vec![0.5, 1.0, 2.0])]),
    ];
    let wide: Vec<&str> = ["row"].into_iter().chain(["a rather long heading"; 12]).collect();
    let sections = [
        Section {
            id: "pictures".into(),
            title: "Pictures".into(),
            body: html! {
                (figure::figure(&figure::tiles(&[tile("one"), tile("two"), tile("three")]), &html! { "Three balls." }))
                (figure::figure(&figure::cells(&ball, "A ball in squares", 4), &html! { "One ball." }))
                (figure::grid(18, &vec![figure::card("A card", &figure::tiles(&[tile("input"), tile("output")]), &html! { "Error 0.1." }); 5]))
            },
        },
        Section {
            id: "charts".into(),
            title: "Charts".into(),
            body: figure::grid(
                22,
                &charts.map(|c| figure::figure(&c, &html! { "A caption with " strong { "weight" } "." })),
            ),
        },
        Section {
            id: "tables".into(),
            title: "Tables".into(),
            body: html! {
                (table::table("A small table", &["name", "a", "b"], &rows))
                (table::table("A table wider than a phone", &wide, &[vec!["0.123".into(); 13]]))
            },
        },
    ];
    document("Sample report", &html! { p { "One of everything." } }, &sections)
}

/// Writes the page to the file `GONIO_SAMPLE_PAGE`, if set, for the test in `tests/browser`.
#[test]
fn sample_page_contains_all_elements() {
    let page = sample();
    assert_eq!(page.matches("<img").count(), 14);
    assert_eq!(page.matches("role=\"img\"").count(), 4);
    assert!(page.matches(" alt=\"").count() == 14 && !page.contains("alt=\"\""));
    if let Some(path) = std::env::var_os("GONIO_SAMPLE_PAGE") {
        gonio_io::atomic::write_file(&path, page.as_bytes()).unwrap();
    }
}
