//! Principal component model of the logarithms of measured BRDF tables.
//!
//! Reflectance spans five orders of magnitude. In the logarithm, a few dozen axes represent a
//! hundred materials to a few percent, both in the diffuse part and in the peak. A factorisation of
//! the values themselves spends all its functions on the peaks of metals.

use gonio_linalg::{principal_axes, project};

use super::table::BivariateTable;

/// Smallest reflectance in 1/sr whose logarithm is used, a thousandth of the reflectance of soot.
const DARKEST: f32 = 1e-6;

/// Tables as `exp(mean + sum_r c_r axis_r)`, with coefficients `c` for each material.
#[derive(Clone, Debug, PartialEq)]
pub struct LogBasis {
    /// Names of the materials.
    pub names: Vec<String>,
    /// Mean of the logarithms, one value for each cell of a [`BivariateTable`].
    pub mean: Vec<f32>,
    /// Orthonormal axes over the cells, in order of decreasing variance.
    pub axes: Vec<Vec<f32>>,
    /// Coefficients of each material, one for each axis.
    pub coefficients: Vec<Vec<f32>>,
}

impl LogBasis {
    /// Number of axes that represent the hundred reconstructed MERL materials to 3 %.
    ///
    /// The error is the root mean square of the logarithm over trusted cells; it is 5 % for the
    /// worst material.
    pub const RANK: usize = 40;

    /// Computes the `rank` leading axes, or fewer if there are not as many materials.
    ///
    /// Cells that are not trusted repeat the nearest trusted value.
    ///
    /// # Panics
    /// If there are no materials.
    pub fn fit(materials: &[(String, BivariateTable)], rank: usize) -> Self {
        assert!(!materials.is_empty(), "no materials");
        let logs: Vec<Vec<f64>> = materials
            .iter()
            .map(|(_, table)| {
                let mut table = table.clone();
                table.extend_from_trusted();
                table.as_slice().iter().map(|v| f64::from(v.max(DARKEST)).ln()).collect()
            })
            .collect();
        let (mean, axes, _) = principal_axes(&logs, rank);
        let coefficients =
            logs.iter().map(|log| axes.iter().map(|axis| project(log, &mean, axis) as f32).collect()).collect();
        Self {
            names: materials.iter().map(|(name, _)| name.clone()).collect(),
            mean: mean.iter().map(|v| *v as f32).collect(),
            axes: axes.iter().map(|axis| axis.iter().map(|v| *v as f32).collect()).collect(),
            coefficients,
        }
    }

    /// Returns the table of a material in 1/sr.
    pub fn table(&self, material: usize) -> BivariateTable {
        self.at(&self.coefficients[material].iter().map(|c| f64::from(*c)).collect::<Vec<_>>())
    }

    /// Returns the table with these coefficients, one per axis, in 1/sr.
    pub(crate) fn at(&self, coefficients: &[f64]) -> BivariateTable {
        let mut log: Vec<f64> = self.mean.iter().map(|v| f64::from(*v)).collect();
        for (axis, c) in self.axes.iter().zip(coefficients) {
            log.iter_mut().zip(axis).for_each(|(log, a)| *log += c * f64::from(*a));
        }
        BivariateTable::from_vec(log.into_iter().map(|v| v.exp() as f32).collect())
    }

    /// Returns the number of materials.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Returns whether there are no materials.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }
}
