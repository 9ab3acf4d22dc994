//! How the bound changes with reflectance, exposure and noise, the scales fixed.
//!
//! Where expectation maximisation has converged the bound does not change with the
//! responsibilities, so that this is also the gradient of the maximum over them.

use super::point::Point;
use super::{Evidence, EvidenceSettings, LightOperator, Marginal, MarginalError};
use crate::transfer::Bilinear;
use crate::transfer::kernels::dot;

/// Derivatives of [`Evidence::bound`] for the responsibilities that the evidence ended with.
#[derive(Clone, Debug, PartialEq)]
pub struct Gradient {
    /// With respect to the entries of `B`, row by row (r x M).
    pub operator: Vec<f64>,
    /// With respect to `log g`, `b` fixed.
    pub log_exposure: f64,
    /// With respect to `log b`, `g` fixed.
    pub log_precision: f64,
}

impl Gradient {
    /// With respect to `f` (K), by one contraction with all `A_k`: `sum_im (dF/dB)_im A_imk`.
    ///
    /// # Panics
    /// If the operator has other rows or light coefficients.
    pub fn reflectance(&self, bilinear: &Bilinear) -> Vec<f64> {
        bilinear.reflectance_adjoint(&self.operator)
    }
}

impl Point<'_> {
    /// `dF/dB = b g (t - g B<l>) <l>' - b g^2 B Sigma`, `Sigma` after the cut: by Fisher's identity
    /// the expectation of the derivative of `log p(t, l)` under the posterior of the light.
    pub(super) fn gradient(&mut self, marginal: &Marginal<'_>) -> Gradient {
        self.find_variances();
        let (g, b) = (self.state.log_g.exp(), self.state.log_b.exp());
        let rho = b * g * g;
        let sensitivity = self.factor.sensitivity();
        let residual: Vec<f64> = marginal.target.iter().zip(&self.image).map(|(t, y)| t - g * y).collect();
        let m = self.light.len();
        let mut operator = vec![0.0; residual.len() * m];
        for (i, row) in operator.chunks_exact_mut(m).enumerate() {
            for (j, (out, l)) in row.iter_mut().zip(&self.light).enumerate() {
                *out = b * g * residual[i] * l - sensitivity[(i, j)];
            }
            if let Some(cut) = &self.cut {
                let factor = rho * cut.lost_variance * cut.image[i];
                row.iter_mut().zip(&cut.regression).for_each(|(out, k)| *out += factor * k);
            }
            row.iter_mut().for_each(|out| *out *= marginal.weights[i]);
        }
        let error = dot(&residual, &residual) + marginal.outside;
        Gradient {
            operator,
            log_exposure: b * g * dot(&residual, &self.image) - self.effective(),
            log_precision: 0.5 * (marginal.pixels - b * error - self.effective()),
        }
    }
}

impl Marginal<'_> {
    /// The gradient of the bound at an operator whose evidence is known: one factorisation and two
    /// solves of `r^2 M` flops.
    ///
    /// # Errors
    /// As [`Self::evidence`].
    pub fn gradient(&self, operator: &LightOperator, evidence: &Evidence) -> Result<Gradient, MarginalError> {
        let design = self.design(operator);
        let settings = EvidenceSettings::default();
        let mut point =
            Point::new(self, &design, evidence.state.clone(), &settings, true).ok_or(MarginalError::NotFinite)?;
        Ok(point.gradient(self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::marginal::point::State;
    use crate::inference::marginal::tests::{Toy, known, mixed};
    use crate::inference::tests::planted;

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        for (rows, m) in [(8, 16), (40, 9)] {
            let mut toy = Toy::new(rows, mixed(m), 0.3, 5);
            toy.relative = (0..rows).map(|i| 0.5 + 0.1 * i as f64).collect();
            let marginal = toy.marginal();
            let at = EvidenceSettings { max_steps: 3, ..Default::default() };
            let evidence = toy.evidence(&at);
            let value = |operator: &LightOperator, by_g: f64, by_b: f64| {
                let State { squares, log_g, log_b } = evidence.state.clone();
                let (g, b) = ((log_g + by_g).exp(), (log_b + by_b).exp());
                let state = State { squares, log_g: g.ln(), log_b: b.ln() };
                let fixed = EvidenceSettings { max_steps: 0, ..known(g, b) };
                let design = marginal.design(operator);
                marginal.climb(&design, state, &fixed).unwrap().bound
            };
            assert!((value(&toy.operator, 0.0, 0.0) - evidence.bound).abs() < 1e-9);
            let got = marginal.gradient(&toy.operator, &evidence).unwrap();
            let h = 1e-4;
            let difference = |f: &dyn Fn(f64) -> f64| (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h);
            let near = |got: f64, want: f64, scale: f64| assert!((got - want).abs() < 1e-6 * scale, "{got} {want}");
            let scale = 1.0 + got.log_exposure.abs() + got.log_precision.abs();
            near(got.log_exposure, difference(&|x| value(&toy.operator, x, 0.0)), scale);
            near(got.log_precision, difference(&|x| value(&toy.operator, 0.0, x)), scale);
            let largest = got.operator.iter().fold(0.0_f64, |top, x| top.max(x.abs()));
            for at in [0, 1, 2, m - 1, m + 2, rows * m / 2, rows * m - 1] {
                let moved = |x: f64| {
                    let mut entries = toy.entries.clone();
                    entries[at] += x;
                    value(&LightOperator::from_rows(rows, m, &entries), 0.0, 0.0)
                };
                near(got.operator[at], difference(&moved), largest);
            }
        }
    }

    #[test]
    fn the_gradient_in_reflectance_is_that_of_finite_differences() {
        let planted = planted(60, 4, 0.05, 3);
        let problem = planted.problem();
        let marginal = Marginal::of_problem(&problem);
        let bilinear = &planted.image.bilinear;
        let settings = EvidenceSettings { tolerance: 1e-12, max_steps: 3000, ..Default::default() };
        let value = |f: &[f64]| {
            let operator = LightOperator::of_reflectance(bilinear, f);
            marginal.evidence(&operator, &settings).unwrap().objective
        };
        let operator = LightOperator::of_reflectance(bilinear, &planted.f);
        let evidence = marginal.evidence(&operator, &settings).unwrap();
        let got = marginal.gradient(&operator, &evidence).unwrap().reflectance(bilinear);
        let largest = got.iter().fold(0.0_f64, |top, x| top.max(x.abs()));
        for k in 0..4 {
            // The scales, exposure and noise follow: at their best they do not matter.
            let moved = |x: f64| {
                let mut f = planted.f.clone();
                f[k] += x;
                value(&f)
            };
            let h = 1e-3 * planted.f[k];
            let want = (8.0 * (moved(h) - moved(-h)) - (moved(2.0 * h) - moved(-2.0 * h))) / (12.0 * h);
            assert!((got[k] - want).abs() < 1e-4 * largest, "{k}: {} {want}", got[k]);
        }
    }
}
