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
    /// At least 1 and at most the number of samples and of cells.
    pub rank: usize,
    /// Number of independent starts, at least 1. Default 16.
    ///
    /// The first start is NNDSVD; then random samples and uniform random numbers alternate.
    pub starts: usize,
    /// Largest number of iterations of each start. Default 2000.
    pub max_iterations: usize,
    /// Relative decrease of the cost per iteration at which a start ends. Default 1e-6.
    ///
    /// The decrease is averaged over ten iterations.
    pub tolerance: f64,
    /// Whether iterates are extrapolated; otherwise the method is plain HALS. Default on.
    pub extrapolate: bool,
    /// Seed of the starts. Default 0.
    pub seed: u64,
}

impl Default for NmfSettings {
    fn default() -> Self {
        Self { rank: 10, starts: 16, max_iterations: 2000, tolerance: 1e-6, extrapolate: true, seed: 0 }
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
    /// The rank is zero or larger than the matrix.
    #[error("rank {rank} for {cells} cells and {samples} samples")]
    Rank {
        /// Requested rank.
        rank: usize,
        /// Number of rows of the matrix.
        cells: usize,
        /// Number of columns of the matrix.
        samples: usize,
    },
    /// Restarts or iterations are zero, or the tolerance is negative or not finite.
    #[error("starts and iterations must be at least 1 and the tolerance finite and not negative")]
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
    /// `W`, cells x rank, not negative.
    ///
    /// The scale between `W` and `V` is arbitrary.
    pub functions: Mat<f64>,
    /// `V`, samples x rank, not negative.
    pub coefficients: Mat<f64>,
    /// Report on the start.
    pub report: StartReport,
}

/// Factorises `x` (cells x samples, not negative) from several starts.
///
/// Returns the local minimum of each start, in the order of the starts.
///
/// The starts run in parallel; the result is the same for every number of threads.
///
/// # Errors
/// See [`NmfError`].
pub(crate) fn factorize_all(x: MatRef<'_, f64>, settings: &NmfSettings) -> Result<Vec<Nmf>, NmfError> {
    check(x, settings)?;
    let mut seeds = Pcg64::seed_from_u64(settings.seed);
    let seeds: Vec<u64> = (0..settings.starts).map(|_| seeds.random()).collect();
    let run = |(index, seed)| {
        let start = starts::start(x, settings.rank, index, seed);
        let (pair, report) = hals::descend(x, start, settings);
        Nmf { functions: pair.w, coefficients: pair.v, report }
    };
    Ok(seeds.into_par_iter().enumerate().map(run).collect())
}

fn check(x: MatRef<'_, f64>, settings: &NmfSettings) -> Result<(), NmfError> {
    let (cells, samples) = (x.nrows(), x.ncols());
    let counts = [settings.starts, settings.max_iterations];
    if counts.contains(&0) || !settings.tolerance.is_finite() || settings.tolerance < 0.0 {
        return Err(NmfError::Settings);
    }
    for sample in 0..samples {
        for cell in 0..cells {
            let value = x[(cell, sample)];
            if !(value.is_finite() && value >= 0.0) {
                return Err(NmfError::BadEntry { cell, sample, value });
            }
        }
    }
    if settings.rank == 0 || settings.rank > cells.min(samples) {
        return Err(NmfError::Rank { rank: settings.rank, cells, samples });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::on_threads;

    /// Returns the start with the smallest cost, the first of equals.
    fn factorize(x: MatRef<'_, f64>, settings: &NmfSettings) -> Result<Nmf, NmfError> {
        let all = factorize_all(x, settings)?;
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
        NmfSettings { rank, starts: 3, ..Default::default() }
    }

    #[test]
    fn cost_never_rises() {
        let x = noisy(300, 20);
        for extrapolate in [false, true] {
            let all = factorize_all(x.as_ref(), &NmfSettings { extrapolate, ..settings(4) }).unwrap();
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
            let s = NmfSettings { extrapolate, starts: 1, max_iterations: 60, tolerance: 0.0, ..settings(5) };
            factorize(x.as_ref(), &s).unwrap().report.cost
        };
        assert!(run(true) <= run(false), "{} {}", run(true), run(false));
    }

    #[test]
    fn recovers_an_exact_product() {
        let x = low_rank(200, 30, 4);
        let s = NmfSettings { max_iterations: 20_000, tolerance: 0.0, ..settings(4) };
        let nmf = factorize(x.as_ref(), &s).unwrap();
        assert!(nmf.report.cost < 1e-12 * x.squared_norm_l2(), "{:e}", nmf.report.cost / x.squared_norm_l2());
    }

    #[test]
    fn full_rank_is_exact() {
        let x = noisy(60, 5);
        let s = NmfSettings { max_iterations: 20_000, tolerance: 0.0, ..settings(5) };
        let nmf = factorize(x.as_ref(), &s).unwrap();
        assert!(nmf.report.cost < 1e-9 * x.squared_norm_l2(), "{:e}", nmf.report.cost / x.squared_norm_l2());
    }

    #[test]
    fn result_is_stationary() {
        let x = noisy(200, 25);
        let s = NmfSettings { tolerance: 0.0, max_iterations: 5000, ..settings(4) };
        let nmf = factorize(x.as_ref(), &s).unwrap();
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
            on_threads(threads, || factorize_all(x.as_ref(), &s).unwrap())
        };
        let (a, b, c) = (run(1, 3), run(4, 3), run(1, 4));
        for (a, b) in a.iter().zip(&b) {
            assert!(a.functions == b.functions && a.coefficients == b.coefficients && a.report == b.report);
        }
        assert!(a[1].report != c[1].report);
    }

    #[test]
    fn rejects_invalid_input() {
        let x = Mat::from_fn(4, 3, |i, j| (i + j) as f64);
        let error = |x: &Mat<f64>, s: NmfSettings| factorize(x.as_ref(), &s).unwrap_err();
        assert_eq!(error(&x, settings(4)), NmfError::Rank { rank: 4, cells: 4, samples: 3 });
        assert_eq!(error(&x, settings(0)), NmfError::Rank { rank: 0, cells: 4, samples: 3 });
        assert_eq!(error(&x, NmfSettings { starts: 0, ..settings(1) }), NmfError::Settings);
        let negative = Mat::from_fn(4, 3, |i, j| 1.0 - (i + j) as f64);
        assert_eq!(error(&negative, settings(1)), NmfError::BadEntry { cell: 2, sample: 0, value: -1.0 });
    }
}
