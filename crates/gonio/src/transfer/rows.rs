//! Rows of the light transport operator: the image of a point under each Haar coefficient of the
//! light, for each table of reflectance.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{InterleavedTables, Quadrature, QuadratureSettings};
use crate::lighting::{LightGrid, LightPrior};
use crate::reflectance::BivariateTable;
use crate::shape::{Points, SurfacePoint};
use crate::sphere::Haar;

/// Smallest number of points with a value.
pub const MIN_POINTS: usize = 50;

/// Grid of the light, and quadrature of reflectance over its texels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TransferSettings {
    /// Number of texels along a side of the light grid, a power of two.
    pub side: usize,
    /// Quadrature of reflectance over texels.
    pub quadrature: QuadratureSettings,
}

impl Default for TransferSettings {
    fn default() -> Self {
        Self::of_side(32)
    }
}

impl TransferSettings {
    /// Returns the default settings for a grid of `side` texels per side.
    pub fn of_side(side: usize) -> Self {
        Self { side, quadrature: QuadratureSettings::default() }
    }
}

/// Error in computing rows of the operator.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TransferError {
    /// There are too few points.
    #[error("only {0} points have a value, but {MIN_POINTS} are required; use a larger image or more of the object")]
    TooFewPoints(usize),
    /// The light prior does not cover the grid.
    #[error("the light prior supports grids of up to {covered} texels per side, not {side}")]
    Grid {
        /// Requested side.
        side: usize,
        /// Largest supported side.
        covered: usize,
    },
    /// There are no tables.
    #[error("the reflectance basis is empty")]
    EmptyBasis,
    /// Visibility and light have different grids.
    #[error(
        "the visibility has a grid of {visibility} texels per side (or another map), but the light has {side}; \
         compute the visibility again"
    )]
    Visibility {
        /// Side of the grid of the visibility.
        visibility: usize,
        /// Side of the grid of the light.
        side: usize,
    },
    /// The image and the surface differ in the number of points.
    #[error("the surface has {points} points, but the image has {image}")]
    Points {
        /// Number of points of the surface.
        points: usize,
        /// Number of observations of the image.
        image: usize,
    },
}

/// Source of the rows of the operator for points of a surface, in the Haar domain.
///
/// A row contains the image of one point, `[k][m]`: for each of K tables, one value for each of M
/// light coefficients.
pub struct TransferRows<'a> {
    points: Points<'a>,
    quadrature: Quadrature,
    tables: InterleavedTables,
    haar: Haar,
}

impl<'a> TransferRows<'a> {
    /// Prepares the rows of points under tables of reflectance.
    ///
    /// # Errors
    /// If there are fewer than [`MIN_POINTS`] points, there are no tables, the prior does not cover
    /// the grid, or the visibility has another grid.
    pub fn new(
        points: Points<'a>,
        tables: &[BivariateTable],
        prior: &LightPrior,
        settings: &TransferSettings,
    ) -> Result<Self, TransferError> {
        if points.len() < MIN_POINTS {
            return Err(TransferError::TooFewPoints(points.len()));
        }
        if let Some(visibility) = points.visibility
            && (visibility.side(), visibility.map()) != (settings.side, prior.map)
        {
            return Err(TransferError::Visibility { visibility: visibility.side(), side: settings.side });
        }
        if tables.is_empty() {
            return Err(TransferError::EmptyBasis);
        }
        let covered = prior.finest_side();
        let haar = Haar::new(settings.side).filter(|_| (4..=covered).contains(&settings.side));
        let haar = haar.ok_or(TransferError::Grid { side: settings.side, covered })?;
        Ok(Self {
            points,
            quadrature: Quadrature::new(prior.map, settings.side, settings.quadrature),
            tables: InterleavedTables::new(tables),
            haar,
        })
    }

    /// Returns the number of points.
    pub fn points(&self) -> usize {
        self.points.len()
    }

    /// Returns the number of values in a row, M K.
    pub fn columns(&self) -> usize {
        self.tables.count() * self.haar.coefficients()
    }

