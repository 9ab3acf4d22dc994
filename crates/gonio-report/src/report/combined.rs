//! Page of the result of several photographs of one material.

use glam::Vec3;
use gonio::estimate::MaterialEstimate;
use gonio::picture::Plane;
use gonio_io::result::ResultDocument;
use maud::html;

use super::{Fits, RESULT_STYLE, facts, reflectance, renderers, verdict_of};
use crate::page::{Document, Section, figure, table};
use crate::uncertainty::{svg, width};

/// A photograph of a combined result.
#[derive(Clone, Debug, PartialEq)]
pub struct CombinedPhotograph {
    /// Name of its folder of results.
    pub name: String,
    /// 5, 50 and 95 % quantiles of the roughness, from this photograph alone.
    pub roughness: [f64; 3],
    /// Log odds that it shows the same material as the others.
    pub agreement: f64,
}

/// Content of the page of a combined result.
pub struct CombinedReport<'a> {
    /// Name of the material in exports.
    pub name: &'a str,
    /// The material.
    pub material: &'a MaterialEstimate,
    /// Picture of the combined and the single materials, as linear display values.
    pub sheet: &'a Plane<Vec3>,
    /// The photographs.
    pub photographs: &'a [CombinedPhotograph],
    /// Best fits of renderer models to the BRDF.
    pub fits: &'a Fits,
    /// Content of `result.json`.
    pub result: &'a ResultDocument,
}

impl CombinedReport<'_> {
    /// Renders the page as HTML.
    pub fn render(&self) -> String {
        let Self { name, material, sheet, photographs, fits, result } = *self;
        let row = |photograph: &CombinedPhotograph| {
            let [low, median, high] = photograph.roughness;
            let roughness = format!("{median:.2} ({low:.2} to {high:.2})");
            vec![photograph.name.clone(), roughness, format!("{:.1}", photograph.agreement)]
        };
        let rows: Vec<Vec<String>> = photographs.iter().map(row).collect();
        let lead = html! {
            p.answer { (verdict_of(material)) }
            p.note { "One BRDF from " (photographs.len()) " photographs. The albedo at normal incidence is set to 0.5." }
            (facts(material, result))
        };
        let section = |id: &str, title: &str, body| Section { id: id.into(), title: title.into(), body };
        let alone = html! {
            (figure::figure(&figure::picture(sheet, "Spheres of the combined material, of both ends of its interval, and of the materials from single photographs"),
                &html! { "First row: the combined material and both ends of its 90 % interval. Below: the material from each photograph alone." }))
            (table::table("The photographs: the roughness with its 90 % interval from each alone, and the log odds that it shows the same material as the others",
                &["photograph", "roughness", "agreement"], &rows))
        };
        let trust = figure::figure(
            &svg(&[&width(material)], false, "Map of the width of the 90 % interval over half and difference angle"),
            &html! { "Width of the 90 % interval in each cell, as the ratio of its ends. The photographs do not determine the hatched cells." },
        );
        let sections = vec![
            section("photographs", "Photographs", alone),
            section("reflectance", "BRDF", reflectance::charts(&material.table, Some(material))),
            section("trust", "Uncertainty", trust),
            section("renderers", "Parameters for renderers", renderers::section(name, fits)),
        ];
        let script = include_str!("../page/copy.js");
        Document { title: "Material of several photographs", lead, sections, style: RESULT_STYLE, script }.render()
    }
}
