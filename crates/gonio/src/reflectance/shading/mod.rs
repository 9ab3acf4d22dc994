//! The shading models of common renderers, in their own parameters, and what comes nearest to a
//! table in each of them.
//!
//! | model | renderers | width of the lobe |
//! |---|---|---|
//! | [`Principled`] | Mitsuba 3 `principled` | `alpha = roughness^2` |
//! | [`MetallicRoughness`] | glTF 2.0 | `alpha = roughness^2` |
//! | [`Layered`] | OpenPBR, MaterialX, Blender's Principled | `alpha = roughness^2` |
//! | [`ColourCookTorrance`] | classic | `m = roughness`, not squared |
//! | [`ColourWard`] | classic | `alpha = roughness`, not squared |
//!
//! Each is fitted ([`Fitter::fit`]) by Levenberg and Marquardt's method from several starts, and
//! judged by how a sphere of it looks in a studio light beside one of the table.

mod classic;
mod fit;
mod layered;
mod metallic_roughness;
mod microfacet;
mod principled;

pub use classic::{ColourCookTorrance, ColourWard};
pub use fit::{Fitted, Fitter};
pub use layered::Layered;
pub use metallic_roughness::MetallicRoughness;
pub use principled::Principled;

use glam::DVec3;

use super::BivariateTable;
use super::parametric::azimuth_means;

/// An isotropic BRDF in colour with parameters that go into a file.
pub trait Shading: Sync + Send + Sized {
    /// The range of each parameter, and whether it is a width, whose logarithm matters.
    const PARAMETERS: &'static [Parameter];

    /// The model of these parameters, each within its range.
    fn of(parameters: &[f64]) -> Self;

    /// Value in 1/sr, linear RGB, for unit vectors towards the light (`wi`) and the viewer (`wo`),
    /// the normal being `+z`.
    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3;

    /// Parameters to start from, for a material of this body colour and albedo of its highlight.
    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>>;

    /// The means over `phi_d` of each channel, as
    /// [`Parametric::to_bivariate`](super::parametric::Parametric::to_bivariate) takes them, of
    /// samples every so many degrees: formulas are smooth.
    fn to_bivariate(&self, step: usize) -> [BivariateTable; 3] {
        azimuth_means(step, |wi, wo| self.eval(wi, wo).to_array())
    }
}

/// What is known of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
}

const UNIT: Parameter = Parameter { low: 0.0, high: 1.0 };
