//! Files of materials for renderers, as parameters of the models in [`gonio::shading`].
//!
//! Colours are linear Rec. 709 throughout, as all these formats expect. Names are kept where the
//! format allows; elsewhere every character except letters, digits and underscores becomes an
//! underscore.

mod blender;
pub(crate) mod glb;
mod materialx;
mod mitsuba;

pub use blender::{blender_scene, blender_script};
pub use glb::{glb_sphere, gltf_material};
pub use materialx::materialx;
pub use mitsuba::{Place, mitsuba_measured, mitsuba_principled, mitsuba_scene};

use glam::DVec3;

/// Width and height in pixels of the pictures that the scenes render.
const SIZE: usize = 256;

/// Half the width of such a picture for a sphere of radius one. The margin is two pixels, as in
/// `gonio::render::SphereSettings`.
const HALF_WIDTH: f64 = 0.5 * SIZE as f64 / (0.5 * SIZE as f64 - 2.0);

/// Fit error above which a model does not represent a BRDF.
const LARGE_ERROR: f64 = 0.2;

/// Returns a warning if the error of a fitted model is large: the relative error of a relit sphere.
pub fn poor_fit(relight: f64) -> Option<String> {
    (relight > LARGE_ERROR).then(|| {
        format!(
            "this model cannot represent the BRDF: the relative error of a relit sphere is {:.0} %; use the tensor \
             (target bsdf of gonio export)",
            100.0 * relight
        )
    })
}

/// Returns the comment on a fitted model: its error, or the warning of [`poor_fit`].
pub fn fit_note(relight: f64) -> String {
    // XML does not allow two hyphens in a comment.
    poor_fit(relight)
        .unwrap_or_else(|| format!("Fitted by gonio; relative error of a relit sphere: {:.0} %", 100.0 * relight))
}

/// Converts a name to an identifier of XML and Python.
fn identifier(name: &str) -> String {
    let mut out: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !out.starts_with(|c: char| c.is_ascii_alphabetic()) {
        out.insert_str(0, "m_");
    }
    out
}

/// Formats a number with four decimals, more than the accuracy of the models.
fn number(value: f64) -> String {
    format!("{value:.4}")
}

fn colour(value: DVec3) -> String {
    value.to_array().map(number).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_identifiers() {
        assert_eq!(identifier("red-phenolic 2"), "red_phenolic_2");
        assert_eq!(identifier("2nd <ball>"), "m_2nd__ball_");
        assert_eq!(identifier(""), "m_");
    }
}
