//! BRDF tables in the half/difference parametrisation of the MERL database.
//!
//! Axes (Rusinkiewicz 1998, sampled as MERL does): `theta_h = (i/90)^2 * 90` degrees, `theta_d = j`
//! degrees, `phi_d = k` degrees with `i, j` in 0..90 and `k` in 0..180; reciprocity gives
//! `phi_d + 180`. Values are in 1/sr.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Number of samples in `theta_h`.
pub const THETA_H: usize = 90;
/// Number of samples in `theta_d`.
pub const THETA_D: usize = 90;
/// Number of samples in `phi_d`.
pub const PHI_D: usize = 180;
/// Number of cells of a bivariate table.
pub const CELLS: usize = THETA_H * THETA_D;
/// Angle (radians) of `theta_h` and `theta_d` from which on measured tables are extrapolated.
pub const TRUSTED: f64 = 80.0 / 180.0 * PI;

/// Returns the angle of sample `i` of the `theta_h` axis in radians.
///
/// The axis is denser towards the specular peak.
pub fn theta_h_of(i: usize) -> f64 {
    (i as f64 / THETA_H as f64).powi(2) * FRAC_PI_2
}

/// Returns the angle of sample `j` of the `theta_d` axis in radians.
pub fn theta_d_of(j: usize) -> f64 {
    (j as f64).to_radians()
}

/// Returns row `i` (`theta_h`) and column `j` (`theta_d`) of a cell of a [`BivariateTable`].
pub fn indices_of(cell: usize) -> (usize, usize) {
    (cell / THETA_D, cell % THETA_D)
}

/// Returns `theta_h` and `theta_d` of a cell of a [`BivariateTable`] in radians.
pub fn angles_of(cell: usize) -> (f64, f64) {
    let (i, j) = indices_of(cell);
    (theta_h_of(i), theta_d_of(j))
}

/// Returns whether both angles of a cell of a [`BivariateTable`] are below [`TRUSTED`].
///
/// These cells are the measured part of the domain.
pub fn is_trusted(cell: usize) -> bool {
    let (theta_h, theta_d) = angles_of(cell);
    theta_h < TRUSTED && theta_d < TRUSTED
}

/// Returns the cells that satisfy [`is_trusted`], in order.
pub fn trusted_cells() -> impl DoubleEndedIterator<Item = usize> + Clone {
    (0..CELLS).filter(|cell| is_trusted(*cell))
}

/// Returns the trusted cell whose indices are nearest to those of a cell.
pub(crate) fn nearest_trusted(cell: usize) -> usize {
    let last_h = (0..THETA_H).rfind(|&i| theta_h_of(i) < TRUSTED).expect("some rows are trusted");
    let last_d = (0..THETA_D).rfind(|&j| theta_d_of(j) < TRUSTED).expect("some columns are trusted");
    (cell / THETA_D).min(last_h) * THETA_D + (cell % THETA_D).min(last_d)
}

/// Returns whether light and view are both above the surface at this half/difference direction.
pub(crate) fn above_horizon(theta_h: f64, theta_d: f64, phi_d: f64) -> bool {
    are_above_horizon(theta_h.cos() * theta_d.cos(), theta_h.sin() * theta_d.sin() * phi_d.cos())
}

/// Returns whether both cosines, `vertical - lateral` and `vertical + lateral`, are positive.
fn are_above_horizon(vertical: f64, lateral: f64) -> bool {
    vertical - lateral > 0.0 && vertical + lateral > 0.0
}

/// Position between two samples of an axis: index of the first, weight of the second.
pub(crate) type LinearStencil = (usize, f64);

/// Returns the position of `x` on an axis of `n` samples, for linear interpolation.
///
/// The last value applies beyond the last sample.
fn stencil(x: f64, n: usize) -> LinearStencil {
    let x = x.clamp(0.0, (n - 1) as f64);
    let i = (x as usize).min(n - 2);
    (i, x - i as f64)
}

