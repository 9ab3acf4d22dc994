//! Inference of reflectance from a projected image (paper 3.4).
//!
//! One [`Problem`] (image, priors), several [`Method`]s, one [`Posterior`]:
//!
//! * [`Method::Variational`], the separable posterior of eqs. 12 to 14 fitted by Algorithm 1;
//! * [`Method::JointMap`], the single most probable pair of light and reflectance (eq. 2), the
//!   baseline, which wrongly prefers a mirror under blurred illumination;
//! * [`Method::KnownLight`], for a problem whose light is given: the best estimate that the image
//!   permits.
//!
//! [`light`] instead integrates the light out given one BRDF: it computes a bound on the evidence
//! of the BRDF and the posterior of the light.

mod blocks;
mod component_switch;
mod coordinate;
mod ensemble;
#[cfg(test)]
mod evidence;
mod expectations;
mod grams;
mod joint_map;
pub mod known_light;
pub mod learnt;
pub mod light;
mod light_system;
mod likelihood;
mod newton;
#[cfg(test)]
mod nuts;
mod parallel;
mod posterior;
mod problem;
#[cfg(test)]
mod sized;
#[cfg(test)]
mod tests;
mod variational;

pub use ensemble::VariationalParameters;
pub use expectations::Expectations;
pub use joint_map::JointMapSettings;
pub use likelihood::{CONTRADICTION, Embedding, Likelihood, LikelihoodProduct, ProductError};
pub use posterior::{Posterior, StartReport};
pub use problem::{Hyperparameters, MODEL_ERROR, Problem, ProblemError};
pub use variational::{Solver, VariationalSettings};

/// Method for computing the posterior of a [`Problem`].
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Separable posterior that minimises `C_KL` (eq. 11), from several random starts.
    Variational(VariationalSettings),
    /// Joint maximum of eq. 10 over light, reflectance, exposure and noise.
    JointMap(JointMapSettings),
    /// Separable posterior of the other unknowns when the light is known: the problem has one light
    /// coefficient, the DC.
    KnownLight(VariationalSettings),
}

/// Computes the posterior; deterministic for the seed in the method's settings.
///
/// `progress` receives a fraction in 0..=1.
pub fn infer(problem: &Problem<'_>, method: &Method, progress: &(dyn Fn(f64) + Sync)) -> Posterior {
    match method {
        Method::Variational(settings) | Method::KnownLight(settings) => variational::infer(problem, settings, progress),
        Method::JointMap(settings) => joint_map::infer(problem, settings, progress),
    }
}
