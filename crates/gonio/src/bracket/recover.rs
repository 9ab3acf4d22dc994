//! Recovery of a camera's response from a bracket: Debevec and Malik (SIGGRAPH 1997) with the
//! radiances of the pixels eliminated, so that every pixel can contribute.
//!
//! For each channel the unknowns are `g`, the logarithm of the exposure at 256 levels of the code.
//! Pixel `i` with level `z_ij` in exposure `j` gives the equation `g(z_ij) = ln E_i + ln t_j`; the
//! best `ln E_i` given `g` is a weighted mean, which leaves normal equations in `g` alone.
//! Differences from the paper:
//!
//! * Each equation is weighted by the inverse variance of `g(z)` under noise of the code, with the
//!   slope of a typical camera curve. It is weighted again by its residual (Cauchy), so that pixels
//!   that moved or were clipped in between lose their influence.
//! * Smoothness is imposed on `g` over the logarithm of the code, where every power law is
//!   straight. Where the data do not determine the curve, mainly near black, the local power law
//!   continues it.
//! * Isotonic regression makes the curve increase.

use crate::parallel;
use crate::statistics::median;
use faer::Mat;
use gonio_linalg::solve_positive;

use super::frame::Frame;
use super::response::interpolate;
use super::{BracketError, Exposure, Response, check};

/// Number of levels of the code at which the curve is estimated.
const LEVELS: usize = 256;
/// Range of reliable levels: outside it, a code may be clipped or mostly rounding.
const TRUSTED: std::ops::RangeInclusive<f64> = 2.5..=251.5;
/// Standard deviation of a code, in levels: rounding and a little noise.
const CODE_NOISE: f64 = 0.4;
/// Smallest relative error assumed for an exposure.
const MIN_EXPOSURE_ERROR: f64 = 0.02;
/// Weight of the squared second derivative of the curve over the logarithm of the code. Times in a
/// constant ratio leave functions of that period undetermined except for smoothness: a smaller
/// weight admits them, a larger one flattens sharp shoulders.
const SMOOTHNESS: f64 = 100.0;
/// Number of standard deviations at which an equation loses half its weight.
const OUTLYING: f64 = 4.0;
/// Number of rounds of weighting and solving.
const ROUNDS: usize = 8;
/// Largest number of pixels used, evenly spaced.
const MAX_PIXELS: usize = 1 << 18;
/// Smallest number of pixels.
const MIN_PIXELS: usize = 100;
/// Number of parts into which the pixels are split, fixed so that sums do not depend on the number
/// of threads.
const PARTS: usize = 16;
/// Smallest ratio of the times of two exposures that are informative together.
const MIN_RATIO: f64 = 1.1;
/// Largest median disagreement of exposures under the best curve.
const MAX_RESIDUAL: f64 = 0.08;

/// Equations of a pixel: level and logarithm of the time of each exposure whose code is reliable.
type Equations = Vec<(f64, f64)>;

impl Response {
    /// Estimates the response of the camera that took a bracket.
    ///
    /// The middle code of each channel represents an exposure of 1: a pixel whose three codes are
    /// in the middle is grey.
    ///
    /// The codes must overlap: each range of codes must appear in two exposures. The ratios of the
    /// times determine the scale of the logarithm.
    ///
    /// # Errors
    /// [`BracketError::TooLittleOverlap`] with fewer than 100 informative pixels in a channel;
    /// [`BracketError::NoResponse`] if no curve explains the bracket; and the errors of
    /// [`merge()`](super::merge()) about sizes, depths and times.
    pub fn recover(exposures: &[Exposure]) -> Result<Self, BracketError> {
        check(exposures)?;
        let frames: Vec<Frame<'_>> = (0..exposures.len()).map(|i| Frame::new(exposures, i, (0, 0))).collect();
        Self::of_frames(&frames)
    }

