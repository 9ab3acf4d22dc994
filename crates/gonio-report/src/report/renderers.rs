//! Parameters of the material for renderers, ready to copy.

use gonio::reflectance::BivariateTable;
use gonio::shading::{Fitted, Fitter, Layered, MetallicRoughness, Principled};
use gonio_io::material::{Place, blender_script, materialx, mitsuba_principled};
use maud::{Markup, html};
use serde_json::json;

use super::percent;

/// Best fits of the models of common renderers to a BRDF.
#[derive(Clone, Debug, PartialEq)]
pub struct Fits {
    /// Mitsuba.
    pub principled: Fitted<Principled>,
    /// OpenPBR, MaterialX, Blender.
    pub layered: Fitted<Layered>,
    /// glTF.
    pub metallic_roughness: Fitted<MetallicRoughness>,
}

impl Fits {
    /// Fits the models to linear RGB tables in 1/sr. This takes about two seconds on one core.
    pub fn of(tables: &[BivariateTable; 3]) -> Self {
        let fitter = Fitter::new(tables);
        Self { principled: fitter.fit(), layered: fitter.fit(), metallic_roughness: fitter.fit() }
    }
}

pub(super) fn section(name: &str, fits: &Fits) -> Markup {
    let Fits { principled, layered, metallic_roughness } = fits;
    let gltf = &metallic_roughness.model;
    let [r, g, b] = gltf.base_color.to_array();
    let gltf = json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [rounded(r), rounded(g), rounded(b), 1.0],
            "metallicFactor": rounded(gltf.metallic),
            "roughnessFactor": rounded(gltf.roughness),
        },
        "extensions": { "KHR_materials_ior": { "ior": rounded(gltf.ior) } },
    });
    let gltf = serde_json::to_string_pretty(&gltf).unwrap_or_default();
    let width = "alpha = roughness²";
    html! {
        p { "Best fit of each model to the BRDF, with the relative error of a sphere in a studio light. The \
            tabulated BRDF has no such error: "
            code { "gonio export" } " writes the table for Mitsuba and pbrt." }
        (block("mitsuba", "Mitsuba 3, principled", principled.relight, width, &mitsuba_principled(name, &principled.model, Place::Scene)))
        (block("blender", "Blender 4, Principled BSDF (script)", layered.relight, "alpha = Roughness²", &blender_script(name, &layered.model)))
        (block("materialx", "MaterialX, OpenPBR", layered.relight, "alpha = specular_roughness²", &materialx(name, &layered.model)))
        (block("gltf", "glTF 2.0, metallic-roughness", metallic_roughness.relight, "alpha = roughnessFactor²", &gltf))
    }
}

/// Builds a foldable block of text to copy.
fn block(id: &str, title: &str, off: f64, width: &str, text: &str) -> Markup {
    html! {
        details.copied open[id == "mitsuba"] {
            summary { (title) span.note { " error " (percent(off)) ", " (width) } }
            button type="button" data-copy=(id) { "Copy" }
            pre id=(id) tabindex="0" { code { (text) } }
        }
    }
}

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
