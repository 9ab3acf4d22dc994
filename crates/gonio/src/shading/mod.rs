//! Shading models of common renderers, in their own parameters, and fits of each model to a table.
//!
//! | model | renderers | width of the lobe |
//! |---|---|---|
//! | [`Principled`] | Mitsuba 3 `principled` | `alpha = roughness^2` |
//! | [`MetallicRoughness`] | glTF 2.0 | `alpha = roughness^2` |
//! | [`Layered`] | OpenPBR, MaterialX | `alpha = roughness^2` |
//! | [`BlenderPrincipled`] | Blender's Principled BSDF | `alpha = roughness^2` |
//! | [`ColourCookTorrance`] | classic | `m = roughness`, not squared |
//! | [`ColourWard`] | classic | `alpha = roughness`, not squared |
//!
//! [`Fitter::fit`] fits each model by the Levenberg-Marquardt method from several starts, and
//! compares a sphere of it with one of the table in a studio light.

mod classic;
mod fit;
mod layered;
mod metallic_roughness;
mod microfacet;
mod principled;

pub use classic::{ColourCookTorrance, ColourWard};
pub use fit::{Fitted, Fitter};
pub use layered::{BlenderPrincipled, Layered};
pub use metallic_roughness::MetallicRoughness;
pub use microfacet::COAT_IOR;
pub(crate) use microfacet::fresnel_dielectric;
pub use principled::Principled;

use glam::DVec3;

use crate::reflectance::BivariateTable;
use crate::reflectance::parametric::azimuth_means;

/// An isotropic RGB BRDF, with parameters that are written to a file.
pub trait Shading: Sync + Send + Sized {
    /// Range of each parameter.
    const PARAMETERS: &'static [Parameter];

    /// Groups of parameters that a fit leaves out if they hardly improve it: the indices of the
    /// parameters, with the values that disable the group.
    const OPTIONAL: &'static [&'static [(usize, f64)]] = &[];

    /// Index of the roughness of the base, the square root of GGX's `alpha`, and the group in
    /// [`OPTIONAL`](Shading::OPTIONAL) that disables the coat.
    const ROUGHNESS_AND_COAT: Option<(usize, usize)> = None;

    /// Builds the model from these parameters, each within its range.
    fn of(parameters: &[f64]) -> Self;

    /// Returns the value in 1/sr, linear RGB.
    ///
    /// `wi` and `wo` are unit vectors towards the light and the viewer; the normal is `+z`.
    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3;

    /// Returns [`eval`](Shading::eval), prepared for many pairs of directions.
    fn evaluator(&self) -> impl Fn(DVec3, DVec3) -> DVec3 + Sync {
        |wi, wo| self.eval(wi, wo)
    }

    /// Returns starting parameters for this body colour and albedo of the highlight.
    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>>;

    /// Returns the means over `phi_d` of each channel, from samples every `step` degrees.
    ///
    /// [`Parametric::to_bivariate`](crate::reflectance::parametric::Parametric::to_bivariate) uses
    /// more samples; these formulas are smooth.
    fn to_bivariate(&self, step: usize) -> [BivariateTable; 3] {
        let eval = self.evaluator();
        azimuth_means(step, |wi, wo| eval(wi, wo).to_array())
    }
}

/// Range of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
}

const UNIT: Parameter = Parameter { low: 0.0, high: 1.0 };
