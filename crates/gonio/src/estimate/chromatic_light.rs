//! Colours of the estimated light in each direction, and the residual of the channels.
//!
//! Given the channels `F_c` of a BRDF and the luminance `L` of the light, the channels of the light
//! are `L_c(w) = w_c L(w) (1 + t_c(w))`, where `w_c` is its overall colour. The tints `t` of red
//! and blue are Gaussian fields along two axes, with the statistics of captured light; the tint of
//! green preserves the luminance. An image is linear in the tints, so their posterior is Gaussian.
//! [`ChromaticLight::grid`] is the light of the posterior mean.
//!
//! Captured light varies from blue to orange, and little from green to magenta. If photograph and
//! BRDF differ along the green-magenta axis ([`ChromaticLight::chroma_residual`]), either the
//! colours of the BRDF are wrong, or the light is unusual, for example over grass.

use faer::{Accum, Mat};
use glam::{DVec3, Vec3};
use gonio_linalg::{Cholesky, multiply};

use super::{Colouring, Diagnostic, EstimateError, Light};
use crate::colour::Chroma;
use crate::inference::light::LightError;
use crate::lighting::{LightGrid, LightPrior};
use crate::parallel;
use crate::picture::luminance;
use crate::reflectance::BivariateTable;
use crate::scene::Observations;
use crate::sphere::{Haar, OctahedralMap};
use crate::transfer::{TransferSettings, observed_rows};

/// Blue-orange and green-magenta axis of the tints of red and blue, with the standard deviation
/// along each over the directions of a light (`gonio-eval tints`).
const AXES: [([f64; 2], f64); 2] = [([-0.465, 0.885], 0.46), ([0.885, 0.465], 0.12)];

/// Angle (radians) over which the correlation of the tints falls to 1/e, and the correlated share
/// of their variance (`gonio-eval tints`).
const CORRELATED: (f64, f64) = (50.0 / 180.0 * std::f64::consts::PI, 0.75);

/// Squares along a side of the grid of tints. Colours need fewer squares than luminance.
const CHROMA_SIDE: usize = 16;

/// Approximate number of observations for the estimation of the tints.
const ROWS: usize = 500;

/// Smallest relative error of the model.
const MIN_ERROR: f64 = 0.03;

/// Share of the mean brightness that the error model adds to the brightness of a point, since the
/// error of dark points is not proportional to their brightness.
const BRIGHTNESS_FLOOR: f64 = 0.2;

/// Green-magenta difference above which the colours of the BRDF are reported as unreliable. The
/// median error of the colours was at least 0.48 above it, and 0.17 below a difference of 0.1
/// (docs/trials.md).
const MAX_GREEN_MAGENTA_RESIDUAL: f64 = 0.2;

/// Colours of a light, and their residual.
#[derive(Clone, Debug, PartialEq)]
pub struct ChromaticLight {
    /// The light in linear RGB, with the luminance of [`Light::grid`].
    pub grid: LightGrid,
    /// Root mean square difference between the chroma of the photograph and that of the BRDF in a
    /// light of uniform colour. The two values are those along the blue-orange and the
    /// green-magenta axis, in natural logarithms. They exclude the noise of single pixels.
    pub chroma_residual: [f64; 2],
    /// Root mean square residual of the channels, given BRDF and coloured light, relative to the
    /// photograph at the luminance of the reproduction.
    pub misfit: f64,
}

impl ChromaticLight {
    /// Returns a diagnostic if the colours of the BRDF are unreliable.
    pub(super) fn diagnostic(&self) -> Option<Diagnostic> {
        (self.chroma_residual[1] > MAX_GREEN_MAGENTA_RESIDUAL).then_some(Diagnostic::Colours(self.chroma_residual[1]))
    }
}

