//! Light without negative texels.

use faer::Mat;
use gonio_linalg::{each_column, squared_norms};

use super::factor::Design;
use super::truncated::{Sites, truncated};
use super::{LightInference, LightInferenceError, LightPosterior};
use crate::sphere::Haar;

/// Number of times that the scales of the mixtures are re-estimated from the light without negative
/// texels.
const ROUNDS: usize = 1;

/// Largest number of steps of expectation propagation in each round, each a factorisation of M x M.
const MAX_STEPS: usize = 20;

/// Change of the light in one step, relative to its norm, at which it has converged.
const TOLERANCE: f64 = 1e-3;

/// Factor of the tolerance in all rounds but the last.
const EARLIER: f64 = 10.0;

/// A light without negative texels.
#[derive(Clone, Debug, PartialEq)]
pub struct NonNegativeLight {
    /// Coefficients (M), DC first, of a light of integral one.
    pub light: Vec<f64>,
    /// Posterior standard deviations of the light coefficients (M); that of DC is of its exposure.
    pub light_sd: Vec<f64>,
    /// Factor of the light, in units of the image.
    pub exposure: f64,
    /// Number of steps in all rounds.
    pub steps: usize,
    /// Whether the last round met the tolerance.
    pub converged: bool,
}

impl LightInference<'_> {
    /// Computes the mean of the light with texels `>= 0` under the Gaussian of a
    /// [`LightPosterior`].
    ///
    /// `posterior` must be that of `design`. The result is the mean of `g l` over
    /// `exp(-b |t - g B l|^2 / 2 - (g l / g_0 - mu)' D (g l / g_0 - mu) / 2)`, with `g_0` the
    /// exposure of the posterior, by expectation propagation with a bound at every texel. The
    /// scales, which determine `D`, are then re-estimated from the expected squares of that light.
    ///
    /// The exposure is re-estimated with the light, to compensate for the increase of negative
    /// texels to zero. The DC coefficient of `g l / g_0` is therefore free, with its constant as
    /// mean and standard deviation. The threshold of a rectified prior is omitted, since it follows
    /// from the non-negativity of the lights that the prior was learnt from.
    ///
    /// # Errors
    /// If values overflow.
    ///
    /// # Panics
    /// If M is not the square of a power of two, at least 4, or the design does not fit the image
    /// and the prior.
    pub(super) fn non_negative_light(
        &self,
        design: &Design,
        posterior: &LightPosterior,
    ) -> Result<NonNegativeLight, LightInferenceError> {
        let haar = square(design.matrix.ncols());
        let mut squares = posterior.state.squares.clone();
        let mut sites = None;
        let mut steps = 0;
        for round in 0.. {
            let (quadratic, linear) = self.on_texels(design, haar, posterior, &squares);
            let sites = sites.get_or_insert_with(|| Sites::of_mean(&quadratic, &texels(haar, &posterior.light)));
            // The scales depend little on the last percent of the light.
            let tolerance = if round == ROUNDS { 1.0 } else { EARLIER } * TOLERANCE;
            let found =
                truncated(&quadratic, &linear, sites, tolerance, MAX_STEPS).ok_or(LightInferenceError::NotFinite)?;
            steps += found.steps;
            let (light, brightness) = self.normalised(haar, found.mean)?;
            let light_sd: Vec<f64> =
                variances_of_coefficients(&found.root, haar).iter().map(|v| v.sqrt() / brightness).collect();
            if round == ROUNDS {
                let (exposure, converged) = (brightness * posterior.exposure, found.change <= TOLERANCE);
                return Ok(NonNegativeLight { light, light_sd, exposure, steps, converged });
            }
            squares = light.iter().zip(&light_sd).map(|(l, sd)| l * l + sd * sd).collect();
        }
        unreachable!("the last round returns")
    }

    /// `H` and `c` of the posterior `exp(-x'Hx / 2 + c'x)` of the texels of `g l / g_0`, for
    /// responsibilities from `<l_m^2>` (M).
    fn on_texels(
        &self,
        design: &Design,
        haar: Haar,
        posterior: &LightPosterior,
        squares: &[f64],
    ) -> (Mat<f64>, Vec<f64>) {
        let state = &posterior.state;
        let (g, rho) = (state.log_g.exp(), state.log_rho().exp());
        let means = self.scales.means();
        let mut precisions: Vec<f64> = self.scales.given(squares).variances.iter().map(|v| v.recip()).collect();
        precisions[0] = means[0].powi(-2);
        let target: Vec<f64> = self.target.iter().map(|t| rho * t / g).collect();
        let pulls = design.adjoint(&target);
        let linear: Vec<f64> = (0..pulls.len()).map(|m| pulls[m] + precisions[m] * means[m]).collect();
        // The inverse transform of all columns, then of all rows.
        let half = inverse_of_columns(design.precision(rho, &precisions), haar);
        (inverse_of_columns(half.transpose().to_owned(), haar), texels(haar, &linear))
    }

    /// Returns the coefficients of the texels scaled to the constant DC, and the divisor of this
    /// scaling.
    fn normalised(&self, haar: Haar, mut texels: Vec<f64>) -> Result<(Vec<f64>, f64), LightInferenceError> {
        haar.forward(&mut texels, &mut Vec::new());
        let dc = self.scales.means()[0];
        let brightness = texels[0] / dc;
        if !brightness.is_finite() || brightness <= 0.0 {
            return Err(LightInferenceError::NotFinite);
        }
        texels.iter_mut().for_each(|l| *l /= brightness);
        texels[0] = dc;
        Ok((texels, brightness))
    }
}

