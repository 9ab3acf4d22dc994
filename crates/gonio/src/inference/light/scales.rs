//! Prior of light given its scales: variances and constants of the variational bound (eq. 5).

use std::f64::consts::TAU;

use crate::lighting::{CoefficientPrior, RectifiedGaussian, ScaleMixture};

/// Prior of one light coefficient, as the inference uses it.
#[derive(Clone, Copy, Debug)]
enum Density<'a> {
    Constant(f64),
    Mixture(&'a ScaleMixture),
    Gaussian { mean: f64, variance: f64 },
}

/// Priors of all M coefficients, the constant DC first.
#[derive(Clone, Debug)]
pub(super) struct Scales<'a> {
    densities: Vec<Density<'a>>,
    /// Index and prior of the rectified coefficient.
    pub(super) rectified: Option<(usize, RectifiedGaussian)>,
}

/// Gaussian prior for given expected squares of the light, and the constant that it adds to the
/// bound.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ConditionalPrior {
    /// `1 / d_m` with `d_m = sum_n r_n / s_n^2`; zero for a constant.
    pub(super) variances: Vec<f64>,
    /// `sum_m { sum_n r_n (log pi_n - log r_n - log(s_n^2) / 2) - log(d_m) / 2 }`, at most zero up
    /// to the weights; zero for mixtures of one component.
    pub(super) constant: f64,
}

impl<'a> Scales<'a> {
    /// Builds the priors. The first rectified prior is exact; any further one is replaced by the
    /// Gaussian of its mean and variance.
    pub(super) fn new(dc: f64, priors: &[&'a CoefficientPrior]) -> Self {
        let mut rectified = None;
        let mut densities = vec![Density::Constant(dc)];
        for (at, prior) in priors.iter().enumerate() {
            densities.push(match prior {
                CoefficientPrior::Mixture(mixture) => Density::Mixture(mixture),
                CoefficientPrior::Rectified(r) if rectified.is_none() => {
                    rectified = Some((at + 1, *r));
                    Density::Gaussian { mean: r.location, variance: r.variance }
                }
                CoefficientPrior::Rectified(r) => {
                    let moments = r.moments();
                    Density::Gaussian { mean: moments.mean, variance: moments.variance }
                }
            });
        }
        Self { densities, rectified }
    }

    /// Returns the priors of the first `m` coefficients alone.
    pub(super) fn first(&self, m: usize) -> Self {
        Self { densities: self.densities[..m].to_vec(), rectified: self.rectified.filter(|(at, _)| *at < m) }
    }

    /// Returns the means of the coefficients (M), that of the rectified one before rectification.
    pub(super) fn means(&self) -> Vec<f64> {
        let mean = |density: &Density<'_>| match *density {
            Density::Constant(value) => value,
            Density::Mixture(_) => 0.0,
            Density::Gaussian { mean, .. } => mean,
        };
        self.densities.iter().map(mean).collect()
    }

    /// Returns the initial expected squares.
    ///
    /// They are those of the prior, so that the widest scales are responsible.
    pub(super) fn prior_squares(&self) -> Vec<f64> {
        let square = |density: &Density<'_>| match *density {
            Density::Constant(value) => value * value,
            Density::Mixture(mixture) => mixture.variance(),
            Density::Gaussian { mean, variance } => mean * mean + variance,
        };
        self.densities.iter().map(square).collect()
    }

    /// Returns the Gaussian prior with the optimal responsibilities for given expected squares.
    ///
    /// For the expected squares `<l_m^2>` (M), `r_n` is proportional to
    /// `pi_n / s_n exp(-<l^2> / (2 s_n^2))`.
    pub(super) fn given(&self, squares: &[f64]) -> ConditionalPrior {
        let mut constant = 0.0;
        let variance = |(density, square): (&Density<'_>, &f64)| match density {
            Density::Constant(_) => 0.0,
            Density::Gaussian { variance, .. } => *variance,
            Density::Mixture(mixture) => {
                let (variance, lost) = gaussian_of(mixture, *square);
                constant += lost;
                variance
            }
        };
        let variances = self.densities.iter().zip(squares).map(variance).collect();
        ConditionalPrior { variances, constant }
    }

    /// Returns the expected squares whose responsibilities are optimal for every mixture by itself.
    ///
    /// All other coefficients have the posterior means and variances `light` and `posterior` (M
    /// each). Each coefficient is optimised by expectation maximisation in its cavity, from each
    /// component in turn. Coefficients that the image determines to a share of more than `weak`
    /// keep their value in `squares`.
    ///
    /// Expectation maximisation alone would keep a coefficient that the image does not determine in
    /// its present component, since the bound has a local maximum at each.
    pub(super) fn best_in_cavity(
        &self,
        given: &ConditionalPrior,
        light: &[f64],
        posterior: &[f64],
        squares: &[f64],
        weak: f64,
    ) -> Vec<f64> {
        let mut best = squares.to_vec();
        for (m, density) in self.densities.iter().enumerate() {
            let Density::Mixture(mixture) = density else { continue };
            let prior = given.variances[m];
            let cavity = Cavity::new(light[m], posterior[m], prior);
            if 1.0 - posterior[m] / prior > weak {
                continue;
            }
            let mut top = f64::NEG_INFINITY;
            for start in std::iter::once(prior).chain(mixture.variances.iter().copied()) {
                let mut variance = start;
                for _ in 0..CAVITY_STEPS {
                    variance = gaussian_of(mixture, cavity.square(variance)).0;
                }
                let square = cavity.square(variance);
                let (variance, constant) = gaussian_of(mixture, square);
                let bound = cavity.log_z(variance) + constant;
                if bound > top {
                    (top, best[m]) = (bound, square);
                }
            }
        }
        best
    }
}

