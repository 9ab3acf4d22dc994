//! Converts pixels of the second paint to the first.
//!
//! A coat reflects the same light over both paints, and the diffuse reflections of both are smooth
//! functions of the normal `n`. In each channel, the radiance `I1` of the first paint therefore
//! follows from the radiance `I2` of the second:
//!
//! ```text
//! I1 = g I2 + A(n)
//! ```
//!
//! `A` is a polynomial of the normal. If both paints have the same reflections at their surface,
//! the gain `g` is one (a free gain would be too small, because `I2` is noisy). If all reflections
//! of the paints are proportional, `A` is zero. Both relations are fitted to the border of the
//! paints, where a photograph shows `I1` and `I2` side by side. The fits are robust, since some
//! cells at the border show both paints. Their covariance decides which pixels can be converted.

use faer::Mat;
use glam::{DVec3, Vec3};
use gonio_linalg::{Cholesky, axpy, dot, squared_norms, weighted_gram};

use super::groups::robust_weight;
use super::{Cells, Groups, deviation};
use crate::scene::shading::{degrees, polynomials};
use crate::statistics::median;

/// Standard deviations of the coefficients before the fit, by degree, relative to the median
/// radiance of the first paint. Diffuse reflections are smooth.
const SMOOTHNESS: [f64; 7] = [2.0, 1.0, 0.5, 0.3, 0.2, 0.1, 0.1];
/// Largest degree of the polynomials.
const DEGREE: usize = SMOOTHNESS.len() - 1;
/// Prior of paints with the same reflections at their surface.
const EQUAL_SURFACES: Relation = Relation { gain: (1.0, 1e-4), smooth: 1.0 };
/// Prior of paints whose reflections are all proportional.
const PROPORTIONAL: Relation = Relation { gain: (1.0, 10.0), smooth: 1e-6 };
/// Scale of the residuals of proportional paints, relative to that of equal surfaces. Up to the
/// first value, gonio takes the paints for proportional. Up to the second, it does so without
/// comparing the conversions.
const PROPORTIONAL_SCALE: [f64; 2] = [1.1, 0.8];
/// Largest scale of the residuals of a conversion.
const MAX_SCALE: f64 = 0.1;
/// Number of rounds of the robust fit.
const ROUNDS: usize = 12;
/// Smallest scale of the residuals, relative to the radiance.
const MIN_SCALE: f64 = 0.005;

/// Radiance of the first paint as a function of the normal and the radiance of the second.
pub(super) struct Conversion {
    channels: [ChannelConversion; 3],
    /// A conversion that explains the border as well. Where it differs, both are inaccurate.
    rival: Option<[ChannelConversion; 3]>,
}

/// Relation of the radiance of two paints.
#[derive(Clone, Copy)]
struct Relation {
    /// Mean and standard deviation of the gain before the fit.
    gain: (f64, f64),
    /// Factor of the standard deviations of the polynomials.
    smooth: f64,
}

/// The conversion of one channel.
struct ChannelConversion {
    /// The gain, then the coefficients of the polynomials.
    coefficients: Vec<f64>,
    /// Factor of the inverse of the covariance of the coefficients.
    precision: Cholesky,
    /// Radiance added to that of the first paint before residuals are divided by it.
    floor: f64,
    /// Scale of the residuals, relative to the radiance of the first paint.
    scale: f64,
}

impl Conversion {
    /// Fits the conversion to the steps along the border of the groups; `None` if it does not
    /// explain them.
    pub(super) fn fit(groups: &Groups, cells: &Cells) -> Option<Self> {
        let steps = groups.steps();
        let normals: Vec<Vec3> = steps.iter().map(|step| groups.normal_of(step)).collect();
        let radiances: Vec<[DVec3; 2]> = steps.iter().map(|step| step.tones.map(|tone| cells.radiance(tone))).collect();
        let fit = |relation: Relation| {
            let channel = |c: usize| {
                let pairs: Vec<[f64; 2]> = radiances.iter().map(|pair| pair.map(|radiance| radiance[c])).collect();
                ChannelConversion::fit(&pairs, &normals, cells.floor(), relation)
            };
            Some([channel(0)?, channel(1)?, channel(2)?])
        };
        // The geometric mean of the channels.
        let scale = |fit: &[ChannelConversion; 3]| fit.iter().map(|channel| channel.scale).product::<f64>().cbrt();
        let (equal, proportional) = (fit(EQUAL_SURFACES)?, fit(PROPORTIONAL)?);
        let relative = scale(&proportional) / scale(&equal);
        let [most, clear] = PROPORTIONAL_SCALE;
        let found = if relative > most {
            Self { channels: equal, rival: None }
        } else {
            Self { channels: proportional, rival: (relative > clear).then_some(equal) }
        };
        (scale(&found.channels) <= MAX_SCALE).then_some(found)
    }

