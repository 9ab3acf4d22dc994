//! The methods of the paper "Blind Reflectometry": reflectance as coefficients in a non-negative
//! basis, light as Haar coefficients, and a bilinear model of the image.
//!
//! 1. [`training::train`] learns the basis from measured materials (paper 3.2).
//! 2. [`Plan::build`] computes the bilinear operator of eq. 8 and keeps the leading left singular
//!    directions; [`Plan::project`] projects an image on them.
//! 3. A [`Problem`] adds the priors, and [`infer`] computes its [`Posterior`] by a [`Method`]:
//!    * [`Method::Variational`], the separable posterior of eqs. 12 to 14 fitted by Algorithm 1;
//!    * [`Method::JointMap`], the single most probable pair of light and reflectance (eq. 2), the
//!      baseline, which wrongly prefers a mirror under blurred illumination.
//!
//!    If the light is known, [`Problem::with_known_light`] builds a problem with one light
//!    coefficient, the DC.
//! 4. [`estimate`] performs steps 2 and 3 on the observations of a photograph.

#![deny(clippy::print_stdout, clippy::print_stderr)]

mod bilinear;
mod blocks;
mod component_switch;
mod coordinate;
mod ensemble;
mod estimate;
#[cfg(test)]
mod evidence;
mod expectations;
mod grams;
mod joint_map;
mod light_system;
mod newton;
pub mod nmf;
#[cfg(test)]
mod nuts;
mod plan;
mod posterior;
mod printed;
mod problem;
#[cfg(test)]
mod sized;
mod sketch;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
pub mod training;
mod variational;

pub use bilinear::Bilinear;
pub use ensemble::VariationalParameters;
pub use estimate::{
    PaperDiagnostic, PaperError, PaperEstimate, PaperMethod, PaperSettings, PaperStage, ProjectionLoss, estimate,
};
pub use expectations::Expectations;
pub use joint_map::JointMapSettings;
pub use plan::{Plan, PlanError, PlanSettings, Projected};
pub use posterior::{Posterior, StartReport};
pub use problem::{Problem, ProblemError};
pub use variational::{Solver, VariationalSettings};

/// Method for computing the posterior of a [`Problem`].
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Separable posterior that minimises `C_KL` (eq. 11), from several random starts.
    Variational(VariationalSettings),
    /// Joint maximum of eq. 10 over light, reflectance, exposure and noise.
    JointMap(JointMapSettings),
}

/// Computes the posterior; deterministic for the seed in the method's settings.
///
/// `progress` receives a fraction in 0..=1.
pub fn infer(problem: &Problem<'_>, method: &Method, progress: &(dyn Fn(f64) + Sync)) -> Posterior {
    match method {
        Method::Variational(settings) => variational::infer(problem, settings, progress),
        Method::JointMap(settings) => joint_map::infer(problem, settings, progress),
    }
}
