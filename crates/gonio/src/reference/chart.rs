//! The 24-patch ColorChecker Classic at known corners.

use std::ops::Range;

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::colours::{COLUMNS, FIRST_NEUTRAL, PATCHES, ROWS, patch_colours};
use super::homography::{apply, fit};
use super::light::REFLECTANCE_LOG_SD;
use super::patch::{Clipping, PatchPixels, check_neutral};
use super::{ReferenceError, ReferenceLight};
use crate::colour::Chroma;
use crate::picture::{Plane, luminance};
use crate::statistics::weighted_median;

/// Half of the side of the measured part of a patch, relative to the patch pitch.
const HALF_SIDE: f64 = 0.22;
/// Approximate largest number of pixels that are measured in a patch.
const MAX_PIXELS: usize = 900;
/// Smallest patch pitch in pixels, at which nine pixels of each patch are measured.
pub(super) const MIN_PITCH: f64 = 7.0;
/// Largest fraction of clipped pixels in a usable patch.
const MAX_CLIPPED: f64 = 0.05;
/// Largest relative standard deviation of the luminance in a uniform patch.
const MAX_VARIATION: f64 = 0.2;
/// Smallest number of usable neutral patches.
const MIN_NEUTRAL: usize = 3;
/// Smallest number of usable patches.
const MIN_PATCHES: usize = 14;

/// Centres of the corner patches in pixels from the top left corner of the photograph.
///
/// The order is dark skin, bluish green, black, white: clockwise from the top left on an upright
/// chart.
pub type Corners = [(f64, f64); 4];

/// Corners in chart coordinates, in units of the patch pitch.
const CHART_CORNERS: [DVec2; 4] = [
    DVec2::new(0.0, 0.0),
    DVec2::new(COLUMNS as f64 - 1.0, 0.0),
    DVec2::new(COLUMNS as f64 - 1.0, ROWS as f64 - 1.0),
    DVec2::new(0.0, ROWS as f64 - 1.0),
];

/// Bounds on the deviations of a chart from its published colours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    /// Smallest correlation of the log-chroma of the coloured patches with the published one.
    ///
    /// The channels of a camera before any colour matrix reach 0.9. Patches in another order, or
    /// shifted by one, reach less than 0.3.
    correlation: f64,
    /// Largest mean distance of the chroma of the neutral patches from their common colour.
    neutral: f64,
    /// Largest mean absolute logarithm of the luminance relative to the published one.
    luminance: f64,
    /// Smallest number of uniform patches.
    uniform: usize,
}

impl Tolerance {
    /// Tolerance for corners that a user gave.
    pub(super) const GIVEN: Self = Self { correlation: 0.75, neutral: 0.15, luminance: 0.35, uniform: 18 };
    /// Tolerance for corners that were detected.
    pub(super) const DETECTED: Self = Self { correlation: 0.85, neutral: 0.12, luminance: 0.30, uniform: 20 };
}

/// Colours measured on a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartReading {
    /// Centres of the corner patches, in the order of [`Corners`].
    pub corners: Corners,
    /// Light on the chart.
    pub light: ReferenceLight,
    /// Correlation of the log-chroma of the coloured patches with the published one, at most 1.
    pub chroma_correlation: f64,
    /// Mean distance of the log-chroma of the coloured patches from the published one.
    ///
    /// Primaries other than those of Rec. 709 cause a distance of 0.5 and more.
    pub chroma_residual: f64,
    /// Mean absolute logarithm of the luminance relative to the published one, over all patches.
    pub luminance_residual: f64,
    /// Number of neutral patches used, of six.
    pub neutral_patches: usize,
    /// Number of clipped patches, which are ignored.
    pub clipped_patches: usize,
    /// Angle in radians between the normal of the chart and the direction to the camera.
    ///
    /// The angle is estimated from the foreshortening.
    pub tilt: f64,
}

impl ChartReading {
    /// Measures a chart at given corners.
    ///
    /// The corners may start at any corner patch and run in either direction; the colours determine
    /// their order. `clip` is the radiance at or above which a channel is clipped; without it, the
    /// level is detected in the photograph.
    ///
    /// # Errors
    /// * The corners do not form a chart, are outside the photograph, or are too close together.
    /// * Too many patches are clipped.
    /// * The colours are not those of the chart.
    pub fn of(rgb: &Plane<Vec3>, corners: &Corners, clip: Option<f32>) -> Result<Self, ReferenceError> {
        Self::at(rgb, corners, Clipping::of(rgb, clip), Tolerance::GIVEN)
    }

