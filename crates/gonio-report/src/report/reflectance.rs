//! Pictures of the BRDF.

use gonio::estimate::MaterialEstimate;
use gonio::reflectance::{BivariateTable, THETA_D, THETA_H, is_trusted, theta_h_of};
use maud::{Markup, html};

use super::lobes::{curve, lobe};
use super::short;
use crate::page::chart::{Axis, Frame, Series, chart};
use crate::page::figure;
use crate::panels::{PANEL, Panels, Subject};
use crate::uncertainty::{mean, svg};

/// Angles of incidence of the lobes, in degrees.
const INCIDENCES: [f64; 3] = [15.0, 45.0, 70.0];
/// Difference angles of the cuts, in degrees.
const CUTS: [usize; 2] = [5, 60];

pub(super) fn section(subject: &Subject<'_>, panels: &Panels) -> Markup {
    let spheres: Vec<(&str, Markup)> = panels
        .spheres
        .iter()
        .map(|(light, sphere)| {
            (*light, figure::sized(sphere, 2 * PANEL / 3, &format!("A sphere of the material, {light}")))
        })
        .collect();
    html! {
        (figure::figure(&figure::tiles(&spheres), &html! { "Spheres with the estimated BRDF in three built-in lights." }))
        (charts(subject.table, subject.material))
    }
}

/// Draws the BRDF over both angles, its cuts and its lobes, with the 90 % intervals of a material.
pub(super) fn charts(table: &BivariateTable, material: Option<&MaterialEstimate>) -> Markup {
    let band = material.map(|m| {
        let quantile = |q: &Vec<f32>| BivariateTable::from_vec(q.clone());
        (quantile(&m.quantiles[0]), quantile(&m.quantiles[m.quantiles.len() - 1]))
    });
    let band = band.as_ref().map(|(low, high)| (low, high));
    let interval = if band.is_some() { " The band is the 90 % interval at each angle." } else { "" };
    let lobes = INCIDENCES.map(|incidence| {
        let peak = |t: &BivariateTable| curve(t, incidence).iter().map(|p| p.1).fold(1e-6, f64::max);
        let top = band.map_or(0.0, |(_, high)| peak(high)).max(peak(table));
        let drawn = lobe(table, band, incidence, top);
        figure::card(&format!("Light at {incidence:.0}°"), &drawn, &html! { "Up to " (short(top)) " per steradian." })
    });
    html! {
        (figure::grid(20, &[
            figure::figure(&svg(&[&mean(table)], false, "Map of the BRDF over half and difference angle"),
                &html! { "Luminance of the BRDF over half angle (horizontal, stretched at the highlight) and \
                    difference angle (vertical). The highlight is on the left, grazing light at the top." }),
            html! { div { (cut_at(table, band, CUTS[0])) } },
            html! { div { (cut_at(table, band, CUTS[1])) } },
        ]))
        h3 { "Polar lobes" }
        (figure::grid(17, &lobes))
        p.note { "The distance from the centre is the cube root of the BRDF; rings are labelled in 1/sr. The thin \
            line is the incident ray." (interval) }
    }
}

/// Draws the BRDF over the half angle at one difference angle.
fn cut_at(table: &BivariateTable, band: Option<(&BivariateTable, &BivariateTable)>, cut: usize) -> Markup {
    let mut series = vec![Series::line("estimate", self::cut(table, cut))];
    if let Some((low, high)) = band {
        series.push(Series::dashed("5 %", self::cut(low, cut)));
        series.push(Series::dashed("95 %", self::cut(high, cut)));
    }
    let title = format!("At a difference angle of {cut}°");
    let axes = Frame {
        title: &title,
        x: ("half angle (degrees)", Axis::SquareRoot),
        y: ("BRDF (1/sr)", Axis::Log),
        y_range: None,
    };
    chart(&axes, &series)
}

/// Returns the BRDF (1/sr) over the half angle (degrees) at a difference angle of whole degrees.
pub(crate) fn cut(table: &BivariateTable, degrees: usize) -> Vec<(f64, f64)> {
    (0..THETA_H)
        .filter(|&i| is_trusted(i * THETA_D + degrees))
        .map(|i| (theta_h_of(i).to_degrees(), f64::from(table.cell(i, degrees))))
        .collect()
}
