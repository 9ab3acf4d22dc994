//! Sharpness and strength of a highlight in standard measures: the width of an equivalent GGX lobe,
//! as in renderers, and gloss units, as measured by glossmeters.

mod glossmeter;
mod width;

pub use glossmeter::Glossmeter;
pub use width::GgxWidths;