    /// Measures a chart like [`Self::of`], with a known clip level and another tolerance.
    pub(super) fn at(
        rgb: &Plane<Vec3>,
        corners: &Corners,
        clipping: Clipping,
        tolerance: Tolerance,
    ) -> Result<Self, ReferenceError> {
        let size = rgb.size();
        let corners = corners.map(|(x, y)| DVec2::new(x, y));
        if !is_convex(&corners) {
            return Err(ReferenceError::Corners);
        }
        let within = |p: &DVec2| (0.0..=size.0 as f64).contains(&p.x) && (0.0..=size.1 as f64).contains(&p.y);
        if !corners.iter().all(within) {
            return Err(ReferenceError::Outside { size });
        }
        let measured = ORDERS.into_iter().filter_map(|order| PatchColour::of(rgb, order.map(|i| corners[i]), clipping));
        let best =
            measured.max_by(|a, b| a.fit.correlation.total_cmp(&b.fit.correlation)).ok_or(ReferenceError::Corners)?;
        best.check(tolerance)?;
        check_neutral(best.fit.white)?;
        Ok(Self {
            corners: best.corners.map(|corner| (corner.x, corner.y)),
            light: ReferenceLight { white: best.fit.white, ball: None, log_sd: best.fit.log_sd },
            chroma_correlation: best.fit.correlation,
            chroma_residual: best.fit.residual,
            luminance_residual: best.fit.luminance,
            neutral_patches: best.fit.neutral_patches,
            clipped_patches: best.clipped,
            tilt: tilt(&best.pose),
        })
    }

    /// Returns the pixels of the chart, including the frame between the patches.
    ///
    /// The plane has the size of the photograph.
    pub fn region(&self, (width, height): (usize, usize)) -> Plane<bool> {
        let corners = self.corners.map(|(x, y)| DVec2::new(x, y));
        let inverse = fit(&CHART_CORNERS.into_iter().zip(corners).collect::<Vec<_>>()).map(|pose| pose.inverse());
        Plane::from_fn(width, height, |x, y| {
            inverse.is_some_and(|inverse| {
                let p = apply(&inverse, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                (-0.5..COLUMNS as f64 - 0.5).contains(&p.x) && (-0.5..ROWS as f64 - 0.5).contains(&p.y)
            })
        })
    }
}

/// Possible orders of four corners: starting at any of them, in either direction.
const ORDERS: [[usize; 4]; 8] =
    [[0, 1, 2, 3], [1, 2, 3, 0], [2, 3, 0, 1], [3, 0, 1, 2], [3, 2, 1, 0], [2, 1, 0, 3], [1, 0, 3, 2], [0, 3, 2, 1]];

/// Patches measured for one order of the corners.
struct PatchColour {
    corners: [DVec2; 4],
    pose: DMat3,
    /// Number of patches with positive values that are not clipped.
    usable: usize,
    /// Number of clipped patches.
    clipped: usize,
    /// Number of uniform patches.
    uniform: usize,
    fit: ChartFit,
}

/// Light on the neutral patches, and deviations of all patches from the published colours.
#[derive(Clone, Copy, Debug)]
struct ChartFit {
    white: DVec3,
    log_sd: f64,
    correlation: f64,
    residual: f64,
    neutral: f64,
    luminance: f64,
    neutral_patches: usize,
}

impl PatchColour {
    /// Measures the patches; `None` if the corners are degenerate.
    fn of(rgb: &Plane<Vec3>, corners: [DVec2; 4], clipping: Clipping) -> Option<Self> {
        let pose = fit(&CHART_CORNERS.into_iter().zip(corners).collect::<Vec<_>>())?;
        let patches: Vec<PatchPixels> = (0..PATCHES)
            .map(|patch| PatchPixels::of(&pixels(rgb, &pose, centre_of(patch)), clipping).unwrap_or_default())
            .collect();
        let is_clipped = |patch: &PatchPixels| patch.clipped_share() > MAX_CLIPPED;
        let usable = |patch: &PatchPixels| {
            (!is_clipped(patch) && patch.usable > 0 && patch.median.min_element() > 0.0).then_some(patch.median)
        };
        let colours: Vec<Option<DVec3>> = patches.iter().map(usable).collect();
        Some(Self {
            corners,
            pose,
            usable: colours.iter().flatten().count(),
            clipped: patches.iter().filter(|patch| is_clipped(patch)).count(),
            uniform: patches.iter().filter(|patch| patch.usable > 0 && patch.variation <= MAX_VARIATION).count(),
            fit: ChartFit::of(&colours),
        })
    }