#[inline]
pub(crate) fn axis_h(theta_h: f64) -> LinearStencil {
    stencil((theta_h.max(0.0) / FRAC_PI_2).sqrt() * THETA_H as f64, THETA_H)
}

#[inline]
pub(crate) fn axis_d(theta_d: f64) -> LinearStencil {
    stencil(theta_d.to_degrees(), THETA_D)
}

/// An isotropic BRDF that does not depend on `phi_d` (Romeiro et al. 2008).
///
/// It has 90 x 90 samples over `(theta_h, theta_d)`, `theta_d` fastest, in 1/sr or relative units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<f32>", into = "Vec<f32>")]
pub struct BivariateTable {
    values: Vec<f32>,
}

/// Error of a list of values without the length of a bivariate table.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("{0} values; a bivariate table has {CELLS}")]
pub struct CellCountError(pub usize);

impl TryFrom<Vec<f32>> for BivariateTable {
    type Error = CellCountError;

    fn try_from(values: Vec<f32>) -> Result<Self, CellCountError> {
        if values.len() == CELLS { Ok(Self { values }) } else { Err(CellCountError(values.len())) }
    }
}

impl From<BivariateTable> for Vec<f32> {
    fn from(table: BivariateTable) -> Self {
        table.values
    }
}

impl BivariateTable {
    /// Wraps [`CELLS`] values; row `i` contains all `theta_d` of `theta_h` sample `i`.
    ///
    /// # Panics
    /// If there are not [`CELLS`] values.
    pub fn from_vec(values: Vec<f32>) -> Self {
        assert_eq!(values.len(), CELLS, "a bivariate table has {CELLS} cells");
        Self { values }
    }

    /// Samples `f(theta_h, theta_d)` (radians) at the cells.
    pub fn from_fn(mut f: impl FnMut(f64, f64) -> f64) -> Self {
        let value = |c| {
            let (theta_h, theta_d) = angles_of(c);
            f(theta_h, theta_d) as f32
        };
        Self::from_vec((0..CELLS).map(value).collect())
    }

    /// Returns all cells, `theta_d` fastest.
    pub fn as_slice(&self) -> &[f32] {
        &self.values
    }

    /// Returns all cells, `theta_d` fastest.
    pub fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Returns the cell of `theta_h` sample `i` and `theta_d` sample `j`.
    pub fn cell(&self, i: usize, j: usize) -> f32 {
        self.values[i * THETA_D + j]
    }

    /// Returns the value at `(theta_h, theta_d)` in radians.
    ///
    /// The interpolation is bilinear in the sample indices; the last sample applies up to 90
    /// degrees.
    pub fn eval(&self, theta_h: f64, theta_d: f64) -> f64 {
        self.between(axis_h(theta_h), axis_d(theta_d))
    }

    /// Computes [`Self::eval`] from positions on both axes, which several tables can share.
    pub(crate) fn between(&self, (i, s): LinearStencil, (j, t): LinearStencil) -> f64 {
        let row = |i: usize| {
            let v = &self.values[i * THETA_D + j..][..2];
            f64::from(v[0]) * (1.0 - t) + f64::from(v[1]) * t
        };
        row(i) * (1.0 - s) + row(i + 1) * s
    }

    /// Returns the four cells between which [`Self::eval`] interpolates, with their weights.
    ///
    /// `eval` is `sum_c weight_c value_c`.
    pub(crate) fn stencil(theta_h: f64, theta_d: f64) -> [(usize, f64); 4] {
        let ((i, s), (j, t)) = (axis_h(theta_h), axis_d(theta_d));
        let at = i * THETA_D + j;
        [(at, (1.0 - s) * (1.0 - t)), (at + 1, (1.0 - s) * t), (at + THETA_D, s * (1.0 - t)), (at + THETA_D + 1, s * t)]
    }

    /// Returns the table with every cell multiplied by a factor.
    pub fn scaled(&self, by: f64) -> Self {
        Self::from_vec(self.values.iter().map(|&v| (f64::from(v) * by) as f32).collect())
    }

