//! Plan: the parts of the bilinear operator that do not depend on the image.
//!
//! They depend on shape, view, basis and grid. The N x (M K) stack of all rows has low numerical
//! rank. The plan therefore keeps only its leading left singular directions `Q` (weighted by the
//! prior magnitude of light and reflectance coefficients) and `R = Q' A`. With
//! `I_i = g l' A_i f + e_i` and white noise, the likelihood depends on the image only through
//! `Q' I` and the energy of `I` outside `Q`.

use faer::{Mat, MatRef};
use gonio::lighting::LightPrior;
use gonio::reflectance::BivariateTable;
use gonio::shape::Points;
use gonio::transfer::{MIN_POINTS, TransferError, TransferRows, TransferSettings, observed_rows};
use gonio_linalg::{Cholesky, product};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::Bilinear;
use crate::sketch::{RowBlocks, Sketch, sketch};

/// Settings of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanSettings {
    /// Grid of the light and quadrature.
    pub transfer: TransferSettings,
    /// Largest number of directions.
    pub rank: usize,
    /// Number of additional directions of the random sketch.
    pub oversampling: usize,
    /// Seed of the random sketch.
    pub seed: u64,
    /// Size of all rows in bytes below which they are stored.
    ///
    /// Larger rows are recomputed in each of four passes.
    pub hold: usize,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self { transfer: TransferSettings::default(), rank: 1000, oversampling: 50, seed: 1, hold: 1_200_000_000 }
    }
}

impl PlanSettings {
    /// Returns the default settings for a grid of `side` texels per side.
    pub fn of_side(side: usize) -> Self {
        Self { transfer: TransferSettings::of_side(side), ..Self::default() }
    }
}

/// Error in building or using a plan.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PlanError {
    /// The rows cannot be computed, or too few points have a value.
    #[error(transparent)]
    Transfer(#[from] TransferError),
    /// Fewer points have a value than the plan has directions; use all rows instead.
    #[error("only {kept} points have a value, fewer than the {rank} rows of the plan; use all observations instead")]
    TooFewForPlan {
        /// Number of points with a value.
        kept: usize,
        /// Number of directions of the plan.
        rank: usize,
    },
}

/// Directions of the image space that light and reflectance reach, and the operator on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Settings of the plan.
    pub settings: PlanSettings,
    /// Number of points of the surface, N.
    pub points: usize,
    /// Number of reflectance basis functions, K.
    pub k: usize,
    /// `Q`, N x rank, row-major; orthonormal columns in order of decreasing energy.
    pub q: Vec<f32>,
    /// `R = Q' A`, `[rank][k][m]`.
    pub r: Vec<f32>,
    /// Prior-weighted energy of each direction.
    pub energies: Vec<f64>,
    /// Prior-weighted energy of all rows.
    pub total_energy: f64,
}

/// All rows of the operator, block by block.
struct Rows<'a> {
    source: TransferRows<'a>,
    held: Vec<f32>,
}

/// Number of rows in a block.
const BLOCK: usize = 256;

impl Rows<'_> {
    /// Returns the root mean square of a pixel under each basis function alone.
    ///
    /// `light` contains the root mean square of the light coefficients. At most 400 points are
    /// used.
    fn energies(&self, light: &[f64]) -> Vec<f64> {
        let step = self.rows().div_ceil(400);
        let (some, columns) = (self.rows().div_ceil(step), self.columns());
        let mut rows = vec![0.0; some * columns];
        self.source.compute(0, step, &mut rows);
        let mut sums = vec![0.0; columns / light.len()];
        for row in rows.chunks_exact(columns) {
            for (sum, a) in sums.iter_mut().zip(row.chunks_exact(light.len())) {
                *sum += a.iter().zip(light).map(|(a, l)| (f64::from(*a) * l).powi(2)).sum::<f64>();
            }
        }
        sums.into_iter().map(|s| (s / some as f64).sqrt()).collect()
    }
}

impl RowBlocks for Rows<'_> {
    fn rows(&self) -> usize {
        self.source.points()
    }

    fn columns(&self) -> usize {
        self.source.columns()
    }

    fn for_each(&self, visit: &mut dyn FnMut(usize, &[f32])) {
        let columns = self.columns();
        if self.held.is_empty() {
            let mut block = vec![0.0; BLOCK.min(self.rows()) * columns];
            for first in (0..self.rows()).step_by(BLOCK) {
                let block = &mut block[..BLOCK.min(self.rows() - first) * columns];
                self.source.compute(first, 1, block);
                visit(first, block);
            }
        } else {
            for (i, block) in self.held.chunks(4 * BLOCK * columns).enumerate() {
                visit(4 * BLOCK * i, block);
            }
        }
    }
}