    fn check(&self, tolerance: Tolerance) -> Result<(), ReferenceError> {
        let (Self { fit, clipped, .. }, pitch) = (self, least_pitch(&self.pose));
        if pitch < MIN_PITCH {
            return Err(ReferenceError::SmallChart { pitch });
        }
        if *clipped > 0 && (fit.neutral_patches < MIN_NEUTRAL || self.usable < MIN_PATCHES) {
            let (clipped, usable, neutral) = (*clipped, self.usable, fit.neutral_patches);
            return Err(ReferenceError::ClippedChart { clipped, usable, neutral });
        }
        let over = |what: &str, value: f64, most: f64| {
            (value.is_nan() || value > most)
                .then(|| format!("{what} differs from the published value by {value:.2} (limit {most:.2})"))
        };
        let few = |what: &str, count: usize, least: usize| {
            (count < least).then(|| format!("only {count} of 24 patches are {what} ({least} required)"))
        };
        let reason = few("positive in all channels", self.usable, MIN_PATCHES)
            .or_else(|| {
                let (is, least) = (fit.correlation, tolerance.correlation);
                let text = format!(
                    "the correlation of their log chroma with the published values is {is:.2} ({least:.2} \
                        required)"
                );
                (is < least).then_some(text)
            })
            .or_else(|| over("the log chroma of the neutral patches", fit.neutral, tolerance.neutral))
            .or_else(|| over("the log luminance of the patches", fit.luminance, tolerance.luminance))
            .or_else(|| few("uniform", self.uniform, tolerance.uniform));
        reason.map_or(Ok(()), |reason| Err(ReferenceError::NotAChart { reason }))
    }
}

impl ChartFit {
    /// Compares the colours of the patches, row by row, with the published ones.
    ///
    /// Patches that are not usable are `None`. Without usable patches, all deviations are infinite
    /// and the correlation is zero.
    fn of(measured: &[Option<DVec3>]) -> Self {
        let published = patch_colours();
        let neutral = || (FIRST_NEUTRAL..PATCHES).filter_map(|patch| Some((measured[patch]?, published[patch])));
        let neutral_patches = neutral().count();
        // Weighted by the published colour, since stray light affects the dark patches most.
        let channel =
            |c: usize| weighted_median(neutral().map(|(got, want)| (got[c] / want[c], want[c]))).unwrap_or(0.0);
        let white = DVec3::from_array([0, 1, 2].map(channel));
        let brightness = |colour: DVec3| f64::from(luminance(colour.as_vec3()));
        let off = |patch: usize| {
            let (got, want) = (measured[patch]? / white, published[patch]);
            let chroma = [Chroma::of(got), Chroma::of(want)];
            Some((chroma, (brightness(got) / brightness(want)).ln().abs()))
        };
        let mean = |patches: Range<usize>, pick: fn(([Chroma; 2], f64)) -> f64| {
            let values: Vec<f64> = patches.filter_map(off).map(pick).collect();
            if values.is_empty() { f64::INFINITY } else { values.iter().sum::<f64>() / values.len() as f64 }
        };
        let distance = |([got, want], _): ([Chroma; 2], f64)| got.distance(want);
        let greys = (FIRST_NEUTRAL..PATCHES).filter_map(|patch| Some((off(patch)?.1, published[patch].y)));
        Self {
            white,
            log_sd: REFLECTANCE_LOG_SD.hypot(1.48 * weighted_median(greys).unwrap_or(0.0)),
            correlation: correlation((0..FIRST_NEUTRAL).filter_map(off).map(|off| off.0)),
            residual: mean(0..FIRST_NEUTRAL, distance),
            neutral: mean(FIRST_NEUTRAL..PATCHES, distance),
            luminance: mean(0..PATCHES, |off| off.1),
            neutral_patches,
        }
    }
}

/// Returns the chart coordinates of the centre of a patch.
pub(super) fn centre_of(patch: usize) -> DVec2 {
    DVec2::new((patch % COLUMNS) as f64, (patch / COLUMNS) as f64)
}

/// Returns the pixels in the middle of a patch; of a large patch, every second, third and so on.
fn pixels(rgb: &Plane<Vec3>, pose: &DMat3, centre: DVec2) -> Vec<Vec3> {
    let inverse = pose.inverse();
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(a, b)| apply(pose, centre + HALF_SIDE * DVec2::new(a, b)));
    let (low, high) = corners.iter().fold((corners[0], corners[0]), |(low, high), p| (low.min(*p), high.max(*p)));
    // Casts of negative numbers and NaN give zero.
    let range =
        |low: f64, high: f64, length: usize| (low.floor() as usize).min(length)..(high.ceil() as usize).min(length);
    let (columns, rows) = (range(low.x, high.x, rgb.width()), range(low.y, high.y, rgb.height()));
    let step = (columns.len() * rows.len()).div_ceil(MAX_PIXELS).isqrt().max(1);
    let mut found = Vec::new();
    for y in rows.step_by(step) {
        for x in columns.clone().step_by(step) {
            let p = apply(&inverse, DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) - centre;
            if p.abs().max_element() <= HALF_SIDE {
                found.push(rgb[(x, y)]);
            }
        }
    }
    found
}

