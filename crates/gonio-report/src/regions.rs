//! Picture and HTML page of several regions of a photograph.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::render::Exposure;
use gonio_io::result::RegionsDocument;
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

/// Renders the page of all regions, with links to the report of each region.
///
/// `nearest` is, for each region, the measured material with the most similar highlight.
pub fn page(image: &str, overview: &Plane<Vec3>, result: &RegionsDocument, nearest: &[Option<String>]) -> String {
    let regions = &result.regions;
    let lead = html! {
        p { (regions.len()) " materials in " (image) ". Each name links to the report of the region." }
        (embedded(overview, "The regions of the photograph, and a sphere of each material."))
    };
    let body = html! {
        table {
            thead {
                tr { th { "region" } th { "finish (90 % interval of the roughness)" } th { "albedo relative to the brightest region" } th { "misfit" } th { "most similar highlight (not colour)" } }
            }
            tbody {
                @for (region, nearest) in regions.iter().zip(nearest) {
                    tr {
                        th { a href={ "./" (region.name) "/report.html" } { (region.name) } }
                        td { (region.verdict.as_deref().unwrap_or("")) }
                        td {
                            @if let Some(albedo) = region.relative_albedo { (format!("{albedo:.2}")) }
                        }
                        td { (format!("{:.1} %", 100.0 * region.misfit)) }
                        td { (nearest.as_deref().unwrap_or("")) }
                    }
                }
            }
        }
        @for warning in &result.warnings { p { (warning) } }
        @for region in regions {
            @for warning in &region.warnings { p { b { (region.name) ": " } (warning) } }
        }
    };
    let sections = [Section { id: "regions".into(), title: "Regions".into(), body }];
    document("Materials of a photograph", &lead, &sections)
}

#[cfg(test)]
mod tests {
    use gonio_io::result::RegionEntry;

    use super::*;

    #[test]
    fn names_are_escaped_and_linked() {
        let region = RegionEntry {
            name: "a<b".into(),
            verdict: Some("gloss: roughness 0.20 (0.10 to 0.30)".into()),
            relative_albedo: Some(0.5),
            ..RegionEntry::default()
        };
        let result = RegionsDocument {
            regions: vec![region],
            warnings: vec!["two <exposures> are left out".into()],
            ..RegionsDocument::default()
        };
        let page = page("x.exr", &Plane::from_fn(8, 8, |_, _| Vec3::ZERO), &result, &[Some("brass".into())]);
        assert!(page.contains("two &lt;exposures&gt; are left out"));
        assert!(page.contains("a&lt;b/report.html") && page.contains("0.20 (0.10 to 0.30)"));
        assert!(page.contains("0.50") && page.contains("brass"));
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
