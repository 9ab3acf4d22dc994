//! Patterns of two paints on one object: checkers, stripes, spots and labels.
//!
//! A network trained on objects of one material mistakes such a pattern for reflections. On the
//! logarithm of the brightness, a pattern is a smooth function of the normal (the shading) plus the
//! same step wherever the paint changes. The segmentation separates the two:
//!
//! 1. A robust fit of shading to differences between neighbouring cells, for which steps are
//!    outliers, leaves two groups of cells. If the result is not a pattern, a second fit leaves out
//!    the rim.
//! 2. Alternately, shading and step are fitted to the groups, and each cell joins the paint that it
//!    agrees with better.
//! 3. Parts of a group without the step along their border join the other group.
//! 4. If the second paint can be converted to the first, cells of half the side are assigned again
//!    by the conversion. Where reflections at the surface hide the step, earlier assignments are
//!    wrong.
//!
//! Reflections in a mirror can be segmented in the same way, but the steps along their borders are
//! neither equal nor as high as the difference of the groups. The pattern must pass this test. On a
//! surface that may shadow itself, one channel must also rise where another falls, since the
//! borders of shadows are sharp. The thresholds come from renderings of 20 materials in 60 training
//! lights with and without patterns (docs/trials.md).

mod convert;
mod groups;
mod reassign;
mod separate;

use glam::{DVec3, Vec3};

use self::convert::Conversion;
use self::groups::{Groups, Step, deviation, dilated};
use self::reassign::reassign;
use self::separate::{Photograph, separate};
use super::cells::{Cells, SurfaceGeometry};
use super::components::neighbours;
use super::shading::{ShadingBasis, TwoPaints};
use crate::picture::Plane;
use crate::statistics::median;

/// Approximate number of cells along the longer side of the object.
const CELLS: f64 = 100.0;
/// Smallest z of the normals whose differences are fitted, in each start. Reflections at the rim
/// can hide a label on a bright ball.
const STARTS: [f32; 2] = [-1.0, 0.45];
/// Degrees of the shading in the rounds of step 2, and the largest number of rounds of each.
const DEGREES: [(usize, usize); 2] = [(4, 25), (6, 8)];
/// Number of passes over the parts of the groups.
const PASSES: usize = 3;
/// Smallest share of the object of each paint.
const MIN_SHARE: f64 = 0.1;
/// Smallest number of steps along the border of the paints.
const MIN_STEPS: usize = 30;
/// Smallest difference of the paints, a natural logarithm.
const MIN_DIFFERENCE: f64 = 0.25;
/// Smallest rise of one channel while another falls, in natural logarithms, on a surface that may
/// shadow itself.
const MIN_RISE: f64 = 0.05;
/// Range of the median step, relative to the difference of the groups. Patterns have 0.88 to 1.1.
const MEDIAN_STEP: [f64; 2] = [0.8, 1.25];
/// Smallest median step if the smaller part is brighter in all channels, as the image of a lamp is:
/// one in a metallic paint has 0.84.
const MIN_BRIGHT_STEP: f64 = 0.9;
/// Largest spread of the steps about their median, relative to it: a standard deviation, computed
/// from the median absolute deviation. Patterns have 0.05 to 0.4, reflections 0.6 to 2.
const MAX_SPREAD: f64 = 0.45;

/// The smaller part of a pattern of two paints.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pattern {
    /// Pixels of this part, and those so close to it that they may show it, unless they can be
    /// converted.
    pub(super) other: Plane<bool>,
    /// Pixels of this part, converted to the paint of the larger part, in linear RGB.
    pub(super) converted: Plane<Option<Vec3>>,
    /// Ratio of its reflectance to that of the larger part (luminance in the light of the
    /// photograph).
    pub(super) ratio: f64,
    /// Reflectance of each pixel relative to that of the larger part, in linear RGB. Pixels off the
    /// object have the paint of the nearest one on it.
    pub(super) relative: Plane<Vec3>,
}

/// Detects a pattern of two paints; `None` if there is no clear pattern.
pub(super) fn segment_pattern(
    rgb: &Plane<Vec3>,
    usable: &dyn Fn((usize, usize)) -> bool,
    surface: &SurfaceGeometry<'_>,
) -> Option<Pattern> {
    let cells = Cells::of(rgb, usable, surface, (CELLS, false))?;
    let photograph = Photograph { rgb, usable, surface };
    STARTS.into_iter().find_map(|min_z| segment_cells(&cells, min_z, &photograph))
}

/// Detects a pattern from the start with normals of at least `min_z`.
fn segment_cells(cells: &Cells, min_z: f32, photograph: &Photograph<'_>) -> Option<Pattern> {
    let mut groups = Groups::of(cells, min_z)?;
    let (mut step, mut weights) = (DVec3::ZERO, vec![1.0; groups.tones.len()]);
    let mut basis = ShadingBasis::new(&[], 0);
    for (degree, rounds) in DEGREES {
        basis = ShadingBasis::new(&groups.normals, degree);
        (step, weights) = groups.assign(&basis, rounds)?;
    }
    for _ in 0..PASSES {
        if !groups.join_parts(step) {
            break;
        }
    }
    if 2 * groups.count() > groups.other.len() {
        groups.other.iter_mut().for_each(|other| *other = !*other);
    }
    if (groups.count() as f64) < MIN_SHARE * groups.other.len() as f64 {
        return None;
    }
    // The weights belong to the groups before their parts moved.
    let fit = basis.fit_two(&groups.tones, &groups.other, &weights)?;
    let weights = groups.weights(&fit, groups.scale(&fit));
    let step = basis.fit_two(&groups.tones, &groups.other, &weights)?.step;
    let changes: Vec<DVec3> = groups.steps().iter().map(Step::change).collect();
    // Shadows lower all channels.
    let is_shadow = step.max_element() < MIN_RISE || step.min_element() > -MIN_RISE;
    if is_shadow && !photograph.surface.convex {
        return None;
    }
    if !is_pattern(step, &changes) {
        return None;
    }
    separate(&mut groups, step, cells, photograph)
}

/// Whether the steps along the border of two groups are those of two paints that differ by `step`.
fn is_pattern(step: DVec3, steps: &[DVec3]) -> bool {
    let channel = (0..3).fold(0, |best, c| if step[c].abs() > step[best].abs() { c } else { best });
    let difference = step[channel];
    if steps.len() < MIN_STEPS || difference.abs() < MIN_DIFFERENCE {
        return false;
    }
    let relative = || steps.iter().map(|step| step[channel] / difference);
    let middle = median(relative()).unwrap_or(0.0);
    let spread = deviation(relative().map(|step| step - middle)) / middle;
    let is_brighter = step.min_element() > -MIN_RISE && difference > 0.0;
    let least = if is_brighter { MIN_BRIGHT_STEP } else { MEDIAN_STEP[0] };
    (least..=MEDIAN_STEP[1]).contains(&middle) && spread <= MAX_SPREAD
}

#[cfg(test)]
mod tests;