impl Plan {
    /// Integrates the basis over the light grid for every point and keeps the leading directions.
    ///
    /// Directions are weighted by the prior root mean square of each light coefficient, and
    /// inversely by the brightness of each basis function, so that all functions count equally.
    /// Sharp functions are dim under average light, and their images would otherwise be lost.
    /// `progress` receives a fraction in 0..=1.
    ///
    /// # Errors
    /// Those of [`TransferRows::new`].
    pub fn build<'a>(
        points: impl Into<Points<'a>>,
        tables: &[BivariateTable],
        prior: &LightPrior,
        settings: &PlanSettings,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self, PlanError> {
        let points = points.into();
        let source = TransferRows::new(points, tables, prior, &settings.transfer)?;
        let mut rows = Rows { source, held: Vec::new() };
        let bytes = rows.rows() * rows.columns() * size_of::<f32>();
        if bytes < settings.hold {
            let columns = rows.columns();
            let mut held = vec![0.0; rows.rows() * columns];
            for (i, block) in held.chunks_mut(BLOCK * columns).enumerate() {
                rows.source.compute(i * BLOCK, 1, block);
                progress(0.5 * ((i + 1) * BLOCK).min(points.len()) as f64 / points.len() as f64);
            }
            rows.held = held;
        }
        let moments = prior.mean_and_variance(settings.transfer.side);
        let light: Vec<f64> = moments.iter().map(|(mean, variance)| (mean * mean + variance).sqrt()).collect();
        let levels = rows.energies(&light);
        let weights: Vec<f32> =
            levels.iter().flat_map(|level| light.iter().map(move |l| (l / level.max(1e-300)) as f32)).collect();
        progress(0.5);
        let Sketch { q, r, energies, total } =
            sketch(&rows, &weights, settings.rank, settings.oversampling, settings.seed);
        let rank = q.ncols();
        let q = (0..points.len() * rank).map(|at| q[(at / rank, at % rank)]).collect();
        progress(1.0);
        Ok(Self { settings: *settings, points: points.len(), k: tables.len(), q, r, energies, total_energy: total })
    }

    /// Returns the number of directions.
    pub fn rank(&self) -> usize {
        self.energies.len()
    }

    /// Returns the number of light coefficients, M.
    pub fn m(&self) -> usize {
        self.settings.transfer.side.pow(2)
    }

    /// Returns the fraction of the prior-weighted energy outside the directions of the plan.
    pub fn left_out(&self) -> f64 {
        (1.0 - self.energies.iter().sum::<f64>() / self.total_energy).max(0.0)
    }

    /// Projects an image onto the plan.
    ///
    /// Points without a value (`None`) are excluded exactly: the remaining rows of `Q` are
    /// orthonormalised again.
    ///
    /// The rank is the smallest, in steps of 50, at which the residual energy exceeds that at the
    /// full rank by at most `slack` of the image's energy. If points are excluded, the rank is the
    /// full rank.
    ///
    /// # Errors
    /// If image and plan differ in the number of points, or if fewer points have a value than 50 or
    /// than the rank.
    pub fn project(&self, image: &[Option<f64>], slack: f64) -> Result<Projected, PlanError> {
        if image.len() != self.points {
            return Err(TransferError::Points { points: self.points, image: image.len() }.into());
        }
        let kept: Vec<usize> = (0..image.len()).filter(|&i| image[i].is_some()).collect();
        if kept.len() < MIN_POINTS {
            return Err(TransferError::TooFewPoints(kept.len()).into());
        }
        let full = self.rank();
        if kept.len() < full {
            return Err(PlanError::TooFewForPlan { kept: kept.len(), rank: full });
        }
        let values = Mat::<f64>::from_fn(kept.len(), 1, |i, _| image[kept[i]].unwrap_or(0.0));
        let energy = values.squared_norm_l2();
        let q = Mat::<f64>::from_fn(kept.len(), full, |i, j| f64::from(self.q[kept[i] * full + j]));
        let coordinates = product(q.transpose(), values.as_ref());
        if kept.len() == self.points {
            // Q is already orthonormal to single precision.
            let left = |r: usize| energy - coordinates.subrows(0, r).squared_norm_l2();
            let least = left(full);
            let rank = (1..).map(|s| (50 * s).min(full)).find(|&r| left(r) <= least + slack * energy).unwrap_or(full);
            let columns = self.k * self.m();
            return Ok(Projected {
                bilinear: Bilinear::new(rank, self.k, self.m(), self.r[..rank * columns].to_vec()),
                target: (0..rank).map(|j| coordinates[(j, 0)]).collect(),
                outside: left(rank).max(0.0),
                pixels: kept.len(),
            });
        }
        // With Q_kept = Q~ L' and L L' = Q_kept' Q_kept, the target is L^-1 Q_kept' I and the
        // operator L' R.
        let mut gram = product(q.transpose(), q.as_ref());
        for j in 0..gram.ncols() {
            gram[(j, j)] += 1e-9;
        }
        let factor = Cholesky::new(gram).expect("a ridge makes the Gram matrix positive definite");
        let lower = factor.lower();
        let mut target = coordinates;
        factor.whiten(&mut target);
        let rank = target.nrows();
        let columns = self.k * self.m();
        let upper = Mat::<f32>::from_fn(rank, rank, |i, j| if i <= j { lower[(j, i)] as f32 } else { 0.0 });
        let r = MatRef::from_row_major_slice(&self.r[..rank * columns], rank, columns);
        let operator = product(upper.as_ref(), r);
        let data = (0..rank * columns).map(|at| operator[(at / columns, at % columns)]).collect();
        Ok(Projected {
            bilinear: Bilinear::new(rank, self.k, self.m(), data),
            outside: (energy - target.squared_norm_l2()).max(0.0),
            target: (0..rank).map(|j| target[(j, 0)]).collect(),
            pixels: kept.len(),
        })
    }
}

