//! Draws from the posterior predictive distribution, which includes the error of the model.

use rand::SeedableRng;
use rand_distr::{ChiSquared, Distribution};
use rand_pcg::Pcg64;

use super::spread::{DEGREES_OF_FREEDOM, error_scales};
use super::{LearntPosterior, sample};
use crate::inference::likelihood::Likelihood;
use crate::parallel;
use crate::reflectance::{BivariateTable, unit_field};

/// Draws materials with albedo one along the normal from the posterior predictive distribution.
///
/// Each draw is one of [`sample`] times `exp(t s f)`. Here `s` is the error scale of the cell,
/// and `f` is a smooth random field of variance one. `t` makes the product `t f` follow Student's
/// distribution in every cell. The quantiles of the draws are approximately those of
/// [`MaterialPosterior::quantiles`](super::MaterialPosterior::quantiles), which add the distances
/// of both errors from the median in quadrature.
///
/// The same seed gives the same draws. Returns `None` if the likelihood is that of another model.
pub(crate) fn predict(
    learnt: &LearntPosterior,
    likelihood: &Likelihood,
    count: usize,
    seed: u64,
) -> Option<Vec<BivariateTable>> {
    let scales = error_scales(likelihood);
    let squares = ChiSquared::new(DEGREES_OF_FREEDOM).expect("the number of degrees of freedom is positive");
    let mut rng = Pcg64::seed_from_u64(seed);
    let fields: Vec<Vec<f32>> = (0..count)
        .map(|_| {
            let t = (DEGREES_OF_FREEDOM / squares.sample(&mut rng)).sqrt() as f32;
            unit_field(&mut rng).into_iter().map(|f| t * f).collect()
        })
        .collect();
    let tables = sample(learnt, likelihood, count, seed)?;
    let with_errors = |at: usize| {
        let (table, field) = (&tables[at], &fields[at]);
        let cells = table.as_slice().iter().zip(&scales).zip(field);
        let values = cells.map(|((value, scale), f)| value * (scale * f).exp()).collect();
        BivariateTable::from_vec(values).with_normal_albedo(1.0).0
    };
    Some(parallel::map_range(tables.len(), with_errors))
}
