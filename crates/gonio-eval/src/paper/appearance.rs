//! Fig. 4: input, appearance predicted in a novel light, ground truth.

use maud::{Markup, html};

use super::context::{LIGHTS, Material, NOVEL, PaperContext};
use super::recovery::{Estimate, Recovered};
use super::show;
use crate::metrics;
use gonio_report::page::{figure, table};

pub(super) fn section(context: &PaperContext, recovered: &[Recovered]) -> Markup {
    let pairs = || context.materials.iter().zip(recovered);
    let mut rows: Vec<Vec<String>> = pairs()
        .flat_map(|(material, r)| {
            r.estimates.iter().zip(LIGHTS).map(move |(e, (_, light))| row(&format!("{}, {light}", material.name), e))
        })
        .collect();
    let medians: Vec<[f64; 3]> = (0..LIGHTS.len())
        .map(|i| {
            let of =
                |f: &dyn Fn(&Estimate) -> f64| metrics::median(recovered.iter().map(|r| f(&r.estimates[i])).collect());
            [of(&|e| e.relight.relative), of(&|e| e.relight.log), of(&|e| e.brdf)]
        })
        .collect();
    for (median, (_, light)) in medians.iter().zip(LIGHTS) {
        let mut row = vec![format!("median, {light}")];
        row.extend(median.iter().map(|m| format!("{m:.2}")));
        row.push(String::new());
        rows.push(row);
    }
    html! {
        p {
            "Each BRDF is inferred from a single picture of a sphere under " (LIGHTS[0].1) " or " (LIGHTS[1].1) ", without the light as input, "
            "and shown under " (NOVEL.1) ". The inferred BRDF is monochrome; it is shown in the RGB "
            "colour that fits the picture of the truth best, as in the paper."
        }
        @for (i, (_, light)) in LIGHTS.iter().enumerate() {
            h3 { "From " (light) }
            (figure::grid(19, &pairs().map(|(m, r)| card(m, r, i)).collect::<Vec<_>>()))
        }
        p { (verdict(context, recovered)) }
        (table::table(
            &format!("Errors of the predictions under {}, and of the BRDF", NOVEL.1),
            &["input", "relight", "log relight", "BRDF log", "beyond the grid"],
            &rows,
        ))
        p.note {
            "Relight: root mean square difference to the truth over that of the truth, after the best scale, within 80 degrees. Log relight: "
            "root mean square of the logarithm of the ratio, with 1 % of the mean added to both. BRDF log: the same over the cells of the MERL grid "
            "below 80 degrees, with a thousandth of the diffuse level added. Beyond the grid: share of the input's energy that no 32 x 32 "
            "light can produce with any material of the basis; if it is large, the estimate of a sharp material is too dull."
        }
    }
}

fn row(name: &str, e: &Estimate) -> Vec<String> {
    vec![
        name.to_owned(),
        format!("{:.2}", e.relight.relative),
        format!("{:.2}", e.relight.log),
        format!("{:.2}", e.brdf),
        format!("{:.2} %", 100.0 * e.left_over),
    ]
}

fn card(material: &Material, recovered: &Recovered, light: usize) -> Markup {
    let e = &recovered.estimates[light];
    let name = material.name;
    let exposure = show::exposure(&recovered.truth);
    let tiles = figure::tiles(&[
        (
            "input",
            figure::picture(
                &show::display(&e.input, show::exposure(&e.input)),
                &format!("Sphere of {name} under {}, the input", LIGHTS[light].1),
            ),
        ),
        (
            "predicted",
            figure::picture(&show::display(&e.predicted, exposure), &format!("{name} as predicted under {}", NOVEL.1)),
        ),
        (
            "truth",
            figure::picture(&show::display(&recovered.truth, exposure), &format!("{name} rendered under {}", NOVEL.1)),
        ),
    ]);
    let numbers = html! {
        "relight " (format!("{:.2}", e.relight.relative)) ", log " (format!("{:.2}", e.relight.log)) ", BRDF log "
        (format!("{:.2}", e.brdf))
    };
    figure::card(name, &tiles, &numbers)
}

/// Returns a sentence that summarises the errors.
fn verdict(context: &PaperContext, recovered: &[Recovered]) -> String {
    let mut cells: Vec<(f64, String)> = context
        .materials
        .iter()
        .zip(recovered)
        .flat_map(|(m, r)| {
            r.estimates.iter().zip(LIGHTS).map(|(e, (_, l))| (e.relight.relative, format!("{} from {l}", m.name)))
        })
        .collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (Some(best), Some(worst)) = (cells.first(), cells.last()) else { return String::new() };
    let median = metrics::median(cells.iter().map(|c| c.0).collect());
    format!(
        "The relight error is {median:.2} in the median of {} predictions, from {:.2} ({}) to {:.2} ({}).",
        cells.len(),
        best.0,
        best.1,
        worst.0,
        worst.1
    )
}