    /// Computes the rows of the points `first`, `first + step` and so on until `block` is full.
    ///
    /// # Panics
    /// If `block` has more rows than there are points.
    pub fn compute(&self, first: usize, step: usize, block: &mut [f32]) {
        let (m, k, stride) = (self.haar.coefficients(), self.tables.count(), self.tables.stride());
        let scale = (1.0 / LightGrid::texel_measure(m.isqrt()).sqrt()) as f32;
        block.par_chunks_mut(k * m).enumerate().for_each_init(
            || (vec![0.0; m * stride], Vec::new()),
            |(texels, scratch), (i, row)| {
                let point = first + i * step;
                texels.fill(0.0);
                self.quadrature.integrate(&self.points.points[point], &self.tables, texels);
                if let Some(visibility) = self.points.visibility {
                    visibility.apply(point, texels, stride);
                }
                for (k, out) in row.chunks_exact_mut(m).enumerate() {
                    for (out, texel) in out.iter_mut().zip(texels.chunks_exact(stride)) {
                        *out = texel[k] * scale;
                    }
                    self.haar.forward(out, scratch);
                }
            },
        );
    }
}

/// Computes the rows of the points that have a value, `[point][k][m]`.
///
/// Returns these rows and values.
///
/// # Errors
/// If image and surface differ in the number of points, and those of [`TransferRows::new`].
pub fn observed_rows(
    all: Points<'_>,
    image: &[Option<f64>],
    tables: &[BivariateTable],
    prior: &LightPrior,
    settings: &TransferSettings,
) -> Result<(Vec<f32>, Vec<f64>), TransferError> {
    if image.len() != all.len() {
        return Err(TransferError::Points { points: all.len(), image: image.len() });
    }
    let kept: Vec<usize> = (0..image.len()).filter(|&i| image[i].is_some()).collect();
    let points: Vec<SurfacePoint> = kept.iter().map(|&i| all.points[i]).collect();
    let visibility = all.visibility.map(|v| v.select(&kept));
    let rows = TransferRows::new(Points::new(&points, visibility.as_ref()), tables, prior, settings)?;
    let mut all = vec![0.0; rows.points() * rows.columns()];
    rows.compute(0, 1, &mut all);
    Ok((all, image.iter().flatten().copied().collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{ball, sphere_points, toy_prior, toy_tables};

    #[test]
    fn rejects_unusable_inputs() {
        let (points, tables, prior) = (sphere_points(600), toy_tables(), toy_prior(16));
        let rows = |points: &[SurfacePoint], tables: &[BivariateTable], side| {
            TransferRows::new(points.into(), tables, &prior, &TransferSettings::of_side(side)).map(|_| ()).unwrap_err()
        };
        assert_eq!(rows(&points[..10], &tables, 16), TransferError::TooFewPoints(10));
        assert_eq!(rows(&points, &[], 16), TransferError::EmptyBasis);
        assert_eq!(rows(&points, &tables, 32), TransferError::Grid { side: 32, covered: 16 });
        assert_eq!(rows(&points, &tables, 12), TransferError::Grid { side: 12, covered: 16 });
        let few = observed_rows((&points).into(), &[Some(1.0)], &tables, &prior, &TransferSettings::default());
        assert_eq!(few.unwrap_err(), TransferError::Points { points: points.len(), image: 1 });
    }

    #[test]
    fn points_without_a_value_have_no_row() {
        let (points, tables, prior) = (ball(60), toy_tables(), toy_prior(8));
        let settings = TransferSettings::of_side(8);
        let image: Vec<Option<f64>> = (0..60).map(|i| (i != 3).then_some(f64::from(i))).collect();
        let all: Vec<Option<f64>> = (0..60).map(|i| Some(f64::from(i))).collect();
        let of = |image: &[Option<f64>]| observed_rows((&points).into(), image, &tables, &prior, &settings).unwrap();
        let ((some, values), (every, _)) = (of(&image), of(&all));
        let columns = tables.len() * 64;
        assert_eq!((some.len(), values.len(), values[3]), (59 * columns, 59, 4.0));
        assert_eq!(some[..3 * columns], every[..3 * columns]);
        assert_eq!(some[3 * columns..], every[4 * columns..]);
    }
}
