//! Non-negative matrix factorisation in the Frobenius norm.
//!
//! `X ~ W V'` with `X` cells x samples, `W >= 0` cells x rank (the functions) and `V >= 0` samples
//! x rank (the coefficients), minimising `sum_c weight_c sum_s (X - W V')_cs^2`. The method is
//! hierarchical alternating least squares with repeated inner sweeps (Gillis & Glineur 2012) and
//! extrapolation (Ang & Gillis 2019), from several starts.

mod hals;
mod starts;

use faer::{Mat, MatRef};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Settings of the factorisation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NmfSettings {
    /// Number of functions. Default 10.
    ///
    /// At least 1 and at most the number of samples and of weighted cells.
    pub rank: usize,
    /// Number of independent starts, at least 1. Default 16.
    ///
    /// The first start is NNDSVD; then random samples and uniform random numbers alternate.
    pub restarts: usize,
    /// Largest number of iterations of each start. Default 2000.
    pub max_iterations: usize,
    /// Relative decrease of the cost per iteration at which a start ends. Default 1e-6.
    ///
    /// The decrease is averaged over ten iterations.
    pub tolerance: f64,
    /// Number of rounds of column updates of the functions per product with `X`. Default 3.
    pub function_sweeps: usize,
    /// Number of rounds of column updates of the coefficients per product with `X`. Default 10.
    pub coefficient_sweeps: usize,
    /// Whether iterates are extrapolated; otherwise the method is plain HALS. Default on.
    pub extrapolate: bool,
    /// Seed of the starts. Default 0.
    pub seed: u64,
}

impl Default for NmfSettings {
    fn default() -> Self {
        Self {
            rank: 10,
            restarts: 16,
            max_iterations: 2000,
            tolerance: 1e-6,
            function_sweeps: 3,
            coefficient_sweeps: 10,
            extrapolate: true,
            seed: 0,
        }
    }
}

/// Error of a factorisation.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum NmfError {
    /// An entry is negative, NaN or infinite.
    #[error("entry ({cell}, {sample}) is {value}; entries must be finite and not negative")]
    BadEntry {
        /// Row of the entry.
        cell: usize,
        /// Column of the entry.
        sample: usize,
        /// Value of the entry.
        value: f64,
    },
    /// The number of weights differs from that of the rows.
    #[error("{weights} weights for {cells} cells")]
    WeightCount {
        /// Number of weights given.
        weights: usize,
        /// Number of rows of the matrix.
        cells: usize,
    },
    /// A weight is negative, NaN or infinite.
    #[error("the weight of cell {cell} is {value}; weights must be finite and not negative")]
    BadWeight {
        /// Row of the weight.
        cell: usize,
        /// Value of the weight.
        value: f64,
    },
    /// The rank is zero or larger than the matrix.
    #[error("rank {rank} for {cells} weighted cells and {samples} samples")]
    Rank {
        /// Requested rank.
        rank: usize,
        /// Number of rows with a positive weight.
        cells: usize,
        /// Number of columns of the matrix.
        samples: usize,
    },
    /// Restarts, iterations or sweeps are zero, or the tolerance is negative or not finite.
    #[error("restarts, iterations and sweeps must be at least 1 and the tolerance finite and not negative")]
    Settings,
}

/// Report on one start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartReport {
    /// Final cost.
    pub cost: f64,
    /// Number of iterations.
    pub iterations: usize,
    /// Whether the start converged before the largest number of iterations.
    pub converged: bool,
    /// Cost of the kept factors after each iteration, accurate to about 1e-14 of `|X|^2`.
    pub trace: Vec<f64>,
}

/// A factorisation `X ~ functions coefficients'`.
#[derive(Clone, Debug)]
pub struct Nmf {
    /// `W`, cells x rank, not negative; zero in cells without weight.
    ///
    /// The scale between `W` and `V` is arbitrary.
    pub functions: Mat<f64>,
    /// `V`, samples x rank, not negative.
    pub coefficients: Mat<f64>,
    /// Report on the start, with its weighted squared error.
    pub report: StartReport,
}

/// Factorises `x` (cells x samples, not negative) from several starts.
///
/// Returns the local minimum of each start, in the order of the starts. `cell_weights` (one per
/// cell, not negative) multiply the squared errors; without them, all weights are 1.
///
/// The starts run in parallel; the result is the same for every number of threads.
///
/// # Errors
/// See [`NmfError`].
pub(crate) fn factorize_all(
    x: MatRef<'_, f64>,
    cell_weights: Option<&[f64]>,
    settings: &NmfSettings,
) -> Result<Vec<Nmf>, NmfError> {
    let roots = check(x, cell_weights, settings)?;
    let used: Vec<usize> = (0..x.nrows()).filter(|&c| roots[c] > 0.0).collect();
    // Multiplying rows by the root of their weight makes the problem unweighted.
    let packed = Mat::from_fn(used.len(), x.ncols(), |i, j| roots[used[i]] * x[(used[i], j)]);
    let mut seeds = Pcg64::seed_from_u64(settings.seed);
    let seeds: Vec<u64> = (0..settings.restarts).map(|_| seeds.random()).collect();
    let run = |(index, seed)| {
        let start = starts::start(packed.as_ref(), settings.rank, index, seed);
        let (pair, report) = hals::descend(packed.as_ref(), start, settings);
        let mut functions = Mat::zeros(x.nrows(), settings.rank);
        for k in 0..settings.rank {
            let to = functions.col_as_slice_mut(k);
            for (&c, w) in used.iter().zip(pair.w.col_as_slice(k)) {
                to[c] = w / roots[c];
            }
        }
        Nmf { functions, coefficients: pair.v, report }
    };
    Ok(seeds.into_par_iter().enumerate().map(run).collect())
}

