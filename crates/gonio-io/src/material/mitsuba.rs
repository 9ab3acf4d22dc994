use gonio::shading::Principled;

use super::{colour, identifier, number};

/// Writes a `principled` material for a scene of Mitsuba 3; its `roughness` is the square root of
/// GGX's width.
pub fn mitsuba_principled(name: &str, model: &Principled) -> String {
    let float = |name: &str, value: f64| format!("    <float name=\"{name}\" value=\"{}\"/>\n", number(value));
    let values = [
        float("metallic", model.metallic),
        float("roughness", model.roughness),
        float("eta", model.eta),
        float("sheen", model.sheen),
        float("clearcoat", model.clearcoat),
        float("clearcoat_gloss", model.clearcoat_gloss),
    ];
    format!(
        "<bsdf type=\"principled\" id=\"{}\">\n    <rgb name=\"base_color\" value=\"{}\"/>\n{}</bsdf>\n",
        identifier(name),
        colour(model.base_color),
        values.concat()
    )
}

/// Writes a `measured` material for a scene of Mitsuba 3, read from a file beside it.
pub fn mitsuba_measured(name: &str, file: &str) -> String {
    format!(
        "<bsdf type=\"measured\" id=\"{}\">\n    <string name=\"filename\" value=\"{file}\"/>\n</bsdf>\n",
        identifier(name)
    )
}