/// Image in the form of the likelihood: `I_i = g l' A_i f + e_i` on a few rows.
///
/// The energy outside these rows is included.
#[derive(Clone, Debug)]
pub struct Projected {
    /// Operator on the rows.
    pub bilinear: Bilinear,
    /// Image on the rows.
    pub target: Vec<f64>,
    /// Squared norm of the image outside the rows, which the model cannot explain.
    pub outside: f64,
    /// Number of pixels that the rows represent, N of eq. 9.
    pub pixels: usize,
}

impl Projected {
    /// Uses all rows of the image, without projection.
    ///
    /// This is for images with much energy outside the leading directions.
    ///
    /// # Errors
    /// Those of [`observed_rows`].
    pub fn unprojected<'a>(
        points: impl Into<Points<'a>>,
        image: &[Option<f64>],
        tables: &[BivariateTable],
        prior: &LightPrior,
        settings: &TransferSettings,
    ) -> Result<Self, TransferError> {
        let (rows, target) = observed_rows(points.into(), image, tables, prior, settings)?;
        let bilinear = Bilinear::new(target.len(), tables.len(), settings.side * settings.side, rows);
        Ok(Self { bilinear, pixels: target.len(), target, outside: 0.0 })
    }

    /// Uses the images of the basis functions under a known light.
    ///
    /// `rows` contains the images of the `k` basis functions, `[point][k]`. Points without a value
    /// are excluded.
    ///
    /// # Panics
    /// If the lengths of `rows` and `image` do not match.
    pub fn under_known_light(rows: &[f32], k: usize, image: &[Option<f64>]) -> Self {
        assert_eq!(rows.len(), k * image.len());
        let kept = || rows.chunks_exact(k).zip(image).filter_map(|(row, value)| value.map(|v| (row, v)));
        let target: Vec<f64> = kept().map(|(_, v)| v).collect();
        // Scales the rows to mean one, so that exposures near one are plausible.
        let mean = kept().flat_map(|(row, _)| row).map(|&x| f64::from(x)).sum::<f64>() / (k * target.len()) as f64;
        let scale = if mean > 0.0 { 1.0 / mean } else { 1.0 };
        let data = kept().flat_map(|(row, _)| row.iter().map(move |&x| (f64::from(x) * scale) as f32)).collect();
        Self { bilinear: Bilinear::new(target.len(), k, 1, data), pixels: target.len(), target, outside: 0.0 }
    }

    /// Returns the fraction of the image's energy outside the rows.
    pub fn left_over(&self) -> f64 {
        let inside: f64 = self.target.iter().map(|x| x * x).sum();
        self.outside / (inside + self.outside)
    }

    /// Returns the squared norm of the image.
    pub fn energy(&self) -> f64 {
        self.target.iter().map(|x| x * x).sum::<f64>() + self.outside
    }
}

#[cfg(test)]
mod tests;
