//! Likelihoods of a material given one or several photographs.
//!
//! Photographs of one object are independent given its material, so the posterior is the prior
//! times the product of their likelihoods. This requires that all photographs show the same
//! material; the ratio of `p(I_1 .. I_K | one material)` to that of two materials tests this
//! assumption.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::known_light::Gaussian;
use super::learnt::LearntPosterior;

/// Log odds of one material for all photographs to another one for the photograph in question,
/// below which the photographs contradict each other (docs/combine.md).
pub const MIN_SAME_MATERIAL_LOG_ODDS: f64 = -12.0;

/// Likelihood of a material given a photograph, up to a constant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Likelihood {
    /// Under unknown illumination.
    Embedding(Embedding),
    /// Under a known light: a Gaussian in the coefficients of the logarithm of reflectance.
    Gaussian(Gaussian),
}

/// Likelihood by embeddings of images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Embedding {
    /// Sum of the embeddings of the images. Its product with the embedding of a material is the sum
    /// of the log likelihoods.
    sum: Vec<f32>,
    /// Number of images.
    count: usize,
}

/// Share `rho` of the error of a likelihood that photographs of one material have in common: the
/// error of the model, as opposed to that of the light. Therefore, `K` photographs count as
/// `K / (1 + (K - 1) rho)`. Without this correction, the intervals of materials outside the
/// training data became too narrow, and the estimates did not improve (docs/trials.md).
const COMMON: f64 = 0.5;

impl Embedding {
    /// Wraps the embedding of one image.
    pub fn of(image: Vec<f32>) -> Self {
        Self { sum: image, count: 1 }
    }

    /// Returns the embedding that determines the weights of materials.
    pub(crate) fn tempered(&self) -> Vec<f32> {
        let share = 1.0 / (1.0 + (self.count.max(1) - 1) as f64 * COMMON);
        self.sum.iter().map(|v| (f64::from(*v) * share) as f32).collect()
    }
}

/// Error in combining likelihoods.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ProductError {
    /// There are fewer than two likelihoods.
    #[error("too few photographs; specify at least two")]
    Few,
    /// Some likelihoods are for unknown light, others for a known light.
    #[error("some results are for unknown light and others for a known light; combine each kind separately")]
    Mixed,
    /// A likelihood was inferred with another model.
    #[error("was inferred with another model than the specified one")]
    Model(
        /// Index of the photograph.
        usize,
    ),
    /// A photograph does not show the same material as the others.
    #[error("does not show the same material as the others (log odds {ratio:.0}); remove the photograph")]
    Contradiction {
        /// Index of the photograph.
        at: usize,
        /// Log odds of one material to two.
        ratio: f64,
    },
    /// A likelihood contains invalid numbers.
    #[error("contains invalid numbers; run the inference again")]
    Damaged,
}

/// Likelihood of a material given several photographs.
#[derive(Clone, Debug, PartialEq)]
pub struct LikelihoodProduct {
    /// The product of the likelihoods.
    pub likelihood: Likelihood,
    /// For each photograph, the log odds of one material for all to another one for this
    /// photograph; positive if they agree.
    pub agreement: Vec<f64>,
}

impl Likelihood {
    /// Multiplies several likelihoods, all inferred with the model of `learnt`.
    ///
    /// # Errors
    /// If there are fewer than two, they are of both kinds or of another model, or one contradicts
    /// the others.
    pub fn product(learnt: &LearntPosterior, all: &[Self]) -> Result<LikelihoodProduct, ProductError> {
        if all.len() < 2 {
            return Err(ProductError::Few);
        }
        if let Some(at) = all.iter().position(|one| !one.is_of(learnt)) {
            return Err(ProductError::Model(at));
        }
        let embeddings: Option<Vec<&Embedding>> =
            all.iter().map(|one| if let Self::Embedding(e) = one { Some(e) } else { None }).collect();
        let gaussians: Option<Vec<&Gaussian>> =
            all.iter().map(|one| if let Self::Gaussian(g) = one { Some(g) } else { None }).collect();
        let (likelihood, agreement) = match (embeddings, gaussians) {
            (Some(embeddings), _) => (
                Self::Embedding(sum(&embeddings)),
                agreement(all.len(), |some| {
                    let some: Vec<&Embedding> = some.iter().map(|&at| embeddings[at]).collect();
                    Some(learnt.prior.log_evidence(&sum(&some).sum))
                }),
            ),
            (_, Some(gaussians)) => {
                let likelihood = Gaussian::product(&gaussians).ok_or(ProductError::Damaged)?;
                let deviation = likelihood.deviation();
                (
                    Self::Gaussian(likelihood),
                    agreement(all.len(), |some| {
                        let some: Vec<&Gaussian> = some.iter().map(|&at| gaussians[at]).collect();
                        Gaussian::log_evidence(&some, deviation)
                    }),
                )
            }
            _ => return Err(ProductError::Mixed),
        };
        let agreement = agreement.ok_or(ProductError::Damaged)?;
        let worst = (0..all.len()).min_by(|a, b| agreement[*a].total_cmp(&agreement[*b])).unwrap_or(0);
        if agreement[worst] < MIN_SAME_MATERIAL_LOG_ODDS {
            return Err(ProductError::Contradiction { at: worst, ratio: agreement[worst] });
        }
        Ok(LikelihoodProduct { likelihood, agreement })
    }

    /// Whether the dimensions and numbers of the likelihood are valid for this model.
    pub fn is_of(&self, learnt: &LearntPosterior) -> bool {
        match self {
            Self::Embedding(embedding) => {
                learnt.prior.embeddings.first().is_some_and(|e| e.len() == embedding.sum.len())
                    && embedding.count > 0
                    && embedding.sum.iter().all(|v| v.is_finite())
            }
            Self::Gaussian(gaussian) => gaussian.is_of(&learnt.latent_space),
        }
    }
}

/// Returns `ln Z(all) - ln Z(others) - ln Z(it)` for each of `count` photographs.
///
/// `evidence` returns `ln Z` of a subset of them.
fn agreement(count: usize, evidence: impl Fn(&[usize]) -> Option<f64>) -> Option<Vec<f64>> {
    let all: Vec<usize> = (0..count).collect();
    let of_all = evidence(&all)?;
    let each = all.iter().map(|&at| {
        let others: Vec<usize> = all.iter().copied().filter(|other| *other != at).collect();
        Some(of_all - evidence(&others)? - evidence(&[at])?)
    });
    each.collect()
}

fn sum(embeddings: &[&Embedding]) -> Embedding {
    Embedding {
        sum: (0..embeddings[0].sum.len()).map(|i| embeddings.iter().map(|e| e.sum[i]).sum()).collect(),
        count: embeddings.iter().map(|e| e.count).fold(0, usize::saturating_add),
    }
}
