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
//!
//! Reflections in a mirror can be segmented in the same way, but the steps along their borders are
//! neither equal nor as high as the difference of the groups. The pattern must pass this test. On a
//! surface that may shadow itself, one channel must also rise where another falls, since the
//! borders of shadows are sharp. The thresholds come from renderings of 20 materials in 60 training
//! lights with and without patterns (docs/trials.md).

mod convert;

use faer::Mat;
use glam::{DVec3, Vec3};
use gonio_linalg::eigenvectors;

use super::cells::{Cells, SurfaceGeometry};
use super::components::neighbours;
use super::shading::{ShadingBasis, TwoPaints};
use crate::picture::{Plane, luminance};
use crate::statistics::median;

/// Approximate number of cells along the longer side of the object.
const CELLS: f64 = 100.0;
/// Smallest number of cells of an object: those of a ball of 50 pixels. In smaller photographs,
/// reflections of windows have the sharp edges of paint (docs/trials.md).
const MIN_CELLS: usize = 2000;
/// Distance of cells whose differences are fitted, in cells, and the degree of the shading in this
/// fit. With a degree of 4, labels are mistaken for shading.
const DIFFERENCES: (isize, usize) = (3, 6);
/// Smallest z of the normals whose differences are fitted, in each start. Reflections at the rim
/// can hide a label on a bright ball.
const STARTS: [f32; 2] = [-1.0, 0.45];
/// Residual of a difference that counts as a step, and the smallest share of such differences.
/// Without steps, there is no pattern.
const STEP: (f64, f64) = (0.15, 0.005);
/// Number of rounds of this fit. After the first three, photographs without half as many steps are
/// rejected: most photographs show one paint.
const DIFFERENCE_ROUNDS: usize = 12;
/// Degrees of the shading in the rounds of step 2, and the largest number of rounds of each.
const DEGREES: [(usize, usize); 2] = [(4, 25), (6, 8)];
/// Squared residual, in units of the squared scale, beyond which a cell does not decide.
const MAX_SQUARE: f64 = 25.0;
/// Residual at which the weight of a cell is one half, in units of the scale.
const HALF_WEIGHT: f64 = 2.5;
/// Smallest scale of the residuals.
const MIN_SCALE: f64 = 0.01;
/// Number of passes over the parts of the groups.
const PASSES: usize = 3;
/// Smallest number of steps along the border of a part, and their smallest median relative to the
/// difference of the groups.
const PART: (usize, f64) = (4, 0.5);
/// Distance in cells over which the tones of both paints are averaged at their border.
const BORDER: usize = 2;
/// Smallest share of the object of each paint.
const MIN_SHARE: f64 = 0.1;
/// Smallest share of the object that must remain without the second paint and its margin.
const MIN_REMAINING: f64 = 0.15;
/// Share of the object without the second paint below which gonio converts this paint. An
/// interpolation over small spots and labels is more accurate (docs/trials.md).
const MAX_CONVERTED: f64 = 0.5;
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
    STARTS.into_iter().find_map(|min_z| segment_cells(&cells, min_z, surface.convex, rgb))
}

