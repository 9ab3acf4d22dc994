//! Pictures of a BRDF on a sphere under a light (paper section 4): inputs, predictions, reference images.

mod brdf;
mod integrate;
mod sphere;
mod tone;
mod tree;

pub use brdf::{Brdf, Tinted};
pub use integrate::{IntegratorSettings, Radiance, radiance};
pub use sphere::{SphereSettings, render_sphere};
pub use tone::{Exposure, median_colour};
pub use tree::LightTree;