    /// Returns the luminance of an RGB reflectance (Rec. 709 weights).
    pub fn luminance(rgb: &[Self; 3]) -> Self {
        let [r, g, b] = rgb.each_ref().map(Self::as_slice);
        let cell = |c: usize| crate::picture::luminance(glam::Vec3::new(r[c], g[c], b[c]));
        Self::from_vec((0..CELLS).map(cell).collect())
    }

    /// Replaces every cell that is not trusted by the nearest trusted one.
    ///
    /// Many measured tables have their largest values there, which are extrapolated, not measured.
    pub fn extend_from_trusted(&mut self) {
        for cell in 0..CELLS {
            self.values[cell] = self.values[nearest_trusted(cell)];
        }
    }

    /// Returns the directional albedo along the normal.
    ///
    /// This is the fraction of light from the direction of the normal that is reflected,
    /// `2 pi integral of f(t/2, t/2) cos t sin t dt`.
    pub fn normal_albedo(&self) -> f64 {
        NORMAL_ALBEDO.iter().map(|&(cell, weight)| weight * f64::from(self.values[cell])).sum()
    }

    /// Returns the table scaled to a given [`Self::normal_albedo`], and the factor.
    ///
    /// A photograph under unknown light determines only the product of light and reflectance.
    pub fn with_normal_albedo(&self, albedo: f64) -> (Self, f64) {
        let scale = albedo / self.normal_albedo();
        (self.scaled(scale), scale)
    }

    /// Returns the largest value over the trusted cells.
    pub fn trusted_max(&self) -> f32 {
        (0..CELLS).filter(|&c| is_trusted(c)).map(|c| self.values[c]).fold(f32::NEG_INFINITY, f32::max)
    }
}

/// Cells that contribute to [`BivariateTable::normal_albedo`], with their weights.
static NORMAL_ALBEDO: LazyLock<Vec<(usize, f64)>> = LazyLock::new(|| {
    // Midpoints in sqrt(t), which resolve the lobe as the table does.
    const STEPS: usize = 4000;
    let mut weights = vec![0.0; CELLS];
    for i in 0..STEPS {
        let s = (i as f64 + 0.5) / STEPS as f64;
        let t = s * s * FRAC_PI_2;
        let measure = 2.0 * PI * t.cos() * t.sin() * 2.0 * s * FRAC_PI_2 / STEPS as f64;
        for (cell, share) in BivariateTable::stencil(0.5 * t, 0.5 * t) {
            weights[cell] += share * measure;
        }
    }
    weights.into_iter().enumerate().filter(|(_, weight)| *weight > 0.0).collect()
});

/// A measured isotropic BRDF: 90 x 90 x 180 samples of RGB reflectance in 1/sr.
#[derive(Clone, Debug, PartialEq)]
pub struct MerlTable {
    /// Three channels of `THETA_H * THETA_D * PHI_D` values each, `phi_d` fastest.
    ///
    /// Values are negative in cells below the horizon.
    channels: [Vec<f32>; 3],
}

impl MerlTable {
    /// Number of samples in one channel.
    pub const CHANNEL: usize = THETA_H * THETA_D * PHI_D;

    /// Wraps three channels of [`Self::CHANNEL`] values in 1/sr, `phi_d` fastest.
    ///
    /// Negative values are missing.
    ///
    /// # Panics
    /// If a channel has another length.
    pub fn from_channels(channels: [Vec<f32>; 3]) -> Self {
        assert!(channels.iter().all(|c| c.len() == Self::CHANNEL), "a MERL channel has {} samples", Self::CHANNEL);
        Self { channels }
    }

