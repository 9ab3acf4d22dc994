//! Light without negative texels.

use super::factor::Factor;
use super::{Evidence, LightOperator, Marginal, MarginalError};
use crate::sphere::Haar;

/// How [`Marginal::non_negative_light`] iterates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonNegativeSettings {
    /// Iterations at most.
    pub max_iterations: usize,
    /// Converged when both residuals are below this share of the norm of the light.
    pub tolerance: f64,
}

impl Default for NonNegativeSettings {
    fn default() -> Self {
        Self { max_iterations: 500, tolerance: 1e-4 }
    }
}

/// Iterations between two looks at the penalty.
const BALANCE: usize = 20;

impl Marginal<'_> {
    /// The most probable light with texels `>= 0` under the Gaussian of an [`Evidence`] found for `operator`: the
    /// coefficients (M) that minimise `b |t - g B l|^2 / 2 + (l - mu)' D (l - mu) / 2` on the simplex that the fixed DC
    /// leaves of them.
    ///
    /// By the alternating direction method of multipliers, between the quadratic, solved by one factorisation of `S`,
    /// and the projection on the simplex (the Haar basis is orthonormal). The result is feasible at any number of
    /// iterations. The threshold of a rectified prior, which the non-negative lights it was learnt from imply, is left
    /// out.
    ///
    /// # Errors
    /// As [`Self::evidence`].
    ///
    /// # Panics
    /// If M is not the square of a power of two, at least 4, or the operator is not of the image and prior.
    pub fn non_negative_light(
        &self,
        operator: &LightOperator,
        evidence: &Evidence,
        settings: &NonNegativeSettings,
    ) -> Result<Vec<f64>, MarginalError> {
        let m = operator.m();
        let haar =
            Haar::new(m.isqrt()).filter(|haar| haar.coefficients() == m).expect("coefficients of a square light");
        let state = &evidence.state;
        let (g, rho) = (state.log_g.exp(), (state.log_b + 2.0 * state.log_g).exp());
        let target: Vec<f64> = self.target.iter().map(|t| t / g).collect();
        let means = self.scales.means();
        let variances = self.scales.given(&state.squares).variances;
        let design = self.design(operator);
        let mut scratch = Vec::new();
        let mut feasible = |l: &[f64]| {
            let mut x = l.to_vec();
            haar.inverse(&mut x, &mut scratch);
            project(&mut x, means[0] * haar.coefficients().isqrt() as f64);
            haar.forward(&mut x, &mut scratch);
            x[0] = means[0];
            x
        };
        // Start between what prior and image say of a coefficient: as stiff as the typical posterior.
        let posterior: f64 = evidence.light_sd.iter().map(|sd| sd * sd).sum::<f64>() / m as f64;
        let mut penalty = 1.0 / posterior.max(1e-300);
        let mut z = feasible(&evidence.light);
        let mut w = vec![0.0; m];
        let norm = z.iter().map(|z| z * z).sum::<f64>().sqrt();
        let mut iterations = 0;
        while iterations < settings.max_iterations {
            // Under precisions D + penalty.
            let stiffened: Vec<f64> = variances.iter().map(|v| v / (1.0 + penalty * v)).collect();
            let factor = Factor::new(&design, &stiffened, rho).ok_or(MarginalError::NotFinite)?;
            let (mut primal, mut dual) = (0.0, 0.0);
            for _ in 0..BALANCE {
                let centre: Vec<f64> = (0..m)
                    .map(|i| {
                        let share = penalty * stiffened[i];
                        (1.0 - share) * means[i] + share * (z[i] - w[i])
                    })
                    .collect();
                let image = design.times(&centre);
                let misfit: Vec<f64> = target.iter().zip(image).map(|(t, y)| t - y).collect();
                let pull = factor.gain(&factor.solve(&misfit));
                // Over-relaxed by the usual factor.
                let relaxed: Vec<f64> = (0..m).map(|i| 1.6 * (centre[i] + pull[i]) - 0.6 * z[i]).collect();
                let raised: Vec<f64> = relaxed.iter().zip(&w).map(|(l, w)| l + w).collect();
                let next = feasible(&raised);
                (primal, dual) = (0.0, 0.0);
                for i in 0..m {
                    primal += (centre[i] + pull[i] - next[i]).powi(2);
                    dual += (next[i] - z[i]).powi(2);
                    w[i] = raised[i] - next[i];
                }
                z = next;
                iterations += 1;
            }
            (primal, dual) = (primal.sqrt(), dual.sqrt());
            if primal.max(dual) < settings.tolerance * norm {
                break;
            }
            let ratio = (primal / dual.max(1e-300)).sqrt().clamp(0.1, 10.0);
            if !(0.5..2.0).contains(&ratio) {
                penalty *= ratio;
                w.iter_mut().for_each(|w| *w /= ratio);
            }
        }
        Ok(z)
    }
}

