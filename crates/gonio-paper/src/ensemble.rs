//! The approximating distributions q of eqs. 12 to 14, and the intermediate variables Phi that
//! determine them.

use gonio::lighting::{CoefficientPrior, Moments, RectifiedGaussian};
use rand::RngExt;
use rand_distr::{Distribution, Exp1, StandardNormal};
use rand_pcg::Pcg64;

use super::Problem;

/// `Phi`: natural parameters of all q. Light entries cover `m >= 1`; DC is fixed.
///
/// Layout of the flat vector: `Phi_1` (K), `Phi_2` (K), `Phi_3` (M - 1), `Phi_4` (M - 1), `Phi_5`,
/// `Phi_6`, `Phi_7`.
#[derive(Clone, Debug, PartialEq)]
pub struct VariationalParameters {
    k: usize,
    light: usize,
    phi: Vec<f64>,
}

/// One of the factors of q.
#[cfg(test)]
#[derive(Clone, Copy, Debug)]
pub(crate) enum Part {
    F(usize),
    L(usize),
    G,
    Noise,
}

/// Means and variances of all unknowns, from [`VariationalParameters::moments`].
#[derive(Clone, Debug)]
pub(crate) struct AllMoments {
    pub(crate) f: Vec<Moments>,
    /// Light coefficients (M), the fixed DC first.
    pub(crate) l: Vec<Moments>,
    pub(crate) g: Moments,
    /// `<sigma^-2>`.
    pub(crate) precision: f64,
}

impl AllMoments {
    pub(crate) fn f_means(&self) -> Vec<f64> {
        self.f.iter().map(|m| m.mean).collect()
    }

    pub(crate) fn l_means(&self) -> Vec<f64> {
        self.l.iter().map(|m| m.mean).collect()
    }
}

impl VariationalParameters {
    /// Draws a random start: a random reflectance and a random light, all variances `variance`
    /// (paper 3.4: 0.1, "relatively large"); exposure `u = 1, w = 10`; `<sigma^-2> = 1`.
    pub fn random(problem: &Problem<'_>, variance: f64, rng: &mut Pcg64) -> Self {
        let f: Vec<f64> = if problem.examples.is_empty() {
            problem.rates.iter().map(|rate| <Exp1 as Distribution<f64>>::sample(&Exp1, rng) / rate).collect()
        } else {
            problem.examples[rng.random_range(0..problem.examples.len())].clone()
        };
        let l: Vec<f64> = problem.light.iter().map(|prior| draw(prior, rng)).collect();
        Self::at(&f, &l, variance)
    }

    /// Ensemble with the given means, all variances `variance`, exposure and noise as in
    /// [`Self::random`].
    pub fn at(f: &[f64], l: &[f64], variance: f64) -> Self {
        let precision = 1.0 / variance;
        let log_precision = precision.ln();
        let mut phi: Vec<f64> = f.iter().map(|f| f * precision).collect();
        phi.extend(f.iter().map(|_| log_precision));
        phi.extend(l.iter().map(|l| l * precision));
        phi.extend(l.iter().map(|_| log_precision));
        phi.extend([0.0, 1.0 / 10.0, (0.1_f64).ln()]);
        Self { k: f.len(), light: l.len(), phi }
    }

    /// `self + alpha * direction`.
    pub(crate) fn moved(&self, alpha: f64, direction: &[f64]) -> Self {
        let phi = self.phi.iter().zip(direction).map(|(p, d)| p + alpha * d).collect();
        Self { phi, ..*self }
    }

    /// `self - other`, as a direction.
    pub(crate) fn minus(&self, other: &Self) -> Vec<f64> {
        self.phi.iter().zip(&other.phi).map(|(a, b)| a - b).collect()
    }

    /// Position of `Phi_5` in the flat vector.
    pub(crate) fn noise_index(&self) -> usize {
        2 * (self.k + self.light)
    }

    /// `Phi_5 = log(b_p / a_p)`, minus the log of `<sigma^-2>`.
    pub(crate) fn log_noise(&self) -> f64 {
        self.phi[self.noise_index()]
    }

    pub(crate) fn set_log_noise(&mut self, value: f64) {
        let at = self.noise_index();
        self.phi[at] = value;
    }

    /// Sets `u / w` and `1 / w` of reflectance coefficient `k`.
    pub(crate) fn set_f(&mut self, k: usize, natural: f64, precision: f64) {
        self.phi[k] = natural;
        self.phi[self.k + k] = precision.ln();
    }

    /// Sets `u / w` and `1 / w` of light coefficient `m >= 1`.
    pub(crate) fn set_l(&mut self, m: usize, natural: f64, precision: f64) {
        let at = 2 * self.k + m - 1;
        self.phi[at] = natural;
        self.phi[at + self.light] = precision.ln();
    }

    /// Sets `u / w` and `1 / w` of the exposure.
    pub(crate) fn set_g(&mut self, natural: f64, precision: f64) {
        let at = self.noise_index() + 1;
        self.phi[at] = natural;
        self.phi[at + 1] = precision.ln();
    }

    /// `u / w` and `1 / w` of reflectance (K) and exposure.
    pub(crate) fn natural(&self) -> Vec<(f64, f64)> {
        let g = self.noise_index() + 1;
        let pairs = (0..self.k).map(|at| (at, at + self.k)).chain(std::iter::once((g, g + 1)));
        pairs.map(|(natural, log_precision)| (self.phi[natural], self.phi[log_precision].exp())).collect()
    }