/// Number of steps of the expectation maximisation of one coefficient.
const CAVITY_STEPS: usize = 6;

/// Returns `1 / d` and the constant of one mixture with the optimal responsibilities for `<l^2>`.
fn gaussian_of(mixture: &ScaleMixture, square: f64) -> (f64, f64) {
    let log_sum = mixture.log_density_of_square(square);
    let d: f64 = mixture.log_joint(square).zip(&mixture.variances).map(|(j, v)| (j - log_sum).exp() / v).sum();
    // log r_n = log pi_n + log N(<l^2>; s_n^2) - log_sum, inserted into the sum.
    (1.0 / d, log_sum + 0.5 * (TAU.ln() + square * d - d.ln()))
}

/// Information on one coefficient from everything but its own prior: `exp(h l - p l^2 / 2)`.
struct Cavity {
    p: f64,
    h: f64,
}

impl Cavity {
    /// Computes the cavity from the posterior of the coefficient under a Gaussian prior of mean
    /// zero.
    fn new(mean: f64, variance: f64, prior: f64) -> Self {
        let variance = variance.max(1e-14 * prior);
        Self { p: (1.0 / variance - 1.0 / prior).max(0.0), h: mean / variance }
    }

    /// Logarithm of its mass under `N(0, v)`.
    fn log_z(&self, v: f64) -> f64 {
        let q = 1.0 + self.p * v;
        0.5 * (self.h * self.h * v / q - q.ln())
    }

    /// `<l^2>` under its product with `N(0, v)`.
    fn square(&self, v: f64) -> f64 {
        let variance = v / (1.0 + self.p * v);
        variance + (self.h * variance).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_matches_the_sum_over_responsibilities() {
        let mixture = ScaleMixture { weights: vec![0.2, 0.5, 0.3], variances: vec![0.01, 0.3, 5.0] };
        let prior = CoefficientPrior::Mixture(mixture.clone());
        for square in [1e-6, 0.02, 1.0, 40.0] {
            let given = Scales::new(0.3, &[&prior]).given(&[0.09, square]);
            let joint: Vec<f64> = mixture.log_joint(square).map(f64::exp).collect();
            let r: Vec<f64> = joint.iter().map(|j| j / joint.iter().sum::<f64>()).collect();
            let d: f64 = r.iter().zip(&mixture.variances).map(|(r, v)| r / v).sum();
            let terms = r.iter().zip(&mixture.weights).zip(&mixture.variances).filter(|((r, _), _)| **r > 0.0);
            let want: f64 = terms.map(|((r, w), v)| r * ((w / r).ln() - 0.5 * v.ln())).sum::<f64>() - 0.5 * d.ln();
            assert!((given.variances[1] * d - 1.0).abs() < 1e-12 && given.variances[0] == 0.0);
            assert!((given.constant - want).abs() < 1e-10, "{square}: {} {want}", given.constant);
        }
    }

    #[test]
    fn constant_is_zero_for_one_component() {
        let prior = CoefficientPrior::Mixture(ScaleMixture { weights: vec![1.0], variances: vec![0.4] });
        let given = Scales::new(0.3, &[&prior, &prior]).given(&[0.09, 7.0, 1e-9]);
        assert!(given.constant.abs() < 1e-12);
        assert!(given.variances[1..].iter().all(|v| (v - 0.4).abs() < 1e-15));
    }
}