/// Detects a pattern from the start with normals of at least `min_z`.
fn segment_cells(cells: &Cells, min_z: f32, is_convex: bool, rgb: &Plane<Vec3>) -> Option<Pattern> {
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
    let steps = groups.steps();
    let changes: Vec<DVec3> = steps.iter().map(|step| step.change).collect();
    // Shadows lower all channels.
    let is_shadow = step.max_element() < MIN_RISE || step.min_element() > -MIN_RISE;
    if is_shadow && !is_convex {
        return None;
    }
    if !is_pattern(step, &changes) {
        return None;
    }
    let margin = if cells.side > 1 { 1 } else { 2 };
    let ignored = dilated(groups.in_second(), margin);
    let remaining = groups.places.iter().filter(|at| !ignored[**at]).count();
    let share = remaining as f64 / groups.places.len() as f64;
    let is_enough = share >= MIN_REMAINING;
    is_enough.then(|| {
        let second = step.exp().as_vec3();
        let converted = match share < MAX_CONVERTED {
            true => groups.converted(cells, rgb, &steps, margin),
            false => rgb.map(|_| None),
        };
        let other = cells.pixels(&ignored, rgb.size());
        let other = Plane::from_fn(rgb.width(), rgb.height(), |x, y| other[(x, y)] && converted[(x, y)].is_none());
        let paint = |is_second: &bool| if *is_second { second } else { Vec3::ONE };
        Pattern {
            other,
            converted,
            ratio: groups.ratio(step),
            relative: groups.second_paint(cells, rgb, step).map(paint),
        }
    })
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

/// Cells in two groups.
struct Groups {
    /// Index of each cell with a tone.
    index: Plane<Option<usize>>,
    /// Position of each such cell.
    places: Vec<(usize, usize)>,
    tones: Vec<DVec3>,
    normals: Vec<Vec3>,
    /// Whether a cell is in the second group.
    other: Vec<bool>,
}

/// A step between neighbouring cells of different groups.
struct Step {
    /// Indices of a cell of the first group and its neighbour in the second.
    cells: [usize; 2],
    /// Difference of the tones of both groups, extrapolated to the border from both sides.
    change: DVec3,
}

impl Groups {
    /// Divides the cells into two groups by what a smooth shading leaves; `None` without steps. The
    /// shading is fitted to normals of at least `min_z`.
    fn of(cells: &Cells, min_z: f32) -> Option<Self> {
        let size = cells.tones.size();
        let places: Vec<(usize, usize)> = (0..size.1)
            .flat_map(|v| (0..size.0).map(move |u| (u, v)))
            .filter(|at| cells.tones[*at].is_some())
            .collect();
        if places.len() < MIN_CELLS {
            return None;
        }
        let mut index = cells.tones.map(|_| None);
        places.iter().enumerate().for_each(|(i, at)| index[*at] = Some(i));
        let tones: Vec<DVec3> = places.iter().filter_map(|at| cells.tones[*at]).collect();
        let normals: Vec<Vec3> = places.iter().map(|at| cells.normals[*at]).collect();
        let mut groups = Self { index, places, tones, normals, other: Vec::new() };
        let is_fitted: Vec<bool> = groups.normals.iter().map(|normal| normal.z >= min_z).collect();
        groups.other = two_groups(&groups.without_shading(&is_fitted)?, &is_fitted);
        Some(groups)
    }

    /// Returns the index of the cell at an offset from another.
    fn at(&self, (u, v): (usize, usize), offset: (isize, isize)) -> Option<usize> {
        let (u, v) = (u.checked_add_signed(offset.0)?, v.checked_add_signed(offset.1)?);
        if u < self.index.width() && v < self.index.height() { self.index[(u, v)] } else { None }
    }

    /// Returns the ratio of the luminance of the cells of the first group if they had the second
    /// paint, which differs by `step`, to their own.
    fn ratio(&self, step: DVec3) -> f64 {
        let exp = |tone: DVec3| f64::from(luminance(tone.exp().as_vec3()));
        let first = || self.tones.iter().zip(&self.other).filter(|(_, other)| !**other).map(|(tone, _)| *tone);
        first().map(|tone| exp(tone + step)).sum::<f64>() / first().map(exp).sum::<f64>()
    }

    fn count(&self) -> usize {
        self.other.iter().filter(|other| **other).count()
    }

    /// Returns the tones less a smooth shading, about their median. The shading is fitted to
    /// differences of the cells in `is_fitted`, so that steps are outliers. Returns `None` without
    /// steps.
    fn without_shading(&self, is_fitted: &[bool]) -> Option<Vec<DVec3>> {
        let (span, degree) = DIFFERENCES;
        let pairs: Vec<(usize, usize)> = [(span, 0), (0, span)]
            .into_iter()
            .flat_map(|offset| {
                self.places.iter().enumerate().filter_map(move |(i, at)| Some((i, self.at(*at, offset)?)))
            })
            .filter(|(i, j)| is_fitted[*i] && is_fitted[*j])
            .collect();
        if pairs.is_empty() {
            return None;
        }
        let basis = ShadingBasis::new(&self.normals, degree);
        let differences = basis.differences(&pairs);
        let changes: Vec<DVec3> = pairs.iter().map(|(i, j)| self.tones[*j] - self.tones[*i]).collect();
        let mut weights = vec![1.0; pairs.len()];
        let (mut coefficients, mut residuals) = (Vec::new(), Vec::new());
        let has_steps = |residuals: &[f64], share: f64| {
            let steep = residuals.iter().filter(|r| **r > STEP.0).count();
            steep as f64 >= share * residuals.len() as f64
        };
        for round in 0..DIFFERENCE_ROUNDS {
            coefficients = differences.fit(&changes, &weights)?;
            let fitted = differences.values(&coefficients);
            residuals = changes.iter().zip(&fitted).map(|(a, b)| (*a - *b).abs().max_element()).collect();
            if round == 2 && !has_steps(&residuals, 0.5 * STEP.1) {
                return None;
            }
            let scale = 1.5 * deviation(residuals.iter().copied()) + 1e-4;
            weights = residuals.iter().map(|r| (1.0 + (r / scale).powi(2)).powi(-2)).collect();
        }
        if !has_steps(&residuals, STEP.1) {
            return None;
        }
        let shading = basis.without_constant(&coefficients);
        let left: Vec<DVec3> = self.tones.iter().zip(&shading).map(|(tone, shading)| *tone - *shading).collect();
        let fitted = || left.iter().zip(is_fitted).filter(|(_, is_fitted)| **is_fitted).map(|(value, _)| *value);
        let middle = DVec3::from_array([0, 1, 2].map(|c| median(fitted().map(|v| v[c])).unwrap_or(0.0)));
        Some(left.into_iter().map(|v| v - middle).collect())
    }

    /// Fits shading and step, and assigns each cell to the paint that it agrees with better, in
    /// turn. Returns the step and the weights of the last fit.
    fn assign(&mut self, basis: &ShadingBasis, rounds: usize) -> Option<(DVec3, Vec<f64>)> {
        let count = self.tones.len();
        let (mut weights, mut step) = (vec![1.0; count], DVec3::ZERO);
        for round in 0..rounds {
            let fit = basis.fit_two(&self.tones, &self.other, &weights)?;
            step = fit.step;
            let scale = self.scale(&fit);
            let square = |i: usize, other: bool| {
                let relative = self.residual(&fit, i, other) / scale;
                (relative * relative).min(DVec3::splat(MAX_SQUARE)).element_sum()
            };
            // How much better a cell agrees with the second paint.
            let gain: Vec<f64> = (0..count).map(|i| square(i, false) - square(i, true)).collect();
            let around = |i: usize| -> f64 {
                let near = neighbours(self.places[i], self.index.size(), true).filter_map(|at| self.index[at]);
                gain[i] + near.map(|j| gain[j]).sum::<f64>()
            };
            let assigned: Vec<bool> = (0..count).map(|i| around(i) > 0.0).collect();
            let moved = assigned.iter().zip(&self.other).filter(|(a, b)| a != b).count();
            self.other = assigned;
            weights = self.weights(&fit, scale);
            if moved * 10_000 < count && round > 2 {
                break;
            }
        }
        Some((step, weights))
    }

    /// Returns what a fit leaves of a cell if it has the second paint (`other`) or the first.
    fn residual(&self, fit: &TwoPaints, i: usize, other: bool) -> DVec3 {
        self.tones[i] - fit.shading[i] - if other { fit.step } else { DVec3::ZERO }
    }

    /// Returns the scale of the residuals of each channel.
    fn scale(&self, fit: &TwoPaints) -> DVec3 {
        let of_channel = |c: usize| (0..self.other.len()).map(move |i| self.residual(fit, i, self.other[i])[c]);
        DVec3::from_array([0, 1, 2].map(|c| deviation(of_channel(c)) + MIN_SCALE))
    }

    /// Returns the weights of the cells for the next fit.
    fn weights(&self, fit: &TwoPaints, scale: DVec3) -> Vec<f64> {
        let weight = |i: usize| {
            let own = (self.residual(fit, i, self.other[i]) / scale).abs().max_element();
            1.0 / (1.0 + (own / HALF_WEIGHT).powi(2))
        };
        (0..self.other.len()).map(weight).collect()
    }

    /// Lists the steps along the border of the groups, where four cells on each side are in the
    /// same group.
    fn steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        for (i, at) in self.places.iter().enumerate() {
            for way in [(1, 0), (0, 1)] {
                let run = |k: isize| self.at(*at, (k * way.0, k * way.1));
                let same = |from: isize, to: isize, other: bool| {
                    (from..=to).all(|k| run(k).is_some_and(|j| self.other[j] == other))
                };
                let own = self.other[i];
                if !(same(-3, 0, own) && same(1, 4, !own)) {
                    continue;
                }
                let tone = |k: isize| run(k).map(|j| self.tones[j]);
                let (Some(a), Some(b), Some(before), Some(after), Some(next)) =
                    (tone(-1), tone(2), tone(-3), tone(4), run(1))
                else {
                    continue;
                };
                // The mean slope of both sides, over the three cells between the two tones.
                let change = b - a - 0.75 * ((a - before) + (after - b));
                let (cells, change) = if own { ([next, i], -change) } else { ([i, next], change) };
                steps.push(Step { cells, change });
            }
        }
        steps
    }

    /// Moves connected parts of a group to the other group unless the step along their border is
    /// about `step`. Returns true if a part moved.
    fn join_parts(&mut self, step: DVec3) -> bool {
        let size = self.index.size();
        let mut part = vec![usize::MAX; self.other.len()];
        let mut parts: Vec<Vec<usize>> = Vec::new();
        for i in 0..self.other.len() {
            if part[i] != usize::MAX {
                continue;
            }
            let (mut members, mut next) = (vec![i], 0);
            part[i] = parts.len();
            while let Some(&member) = members.get(next) {
                next += 1;
                for j in neighbours(self.places[member], size, false).filter_map(|at| self.index[at]) {
                    if part[j] == usize::MAX && self.other[j] == self.other[i] {
                        part[j] = parts.len();
                        members.push(j);
                    }
                }
            }
            parts.push(members);
        }
        let mut heights: Vec<Vec<f64>> = vec![Vec::new(); parts.len()];
        for Step { cells, change } in self.steps() {
            let height = change.dot(step) / step.length_squared();
            cells.iter().for_each(|cell| heights[part[*cell]].push(height));
        }
        let mut order: Vec<usize> = (0..parts.len()).collect();
        order.sort_by_key(|p| parts[*p].len());
        order.pop();
        let mut has_moved = false;
        for p in order {
            if heights[p].len() >= PART.0 && median(heights[p].iter().copied()) >= Some(PART.1) {
                continue;
            }
            let own = self.other[parts[p][0]];
            let ring: Vec<bool> = parts[p]
                .iter()
                .flat_map(|i| neighbours(self.places[*i], size, false))
                .filter_map(|at| self.index[at])
                .filter(|j| part[*j] != p)
                .map(|j| self.other[j])
                .collect();
            if 2 * ring.iter().filter(|other| **other != own).count() > ring.len() {
                parts[p].iter().for_each(|i| self.other[*i] = !own);
                has_moved = true;
            }
        }
        has_moved
    }

    /// Returns the pixels of the second paint, which differs from the first by `step`. A pixel at
    /// the border of the groups has the paint of those cells nearby whose tone is closer.
    fn second_paint(&self, cells: &Cells, rgb: &Plane<Vec3>, step: DVec3) -> Plane<bool> {
        let group = self.in_second();
        let size = group.size();
        let reach = BORDER as isize;
        // Half way between the mean tones of both groups around a cell at the border.
        let threshold = Plane::from_fn(size.0, size.1, |u, v| {
            if neighbours((u, v), size, true).all(|near| group[near] == group[(u, v)]) {
                return None;
            }
            let around = (-reach..=reach).flat_map(|dv| (-reach..=reach).map(move |du| (du, dv)));
            let mut sums = [(0.0, 0.0); 2];
            for i in around.filter_map(|offset| self.at((u, v), offset)) {
                let (sum, count) = &mut sums[usize::from(self.other[i])];
                *sum += self.tones[i].dot(step);
                *count += 1.0;
            }
            let [first, second] = sums.map(|(sum, count)| sum / count);
            (first < second).then_some(0.5 * (first + second))
        });
        Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
            let Some(at) = cells.cell((x, y)) else { return false };
            threshold[at].map_or(group[at], |least| cells.tone(rgb[(x, y)]).dot(step) > least)
        })
    }

    /// Returns the cells of the second group. A cell without a tone belongs to the group of the
    /// nearest cell with one.
    fn in_second(&self) -> Plane<bool> {
        let size = self.index.size();
        let mut group = self.index.map(|index| index.map(|i| self.other[i]));
        let mut front = self.places.clone();
        while !front.is_empty() {
            let mut next = Vec::new();
            for at in front {
                for near in neighbours(at, size, false) {
                    if group[near].is_none() {
                        group[near] = group[at];
                        next.push(near);
                    }
                }
            }
            front = next;
        }
        group.map(|other| other.unwrap_or(false))
    }
}