    /// `u` of reflectance (K), light (M - 1) and exposure, and `Phi_5`.
    pub(crate) fn locations(&self) -> Vec<f64> {
        let u = self.pairs().map(|(natural, log_precision)| self.phi[natural] / self.phi[log_precision].exp());
        u.chain(std::iter::once(self.log_noise())).collect()
    }

    /// Returns the ensemble with other [`Self::locations`] and the same `w`.
    pub(crate) fn with_locations(&self, locations: &[f64]) -> Self {
        let mut next = self.clone();
        for ((natural, log_precision), location) in self.pairs().zip(locations) {
            next.phi[natural] = location * self.phi[log_precision].exp();
        }
        next.set_log_noise(locations[locations.len() - 1]);
        next
    }

    /// Indices of `u / w` and `log(1 / w)` in the flat vector.
    fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (k, light, noise) = (self.k, self.light, self.noise_index());
        let f = (0..k).map(move |at| (at, at + k));
        let l = (0..light).map(move |at| (2 * k + at, 2 * k + light + at));
        f.chain(l).chain(std::iter::once((noise + 1, noise + 2)))
    }

    /// Copies the parameters of one distribution from another ensemble.
    #[cfg(test)]
    pub(crate) fn copy(&mut self, other: &Self, part: Part) {
        for at in self.indices_of(part) {
            self.phi[at] = other.phi[at];
        }
    }

    /// Indices in the flat vector of the parameters of one distribution.
    #[cfg(test)]
    pub(crate) fn indices_of(&self, part: Part) -> Vec<usize> {
        let noise = self.noise_index();
        match part {
            Part::F(k) => vec![k, self.k + k],
            Part::L(m) => vec![2 * self.k + m - 1, 2 * self.k + self.light + m - 1],
            Part::G => vec![noise + 1, noise + 2],
            Part::Noise => vec![noise],
        }
    }

    fn rectified(&self, natural: usize, log_precision: usize, threshold: f64) -> RectifiedGaussian {
        let variance = (-self.phi[log_precision]).exp();
        RectifiedGaussian { location: self.phi[natural] * variance, variance, threshold }
    }

    /// Scales the reflectance by `c` and the exposure by `1 / c`: `u -> c u, w -> c^2 w` and the
    /// inverse.
    pub(crate) fn rescale(&mut self, c: f64) {
        for k in 0..self.k {
            self.phi[k] /= c;
            self.phi[self.k + k] -= 2.0 * c.ln();
        }
        let g = self.noise_index() + 1;
        self.phi[g] *= c;
        self.phi[g + 1] += 2.0 * c.ln();
    }

    /// Moments of reflectance coefficient `k`.
    pub(crate) fn f_moments(&self, k: usize) -> Moments {
        self.rectified(k, self.k + k, 0.0).moments()
    }

    /// Moments of light coefficient `m >= 1`.
    pub(crate) fn l_moments(&self, m: usize, prior: &CoefficientPrior) -> Moments {
        let at = 2 * self.k + m - 1;
        match prior {
            CoefficientPrior::Rectified(p) => self.rectified(at, at + self.light, p.threshold).moments(),
            CoefficientPrior::Mixture(_) => {
                let variance = (-self.phi[at + self.light]).exp();
                Moments::gaussian(self.phi[at] * variance, variance)
            }
        }
    }

    /// Moments of the exposure.
    pub(crate) fn g_moments(&self) -> Moments {
        let at = self.noise_index() + 1;
        self.rectified(at, at + 1, 0.0).moments()
    }

    /// All moments.
    pub(crate) fn moments(&self, problem: &Problem<'_>) -> AllMoments {
        let dc = Moments { mean: problem.dc, variance: 0.0, mean_log: 0.0 };
        let l = problem.light.iter().enumerate().map(|(i, prior)| self.l_moments(i + 1, prior));
        AllMoments {
            f: (0..self.k).map(|k| self.f_moments(k)).collect(),
            l: std::iter::once(dc).chain(l).collect(),
            g: self.g_moments(),
            precision: (-self.log_noise()).exp(),
        }
    }
}

/// Draws from the prior of a light coefficient.
fn draw(prior: &CoefficientPrior, rng: &mut Pcg64) -> f64 {
    match prior {
        CoefficientPrior::Mixture(mixture) => {
            let mut u: f64 = rng.random_range(0.0..1.0);
            let component = mixture.weights.iter().position(|w| {
                u -= w;
                u < 0.0
            });
            let variance = mixture.variances[component.unwrap_or(mixture.variances.len() - 1)];
            let z: f64 = StandardNormal.sample(rng);
            z * variance.sqrt()
        }
        CoefficientPrior::Rectified(r) => loop {
            let z: f64 = StandardNormal.sample(rng);
            let x = r.location + z * r.variance.sqrt();
            if x >= r.threshold {
                return x;
            }
            // If the location is far below the threshold, rejection is too slow, and the
            // exponential tail is accurate enough.
            if r.location < r.threshold - 3.0 * r.variance.sqrt() {
                let e: f64 = Exp1.sample(rng);
                return r.threshold + e * r.variance / (r.threshold - r.location);
            }
        },
    }
}
