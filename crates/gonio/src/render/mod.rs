//! Pictures of a BRDF on a sphere under a light (paper section 4): inputs, predictions, reference
//! images.

mod brdf;
mod integrate;
mod linear;
mod rows;
mod sphere;
mod surface;
mod tone;
mod tree;

pub use brdf::{Brdf, Tinted};
pub use integrate::{IntegratorSettings, Node, Nodes, nodes, radiance};
pub use linear::Relighter;
pub use sphere::{SphereSettings, images_of_basis, render_sphere};
pub use surface::{SurfaceSettings, render_surface};
pub use tone::{Exposure, median_colour};
pub use tree::LightTree;
