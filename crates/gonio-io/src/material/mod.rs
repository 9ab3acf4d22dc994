//! Materials in the files of renderers, as parameters of their own models: see
//! [`gonio::reflectance::shading`] for what the models are.
//!
//! Colours are linear Rec. 709 throughout, as all these formats expect them. Names go in as they
//! are where the format allows, and else with underscores for everything that is no letter, digit
//! or underscore.

mod blender;
mod glb;
mod materialx;
mod mitsuba;

pub use blender::blender_script;
pub use glb::glb_sphere;
pub use materialx::materialx;
pub use mitsuba::{mitsuba_measured, mitsuba_principled};

use glam::DVec3;

/// A name that XML and Python take for one.
fn identifier(name: &str) -> String {
    let mut out: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !out.starts_with(|c: char| c.is_ascii_alphabetic()) {
        out.insert_str(0, "m_");
    }
    out
}

/// Four digits are more than any of the models deserves.
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
