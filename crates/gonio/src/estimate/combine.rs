//! One material from several photographs.

use super::material::MaterialDraft;
use super::{EstimateError, MaterialEstimate};
use crate::inference::learnt::MaterialPosterior;
use crate::inference::{Likelihood, ProductError};
use crate::model::Model;

/// Material estimated from several photographs.
#[derive(Clone, Debug)]
pub struct Combined {
    /// The material. The measures of a single photograph (filled cells, share out of distribution,
    /// self-shadowing, scatter) are zero.
    pub material: MaterialEstimate,
    /// For each photograph, the log odds that it shows the same material as the others rather than
    /// another one; positive if it agrees.
    pub agreement: Vec<f64>,
}

/// Combines likelihoods ([`MaterialPosterior::likelihood`]) of photographs of one material.
///
/// # Errors
/// If the model has no posterior of materials, or the photographs cannot be combined.
pub fn combine(model: &Model, likelihoods: &[Likelihood]) -> Result<Combined, EstimateError> {
    let learnt = model.learnt.as_ref().ok_or(EstimateError::NotLearnt)?;
    let product = Likelihood::product(learnt, likelihoods)?;
    let posterior = MaterialPosterior::of(learnt, product.likelihood).ok_or(ProductError::Damaged)?;
    Ok(Combined { material: MaterialDraft::with(learnt, 0.0, posterior).describe(), agreement: product.agreement })
}