    /// Estimates the response from aligned exposures, as [`Self::recover`] does.
    pub(super) fn of_frames(frames: &[Frame<'_>]) -> Result<Self, BracketError> {
        let max = frames[0].max();
        let (shortest, longest) =
            frames.iter().fold((f64::MAX, 0.0), |(a, b), f| (f64::min(a, f.nominal), f64::max(b, f.nominal)));
        if frames.len() > 1 && longest < MIN_RATIO * shortest {
            return Err(BracketError::EqualTimes);
        }
        let mut channels = [const { Vec::new() }; 3];
        for (channel, curve) in channels.iter_mut().enumerate() {
            *curve = recover_channel(&equations(frames, channel))?;
        }
        Ok(Self::from_curves(channels)?.resampled(max))
    }
}

/// Collects the equations of the pixels for one channel.
fn equations(frames: &[Frame<'_>], channel: usize) -> Vec<Equations> {
    let (width, height) = frames[0].size();
    let scale = (LEVELS - 1) as f64 / f64::from(frames[0].max());
    let step = (width * height).div_ceil(MAX_PIXELS).max(1);
    let of_pixel = |pixel: usize| -> Option<Equations> {
        let said: Equations = frames
            .iter()
            .filter_map(|frame| Some((f64::from(frame.at(pixel)?[channel]) * scale, frame.nominal.ln())))
            .filter(|(level, _)| TRUSTED.contains(level))
            .collect();
        let (least, most) = said.iter().fold((f64::MAX, f64::MIN), |(a, b), &(_, t)| (a.min(t), b.max(t)));
        (most - least > MIN_RATIO.ln()).then_some(said)
    };
    parallel::flat_map_range((width * height).div_ceil(step), |at| of_pixel(at * step))
}

fn recover_channel(pixels: &[Equations]) -> Result<Vec<f64>, BracketError> {
    if pixels.len() < MIN_PIXELS {
        return Err(BracketError::TooLittleOverlap { pixels: pixels.len(), least: MIN_PIXELS });
    }
    let mut curve = Response::srgb((LEVELS - 1) as u16).curve(0).to_vec();
    // The weights use the slope of the sRGB curve. With the slope of the current curve, steep parts
    // with few measurements would be favoured.
    let slope: Vec<f64> = (0..LEVELS).map(|k| slope_at(&curve, k)).collect();
    for round in 0..ROUNDS {
        // Outliers can be detected only after an estimate of the curve of this camera.
        curve = solve(pixels, &curve, &slope, round >= 2)?;
    }
    let residual = median(pixels.iter().flat_map(|p| disagreements(p, &curve))).unwrap_or(0.0);
    if residual > MAX_RESIDUAL {
        return Err(BracketError::NoResponse { percent: 100.0 * residual.exp_m1() });
    }
    let middle = curve[LEVELS / 2];
    Ok(curve.iter().map(|g| g - middle).collect())
}

/// Computes the deviations of the exposures of a pixel from their mean, in logarithms.
fn disagreements(pixel: &Equations, curve: &[f64]) -> Vec<f64> {
    let logs: Vec<f64> = pixel.iter().map(|&(level, time)| interpolate(curve, level) - time).collect();
    let mean = logs.iter().sum::<f64>() / logs.len() as f64;
    logs.iter().map(|log| (log - mean).abs()).collect()
}

/// Runs one round: computes weights from the curve `before`, then the best curve for them.
fn solve(pixels: &[Equations], before: &[f64], slope: &[f64], robust: bool) -> Result<Vec<f64>, BracketError> {
    let part = pixels.len().div_ceil(PARTS).max(1);
    let parts: Vec<&[Equations]> = pixels.chunks(part).collect();
    let sums: Vec<(Mat<f64>, Vec<f64>)> =
        parallel::map(&parts, |pixels| normal_equations(pixels, before, slope, robust));
    let (mut matrix, mut right) = (Mat::<f64>::zeros(LEVELS, LEVELS), vec![0.0; LEVELS]);
    for (m, r) in &sums {
        matrix += m;
        right.iter_mut().zip(r).for_each(|(a, b)| *a += b);
    }
    smooth(&mut matrix);
    // The scale is free, so the middle is fixed.
    matrix[(LEVELS / 2, LEVELS / 2)] += 1.0;
    let found = solve_positive(matrix, &right).ok_or(BracketError::NoResponse { percent: f64::INFINITY })?;
    Ok(rising(&found))
}

/// Returns the slope of the curve at a level, from the levels around it.
fn slope_at(curve: &[f64], k: usize) -> f64 {
    let reach = (k / 16).clamp(1, 8);
    let (a, b) = (k.saturating_sub(reach), (k + reach).min(curve.len() - 1));
    ((curve[b] - curve[a]) / (b - a) as f64).max(1e-4)
}

/// Builds the normal equations of some pixels, with their radiances eliminated.
fn normal_equations(pixels: &[Equations], before: &[f64], slope: &[f64], robust: bool) -> (Mat<f64>, Vec<f64>) {
    let (mut matrix, mut right) = (Mat::<f64>::zeros(LEVELS, LEVELS), vec![0.0; LEVELS]);
    let mut terms: Vec<(usize, f64)> = Vec::new();
    for pixel in pixels {
        let weights = weights_of(pixel, before, slope, robust);
        let total: f64 = weights.iter().sum();
        let mean: f64 = pixel.iter().zip(&weights).map(|(&(_, time), w)| w * time).sum::<f64>() / total;
        terms.clear();
        for (&(level, time), &w) in pixel.iter().zip(&weights) {
            let (k, share) = (level as usize, level.fract());
            for (k, a) in [(k, 1.0 - share), (k + 1, share)].into_iter().filter(|(_, a)| *a > 0.0) {
                right[k] += w * a * (time - mean);
                matrix[(k, k)] += w * a * a;
                terms.push((k, w * a));
            }
            if share > 0.0 {
                matrix[(k + 1, k)] += w * share * (1.0 - share);
                matrix[(k, k + 1)] += w * share * (1.0 - share);
            }
        }
        for &(i, a) in &terms {
            for &(j, b) in &terms {
                matrix[(i, j)] -= a * b / total;
            }
        }
    }
    (matrix, right)
}

/// Computes the inverse variances of the equations of a pixel.
fn weights_of(pixel: &Equations, before: &[f64], slope: &[f64], robust: bool) -> Vec<f64> {
    let variance =
        |level: f64| (CODE_NOISE * slope[level.round() as usize]).powi(2) + MIN_EXPOSURE_ERROR * MIN_EXPOSURE_ERROR;
    let plain: Vec<f64> = pixel.iter().map(|&(level, _)| 1.0 / variance(level)).collect();
    if !robust {
        return plain;
    }
    let log = |&(level, time): &(f64, f64)| interpolate(before, level) - time;
    // With three or more exposures, their median is a robust centre; with two, no centre is more
    // robust than their mean.
    let centre = if pixel.len() > 2 {
        median(pixel.iter().map(log)).unwrap_or(0.0)
    } else {
        pixel.iter().zip(&plain).map(|(p, w)| w * log(p)).sum::<f64>() / plain.iter().sum::<f64>()
    };
    let strays = |p: &(f64, f64), w: f64| ((log(p) - centre) / OUTLYING).powi(2) * w;
    pixel.iter().zip(&plain).map(|(p, &w)| w / (1.0 + strays(p, w))).collect()
}

/// Adds the prior of small second differences of the curve over the logarithm of the level.
fn smooth(matrix: &mut Mat<f64>) {
    let u = |k: usize| (k as f64).max(0.25).ln();
    for k in 1..LEVELS - 1 {
        let (left, right) = (1.0 / (u(k) - u(k - 1)), 1.0 / (u(k + 1) - u(k)));
        let width = 0.5 * (u(k + 1) - u(k - 1));
        let row = [(k - 1, left), (k, -left - right), (k + 1, right)];
        for &(i, a) in &row {
            for &(j, b) in &row {
                matrix[(i, j)] += SMOOTHNESS / width * a * b;
            }
        }
    }
}

/// Returns the strictly increasing curve nearest to this one.
///
/// Decreasing neighbours are replaced by their mean.
fn rising(curve: &[f64]) -> Vec<f64> {
    const MIN_STEP: f64 = 1e-5;
    // Sum and count of each block. With the smallest step subtracted, the curve need only be
    // non-decreasing.
    let mut blocks: Vec<(f64, f64)> = Vec::new();
    for (k, g) in curve.iter().enumerate() {
        blocks.push((g - MIN_STEP * k as f64, 1.0));
        while let [.., (a, m), (b, n)] = blocks[..]
            && a / m > b / n
        {
            blocks.truncate(blocks.len() - 2);
            blocks.push((a + b, m + n));
        }
    }
    let flat = blocks.iter().flat_map(|&(sum, n)| std::iter::repeat_n(sum / n, n as usize));
    flat.enumerate().map(|(k, g)| g + MIN_STEP * k as f64).collect()
}