    /// Returns the colour of a pixel of the second paint as if it had the first.
    pub(super) fn convert(&self, second: Vec3, normal: Vec3) -> Vec3 {
        let mut functions = functions(0.0, normal);
        Vec3::from_array([0, 1, 2].map(|c| {
            functions[0] = f64::from(second[c]);
            dot(&self.channels[c].coefficients, &functions).max(0.0) as f32
        }))
    }

    /// Returns the relative error to expect of the conversion of each cell if it has the second
    /// paint. It is the largest standard deviation of the channels, plus the difference from the
    /// rival beyond two of its standard deviations.
    pub(super) fn errors(&self, groups: &Groups, cells: &Cells) -> Vec<f64> {
        let mut errors = vec![0.0_f64; groups.tones.len()];
        for (c, channel) in self.channels.iter().enumerate() {
            let radiances: Vec<f64> = groups.tones.iter().map(|tone| cells.radiance(*tone)[c]).collect();
            let own = channel.values(&radiances, &groups.normals);
            let rival = self.rival.as_ref().map(|rival| rival[c].values(&radiances, &groups.normals));
            for (i, (error, (value, deviation))) in errors.iter_mut().zip(own).enumerate() {
                let excess = rival.as_ref().map_or(0.0, |rival| (value - rival[i].0).abs() - 2.0 * rival[i].1);
                *error = error.max((deviation + excess.max(0.0)) / (value.max(0.0) + channel.floor));
            }
        }
        errors
    }
}

impl ChannelConversion {
    /// Returns the radiance of the first paint and its standard deviation for radiances of the
    /// second paint at these normals.
    fn values(&self, radiances: &[f64], normals: &[Vec3]) -> Vec<(f64, f64)> {
        let mut columns = Mat::zeros(self.coefficients.len(), radiances.len());
        for (i, (radiance, normal)) in radiances.iter().zip(normals).enumerate() {
            columns.col_as_slice_mut(i).copy_from_slice(&functions(*radiance, *normal));
        }
        let values: Vec<f64> = (0..radiances.len()).map(|i| dot(columns.col_as_slice(i), &self.coefficients)).collect();
        self.precision.whiten(&mut columns);
        values.into_iter().zip(squared_norms(columns.as_ref()).into_iter().map(f64::sqrt)).collect()
    }

    /// Fits pairs of radiances of the first and the second paint at these normals.
    fn fit(pairs: &[[f64; 2]], normals: &[Vec3], floor: f64, relation: Relation) -> Option<Self> {
        let middle = median(pairs.iter().map(|[first, _]| *first))? + floor;
        // The precision of the coefficients before the fit, and its product with their mean.
        let prior: Vec<f64> = std::iter::once(relation.gain.1.powi(-2))
            .chain(degrees(DEGREE).map(|degree| (relation.smooth * SMOOTHNESS[degree] * middle).powi(-2)))
            .collect();
        let size = prior.len();
        // Rows relative to the radiance of the first paint.
        let mut columns = Mat::zeros(size, pairs.len());
        let mut values = Vec::with_capacity(pairs.len());
        for (i, ([first, second], normal)) in pairs.iter().zip(normals).enumerate() {
            let scale = 1.0 / (first.max(0.0) + floor);
            let column = columns.col_as_slice_mut(i);
            column.copy_from_slice(&functions(*second, *normal));
            column.iter_mut().for_each(|x| *x *= scale);
            values.push(first * scale);
        }
        let mut weights = vec![1.0; pairs.len()];
        let mut scale = 0.1;
        let mut fit = None;
        for _ in 0..ROUNDS {
            let precisions: Vec<f64> = weights.iter().map(|weight| weight / (scale * scale)).collect();
            let precision = Cholesky::of_sum(&weighted_gram(columns.as_ref(), &precisions), &prior)?;
            let mut right = vec![0.0; size];
            right[0] = relation.gain.0 * prior[0];
            for (i, (value, precision)) in values.iter().zip(&precisions).enumerate() {
                axpy(value * precision, columns.col_as_slice(i), &mut right);
            }
            let coefficients = precision.solve(&right);
            let residuals: Vec<f64> = values
                .iter()
                .enumerate()
                .map(|(i, value)| value - dot(columns.col_as_slice(i), &coefficients))
                .collect();
            scale = deviation(residuals.iter().copied()) + MIN_SCALE;
            weights = residuals.iter().map(|residual| robust_weight(residual / scale)).collect();
            fit = Some(Self { coefficients, precision, floor, scale });
        }
        fit
    }
}

/// Returns the radiance of the second paint, and the polynomials of the normal.
fn functions(second: f64, normal: Vec3) -> Vec<f64> {
    std::iter::once(second).chain(polynomials(normal.as_dvec3(), DEGREE)).collect()
}