/// Returns the cells of a set and those within `margin` cells of it.
fn dilated(mut set: Plane<bool>, margin: usize) -> Plane<bool> {
    let size = set.size();
    for _ in 0..margin {
        set =
            Plane::from_fn(size.0, size.1, |u, v| set[(u, v)] || neighbours((u, v), size, true).any(|near| set[near]));
    }
    set
}

/// Divides residuals into two groups along the principal axis of those in `is_fitted`.
fn two_groups(residuals: &[DVec3], is_fitted: &[bool]) -> Vec<bool> {
    let clipped: Vec<DVec3> = residuals.iter().map(|r| r.clamp(-DVec3::ONE, DVec3::ONE)).collect();
    let fitted = || clipped.iter().zip(is_fitted).filter(|(_, is_fitted)| **is_fitted).map(|(r, _)| *r);
    let covariance = Mat::from_fn(3, 3, |i, j| fitted().map(|r| r[i] * r[j]).sum::<f64>());
    let (_, vectors) = eigenvectors(covariance.as_ref());
    let axis = DVec3::new(vectors[(0, 2)], vectors[(1, 2)], vectors[(2, 2)]);
    let mut sorted: Vec<f64> = fitted().map(|r| r.dot(axis)).collect();
    sorted.sort_by(f64::total_cmp);
    let quantile = |share: f64| sorted[(share * (sorted.len() - 1) as f64) as usize];
    let mut centres = [quantile(0.25), quantile(0.75)];
    for _ in 0..20 {
        let middle = 0.5 * (centres[0] + centres[1]);
        let (low, high) = sorted.split_at(sorted.partition_point(|x| *x <= middle));
        for (centre, group) in centres.iter_mut().zip([low, high]) {
            *centre = group.get(group.len() / 2).copied().unwrap_or(*centre);
        }
    }
    let middle = 0.5 * (centres[0] + centres[1]);
    clipped.iter().map(|r| r.dot(axis) > middle).collect()
}

/// Returns the standard deviation about zero of normal values with this median absolute value.
fn deviation(values: impl Iterator<Item = f64>) -> f64 {
    1.4826 * median(values.map(f64::abs)).unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
