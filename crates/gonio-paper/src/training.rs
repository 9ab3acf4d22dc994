//! Training of a reflectance basis on measured materials (paper 3.2).

use faer::Mat;
use gonio::reflectance::{
    BasisError, BivariateTable, CELLS, ReflectanceBasis, TrainingMaterial, indices_of, trusted_cells,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::nmf::{Nmf, NmfError, NmfSettings, StartReport, factorize_all};

/// Settings of the training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainSettings {
    /// Settings of the factorisation; its rank is the number of basis functions.
    pub nmf: NmfSettings,
    /// Relative margin above the smallest cost within which starts are candidates. Default 0.01.
    ///
    /// Candidates cost at most `1 + cost_margin` times the smallest cost. The candidate with the
    /// smallest mean RMS error in 1/sr is selected, since minima of nearly equal cost in scaled
    /// units can differ strongly in 1/sr. Zero selects the smallest cost.
    pub cost_margin: f64,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self { nmf: NmfSettings::default(), cost_margin: 0.01 }
    }
}

/// Error in training a basis.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TrainError {
    /// There are no materials.
    #[error("no materials to train on")]
    Empty,
    /// A trusted cell of a material is negative, NaN or infinite.
    #[error("material {name}: cell (theta_h {theta_h}, theta_d {theta_d}) is {value}")]
    BadValue {
        /// Name of the material.
        name: String,
        /// Index of the cell in `theta_h`.
        theta_h: usize,
        /// Index of the cell in `theta_d`.
        theta_d: usize,
        /// Value of the cell.
        value: f32,
    },
    /// All trusted cells of a material are zero.
    #[error("material {0} is zero in all trusted cells")]
    Black(String),
    /// No material uses function `0`, because the materials have fewer independent parts.
    #[error("no material uses basis function {0}; use a lower rank")]
    Unused(usize),
    /// The margin is negative or NaN.
    #[error("the cost margin must not be negative")]
    Settings,
    /// The factorisation failed.
    #[error("factorisation failed")]
    Nmf(#[from] NmfError),
    /// The final projection failed.
    #[error("final projection of the materials failed")]
    Projection(#[from] BasisError),
}

/// Error with which a basis reproduces one of its materials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaterialFit {
    /// Name of the material.
    pub name: String,
    /// Root mean square difference over the trusted cells (1/sr), with equal weight for each cell.
    pub rms: f64,
}

/// One start of the training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Report on the factorisation; its cost is in scaled units.
    pub start: StartReport,
    /// Mean RMS error of the materials in 1/sr.
    pub mean_rms: f64,
}

/// Report on the training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainReport {
    /// Errors of the materials, in the order given.
    pub fits: Vec<MaterialFit>,
    /// Every start, in order.
    pub candidates: Vec<Candidate>,
    /// Index of the selected start.
    pub best: usize,
}

impl TrainReport {
    /// Returns the mean of the materials' RMS errors in 1/sr.
    pub fn mean_rms(&self) -> f64 {
        mean(&self.fits)
    }

    /// Returns the median of the materials' RMS errors in 1/sr.
    ///
    /// For an even number, this is the mean of the middle two.
    pub fn median_rms(&self) -> f64 {
        let mut rms: Vec<f64> = self.fits.iter().map(|f| f.rms).collect();
        rms.sort_by(f64::total_cmp);
        let n = rms.len();
        if n == 0 { f64::NAN } else { 0.5 * (rms[(n - 1) / 2] + rms[n / 2]) }
    }
}

/// Learns basis functions from `materials` (name and one channel in 1/sr).
///
/// Each material is scaled to maximum one over its trusted cells. The matrix of trusted cells x
/// materials is factorised in the Frobenius norm. Each function is scaled to maximum one and
/// extended beyond the trusted cells. Last, the coefficients of the materials are solved again.
/// [`TrainSettings::cost_margin`] determines which start is selected.
///
/// # Errors
/// See [`TrainError`]. Values in cells that are not trusted are ignored.
pub fn train(
    materials: &[(String, BivariateTable)],
    settings: &TrainSettings,
) -> Result<(ReflectanceBasis, TrainReport), TrainError> {
    if materials.is_empty() {
        return Err(TrainError::Empty);
    }
    if settings.cost_margin.is_nan() || settings.cost_margin < 0.0 {
        return Err(TrainError::Settings);
    }
    let cells: Vec<usize> = trusted_cells().collect();
    let scales = materials.iter().map(|(name, table)| scale(name, table, &cells)).collect::<Result<Vec<f64>, _>>()?;
    let x =
        Mat::from_fn(cells.len(), materials.len(), |i, j| f64::from(materials[j].1.as_slice()[cells[i]]) / scales[j]);
    let set = Scaled { materials, scales, cells };
    let solved = factorize_all(x.as_ref(), &settings.nmf)?
        .into_par_iter()
        .map(|nmf| Ok((set.solve(&nmf)?, nmf.report)))
        .collect::<Result<Vec<_>, TrainError>>()?;
    let (mut solved, candidates): (Vec<_>, Vec<_>) = solved
        .into_iter()
        .map(|((basis, fits), start)| {
            let mean_rms = mean(&fits);
            ((basis, fits), Candidate { start, mean_rms })
        })
        .unzip();
    let best = choose(&candidates, settings.cost_margin);
    let (mut basis, fits) = solved.swap_remove(best);
    basis.rates = rates(&basis)?;
    Ok((basis, TrainReport { fits, candidates, best }))
}

