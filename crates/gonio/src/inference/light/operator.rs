//! Linear map from light to image for one reflectance.

use faer::Mat;
use gonio_linalg::column_bands;
use rayon::prelude::*;

/// `B` (r x M): the image of light `l` is `B l`.
#[derive(Clone, Debug, PartialEq)]
pub struct LightOperator {
    pub(super) matrix: Mat<f64>,
}

impl LightOperator {
    /// Builds the operator of any one BRDF from `entries`, row by row (rows x m).
    ///
    /// # Panics
    /// If there are not `rows * m` entries.
    pub fn from_rows<A: Copy + Into<f64> + Sync>(rows: usize, m: usize, entries: &[A]) -> Self {
        assert_eq!(entries.len(), rows * m);
        let mut matrix = Mat::zeros(rows, m);
        // A band has as many columns as values of a row share a cache line.
        column_bands(matrix.as_mut(), m.div_ceil(16).max(1)).into_par_iter().for_each(|(first, mut band)| {
            for i in 0..rows {
                for (j, entry) in entries[i * m + first..][..band.ncols()].iter().enumerate() {
                    band[(i, j)] = (*entry).into();
                }
            }
        });
        Self { matrix }
    }

    /// The image `B l` (r) of light coefficients `l` (M).
    ///
    /// # Panics
    /// If there are not M coefficients.
    pub fn image(&self, light: &[f64]) -> Vec<f64> {
        assert_eq!(light.len(), self.m());
        let mut image = vec![0.0; self.rows()];
        for (column, l) in self.matrix.col_iter().zip(light) {
            image.iter_mut().zip(column.iter()).for_each(|(y, b)| *y += l * b);
        }
        image
    }

    /// Multiplies each row by its factor.
    pub(super) fn scale_rows(&mut self, factors: &[f64]) {
        assert_eq!(factors.len(), self.rows());
        for column in self.matrix.as_mut().col_iter_mut() {
            column.iter_mut().zip(factors).for_each(|(x, f)| *x *= f);
        }
    }

    /// Number of rows r.
    pub fn rows(&self) -> usize {
        self.matrix.nrows()
    }

    /// Number of light coefficients M.
    pub fn m(&self) -> usize {
        self.matrix.ncols()
    }
}
