//! How the bound changes with reflectance, exposure and noise, the scales fixed.
//!
//! Where expectation maximisation has converged the bound does not change with the responsibilities, so that this is also the
//! gradient of the maximum over them.

use super::evidence::{EvidenceSettings, Point, dot};
use super::{Evidence, LightOperator, Marginal, MarginalError};
use crate::transfer::Bilinear;

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
    /// `dF/dB = b g (t - g B<l>) <l>' - b g^2 B Sigma`, `Sigma` after the cut: by Fisher's identity the expectation of the
    /// derivative of `log p(t, l)` under the posterior of the light.
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
    /// The gradient of the bound at an operator whose evidence is known: one factorisation and two solves of `r^2 M` flops.
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