/// Returns the coefficients of a light (M) with its negative texels set to zero.
///
/// # Panics
/// If M is not the square of a power of two, at least 4.
pub fn cut_off_at_zero(light: &[f64]) -> Vec<f64> {
    let haar = square(light.len());
    let mut lit: Vec<f64> = texels(haar, light).into_iter().map(|x| x.max(0.0)).collect();
    haar.forward(&mut lit, &mut Vec::new());
    lit
}

fn square(m: usize) -> Haar {
    Haar::new(m.isqrt()).filter(|haar| haar.coefficients() == m).expect("coefficients of a square light")
}

/// Returns the texels of coefficients. Since the basis is orthonormal, it also maps gradients in
/// coefficients to gradients in texels.
fn texels(haar: Haar, coefficients: &[f64]) -> Vec<f64> {
    let mut x = coefficients.to_vec();
    haar.inverse(&mut x, &mut Vec::new());
    x
}

/// `W' P` for the transform `W` from texels to coefficients.
fn inverse_of_columns(mut p: Mat<f64>, haar: Haar) -> Mat<f64> {
    each_column(p.as_mut(), &|_, column| haar.inverse(column, &mut Vec::new()));
    p
}

/// The diagonal of `W R'R W'` (M) for a covariance `R'R` of texels.
fn variances_of_coefficients(root: &Mat<f64>, haar: Haar) -> Vec<f64> {
    let mut turned = root.transpose().to_owned();
    each_column(turned.as_mut(), &|_, column| haar.forward(column, &mut Vec::new()));
    squared_norms(turned.transpose().to_owned().as_ref())
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::inference::Hyperparameters;
    use crate::inference::light::InferenceSettings;
    use crate::lighting::{CoefficientPrior, LightGrid, LightPrior, ScaleMixture};
    use crate::testing::on_threads;

    /// Light of a bright and a dimmer lamp in the dark, observed through a blurring design with
    /// noise.
    struct Lamps {
        light: Vec<f64>,
        design: Design,
        target: Vec<f64>,
    }

    fn lamps(side: usize, noise: f64) -> Lamps {
        let m = side * side;
        let mut texels = vec![0.02; m];
        texels[3 * side + 2] = 1.0;
        texels[side * side / 2 + 5] = 0.5;
        let haar = Haar::new(side).unwrap();
        let scale = LightGrid::normalised_dc() * side as f64 / texels.iter().sum::<f64>();
        texels.iter_mut().for_each(|x| *x *= scale);
        haar.forward(&mut texels, &mut Vec::new());
        let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
        let rows = m / 2;
        let mut entries = Vec::new();
        for _ in 0..rows {
            let (u, v) = (rng.random_range(0.0..side as f64), rng.random_range(0.0..side as f64));
            let blob = |at: usize| {
                let (x, y) = ((at % side) as f64 + 0.5 - u, (at / side) as f64 + 0.5 - v);
                (-(x * x + y * y) / 3.0).exp()
            };
            let mut row: Vec<f64> = (0..m).map(blob).collect();
            haar.forward(&mut row, &mut Vec::new());
            entries.extend(row);
        }
        let mut target: Vec<f64> =
            entries.chunks(m).map(|b| b.iter().zip(&texels).map(|(b, l)| b * l).sum::<f64>()).collect();
        let rms = (target.iter().map(|t| t * t).sum::<f64>() / rows as f64).sqrt();
        for t in &mut target {
            let z: f64 = StandardNormal.sample(&mut rng);
            *t += noise * rms * z;
        }
        Lamps { light: texels, design: Design::of_rows(rows, m, &entries, None), target }
    }

    /// Gaussian prior, which does not model lamps: the mean is negative beside them.
    fn gaussian_prior(side: usize) -> LightPrior {
        let mut prior = crate::testing::toy_prior(side);
        for group in &mut prior.groups {
            if let CoefficientPrior::Mixture(mixture) = group {
                *mixture = ScaleMixture { weights: vec![1.0], variances: vec![mixture.variance()] };
            }
        }
        prior
    }

    fn lit(l: &[f64]) -> Vec<f64> {
        texels(square(l.len()), l)
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn removes_negative_lobes_and_improves_the_light() {
        for noise in [0.01, 0.05, 0.2] {
            let Lamps { light, design, target } = lamps(8, noise);
            let prior = gaussian_prior(8);
            let inference = LightInference::new(&target, 64, &prior, Hyperparameters::default()).unwrap();
            let posterior = inference.posterior(&design, &InferenceSettings::default(), None).unwrap();
            let lowest = lit(&posterior.light).into_iter().fold(f64::MAX, f64::min);
            let got = inference.non_negative_light(&design, &posterior).unwrap();
            assert!(got.converged, "{noise}: {} steps", got.steps);
            let top = lit(&got.light).into_iter().fold(0.0, f64::max);
            assert!(lowest < -0.02 * top, "{noise}: nothing to remove: {lowest} of {top}");
            assert!(lit(&got.light).iter().all(|x| *x > -1e-12 * top));
            assert_eq!(got.light[0], posterior.light[0]);
            // The prior, which does not model lamps, dominates where the image is uninformative.
            let (before, after) = (distance(&posterior.light, &light), distance(&got.light, &light));
            assert!(after < if noise > 0.1 { 1.01 * before } else { before }, "{noise}: {before} {after}");
        }
    }

    #[test]
    fn result_is_independent_of_threads() {
        let Lamps { design, target, .. } = lamps(16, 0.05);
        let prior = crate::testing::toy_prior(16);
        let run = || {
            let inference = LightInference::new(&target, 256, &prior, Hyperparameters::default()).unwrap();
            let settings = InferenceSettings { max_steps: 3, ..Default::default() };
            let posterior = inference.posterior(&design, &settings, None).unwrap();
            inference.non_negative_light(&design, &posterior).unwrap()
        };
        assert_eq!(on_threads(1, run), on_threads(3, run));
    }

    #[test]
    fn cut_off_texels_are_zero() {
        let light = [1.0, -3.0, 0.2, 0.1];
        let (before, after) = (lit(&light), lit(&cut_off_at_zero(&light)));
        assert!(before.iter().any(|x| *x < 0.0));
        assert!(before.iter().zip(&after).all(|(b, a)| (b.max(0.0) - a).abs() < 1e-12));
    }

    #[test]
    fn keeps_a_positive_light() {
        let side = 4;
        let texels: Vec<f64> = (0..16).map(|i| 1.0 + 0.03 * f64::from(i)).collect();
        let mut light = texels;
        let scale = LightGrid::normalised_dc() * side as f64 / light.iter().sum::<f64>();
        light.iter_mut().for_each(|x| *x *= scale);
        Haar::new(side).unwrap().forward(&mut light, &mut Vec::new());
        let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
        let entries: Vec<f64> = (0..40 * 16).map(|_| rng.random_range(-1.0..1.0)).collect();
        let target: Vec<f64> =
            entries.chunks(16).map(|b| b.iter().zip(&light).map(|(b, l)| b * l).sum::<f64>()).collect();
        let prior = gaussian_prior(side);
        let inference = LightInference::new(&target, 16, &prior, Hyperparameters::default()).unwrap();
        let design = Design::of_rows(40, 16, &entries, None);
        let posterior = inference.posterior(&design, &InferenceSettings::default(), None).unwrap();
        let got = inference.non_negative_light(&design, &posterior).unwrap();
        let got = got.light;
        assert!(distance(&got, &posterior.light) < 1e-3 * distance(&got, &[0.0; 16]), "{got:?} {:?}", posterior.light);
    }
}