/// Returns the start with the smallest error in 1/sr among those of nearly the smallest cost.
fn choose(candidates: &[Candidate], cost_margin: f64) -> usize {
    let least = candidates.iter().map(|c| c.start.cost).fold(f64::INFINITY, f64::min);
    let limit = least * (1.0 + cost_margin);
    let near = (0..candidates.len()).filter(|&i| candidates[i].start.cost <= limit);
    near.min_by(|&a, &b| candidates[a].mean_rms.total_cmp(&candidates[b].mean_rms)).unwrap_or(0)
}

fn mean(fits: &[MaterialFit]) -> f64 {
    fits.iter().map(|f| f.rms).sum::<f64>() / fits.len() as f64
}

/// Returns the maximum-likelihood rates of the coefficients' exponential distributions.
fn rates(basis: &ReflectanceBasis) -> Result<Vec<f64>, TrainError> {
    let rate = |k: usize| {
        let sum: f64 = basis.materials.iter().map(|m| m.coefficients[k]).sum();
        if sum > 0.0 { Ok(basis.materials.len() as f64 / sum) } else { Err(TrainError::Unused(k)) }
    };
    (0..basis.len()).map(rate).collect()
}

/// Training set, with the scales and cells of its matrix.
struct Scaled<'a> {
    materials: &'a [(String, BivariateTable)],
    scales: Vec<f64>,
    cells: Vec<usize>,
}

impl Scaled<'_> {
    /// Computes the functions of a factorisation, and each material's coefficients and error.
    ///
    /// The rates are still missing. The coefficients are solved again because the factorisation
    /// stops before full convergence and the functions have been rounded since.
    fn solve(&self, nmf: &Nmf) -> Result<(ReflectanceBasis, Vec<MaterialFit>), TrainError> {
        let functions = (0..nmf.functions.ncols())
            .map(|k| function(nmf.functions.col_as_slice(k), &self.cells).ok_or(TrainError::Unused(k)))
            .collect::<Result<Vec<_>, _>>()?;
        let mut basis = ReflectanceBasis { functions, rates: Vec::new(), materials: Vec::new() };
        let mut solved = Vec::with_capacity(self.materials.len());
        let mut fits = Vec::with_capacity(self.materials.len());
        for ((name, table), &scale) in self.materials.iter().zip(&self.scales) {
            let coefficients = basis.project(table)?;
            let rms = rms(&basis.combine(&coefficients)?, table, &self.cells);
            fits.push(MaterialFit { name: name.clone(), rms });
            let coefficients = coefficients.into_iter().map(|f| f / scale).collect();
            solved.push(TrainingMaterial { name: name.clone(), scale, coefficients });
        }
        basis.materials = solved;
        Ok((basis, fits))
    }
}

/// Returns the largest trusted value, if the table is valid for training.
fn scale(name: &str, table: &BivariateTable, cells: &[usize]) -> Result<f64, TrainError> {
    let values = table.as_slice();
    if let Some(&c) = cells.iter().find(|&&c| !(values[c].is_finite() && values[c] >= 0.0)) {
        let (theta_h, theta_d) = indices_of(c);
        return Err(TrainError::BadValue { name: name.into(), theta_h, theta_d, value: values[c] });
    }
    match f64::from(table.trusted_max()) {
        max if max > 0.0 => Ok(max),
        _ => Err(TrainError::Black(name.into())),
    }
}

/// Returns a column of the factorisation as a table of maximum one; `None` if it is zero.
fn function(column: &[f64], cells: &[usize]) -> Option<BivariateTable> {
    let max = column.iter().copied().fold(0.0, f64::max);
    if max <= 0.0 {
        return None;
    }
    let mut values = vec![0.0; CELLS];
    for (&c, v) in cells.iter().zip(column) {
        values[c] = (v / max) as f32;
    }
    let mut table = BivariateTable::from_vec(values);
    table.extend_from_trusted();
    Some(table)
}

