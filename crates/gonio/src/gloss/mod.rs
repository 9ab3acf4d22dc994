//! Sharpness and strength of a highlight in standard measures: the width of an equivalent GGX lobe,
//! as in renderers, and gloss units, as measured by glossmeters. Also the radius and the tip of a
//! lobe.

mod glossmeter;
mod lobe;
mod width;

pub use glossmeter::Glossmeter;
pub use lobe::{lobe_radius, tip_sharpness};
pub use width::GgxWidths;
