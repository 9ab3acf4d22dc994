//! One material from several photographs.

use super::material::Impression;
use super::{EstimateError, Material};
use crate::inference::learnt::MaterialPosterior;
use crate::inference::{Likelihood, ProductError};
use crate::model::Model;

/// A material that several photographs show.
#[derive(Clone, Debug)]
pub struct Combined {
    /// The material. Its fields on a single photograph are those of none: nothing is filled in,
    /// strange or unshadowed, and there is no scatter.
    pub material: Material,
    /// For each photograph, the logarithm of the odds of one material for all to another one for
    /// it; above zero if they agree.
    pub agreement: Vec<f64>,
}

/// Combines what photographs say of one material ([`MaterialPosterior::likelihood`]).
///
/// # Errors
/// If the model has no posterior of materials, or the photographs cannot be combined.
pub fn combine(model: &Model, likelihoods: &[Likelihood]) -> Result<Combined, EstimateError> {
    let learnt = model.learnt.as_ref().ok_or(EstimateError::NotLearnt)?;
    let product = Likelihood::product(learnt, likelihoods)?;
    let posterior = MaterialPosterior::of(learnt, product.likelihood).ok_or(ProductError::Damaged)?;
    Ok(Combined { material: Impression::with(learnt, 0.0, posterior).describe(), agreement: product.agreement })
}