fn rms(model: &BivariateTable, table: &BivariateTable, cells: &[usize]) -> f64 {
    let (model, table) = (model.as_slice(), table.as_slice());
    let squared: f64 = cells.iter().map(|&c| (f64::from(model[c]) - f64::from(table[c])).powi(2)).sum();
    (squared / cells.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns materials of two parts, a lobe and a constant.
    ///
    /// Cells that are not trusted contain invalid values.
    fn materials() -> Vec<(String, BivariateTable)> {
        (0..6)
            .map(|m| {
                let m = f64::from(m);
                let mut table =
                    BivariateTable::from_fn(|h, _| 0.1 + 0.02 * m + 30.0 * (m + 0.5) * (-h * h / 0.01).exp());
                for c in 0..CELLS {
                    if !gonio::reflectance::is_trusted(c) {
                        table.as_mut_slice()[c] = f32::NAN;
                    }
                }
                (format!("m{m}"), table)
            })
            .collect()
    }

    fn settings(rank: usize) -> TrainSettings {
        let nmf = NmfSettings { rank, starts: 2, tolerance: 1e-9, ..Default::default() };
        TrainSettings { nmf, ..Default::default() }
    }

    #[test]
    fn learns_two_parts() {
        let (basis, report) = train(&materials(), &settings(2)).unwrap();
        assert_eq!((basis.len(), basis.rates.len(), basis.materials.len()), (2, 2, 6));
        for f in &basis.functions {
            assert_eq!(f.trusted_max(), 1.0);
            assert!(f.as_slice().iter().all(|v| (0.0..=1.0).contains(v)));
            assert_eq!(f.cell(0, 89), f.cell(0, 79));
        }
        for (fit, (_, table)) in report.fits.iter().zip(materials()) {
            assert!(fit.rms < 1e-4 * f64::from(table.trusted_max()), "{fit:?}");
        }
        assert!(report.median_rms() > 0.0 && report.mean_rms() > 0.0);
    }

    #[test]
    fn rates_are_one_over_the_mean_coefficient() {
        let (basis, _) = train(&materials(), &settings(2)).unwrap();
        for (k, rate) in basis.rates.iter().enumerate() {
            let mean = basis.materials.iter().map(|m| m.coefficients[k]).sum::<f64>() / 6.0;
            assert!((rate * mean - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn coefficients_do_not_depend_on_brightness() {
        let bright: Vec<_> = materials()
            .into_iter()
            .map(|(n, mut t)| {
                t.as_mut_slice().iter_mut().for_each(|v| *v *= 8.0);
                (n, t)
            })
            .collect();
        let (a, ra) = train(&materials(), &settings(2)).unwrap();
        let (b, rb) = train(&bright, &settings(2)).unwrap();
        assert_eq!(a.functions, b.functions);
        assert_eq!(a.rates, b.rates);
        for (a, b) in ra.fits.iter().zip(&rb.fits) {
            assert!((8.0 * a.rms - b.rms).abs() < 1e-9 * b.rms);
        }
    }

    #[test]
    fn cost_margin_admits_starts_of_nearly_smallest_cost() {
        let candidate = |cost, mean_rms| {
            let start = StartReport { cost, iterations: 1, converged: true, trace: vec![cost] };
            Candidate { start, mean_rms }
        };
        let candidates = [candidate(1.005, 2.0), candidate(1.0, 3.0), candidate(1.2, 1.0)];
        assert_eq!(choose(&candidates, 0.0), 1);
        assert_eq!(choose(&candidates, 0.01), 0);
        assert_eq!(choose(&candidates, 0.5), 2);
    }

    #[test]
    fn rejects_invalid_materials() {
        let mut m = materials();
        assert_eq!(train(&[], &settings(2)).unwrap_err(), TrainError::Empty);
        let negative = TrainSettings { cost_margin: -0.1, ..settings(2) };
        assert_eq!(train(&m, &negative).unwrap_err(), TrainError::Settings);
        let rank = NmfError::Rank { rank: 7, cells: 6800, samples: 6 };
        assert_eq!(train(&m, &settings(7)).unwrap_err(), TrainError::Nmf(rank));
        m[3].1.as_mut_slice()[91] = -1.0;
        let bad = TrainError::BadValue { name: "m3".into(), theta_h: 1, theta_d: 1, value: -1.0 };
        assert_eq!(train(&m, &settings(2)).unwrap_err(), bad);
        m[3].1.as_mut_slice()[91] = f32::NAN;
        assert!(matches!(train(&m, &settings(2)), Err(TrainError::BadValue { .. })));
        m[3].1 = BivariateTable::from_fn(|_, _| 0.0);
        assert_eq!(train(&m, &settings(2)).unwrap_err(), TrainError::Black("m3".into()));
    }
}
