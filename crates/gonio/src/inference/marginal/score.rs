//! Evidence of many candidates.

use rayon::prelude::*;

use super::{Evidence, EvidenceSettings, LightOperator, Marginal, MarginalError};
use crate::transfer::Bilinear;

impl Marginal<'_> {
    /// The evidence of candidates `0..count`, in order; `operator` makes the operator of one when
    /// its turn comes, so that no more than one for each thread is held. Candidates are worked on
    /// in parallel, and none depends on another.
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

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::inference::tests::planted;

    /// Random reflectances and the planted one, at noise of a tenth: the planted one is found.
    #[test]
    fn the_true_candidate_wins() {
        for seed in [1, 2, 3] {
            let planted = planted(200, 3, 0.1, seed);
            let problem = planted.problem();
            let marginal = Marginal::of_problem(&problem);
            let mut rng = Pcg64::seed_from_u64(seed);
            let mut candidates: Vec<Vec<f64>> =
                (0..15).map(|_| (0..3).map(|_| rng.random_range(0.0..1.5)).collect()).collect();
            candidates.insert(4, planted.f.clone());
            let all = marginal
                .score_reflectances(&planted.image.bilinear, &candidates, &EvidenceSettings::default())
                .unwrap();
            let best = (0..16).max_by(|a, b| all[*a].objective.total_cmp(&all[*b].objective)).unwrap();
            assert_eq!(best, 4, "{:?}", all.iter().map(|e| e.objective).collect::<Vec<_>>());
            assert!(
                (all[4].noise / (planted.image.energy() / 200.0).sqrt() / 0.1 - 1.0).abs() < 0.2,
                "{}",
                all[4].noise
            );
        }
    }
}
