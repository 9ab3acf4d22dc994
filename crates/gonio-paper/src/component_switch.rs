//! Switches of light coefficients between the components of their mixtures.
//!
//! For coefficients that the image does not determine, `C_KL` has a local minimum at nearly every
//! assignment to components. If a coefficient starts in a wide component, its expected square keeps
//! that component responsible. For each coefficient, coordinate descent from every component finds
//! the best of these minima.

use gonio::lighting::{CoefficientPrior, Moments, ScaleMixture};
use gonio_linalg::{axpy, dispatch, dot};

use super::ensemble::AllMoments;
use super::expectations::{Expectations, expected_precision};
use super::grams::{Columns, pull_weights};
use super::{Problem, VariationalParameters};

/// Largest number of fixed-point iterations of one coefficient in one component.
const ALONE: usize = 200;
/// Smallest decrease of the cost, in nats, for which a coefficient switches its component.
const GAIN: f64 = 1e-9;

/// `C_KL` as a function of one light coefficient with a mixture prior, given all else.
///
/// Up to a constant, it is `<log q> + S <l^2> / 2 - P <l> - <log p(l)>`, with the precision `S` and
/// the push `P` of the image.
#[derive(Clone, Copy)]
pub(super) struct CoordinateObjective<'a> {
    pub(super) mixture: &'a ScaleMixture,
    pub(super) precision: f64,
    pub(super) linear: f64,
}

impl CoordinateObjective<'_> {
    fn cost(&self, l: &Moments) -> f64 {
        let square = l.mean_square();
        l.mean_log + 0.5 * self.precision * square - self.linear * l.mean - self.mixture.log_density_of_square(square)
    }

    /// Returns mean and variance, given the precision of the prior.
    fn given(&self, prior: f64) -> Moments {
        Moments::gaussian(self.linear / (self.precision + prior), 1.0 / (self.precision + prior))
    }

    /// Returns the result of coordinate descent from the prior precision `prior`.
    fn descend(&self, prior: f64) -> Moments {
        let mut l = self.given(prior);
        for _ in 0..ALONE {
            let next = self.given(expected_precision(self.mixture, l.mean_square()));
            let has_converged = (next.variance - l.variance).abs() <= 1e-9 * l.variance;
            l = next;
            if has_converged {
                break;
            }
        }
        l
    }

    /// Returns the best result of descents from all components, and its cost.
    pub(super) fn best(&self) -> (Moments, f64) {
        let ends = self.mixture.variances.iter().map(|v| self.descend(1.0 / v)).map(|l| (l, self.cost(&l)));
        ends.min_by(|a, b| a.1.total_cmp(&b.1)).expect("a mixture has components")
    }

    /// Returns the cost of `l` minus that of the best descent, in nats.
    #[cfg(test)]
    pub(super) fn gain(&self, l: &Moments) -> f64 {
        self.cost(l) - self.best().1
    }
}

/// Minimises over the light coefficients with mixture priors, one after the other.
///
/// Each minimisation uses the results of those before it, so the cost never increases. `now` are
/// the expectations of `ensemble`; the returned expectations are those of the returned ensemble.
pub(super) fn component_switch(
    problem: &Problem<'_>,
    ensemble: &VariationalParameters,
    now: Expectations,
    columns: &Columns,
) -> (VariationalParameters, Expectations) {
    let mut next = ensemble.clone();
    let AllMoments { f, l, g, precision } = &now.moments;
    let (f_means, g2) = (now.moments.f_means(), g.mean_square());
    let stiffness = now.stiffness(problem);
    let (mut a, mut y) = (now.a.clone(), now.y.clone());
    let mut weights = vec![0.0; a.len()];
    for (m, prior) in problem.light.iter().enumerate().map(|(i, prior)| (i + 1, prior)) {
        let CoefficientPrior::Mixture(mixture) = prior else { continue };
        let column = columns.of(m);
        pull_weights(problem, &now, &a, &y, &mut weights);
        let pull = dispatch(|| dot(column, &weights));
        let stiffness = precision * g2 * stiffness[m];
        let alone =
            CoordinateObjective { mixture, precision: stiffness, linear: precision * pull + stiffness * l[m].mean };
        let (best, cost) = alone.best();
        if alone.cost(&l[m]) - cost <= GAIN {
            continue;
        }
        next.set_l(m, best.mean / best.variance, 1.0 / best.variance);
        let change = best.mean - l[m].mean;
        dispatch(|| axpy(change, column, &mut a));
        for (y, a) in y.iter_mut().zip(a.chunks_exact(f.len())) {
            *y = dot(&f_means, a);
        }
    }
    let now = now.after(problem, &next);
    (next, now)
}

/// Returns the one-coefficient problems of all light coefficients with mixture priors.
#[cfg(test)]
pub(super) fn coordinate_objectives<'a>(
    problem: &'a Problem<'_>,
    now: &'a Expectations,
) -> impl Iterator<Item = (usize, CoordinateObjective<'a>)> + 'a {
    let AllMoments { l, g, precision, .. } = &now.moments;
    let pull = now.pull(problem);
    problem.light.iter().enumerate().filter_map(move |(i, prior)| {
        let CoefficientPrior::Mixture(mixture) = prior else { return None };
        let m = i + 1;
        let stiffness = precision * g.mean_square() * pull.curvature[m];
        Some((
            m,
            CoordinateObjective {
                mixture,
                precision: stiffness,
                linear: precision * pull.light[m] + stiffness * l[m].mean,
            },
        ))
    })
}
