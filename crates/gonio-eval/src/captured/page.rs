//! Pictures of predictions beside the photographs that they predict.

use glam::Vec3;
use gonio::picture::{Plane, luminance};
use gonio_report::page::{Section, document, figure};
use maud::{Markup, html};

use super::errors::{self, Reflectance};
use super::object::Captured;
use super::study::EvaluatedEstimate;
use crate::paper::show;

/// All objects on one page.
pub(super) fn page(sections: &[Section]) -> String {
    let lead = html! {
        p {
            "The estimate of the default method from each photograph, shown in another light of the object: the photograph in that light, and predictions \
             from the normals and the known lights. All pictures show luminance; each prediction is scaled to fit the photograph."
        }
    };
    document("Photographs of real objects", &lead, sections)
}

/// Section of one object: for each photograph, the next photograph, in another light, and its
/// predictions.
pub(super) fn section(object: &Captured, estimates: &[EvaluatedEstimate]) -> Section {
    let cards: Vec<Markup> =
        estimates.iter().enumerate().map(|(photograph, estimate)| card(object, photograph, estimate)).collect();
    Section {
        id: format!("object-{}", anchor(&object.name)),
        title: object.name.clone(),
        body: figure::grid(40, &cards),
    }
}

/// Replaces everything but ASCII letters and digits by hyphens.
fn anchor(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}

fn card(object: &Captured, photograph: usize, estimate: &EvaluatedEstimate) -> Markup {
    let other = (photograph + 1) % object.photographs.len();
    let (from, to) = (&object.photographs[photograph], &object.photographs[other]);
    let grey = |rgb: &Plane<Vec3>| object.cropped(&rgb.map(|p| Vec3::splat(luminance(*p))));
    let truth = grey(&to.picture.rgb);
    let exposure = show::exposure(&truth);
    let input = grey(&from.picture.rgb);
    let mut tiles = vec![
        (
            format!("input: {}", from.name),
            figure::picture(
                &show::display(&input, show::exposure(&input)),
                &format!("{} under {}, the input photograph", object.name, from.name),
            ),
        ),
        (
            format!("photographed: {}", to.name),
            figure::picture(&show::display(&truth, exposure), &format!("{} under {}", object.name, to.name)),
        ),
    ];
    let estimates: [(&str, Reflectance<'_>); 3] = [
        ("estimate", &|h, d| estimate.material.table.eval(h, d)),
        ("Lambertian", &|_, _| 1.0),
        ("measured slice", &|h, d| object.slice.eval(h, d)),
    ];
    for (name, f) in estimates {
        let (sent, error) = errors::prediction(object, other, f);
        let picture = show::scaled(&grey(&sent.map(|p| p.as_vec3())), error.scale);
        let alt = format!("{} under {}, predicted by the {name}", object.name, to.name);
        let label = format!("{name}: {:.2}, log {:.2}", error.relative, error.log);
        tiles.push((label, figure::picture(&show::display(&picture, exposure), &alt)));
    }
    let tiles: Vec<(&str, Markup)> = tiles.iter().map(|(label, html)| (label.as_str(), html.clone())).collect();
    let record = &estimate.record;
    let caption = html! {
        "Slice error " (format!("{:.2}", record.estimate.slice)) ", Lambertian " (format!("{:.2}", record.lambert.slice)) "; misfit "
        (format!("{:.0} %", 100.0 * record.misfit)) "."
        @for warning in &record.warnings { " " (warning) "." }
    };
    figure::card(&format!("From {}", from.name), &figure::tiles(&tiles), &caption)
}