/// Checks the input and returns the square roots of the weights.
fn check(x: MatRef<'_, f64>, weights: Option<&[f64]>, settings: &NmfSettings) -> Result<Vec<f64>, NmfError> {
    let (cells, samples) = (x.nrows(), x.ncols());
    let counts = [settings.restarts, settings.max_iterations, settings.function_sweeps, settings.coefficient_sweeps];
    if counts.contains(&0) || !settings.tolerance.is_finite() || settings.tolerance < 0.0 {
        return Err(NmfError::Settings);
    }
    let roots = match weights {
        None => vec![1.0; cells],
        Some(w) if w.len() != cells => return Err(NmfError::WeightCount { weights: w.len(), cells }),
        Some(w) => w.iter().map(|v| v.sqrt()).collect(),
    };
    if let Some(cell) = roots.iter().position(|r| !r.is_finite()) {
        return Err(NmfError::BadWeight { cell, value: weights.map_or(1.0, |w| w[cell]) });
    }
    for sample in 0..samples {
        for cell in 0..cells {
            let value = x[(cell, sample)];
            if !(value.is_finite() && value >= 0.0) && roots[cell] > 0.0 {
                return Err(NmfError::BadEntry { cell, sample, value });
            }
        }
    }
    let used = roots.iter().filter(|r| **r > 0.0).count();
    if settings.rank == 0 || settings.rank > used.min(samples) {
        return Err(NmfError::Rank { rank: settings.rank, cells: used, samples });
    }
    Ok(roots)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::on_threads;

    /// Returns the start with the smallest cost, the first of equals.
    fn factorize(x: MatRef<'_, f64>, weights: Option<&[f64]>, settings: &NmfSettings) -> Result<Nmf, NmfError> {
        let all = factorize_all(x, weights, settings)?;
        let best = all.into_iter().min_by(|a, b| a.report.cost.total_cmp(&b.report.cost));
        Ok(best.expect("there is at least one start"))
    }

    /// Returns a matrix of exact non-negative rank `rank` with zeros in its factors.
    fn low_rank(cells: usize, samples: usize, rank: usize) -> Mat<f64> {
        let mut rng = Pcg64::seed_from_u64(9);
        let mut factor = |n| Mat::from_fn(n, rank, |_, _| (rng.random::<f64>() - 0.3).max(0.0));
        let (w, v) = (factor(cells), factor(samples));
        &w * v.transpose()
    }

    fn noisy(cells: usize, samples: usize) -> Mat<f64> {
        let mut rng = Pcg64::seed_from_u64(5);
        let x = low_rank(cells, samples, 5);
        Mat::from_fn(cells, samples, |i, j| x[(i, j)] + 0.1 * rng.random::<f64>())
    }

    fn settings(rank: usize) -> NmfSettings {
        NmfSettings { rank, restarts: 3, ..Default::default() }
    }

    #[test]
    fn cost_never_rises() {
        let x = noisy(300, 20);
        for extrapolate in [false, true] {
            let all = factorize_all(x.as_ref(), None, &NmfSettings { extrapolate, ..settings(4) }).unwrap();
            for start in all.iter().map(|nmf| &nmf.report) {
                let slack = 1e-13 * x.squared_norm_l2();
                assert!(start.trace.windows(2).all(|p| p[1] <= p[0] + slack), "extrapolate {extrapolate}");
                assert!((start.trace.last().unwrap() - start.cost).abs() <= slack);
            }
        }
    }

    #[test]
    fn extrapolation_is_faster() {
        let x = noisy(300, 20);
        let run = |extrapolate| {
            let s = NmfSettings { extrapolate, restarts: 1, max_iterations: 60, tolerance: 0.0, ..settings(5) };
            factorize(x.as_ref(), None, &s).unwrap().report.cost
        };
        assert!(run(true) <= run(false), "{} {}", run(true), run(false));
    }

    #[test]
    fn recovers_an_exact_product() {
        let x = low_rank(200, 30, 4);
        let s = NmfSettings { max_iterations: 20_000, tolerance: 0.0, ..settings(4) };
        let nmf = factorize(x.as_ref(), None, &s).unwrap();
        assert!(nmf.report.cost < 1e-12 * x.squared_norm_l2(), "{:e}", nmf.report.cost / x.squared_norm_l2());
    }

    #[test]
    fn full_rank_is_exact() {
        let x = noisy(60, 5);
        let s = NmfSettings { max_iterations: 20_000, tolerance: 0.0, ..settings(5) };
        let nmf = factorize(x.as_ref(), None, &s).unwrap();
        assert!(nmf.report.cost < 1e-9 * x.squared_norm_l2(), "{:e}", nmf.report.cost / x.squared_norm_l2());
    }

    #[test]
    fn result_is_stationary() {
        let x = noisy(200, 25);
        let s = NmfSettings { tolerance: 0.0, max_iterations: 5000, ..settings(4) };
        let nmf = factorize(x.as_ref(), None, &s).unwrap();
        let (w, v) = (&nmf.functions, &nmf.coefficients);
        let residual = w * v.transpose() - &x;
        let scale = x.norm_l2() * w.norm_l2().max(v.norm_l2());
        for (factor, gradient) in [(w, &residual * v), (v, residual.transpose() * w)] {
            for k in 0..factor.ncols() {
                for (f, g) in factor.col_as_slice(k).iter().zip(gradient.col_as_slice(k)) {
                    assert!(*f >= 0.0 && *g > -1e-6 * scale, "{f} {g}");
                    assert!(f.min(g.abs()) < 1e-6 * scale, "{f} {g}");
                }
            }
        }
    }

    #[test]
    fn result_depends_on_the_seed_and_not_on_threads() {
        let x = noisy(150, 20);
        let run = |threads, seed| {
            let s = NmfSettings { seed, max_iterations: 50, ..settings(4) };
            on_threads(threads, || factorize_all(x.as_ref(), None, &s).unwrap())
        };
        let (a, b, c) = (run(1, 3), run(4, 3), run(1, 4));
        for (a, b) in a.iter().zip(&b) {
            assert!(a.functions == b.functions && a.coefficients == b.coefficients && a.report == b.report);
        }
        assert!(a[1].report != c[1].report);
    }

    #[test]
    fn cells_without_weight_are_ignored() {
        let mut x = noisy(120, 12);
        let weights: Vec<f64> = (0..120).map(|c| if c < 100 { 1.0 } else { 0.0 }).collect();
        let a = factorize(x.as_ref(), Some(&weights), &settings(3)).unwrap();
        x[(110, 4)] = f64::NAN;
        let b = factorize(x.as_ref(), Some(&weights), &settings(3)).unwrap();
        assert!(a.functions == b.functions);
        assert!((100..120).all(|c| a.functions[(c, 0)] == 0.0));
        let top = factorize(x.as_ref().subrows(0, 100), None, &settings(3)).unwrap();
        assert!((a.report.cost - top.report.cost).abs() < 1e-12 * a.report.cost);
    }

    #[test]
    fn weight_two_equals_a_repeated_cell() {
        let x = noisy(40, 12);
        let twice = Mat::from_fn(50, 12, |i, j| x[(i % 40, j)]);
        let weights: Vec<f64> = (0..40).map(|c| if c < 10 { 2.0 } else { 1.0 }).collect();
        let s = NmfSettings { tolerance: 1e-12, max_iterations: 20_000, restarts: 8, ..settings(2) };
        let a = factorize(x.as_ref(), Some(&weights), &s).unwrap();
        let b = factorize(twice.as_ref(), None, &s).unwrap();
        assert!((a.report.cost - b.report.cost).abs() < 1e-6 * a.report.cost, "{} {}", a.report.cost, b.report.cost);
    }

    #[test]
    fn rejects_invalid_input() {
        let x = Mat::from_fn(4, 3, |i, j| (i + j) as f64);
        let error = |x: &Mat<f64>, w: Option<&[f64]>, s: NmfSettings| factorize(x.as_ref(), w, &s).unwrap_err();
        assert_eq!(error(&x, None, settings(4)), NmfError::Rank { rank: 4, cells: 4, samples: 3 });
        assert_eq!(error(&x, None, settings(0)), NmfError::Rank { rank: 0, cells: 4, samples: 3 });
        assert_eq!(error(&x, Some(&[1.0]), settings(1)), NmfError::WeightCount { weights: 1, cells: 4 });
        assert!(matches!(error(&x, Some(&[1.0, -1.0, 0.0, 1.0]), settings(1)), NmfError::BadWeight { cell: 1, .. }));
        assert_eq!(error(&x, None, NmfSettings { restarts: 0, ..settings(1) }), NmfError::Settings);
        let negative = Mat::from_fn(4, 3, |i, j| 1.0 - (i + j) as f64);
        assert_eq!(error(&negative, None, settings(1)), NmfError::BadEntry { cell: 2, sample: 0, value: -1.0 });
    }
}