/// Linear maps from the luminance of the light to the channels of observations, given a BRDF.
pub(super) struct Rows {
    observations: Observations,
    /// Weights of the light coefficients: `side^2` per channel of the BRDF, for each observation
    /// with a value.
    coefficients: Vec<f32>,
    side: usize,
}

impl Rows {
    /// Integrates the BRDF over a light of `side` texels per side.
    ///
    /// Returns `None` if the photograph or the requested BRDF is grey.
    pub(super) fn of(
        prior: &LightPrior,
        observations: &Observations,
        table: &BivariateTable,
        colouring: &Colouring,
        side: usize,
    ) -> Result<Option<Self>, EstimateError> {
        if matches!(colouring, Colouring::Grey | Colouring::GreyPhotograph) {
            return Ok(None);
        }
        let observations = observations.thinned(ROWS);
        let settings = TransferSettings::of_side(side);
        let tables = colouring.field().tables(table);
        let (coefficients, _) =
            observed_rows(observations.points_with_visibility(), &observations.values, &tables, prior, &settings)
                .map_err(LightError::from)?;
        Ok(Some(Self { observations, coefficients, side }))
    }

    /// Estimates the colours of a light; `None` if the photograph is black.
    pub(super) fn under(&self, colouring: &Colouring, light: &Light) -> Option<ChromaticLight> {
        SquareContributions::of(self, colouring, light).map(|squares| squares.chromatic_light(light))
    }
}

/// Contribution of each square of the light to each observation.
struct SquareContributions {
    /// Observed colours, linear RGB.
    colours: Vec<DVec3>,
    /// Their weights, in 0..=1.
    weights: Vec<f64>,
    /// Normals in the frame of the view direction.
    normals: Vec<DVec3>,
    /// Squares along a side.
    side: usize,
    /// For each channel, the image of every square (squares x observations) under the luminance of
    /// the light, times `w_c`.
    parts: [Mat<f64>; 3],
    /// Overall colour of the light, with luminance one.
    white: [f64; 3],
}

impl SquareContributions {
    /// Returns `None` if all observations are black.
    fn of(rows: &Rows, colouring: &Colouring, light: &Light) -> Option<Self> {
        let observations = &rows.observations;
        let fine = rows.side;
        let coarse = light.grid.reduced(fine);
        let texels: Vec<f64> = coarse.texels().iter().map(|t| f64::from(luminance(*t).max(0.0))).collect();
        let side = fine.min(CHROMA_SIDE);
        let observed: Vec<usize> =
            (0..observations.values.len()).filter(|&i| observations.values[i].is_some()).collect();
        // A row holds weights of light coefficients; the inverse transform converts them to weights
        // of texels.
        let haar = Haar::new(fine).expect("the side of a light is a power of two");
        let scale = LightGrid::texel_measure(fine).sqrt();
        let count = side * side;
        let squares = |row: &[f32]| -> Vec<f64> {
            let mut scratch = Vec::new();
            let mut sums = vec![0.0; 3 * count];
            for (coefficients, sums) in row.chunks_exact(fine * fine).zip(sums.chunks_exact_mut(count)) {
                let mut of_texels = coefficients.to_vec();
                haar.inverse(&mut of_texels, &mut scratch);
                for (t, (share, radiance)) in of_texels.iter().zip(&texels).enumerate() {
                    sums[LightGrid::coarser_texel(fine, side, t)] += scale * f64::from(*share) * radiance;
                }
            }
            sums
        };
        let each: Vec<&[f32]> = rows.coefficients.chunks_exact(3 * fine * fine).collect();
        let sums = parallel::map(&each, |row| squares(row));
        let white = colouring.light().as_dvec3().to_array();
        let part = |c: usize| Mat::from_fn(count, sums.len(), |k, i| white[c] * sums[i][c * count + k]);
        let parts = [part(0), part(1), part(2)];
        let colours: Vec<DVec3> =
            observed.iter().map(|&i| observations.colours[i].unwrap_or_default().as_dvec3()).collect();
        let bright = colours.iter().any(|c| c.max_element() > 0.0);
        bright.then(|| Self {
            colours,
            weights: observed.iter().map(|&i| observations.weights[i].clamp(0.0, 1.0)).collect(),
            normals: observed.iter().map(|&i| observations.points[i].in_view()).collect(),
            side,
            parts,
            white,
        })
    }