/// Projects on `x >= 0` with a given positive sum: the same shift for all, then cut off at zero.
fn project(x: &mut [f64], sum: f64) {
    let mut sorted = x.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let (mut total, mut shift) = (0.0, 0.0);
    for (count, value) in sorted.iter().enumerate() {
        total += value;
        let candidate = (total - sum) / (count + 1) as f64;
        if *value <= candidate {
            break;
        }
        shift = candidate;
    }
    x.iter_mut().for_each(|x| *x = (*x - shift).max(0.0));
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::inference::Hyper;
    use crate::inference::marginal::EvidenceSettings;
    use crate::inference::marginal::factor::{Design, Form};
    use crate::lighting::{LightGrid, LightPrior};

    #[test]
    fn the_projection_is_on_the_simplex() {
        let mut x = vec![0.5, -1.0, 0.9, 0.1];
        project(&mut x, 1.0);
        for (got, want) in x.iter().zip([0.3, 0.0, 0.7, 0.0]) {
            assert!((got - want).abs() < 1e-15, "{x:?}");
        }
        let mut inside = vec![0.25, 0.75];
        project(&mut inside, 1.0);
        assert_eq!(inside, [0.25, 0.75]);
    }

    /// A light of one bright and one lesser lamp in the dark, seen through a blurring operator with noise.
    struct Lamps {
        light: Vec<f64>,
        operator: LightOperator,
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
        Lamps { light: texels, operator: LightOperator::from_rows(rows, m, &entries), target }
    }

    /// Under Gaussian light, which knows nothing of lamps: the mean swings below zero beside them.
    fn blurred<'a>(target: &[f64], prior: &'a LightPrior) -> Marginal<'a> {
        Marginal::new(target, 0.0, target.len(), 64, prior, Hyper::default()).unwrap().with_gaussian_light()
    }

    fn texels(l: &[f64]) -> Vec<f64> {
        let mut x = l.to_vec();
        Haar::new(l.len().isqrt()).unwrap().inverse(&mut x, &mut Vec::new());
        x
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn negative_lobes_vanish_and_the_light_is_no_worse() {
        for noise in [0.01, 0.05, 0.2] {
            let Lamps { light, operator, target } = lamps(8, noise);
            let prior = crate::transfer::toy_prior(8);
            let marginal = blurred(&target, &prior);
            let evidence = marginal.evidence(&operator, &EvidenceSettings::default()).unwrap();
            let lowest = texels(&evidence.light).into_iter().fold(f64::MAX, f64::min);
            let got = marginal.non_negative_light(&operator, &evidence, &NonNegativeSettings::default()).unwrap();
            let top = texels(&got).into_iter().fold(0.0, f64::max);
            assert!(lowest < -0.02 * top, "{noise}: nothing to remove: {lowest} of {top}");
            assert!(texels(&got).iter().all(|x| *x > -1e-12 * top));
            assert_eq!(got[0], evidence.light[0]);
            let (before, after) = (distance(&evidence.light, &light), distance(&got, &light));
            assert!(after < before, "{noise}: {before} {after}");
        }
    }

    /// The conditions of Karush, Kuhn and Tucker: the gradient per texel is the same where there is light, and no lower
    /// where there is none.
    #[test]
    fn the_result_is_the_constrained_minimum() {
        let Lamps { operator, target, .. } = lamps(8, 0.05);
        let prior = crate::transfer::toy_prior(8);
        let marginal = blurred(&target, &prior);
        let evidence = marginal.evidence(&operator, &EvidenceSettings::default()).unwrap();
        let settings = NonNegativeSettings { max_iterations: 20_000, tolerance: 1e-9 };
        let got = marginal.non_negative_light(&operator, &evidence, &settings).unwrap();
        // The default stops early, but near.
        let rough = marginal.non_negative_light(&operator, &evidence, &NonNegativeSettings::default()).unwrap();
        let (off, moved) = (distance(&rough, &got), distance(&evidence.light, &got));
        assert!(off < 0.02 * moved, "{off} {moved}");
        let (g, b) = (evidence.state.log_g.exp(), evidence.state.log_b.exp());
        let design = Design::new(operator.matrix.clone(), Form::Rows);
        let residual: Vec<f64> =
            marginal.target.iter().zip(design.times(&got)).map(|(t, y)| b * g * (g * y - t)).collect();
        let means = marginal.scales.means();
        let variances = marginal.scales.given(&evidence.state.squares).variances;
        let mut gradient = design.adjoint(&residual);
        for i in 1..64 {
            gradient[i] += (got[i] - means[i]) / variances[i];
        }
        // Whatever DC pulls is the constraint's.
        gradient[0] = 0.0;
        let (pull, light) = (texels(&gradient), texels(&got));
        let top = light.iter().copied().fold(0.0, f64::max);
        let lit: Vec<f64> = pull.iter().zip(&light).filter(|(_, x)| **x > 1e-6 * top).map(|(p, _)| *p).collect();
        let level = lit.iter().sum::<f64>() / lit.len() as f64;
        let scale = pull.iter().fold(0.0_f64, |top, p| top.max((p - level).abs()));
        assert!(lit.len() < 60 && scale > 0.0, "{} lit, {scale}", lit.len());
        assert!(lit.iter().all(|p| (p - level).abs() < 1e-3 * scale), "{level} {scale} {lit:?}");
        assert!(pull.iter().all(|p| *p > level - 1e-3 * scale), "{level} {scale} {pull:?}");
    }

    #[test]
    fn a_light_that_is_positive_anyway_stays() {
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
        let prior = crate::transfer::toy_prior(side);
        let marginal = Marginal::new(&target, 0.0, 40, 16, &prior, Hyper::default()).unwrap().with_gaussian_light();
        let operator = LightOperator::from_rows(40, 16, &entries);
        let evidence = marginal.evidence(&operator, &EvidenceSettings::default()).unwrap();
        let got = marginal.non_negative_light(&operator, &evidence, &NonNegativeSettings::default()).unwrap();
        assert!(distance(&got, &evidence.light) < 1e-3 * distance(&got, &[0.0; 16]), "{got:?} {:?}", evidence.light);
    }
}
