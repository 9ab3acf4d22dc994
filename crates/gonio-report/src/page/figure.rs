//! Embedded pictures, tiles and captions.

use base64::Engine;
use glam::Vec3;
use gonio::picture::Plane;
use maud::{Markup, html};

/// Embeds a picture of linear display values in 0..=1 as PNG in the page. `alt` describes it in
/// words.
pub fn picture(rgb: &Plane<Vec3>, alt: &str) -> Markup {
    image(rgb, alt, "", 1)
}

/// Embeds a picture of cells: each is shown as a square of `zoom` by `zoom` pixels with hard edges.
pub fn cells(rgb: &Plane<Vec3>, alt: &str, zoom: usize) -> Markup {
    image(rgb, alt, "cells", zoom)
}

/// Embeds a picture that is shown `width` pixels wide, and in full detail on fine screens.
pub fn sized(rgb: &Plane<Vec3>, width: usize, alt: &str) -> Markup {
    html! { img src=(source(rgb)) width=(width) height=(width * rgb.height() / rgb.width().max(1)) alt=(alt); }
}

fn image(rgb: &Plane<Vec3>, alt: &str, class: &str, zoom: usize) -> Markup {
    let class = (!class.is_empty()).then_some(class);
    html! { img class=[class] src=(source(rgb)) width=(zoom * rgb.width()) height=(zoom * rgb.height()) alt=(alt); }
}

/// Encodes a picture of linear display values as a data URL.
pub(crate) fn source(rgb: &Plane<Vec3>) -> String {
    let png = gonio_io::picture::encode_png(rgb);
    format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(png))
}

/// Embeds a square PNG file that is already in base64.
pub fn encoded(png: &str, side: usize, alt: &str) -> Markup {
    html! { img src={ "data:image/png;base64," (png) } width=(side) height=(side) alt=(alt); }
}

/// Builds a figure with its caption beneath.
pub fn figure(content: &Markup, caption: &Markup) -> Markup {
    html! { figure { (content) figcaption { (caption) } } }
}

/// Builds a framed figure with its own heading, for use in a [`grid`].
pub fn card(heading: &str, content: &Markup, caption: &Markup) -> Markup {
    html! { figure.card { h3 { (heading) } (content) figcaption { (caption) } } }
}

/// Arranges pictures side by side, each with a short label beneath. In a card they share its width,
/// elsewhere they wrap.
pub fn tiles(pictures: &[(impl AsRef<str>, Markup)]) -> Markup {
    html! { div.tiles { @for (label, picture) in pictures { div.tile { (picture) span { (label.as_ref()) } } } } }
}

/// Arranges figures side by side, as many as fit when each is at least `least` rem wide.
pub fn grid(least: u32, figures: &[Markup]) -> Markup {
    html! { div.grid style={ "--least: " (least) "rem" } { @for figure in figures { (figure) } } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_have_data_size_and_alt_text() {
        let red = Plane::from_fn(3, 2, |_, _| Vec3::X);
        let html = cells(&red, "a \"red\" field", 4).into_string();
        assert!(
            html.contains("width=\"12\" height=\"8\"") && html.contains("alt=\"a &quot;red&quot; field\""),
            "{html}"
        );
        let coded = html.split("base64,").nth(1).unwrap().split('"').next().unwrap();
        let bytes = base64::engine::general_purpose::STANDARD.decode(coded).unwrap();
        assert_eq!(bytes, gonio_io::picture::encode_png(&red));
        assert!(!picture(&red, "x").into_string().contains("class"));
    }
}