    /// Returns the image under a light of uniform colour.
    fn plain(&self) -> Vec<DVec3> {
        let sum = |c: usize, i: usize| self.parts[c].col_as_slice(i).iter().sum::<f64>();
        (0..self.colours.len()).map(|i| DVec3::from_array([0, 1, 2].map(|c| sum(c, i)))).collect()
    }

    fn chromatic_light(&self, light: &Light) -> ChromaticLight {
        let plain = self.plain();
        let tints = self.posterior(&plain, light.coarse_misfit.max(MIN_ERROR), light.grid.map());
        let (fine, white) = (light.grid.side(), Vec3::from_array(self.white.map(|x| x as f32)));
        let texel = |(t, radiance): (usize, &Vec3)| {
            let factor = tints[LightGrid::coarser_texel(fine, self.side, t)];
            // Preserves the luminance where a channel is clamped at zero.
            let colour = (white * (Vec3::ONE + factor.as_vec3())).max(Vec3::ZERO);
            luminance(*radiance) * colour / luminance(colour).max(1e-6)
        };
        let texels = light.grid.texels().iter().enumerate().map(texel).collect();
        ChromaticLight {
            grid: LightGrid::from_texels(light.grid.map(), fine, texels),
            chroma_residual: self.chroma_residual(&plain),
            misfit: self.misfit(&tints),
        }
    }

    /// Returns the differences between the chromas of photograph and image along the [`AXES`].
    ///
    /// Each is the root of the mean product of neighbouring observations, in which the noise of
    /// single pixels cancels.
    fn chroma_residual(&self, plain: &[DVec3]) -> [f64; 2] {
        let difference = |(observed, made): (&DVec3, &DVec3)| {
            let (observed, made) = (Chroma::of(*observed).0, Chroma::of(*made).0);
            AXES.map(|(axis, _)| axis[0] * (observed[0] - made[0]) + axis[1] * (observed[1] - made[1]))
        };
        let differences: Vec<[f64; 2]> = self.colours.iter().zip(plain).map(difference).collect();
        let neighbour = |i: usize| {
            let others = (0..self.normals.len()).filter(|&j| j != i);
            others
                .max_by(|&a, &b| self.normals[i].dot(self.normals[a]).total_cmp(&self.normals[i].dot(self.normals[b])))
        };
        let pairs: Vec<(usize, usize)> = (0..differences.len()).filter_map(|i| Some((i, neighbour(i)?))).collect();
        let weight = |&(i, j): &(usize, usize)| self.weights[i] * self.weights[j];
        let total: f64 = pairs.iter().map(weight).sum();
        [0, 1].map(|axis| {
            let product = |pair: &(usize, usize)| weight(pair) * differences[pair.0][axis] * differences[pair.1][axis];
            (pairs.iter().map(product).sum::<f64>() / total.max(f64::MIN_POSITIVE)).max(0.0).sqrt()
        })
    }

