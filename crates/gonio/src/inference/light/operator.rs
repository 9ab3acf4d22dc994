//! Linear map from light to image for one reflectance.

use faer::Mat;

use crate::transfer::Bilinear;

/// `B` (r x M): the image of light `l` is `B l`.
#[derive(Clone, Debug, PartialEq)]
pub struct LightOperator {
    pub(super) matrix: Mat<f64>,
}

impl LightOperator {
    /// `B = sum_k f_k A_k` of reflectance coefficients `f` (K).
    ///
    /// # Panics
    /// If there are not K coefficients.
    pub fn of_reflectance(bilinear: &Bilinear, f: &[f64]) -> Self {
        Self::from_rows(bilinear.rows(), bilinear.m(), &bilinear.of_reflectance(f))
    }

    /// Builds the operator of any one BRDF from `entries`, row by row (rows x m).
    ///
    /// # Panics
    /// If there are not `rows * m` entries.
    pub(crate) fn from_rows<A: Copy + Into<f64>>(rows: usize, m: usize, entries: &[A]) -> Self {
        assert_eq!(entries.len(), rows * m);
        Self { matrix: Mat::from_fn(rows, m, |i, j| entries[i * m + j].into()) }
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

    /// The operator of the first `m` coefficients alone.
    pub(super) fn first(&self, m: usize) -> Self {
        Self { matrix: self.matrix.subcols(0, m).to_owned() }
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
