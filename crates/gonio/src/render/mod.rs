//! Rendering of BRDFs in distant light (paper section 4): inputs, predictions, reference images.

mod brdf;
mod integrate;
mod linear;
pub(crate) mod lobe;
mod prefiltered;
pub(crate) mod pyramid;
mod rows;
mod shader;
mod sphere;
mod surface;
mod tone;
mod tree;

pub use brdf::{Brdf, Tinted};
pub use integrate::{IntegratorSettings, Node, Nodes, nodes, radiance};
pub use linear::Relighter;
pub use lobe::{HalfVectorSampler, LightSample};
pub use prefiltered::PrefilteredLight;
pub use sphere::{SphereSettings, images_of_basis, render_sphere, render_spheres};
pub use surface::{SurfaceSettings, render_surface, render_surfaces};
pub use tone::{Exposure, median_colour};
pub use tree::LightTree;

/// Method by which the radiance of a pixel is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Accuracy {
    /// Fixed set of half vectors: fast, and free of noise.
    #[default]
    Lobes,
    /// Subdivision of the light until the error bound is small enough.
    Bound(IntegratorSettings),
}