    /// Returns the relative root mean square residual of the colours, given the tints.
    fn misfit(&self, tints: &[DVec3]) -> f64 {
        let (mut residual, mut all) = (0.0, 0.0);
        for (i, (observed, weight)) in self.colours.iter().zip(&self.weights).enumerate() {
            let channel = |c: usize| -> f64 {
                self.parts[c].col_as_slice(i).iter().zip(tints).map(|(g, t)| g * (1.0 + t[c])).sum()
            };
            let made = DVec3::from_array([0, 1, 2].map(channel));
            let observed = at_luminance_of(*observed, made);
            residual += weight * (observed - made).length_squared();
            all += weight * observed.length_squared();
        }
        (residual / all.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Returns the tints of red, green and blue of one standard deviation along each axis.
    fn directions(&self) -> [DVec3; 2] {
        let share = [0, 1, 2].map(|c| f64::from(luminance(Vec3::AXES[c])) * self.white[c]);
        AXES.map(|([red, blue], sd)| sd * DVec3::new(red, -(share[0] * red + share[2] * blue) / share[1], blue))
    }

    /// Returns the posterior mean of the tints of red, green and blue of every square.
    ///
    /// `error` is the relative standard deviation of the model error.
    fn posterior(&self, plain: &[DVec3], error: f64, map: OctahedralMap) -> Vec<DVec3> {
        let (count, rows) = (self.side * self.side, self.colours.len());
        let directions = self.directions();
        let mean = plain.iter().sum::<DVec3>() / rows as f64;
        // Factor that scales a channel of an observation to unit error.
        let precision = |c: usize, i: usize, plain: &DVec3| {
            self.weights[i].sqrt() * (1.0 + BRIGHTNESS_FLOOR)
                / (error * (plain[c] + BRIGHTNESS_FLOOR * mean[c])).max(1e-12 * mean[c])
        };
        let mut system = Mat::<f64>::zeros(2 * count, 3 * rows);
        let mut right = vec![0.0; 3 * rows];
        for (i, plain) in plain.iter().enumerate() {
            let observed = at_luminance_of(self.colours[i], *plain);
            for c in 0..3 {
                let (column, weight) = (3 * i + c, precision(c, i, plain));
                right[column] = weight * (observed[c] - plain[c]);
                let part = self.parts[c].col_as_slice(i);
                let out = system.col_as_slice_mut(column);
                for (axis, direction) in directions.iter().enumerate() {
                    let factor = weight * direction[c];
                    out[axis * count..][..count].iter_mut().zip(part).for_each(|(x, g)| *x = factor * g);
                }
            }
        }
        let mut normal = self.inverse_prior(map);
        multiply(normal.as_mut(), Accum::Add, system.as_ref(), system.transpose(), 1.0);
        let moment: Vec<f64> = system.row_iter().map(|row| row.iter().zip(&right).map(|(x, r)| x * r).sum()).collect();
        let solved = Cholesky::new(normal).map(|factor| factor.solve(&moment));
        let solved = solved.unwrap_or_else(|| vec![0.0; 2 * count]);
        (0..count).map(|k| solved[k] * directions[0] + solved[count + k] * directions[1]).collect()
    }

    /// Returns the inverse correlation matrix of the squares, block-diagonal in the axes.
    fn inverse_prior(&self, map: OctahedralMap) -> Mat<f64> {
        let count = self.side * self.side;
        let centres: Vec<DVec3> = (0..count).map(|k| LightGrid::direction_of(map, self.side, k)).collect();
        let (angle, share) = CORRELATED;
        let correlation = Mat::from_fn(count, count, |i, j| {
            let near = share * (-centres[i].angle_between(centres[j]) / angle).exp();
            if i == j { 1.0 } else { near }
        });
        let one = Cholesky::new(correlation).expect("an exponential correlation is positive definite");
        let inverse = one.solve_all(&Mat::identity(count, count));
        Mat::from_fn(
            2 * count,
            2 * count,
            |i, j| {
                if i / count == j / count { inverse[(i % count, j % count)] } else { 0.0 }
            },
        )
    }
}

/// Scales a colour to the luminance of another. The tints preserve the luminance, so they must not
/// explain a misfit of it.
fn at_luminance_of(colour: DVec3, other: DVec3) -> DVec3 {
    let luminance = |c: DVec3| f64::from(luminance(c.as_vec3())).max(0.0);
    let (have, want) = (luminance(colour), luminance(other));
    if have > 0.0 { colour * (want / have) } else { other }
}

#[cfg(test)]
mod tests;
