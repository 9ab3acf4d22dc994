//! Evidence of many candidates.

use rayon::prelude::*;

use super::{Evidence, EvidenceSettings, LightOperator, Marginal, MarginalError};
use crate::transfer::Bilinear;

impl Marginal<'_> {
    /// The evidence of candidates `0..count`, in order; `operator` makes the operator of one when its turn comes, so that no more than
    /// one for each thread is held. Candidates are worked on in parallel, and none depends on another.
    ///
    /// # Errors
    /// As [`Self::evidence`], for the first candidate that has none.
    pub fn score(
        &self,
        count: usize,
        operator: &(dyn Fn(usize) -> LightOperator + Sync),
        settings: &EvidenceSettings,
    ) -> Result<Vec<Evidence>, MarginalError> {
        let all: Vec<_> = (0..count).into_par_iter().map(|at| self.evidence(&operator(at), settings)).collect();
        all.into_iter().collect()
    }

    /// The evidence of candidate reflectances, each of K coefficients, in order.
    ///
    /// # Errors
    /// As [`Self::score`].
    pub fn score_reflectances(
        &self,
        bilinear: &Bilinear,
        candidates: &[Vec<f64>],
        settings: &EvidenceSettings,
    ) -> Result<Vec<Evidence>, MarginalError> {
        let operator = |at: usize| LightOperator::of_reflectance(bilinear, &candidates[at]);
        self.score(candidates.len(), &operator, settings)
    }
}
