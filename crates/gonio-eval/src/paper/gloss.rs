//! The paper's remark on Fig. 6: the inferred BRDFs rank materials by gloss.

use maud::{Markup, html};

use super::context::{LIGHTS, PaperContext};
use super::recovery::Recovered;
use crate::metrics::{Gloss, spearman};
use gonio_report::page::chart::{self, Axis, Frame, Series};
use gonio_report::page::{figure, table};

pub(super) fn section(context: &PaperContext, recovered: &[Recovered]) -> Markup {
    let truth: Vec<Gloss> = context.materials.iter().map(|m| Gloss::of(&m.truth)).collect();
    let found: Vec<Vec<Gloss>> =
        (0..LIGHTS.len()).map(|i| recovered.iter().map(|r| Gloss::of(&r.estimates[i].table)).collect()).collect();
    let order = |of: &dyn Fn(&Gloss) -> f64| -> Vec<f64> {
        let values = |list: &[Gloss]| list.iter().map(of).collect::<Vec<f64>>();
        found.iter().map(|f| spearman(&values(f), &values(&truth))).collect()
    };
    let (peak, contrast, width) = (order(&|g| g.peak), order(&|g| g.contrast), order(&|g| g.width));
    let panel = |title: &str, unit: &str, axis: Axis, of: &dyn Fn(&Gloss) -> f64| {
        let series: Vec<Series> = found
            .iter()
            .zip(LIGHTS)
            .map(|(f, (_, light))| {
                Series::dots(format!("from {light}"), truth.iter().zip(f).map(|(t, e)| (of(t), of(e))).collect())
            })
            .collect();
        let (x, y) = (format!("truth ({unit})"), format!("estimate ({unit})"));
        let frame = Frame { title, x: (&x, axis), y: (&y, axis), y_range: None };
        figure::figure(&chart::scatter(&frame, &series, true), &html! { "One dot per material and light." })
    };
    let list = |values: &[f64]| {
        let each: Vec<String> =
            values.iter().zip(LIGHTS).map(|(v, (_, light))| format!("{v:.2} from {light}")).collect();
        each.join(", ")
    };
    let rows: Vec<Vec<String>> = context
        .materials
        .iter()
        .enumerate()
        .map(|(i, m)| {
            let all = || std::iter::once(&truth).chain(&found).map(|g| g[i]);
            let mut row = vec![m.name.to_owned()];
            row.extend(all().map(|g| format!("{:.1}", g.contrast)));
            row.extend(all().map(|g| format!("{:.1}", g.width.to_degrees())));
            row
        })
        .collect();
    let columns: Vec<String> = ["contrast", "width"]
        .iter()
        .flat_map(|q| std::iter::once("truth").chain(LIGHTS.map(|(_, l)| l)).map(move |of| format!("{q}, {of}")))
        .collect();
    let columns: Vec<&str> = std::iter::once("material").chain(columns.iter().map(String::as_str)).collect();
    let pairs = || found.iter().flat_map(|f| f.iter().zip(&truth));
    let duller = pairs().filter(|(e, t)| e.contrast < t.contrast).count();
    html! {
        p {
            "Rank correlation (Spearman) with the truth over " (truth.len()) " materials. By the peak of the highlight over the mean: "
            strong { (list(&peak)) } ". By its contrast with the diffuse level: " (list(&contrast)) ". By its width: " (list(&width)) ". One is the true order, zero no relation. "
            "The contrast is smaller than the true contrast in " (duller) " out of " (pairs().count()) " estimates."
        }
        (figure::grid(22, &[
            panel("Contrast of the highlight", "log of peak over diffuse level", Axis::Linear, &|g| g.contrast),
            panel("Half width of the highlight", "degrees", Axis::Log, &|g| g.width.to_degrees()),
        ]))
        (table::table("Contrast (natural logarithm of the peak over the diffuse level) and half width (degrees)", &columns, &rows))
    }
}
