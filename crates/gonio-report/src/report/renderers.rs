//! Parameters of the material for renderers, ready to copy.

use gonio::reflectance::BivariateTable;
use gonio::shading::{BlenderPrincipled, Fitted, Fitter, Layered, MetallicRoughness, Principled};
use gonio_io::material::{Place, blender_script, fit_note, gltf_material, materialx, mitsuba_principled, poor_fit};
use maud::{Markup, html};

use super::percent;

/// Best fits of the models of common renderers to a BRDF.
#[derive(Clone, Debug, PartialEq)]
pub struct Fits {
    /// Luminance albedo at normal incidence to which the BRDF was scaled before the fits, if the
    /// photograph does not determine it.
    pub albedo: Option<f64>,
    /// Mitsuba.
    pub principled: Fitted<Principled>,
    /// Blender.
    pub blender: Fitted<BlenderPrincipled>,
    /// OpenPBR, MaterialX.
    pub layered: Fitted<Layered>,
    /// glTF.
    pub metallic_roughness: Fitted<MetallicRoughness>,
}

impl Fits {
    /// Fits the models to linear RGB tables in 1/sr. This takes about two seconds on one core.
    ///
    /// Unless the scale of the tables is known (`absolute`), they are first scaled by
    /// [`Fitter::plausible_scale`]. `roughness` is the roughness of the highlight, if it is known:
    /// the 5 % quantile, the median and the 95 % quantile.
    pub fn of(tables: &[BivariateTable; 3], roughness: Option<[f64; 3]>, absolute: bool) -> Self {
        let mut fitter = Fitter::new(tables);
        if let Some([low, _, high]) = roughness {
            fitter = fitter.with_roughness([low, high]);
        }
        let albedo = (!absolute).then(|| {
            let factor = fitter.plausible_scale();
            fitter = fitter.scaled(factor);
            factor * BivariateTable::luminance(tables).normal_albedo()
        });
        Self {
            albedo,
            principled: fitter.fit(),
            blender: fitter.fit(),
            layered: fitter.fit(),
            metallic_roughness: fitter.fit(),
        }
    }
}

pub(super) fn section(name: &str, fits: &Fits) -> Markup {
    let Fits { albedo, principled, blender, layered, metallic_roughness } = fits;
    let gltf = serde_json::to_string_pretty(&gltf_material(name, &metallic_roughness.model)).unwrap_or_default();
    let width = "alpha = roughness²";
    html! {
        p { "Best fit of each model to the BRDF, with its fit error: the relative error of a sphere in a studio light. The \
            tabulated BRDF has no such error: "
            code { "gonio export" } " writes the table for Mitsuba and pbrt." }
        @if let Some(albedo) = albedo {
            p { "The photograph does not determine the albedo. An albedo of " (format!("{albedo:.2}"))
                " is the largest at which the models fit nearly best; " code { "gonio export --albedo" } " sets another." }
        }
        (block("mitsuba", "Mitsuba 3, principled", principled.relight, width, &mitsuba_principled(name, &principled.model, Place::Scene, &fit_note(principled.relight))))
        (block("blender", "Blender 4, Principled BSDF (script)", blender.relight, "alpha = Roughness²", &blender_script(name, &blender.model, &fit_note(blender.relight))))
        (block("materialx", "MaterialX, OpenPBR", layered.relight, "alpha = specular_roughness²", &materialx(name, &layered.model, &fit_note(layered.relight))))
        (block("gltf", "glTF 2.0, metallic-roughness", metallic_roughness.relight, "alpha = roughnessFactor²", &gltf))
    }
}

/// Builds a foldable block of text to copy.
fn block(id: &str, title: &str, off: f64, width: &str, text: &str) -> Markup {
    html! {
        details.copied open[id == "mitsuba"] {
            summary { (title) span.note { " fit error " (percent(off)) ", " (width) } }
            @if let Some(problem) = poor_fit(off) { p.note { (problem) } }
            button type="button" data-copy=(id) { "Copy" }
            pre id=(id) tabindex="0" { code { (text) } }
        }
    }
}