/// Returns the smallest distance of neighbouring patches in pixels.
fn least_pitch(pose: &DMat3) -> f64 {
    let at = |patch: usize| apply(pose, centre_of(patch));
    let across = (0..PATCHES).filter(|patch| patch % COLUMNS > 0).map(|patch| at(patch).distance(at(patch - 1)));
    let down = (COLUMNS..PATCHES).map(|patch| at(patch).distance(at(patch - COLUMNS)));
    across.chain(down).fold(f64::INFINITY, f64::min)
}

/// Returns the angle between the normal of the chart and the direction to the camera.
///
/// The angle is estimated from the foreshortening in the middle of the chart.
fn tilt(pose: &DMat3) -> f64 {
    let (middle, step) = (DVec2::new(2.5, 1.5), 0.01);
    let along = |axis: DVec2| (apply(pose, middle + step * axis) - apply(pose, middle - step * axis)) / (2.0 * step);
    let (a, b) = (along(DVec2::X), along(DVec2::Y));
    // Squared singular values of the matrix with columns a and b, from their sum and product.
    let (sum, product) = (a.length_squared() + b.length_squared(), a.perp_dot(b).abs());
    let root = (sum * sum - 4.0 * product * product).max(0.0).sqrt();
    let (large, small) = (0.5 * (sum + root), 0.5 * (sum - root).max(0.0));
    (small / large).sqrt().min(1.0).acos()
}

fn is_convex(corners: &[DVec2; 4]) -> bool {
    let turn = |i: usize| {
        let [a, b, c] = [0, 1, 2].map(|step| corners[(i + step) % 4]);
        (b - a).perp_dot(c - b)
    };
    let turns = [0, 1, 2, 3].map(turn);
    corners.iter().all(|corner| corner.is_finite())
        && (turns.iter().all(|t| *t > 1.0) || turns.iter().all(|t| *t < -1.0))
}

/// Returns the correlation of pairs of chromas about white; zero if either side is neutral.
fn correlation(pairs: impl Iterator<Item = [Chroma; 2]>) -> f64 {
    let dot = |a: Chroma, b: Chroma| a.0[0] * b.0[0] + a.0[1] * b.0[1];
    let (product, got, want) = pairs.fold((0.0, 0.0, 0.0), |(product, one, other), [got, want]| {
        (product + dot(got, want), one + dot(got, got), other + dot(want, want))
    });
    let size = (got * want).sqrt();
    if size > 0.0 { product / size } else { 0.0 }
}

#[cfg(test)]
mod tests;
