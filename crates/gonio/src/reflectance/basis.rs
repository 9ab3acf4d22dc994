//! Linear basis `F = sum_k f_k phi_k` of reflectance (paper 3.2) with the prior of eq. 6.

use super::nnls::{NnlsError, nnls};
use super::table::{BivariateTable, CELLS, THETA_D, trusted_cells};
use faer::Mat;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Error of an operation on a basis.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum BasisError {
    /// A list of coefficients does not fit the basis.
    #[error("{got} coefficients for {functions} basis functions")]
    CoefficientCount {
        /// Number of coefficients given.
        got: usize,
        /// Number of functions of the basis.
        functions: usize,
    },
    /// A trusted cell of the table to project is NaN or infinite.
    #[error("cell (theta_h {theta_h}, theta_d {theta_d}) of the table is not finite")]
    NotFinite {
        /// Index of the cell in `theta_h`.
        theta_h: usize,
        /// Index of the cell in `theta_d`.
        theta_d: usize,
    },
    /// The least-squares problem of a projection could not be solved.
    #[error("projection failed")]
    Nnls(#[from] NnlsError),
}

/// A material of the training set of a basis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingMaterial {
    /// Name of the material.
    pub name: String,
    /// Largest trusted value of the material's table (1/sr), by which the table was divided.
    pub scale: f64,
    /// Coefficients after that division, one per function, not negative.
    pub coefficients: Vec<f64>,
}

/// Non-negative functions whose non-negative combinations are reflectances.
///
/// The fields are public so that file formats can store them. The training in `gonio-paper` makes
/// them consistent: `functions`, `rates` and each material's coefficients have the same length `K`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReflectanceBasis {
    /// Functions `phi_k`, each with maximum one over the trusted cells.
    ///
    /// Cells that are not trusted repeat the nearest trusted value.
    pub functions: Vec<BivariateTable>,
    /// Rates `lambda_k` of `p(f_k) = lambda_k exp(-lambda_k f_k)` (eq. 6).
    ///
    /// The maximum-likelihood value is one over the mean of the training materials' coefficients.
    pub rates: Vec<f64>,
    /// Materials of the training set, in the order given.
    pub materials: Vec<TrainingMaterial>,
}

impl ReflectanceBasis {
    /// Returns the number of functions, `K`.
    pub fn len(&self) -> usize {
        self.functions.len()
    }

    /// Returns whether the basis has no functions.
    pub fn is_empty(&self) -> bool {
        self.functions.is_empty()
    }

    /// Returns `sum_k f_k phi_k` for `K` coefficients, in their units.
    ///
    /// # Errors
    /// [`BasisError::CoefficientCount`] unless there are `K` coefficients.
    pub fn combine(&self, coefficients: &[f64]) -> Result<BivariateTable, BasisError> {
        if coefficients.len() != self.len() {
            return Err(BasisError::CoefficientCount { got: coefficients.len(), functions: self.len() });
        }
        let mut sum = vec![0.0_f64; CELLS];
        for (f, function) in coefficients.iter().zip(&self.functions) {
            for (sum, phi) in sum.iter_mut().zip(function.as_slice()) {
                *sum += f * f64::from(*phi);
            }
        }
        Ok(BivariateTable::from_vec(sum.into_iter().map(|v| v as f32).collect()))
    }

    /// Computes the coefficients `f >= 0` that minimise the squared error to `table`.
    ///
    /// The error is summed over the trusted cells; coefficients are in the units of the table.
    ///
    /// # Errors
    /// If a trusted cell is not finite, or the least squares fail because a function is not finite.
    pub fn project(&self, table: &BivariateTable) -> Result<Vec<f64>, BasisError> {
        let cells: Vec<usize> = trusted_cells().collect();
        if let Some(&c) = cells.iter().find(|&&c| !table.as_slice()[c].is_finite()) {
            return Err(BasisError::NotFinite { theta_h: c / THETA_D, theta_d: c % THETA_D });
        }
        let dot = |a: &BivariateTable, b: &BivariateTable| inner(&cells, a, b);
        let gram = Mat::from_fn(self.len(), self.len(), |i, j| dot(&self.functions[i], &self.functions[j]));
        let h: Vec<f64> = self.functions.iter().map(|f| dot(f, table)).collect();
        Ok(nnls(gram.as_ref(), &h)?)
    }
}

fn inner(cells: &[usize], a: &BivariateTable, b: &BivariateTable) -> f64 {
    let (a, b) = (a.as_slice(), b.as_slice());
    cells.iter().map(|&c| f64::from(a[c]) * f64::from(b[c])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn basis() -> ReflectanceBasis {
        ReflectanceBasis {
            functions: vec![
                BivariateTable::from_fn(|_, _| 1.0),
                BivariateTable::from_fn(|h, _| (-h * h / 0.02).exp()),
                BivariateTable::from_fn(|_, d| d.sin().powi(4)),
            ],
            rates: vec![1.0; 3],
            materials: Vec::new(),
        }
    }

    #[test]
    fn projecting_a_combination_recovers_its_coefficients() {
        let f = [0.3, 700.0, 0.0];
        let got = basis().project(&basis().combine(&f).unwrap()).unwrap();
        for (got, want) in got.iter().zip(f) {
            assert!((got - want).abs() < 1e-4, "{got} {want}");
        }
    }

    #[test]
    fn projection_ignores_extrapolated_cells() {
        let mut table = basis().combine(&[1.0, 2.0, 3.0]).unwrap();
        table.as_mut_slice()[CELLS - 1] = f32::NAN;
        assert!((basis().project(&table).unwrap()[2] - 3.0).abs() < 1e-5);
        table.as_mut_slice()[3] = f32::NAN;
        assert_eq!(basis().project(&table), Err(BasisError::NotFinite { theta_h: 0, theta_d: 3 }));
    }

    #[test]
    fn rejects_a_wrong_number_of_coefficients() {
        assert_eq!(basis().combine(&[1.0]), Err(BasisError::CoefficientCount { got: 1, functions: 3 }));
    }
}
