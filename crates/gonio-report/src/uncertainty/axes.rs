//! Maps for a page, as SVG with axes in the colours and the typeface of the page.

use maud::{Markup, html};

use super::{DIFFERENCE, DIFFERENCE_TICKS, HALF, HALF_TICKS, Map, STOPS, across, down, number};
use crate::page::figure::source;

/// Side of a map in units of the drawing, and the margins around it.
const MAP_SIDE: f64 = 360.0;
const LEFT: f64 = 46.0;
const RIGHT: f64 = 76.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 48.0;
/// Style of a separate file, with colours of text for light and dark backgrounds.
const STYLE: &str =
    "svg{color:#1d2126;font:13px system-ui,sans-serif}@media(prefers-color-scheme:dark){svg{color:#e6e6e3}}";

/// Draws maps side by side as SVG in the text colour of the page. If `alone`, the SVG contains its
/// own style, for a separate file. `alt` describes it in words.
pub fn svg(maps: &[&Map], alone: bool, alt: &str) -> Markup {
    let (wide, high) = (LEFT + MAP_SIDE + RIGHT, TOP + MAP_SIDE + BOTTOM);
    html! {
        svg.map xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (wide * maps.len() as f64) " " (high) } role="img" aria-label=(alt) {
            @if alone { style { (STYLE) } }
            @for (n, map) in maps.iter().enumerate() {
                g transform={ "translate(" (wide * n as f64) ")" } { (one(map)) }
            }
        }
    }
}

fn one(map: &Map) -> Markup {
    let gradient = format!("scale-{}", map.id);
    let last = (STOPS.len() - 1) as f64;
    let bar = LEFT + MAP_SIDE + 14.0;
    html! {
        text x=(LEFT) y="14" fill="currentColor" font-weight="600" { (map.title) }
        image href=(source(&map.pixels)) x=(LEFT) y=(TOP) width=(MAP_SIDE) height=(MAP_SIDE) {}
        g stroke="currentColor" {
            @for degrees in HALF_TICKS { (tick(LEFT + MAP_SIDE * across(degrees), TOP + MAP_SIDE, 0.0, 5.0)) }
            @for degrees in DIFFERENCE_TICKS { (tick(LEFT, TOP + MAP_SIDE * down(degrees), -5.0, 0.0)) }
            @for value in map.scale.ticks() { (tick(bar + 14.0, TOP + MAP_SIDE * (1.0 - map.scale.at(value)), 4.0, 0.0)) }
        }
        g fill="currentColor" {
            g text-anchor="middle" {
                @for degrees in HALF_TICKS { (label(LEFT + MAP_SIDE * across(degrees), TOP + MAP_SIDE + 19.0, &format!("{degrees:.0}"))) }
                (label(LEFT + 0.5 * MAP_SIDE, TOP + MAP_SIDE + 40.0, HALF))
                text transform={ "translate(12 " (TOP + 0.5 * MAP_SIDE) ") rotate(-90)" } { (DIFFERENCE) }
            }
            g text-anchor="end" {
                @for degrees in DIFFERENCE_TICKS { (label(LEFT - 8.0, TOP + MAP_SIDE * down(degrees) + 4.5, &format!("{degrees:.0}"))) }
            }
            @for value in map.scale.ticks() {
                (label(bar + 21.0, TOP + MAP_SIDE * (1.0 - map.scale.at(value)) + 4.5, &number(value)))
            }
        }
        linearGradient id=(gradient) x1="0" y1="1" x2="0" y2="0" {
            @for (i, [r, g, b]) in STOPS.iter().enumerate() {
                stop offset=(i as f64 / last) stop-color={ "rgb(" (r) "," (g) "," (b) ")" } {}
            }
        }
        rect x=(bar) y=(TOP) width="14" height=(MAP_SIDE) fill={ "url(#" (gradient) ")" } {}
    }
}

fn tick(x: f64, y: f64, right: f64, down: f64) -> Markup {
    html! { line x1=(x) y1=(y) x2=(x + right) y2=(y + down) {} }
}

fn label(x: f64, y: f64, text: &str) -> Markup {
    html! { text x=(x) y=(y) { (text) } }
}