    /// Repeats one bivariate table per channel over `phi_d`; cells below the horizon become -1.
    pub fn from_bivariate(rgb: [&BivariateTable; 3]) -> Self {
        // All channels share the trigonometry.
        let cosines: [f64; PHI_D] = std::array::from_fn(|k| (k as f64).to_radians().cos());
        let mut channels = rgb.map(|_| Vec::with_capacity(Self::CHANNEL));
        for c in 0..CELLS {
            let ((sin_h, cos_h), (sin_d, cos_d)) = (angles_of(c).0.sin_cos(), angles_of(c).1.sin_cos());
            let valid = cosines.map(|cos_phi| are_above_horizon(cos_h * cos_d, sin_h * sin_d * cos_phi));
            for (channel, table) in channels.iter_mut().zip(rgb) {
                channel.extend(valid.iter().map(|valid| if *valid { table.values[c] } else { -1.0 }));
            }
        }
        Self::from_channels(channels)
    }

    /// Returns [`Self::bivariate`] of red, green and blue.
    pub fn to_bivariate(&self) -> [BivariateTable; 3] {
        [0, 1, 2].map(|channel| self.bivariate(channel))
    }

    /// Returns whether no cell depends on `phi_d`, as in tables from [`Self::from_bivariate`].
    pub fn is_bivariate(&self) -> bool {
        self.channels.iter().flat_map(|channel| channel.chunks_exact(PHI_D)).all(|cell| {
            let mut valid = cell.iter().filter(|v| **v >= 0.0);
            valid.next().is_none_or(|first| valid.all(|v| v == first))
        })
    }

    /// Returns the samples of one channel (0 red, 1 green, 2 blue), `phi_d` fastest.
    pub fn channel(&self, channel: usize) -> &[f32] {
        &self.channels[channel]
    }

    /// Returns the mean over `phi_d` with light and view above the surface (Romeiro et al. 2008).
    ///
    /// Missing values (negative) are skipped. A cell without any value takes that of the neighbour
    /// with the next smaller `theta_d`.
    pub fn bivariate(&self, channel: usize) -> BivariateTable {
        let samples = &self.channels[channel];
        let mut values = vec![0.0_f32; CELLS];
        for c in 0..CELLS {
            let (h, d) = angles_of(c);
            let (mut sum, mut count) = (0.0_f64, 0_u32);
            for (k, &v) in samples[c * PHI_D..][..PHI_D].iter().enumerate() {
                if v >= 0.0 && above_horizon(h, d, (k as f64).to_radians()) {
                    sum += f64::from(v);
                    count += 1;
                }
            }
            values[c] = match count {
                0 if c % THETA_D > 0 => values[c - 1],
                0 => 0.0,
                n => (sum / f64::from(n)) as f32,
            };
        }
        BivariateTable::from_vec(values)
    }

    /// Returns the RGB reflectance at a half/difference direction in radians.
    ///
    /// The interpolation is linear in all three axes, with `phi_d` periodic in 180 degrees. Missing
    /// samples are excluded.
    pub fn eval(&self, theta_h: f64, theta_d: f64, phi_d: f64) -> [f64; 3] {
        let ((i, s), (j, t)) = (axis_h(theta_h), axis_d(theta_d));
        let turn = phi_d.to_degrees().rem_euclid(PHI_D as f64);
        let k = (turn as usize).min(PHI_D - 1);
        let u = turn - k as f64;
        let mut sum = [0.0; 3];
        let mut total = 0.0;
        for (di, wi) in [(0, 1.0 - s), (1, s)] {
            for (dj, wj) in [(0, 1.0 - t), (1, t)] {
                for (dk, wk) in [(0, 1.0 - u), (1, u)] {
                    let at = ((i + di) * THETA_D + j + dj) * PHI_D + (k + dk) % PHI_D;
                    let w = wi * wj * wk;
                    if w > 0.0 && self.channels[1][at] >= 0.0 {
                        total += w;
                        for (sum, channel) in sum.iter_mut().zip(&self.channels) {
                            *sum += w * f64::from(channel[at].max(0.0));
                        }
                    }
                }
            }
        }
        if total > 0.0 { sum.map(|x| x / total) } else { [0.0; 3] }
    }
}

#[cfg(test)]
mod tests;
