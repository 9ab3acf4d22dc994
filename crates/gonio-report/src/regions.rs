//! Picture and HTML page of several regions of a photograph.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::render::Exposure;
use maud::html;

use crate::page::figure::picture as embedded;
use crate::page::{Section, document};
use crate::panels::{PANEL, resize};

/// Colours of regions, which most viewers can distinguish.
const COLOURS: [Vec3; 8] = [
    Vec3::new(0.90, 0.36, 0.02),
    Vec3::new(0.02, 0.36, 0.80),
    Vec3::new(0.10, 0.62, 0.20),
    Vec3::new(0.75, 0.10, 0.55),
    Vec3::new(0.85, 0.75, 0.05),
    Vec3::new(0.05, 0.65, 0.70),
    Vec3::new(0.55, 0.30, 0.12),
    Vec3::new(0.55, 0.55, 0.60),
];

/// Width of the outline of a region, relative to the height of the photograph.
const OUTLINE: f64 = 0.012;

/// Draws the photograph with the outlines of the regions at the height of a panel. Also returns the
/// colour of each outline.
pub fn outlined(photograph: &Picture, masks: &[&Plane<f32>]) -> (Plane<Vec3>, Vec<Vec3>) {
    let colours: Vec<Vec3> = (0..masks.len()).map(|at| COLOURS[at % COLOURS.len()]).collect();
    let (width, height) = photograph.rgb.size();
    let of = |at: usize| masks.iter().position(|mask| mask.as_slice()[at] > 0.5);
    let exposure = Exposure::by_quantile(&photograph.rgb, |at| of(at).is_some(), 0.9, 0.6);
    let reach = ((OUTLINE * height as f64).round() as isize).max(1);
    let is_outline = |x: usize, y: usize, region: usize| {
        [(-reach, 0), (reach, 0), (0, -reach), (0, reach)].into_iter().any(|(dx, dy)| {
            let (u, v) = (x.checked_add_signed(dx), y.checked_add_signed(dy));
            let inside = u.zip(v).filter(|(u, v)| *u < width && *v < height);
            inside.is_none_or(|(u, v)| of(v * width + u) != Some(region))
        })
    };
    let drawn = Plane::from_fn(width, height, |x, y| {
        let shown = exposure.apply(photograph.rgb[(x, y)]);
        match of(y * width + x) {
            Some(region) if is_outline(x, y, region) => colours[region],
            Some(_) => shown,
            None => 0.4 * shown,
        }
    });
    (resize(&drawn, (PANEL * width).div_ceil(height).max(1), PANEL), colours)
}

/// A row of the table of regions.
pub struct Row {
    /// Name of the region, which is that of its folder.
    pub name: String,
    /// Finish, roughness and certainty in one line.
    pub verdict: Option<String>,
    /// Measured material with the most similar highlight.
    pub nearest: Option<String>,
    /// Its albedo relative to that of the brightest region.
    pub relative_albedo: Option<f64>,
    /// Relative residual.
    pub misfit: f64,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// Renders the page of all regions, with links to the report of each region.
pub fn page(image: &str, overview: &Plane<Vec3>, rows: &[Row]) -> String {
    let lead = html! {
        p { (rows.len()) " materials in " (image) ". Each name links to the report of the region." }
        (embedded(overview, "The regions of the photograph, and a sphere of each material."))
    };
    let body = html! {
        table {
            thead {
                tr { th { "region" } th { "finish (90 % interval of the roughness)" } th { "albedo relative to the brightest region" } th { "misfit" } th { "most similar highlight (not colour)" } }
            }
            tbody {
                @for row in rows {
                    tr {
                        th { a href={ "./" (row.name) "/report.html" } { (row.name) } }
                        td { (row.verdict.as_deref().unwrap_or("")) }
                        td {
                            @if let Some(albedo) = row.relative_albedo { (format!("{albedo:.2}")) }
                        }
                        td { (format!("{:.1} %", 100.0 * row.misfit)) }
                        td { (row.nearest.as_deref().unwrap_or("")) }
                    }
                }
            }
        }
        @for row in rows {
            @for warning in &row.warnings { p { b { (row.name) ": " } (warning) } }
        }
    };
    let sections = [Section { id: "regions".into(), title: "Regions".into(), body }];
    document("Materials of a photograph", &lead, &sections)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped_and_linked() {
        let row = Row {
            name: "a<b".into(),
            verdict: Some("gloss: roughness 0.20 (0.10 to 0.30)".into()),
            nearest: Some("brass".into()),
            relative_albedo: Some(0.5),
            misfit: 0.05,
            warnings: vec!["odd".into()],
        };
        let page = page("x.exr", &Plane::from_fn(8, 8, |_, _| Vec3::ZERO), &[row]);
        assert!(page.contains("a&lt;b/report.html") && page.contains("0.20 (0.10 to 0.30)") && page.contains("0.50"));
    }

    #[test]
    fn outlines_have_their_colours_and_regions_keep_theirs() {
        let picture = Picture { rgb: Plane::from_fn(200, 100, |_, _| Vec3::ONE), alpha: None };
        let half = |left: bool| Plane::from_fn(200, 100, |x, _| f32::from(u8::from((x < 100) == left)));
        let (map, colours) = outlined(&picture, &[&half(true), &half(false)]);
        assert_eq!((map.size(), colours.len()), ((2 * PANEL, PANEL), 2));
        assert_eq!((map[(1, PANEL / 2)], map[(2 * PANEL - 2, PANEL / 2)]), (colours[0], colours[1]));
        assert_eq!(map[(PANEL / 2, PANEL / 2)], map[(3 * PANEL / 2, PANEL / 2)]);
    }
}
