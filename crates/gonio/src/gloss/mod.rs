//! The sharpness and strength of a highlight in terms that other trades use: the width of an
//! equivalent GGX lobe, which renderers take, and gloss units, which glossmeters read.

mod glossmeter;
mod width;

pub use glossmeter::Glossmeter;
pub use width::GgxWidths;
