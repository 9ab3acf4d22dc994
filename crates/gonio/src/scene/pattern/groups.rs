//! Division of the cells of an object into two groups, by paint.

use faer::Mat;
use glam::{DVec3, Vec3};
use gonio_linalg::eigenvectors;

use super::{Cells, ShadingBasis, TwoPaints, neighbours};
use crate::picture::{Plane, luminance};
use crate::scene::components::{Component, components};
use crate::statistics::median;

/// Smallest number of cells of an object: those of a ball of 50 pixels. In smaller photographs,
/// reflections of windows have the sharp edges of paint (docs/trials.md).
const MIN_CELLS: usize = 2000;
/// Distance of cells whose differences are fitted, in cells, and the degree of the shading in this
/// fit. With a degree of 4, labels are mistaken for shading.
const DIFFERENCES: (isize, usize) = (3, 6);
/// Residual of a difference that counts as a step, and the smallest share of such differences.
/// Without steps, there is no pattern.
const STEP: (f64, f64) = (0.15, 0.005);
/// Number of rounds of this fit. After the first three, photographs without half as many steps are
/// rejected: most photographs show one paint.
const DIFFERENCE_ROUNDS: usize = 12;
/// Squared residual, in units of the squared scale, beyond which a cell does not decide.
const MAX_SQUARE: f64 = 25.0;
/// Residual at which a weight of a robust fit is one half, in units of the scale.
const HALF_WEIGHT: f64 = 2.5;
/// Smallest scale of the residuals.
const MIN_SCALE: f64 = 0.01;
/// Smallest number of steps along the border of a part, and their smallest median relative to the
/// difference of the groups.
const PART: (usize, f64) = (4, 0.5);
/// Distance in cells over which the tones of both paints are averaged at their border.
const BORDER: usize = 2;

/// Cells in two groups.
pub(super) struct Groups {
    /// Index of each cell with a tone.
    pub(super) index: Plane<Option<usize>>,
    /// Position of each such cell.
    pub(super) places: Vec<(usize, usize)>,
    pub(super) tones: Vec<DVec3>,
    pub(super) normals: Vec<Vec3>,
    /// Whether a cell is in the second group.
    pub(super) other: Vec<bool>,
}

/// A step between neighbouring cells of different groups.
pub(super) struct Step {
    /// Indices of a cell of the first group and its neighbour in the second.
    pub(super) cells: [usize; 2],
    /// Tones of the first and the second group, extrapolated to the border from their side.
    pub(super) tones: [DVec3; 2],
}

impl Step {
    /// Difference of the tones.
    pub(super) fn change(&self) -> DVec3 {
        self.tones[1] - self.tones[0]
    }
}

impl Groups {
    /// Divides the cells into two groups by what a smooth shading leaves; `None` without steps. The
    /// shading is fitted to normals of at least `min_z`.
    pub(super) fn of(cells: &Cells, min_z: f32) -> Option<Self> {
        let mut groups = Self::undivided(cells);
        if groups.places.len() < MIN_CELLS {
            return None;
        }
        let is_fitted: Vec<bool> = groups.normals.iter().map(|normal| normal.z >= min_z).collect();
        groups.other = two_groups(&groups.without_shading(&is_fitted)?, &is_fitted);
        Some(groups)
    }

    /// Returns all cells in the first group.
    fn undivided(cells: &Cells) -> Self {
        let size = cells.tones.size();
        let places: Vec<(usize, usize)> = (0..size.1)
            .flat_map(|v| (0..size.0).map(move |u| (u, v)))
            .filter(|at| cells.tones[*at].is_some())
            .collect();
        let mut index = cells.tones.map(|_| None);
        places.iter().enumerate().for_each(|(i, at)| index[*at] = Some(i));
        let tones = places.iter().filter_map(|at| cells.tones[*at]).collect();
        let normals = places.iter().map(|at| cells.normals[*at]).collect();
        let other = vec![false; places.len()];
        Self { index, places, tones, normals, other }
    }

    /// Returns finer cells of the same photograph, in the groups of the cells that contain their
    /// first pixels.
    pub(super) fn divided(&self, cells: &Cells, fine: &Cells) -> Self {
        let group = self.in_second();
        let mut divided = Self::undivided(fine);
        for (other, at) in divided.other.iter_mut().zip(&divided.places) {
            *other = cells.cell(fine.first_pixel(*at)).is_some_and(|at| group[at]);
        }
        divided
    }

    /// Moves each cell to the group of most of the finer cells whose first pixels are in it.
    pub(super) fn join_groups(&mut self, cells: &Cells, divided: &Self, fine: &Cells) {
        let mut votes = vec![0_i32; self.other.len()];
        for (at, other) in divided.places.iter().zip(&divided.other) {
            if let Some(i) = cells.cell(fine.first_pixel(*at)).and_then(|at| self.index[at]) {
                votes[i] += if *other { 1 } else { -1 };
            }
        }
        for (other, votes) in self.other.iter_mut().zip(votes).filter(|(_, votes)| *votes != 0) {
            *other = votes > 0;
        }
    }

    /// Returns the index of the cell at an offset from another.
    pub(super) fn at(&self, (u, v): (usize, usize), offset: (isize, isize)) -> Option<usize> {
        let (u, v) = (u.checked_add_signed(offset.0)?, v.checked_add_signed(offset.1)?);
        if u < self.index.width() && v < self.index.height() { self.index[(u, v)] } else { None }
    }

    /// Returns the ratio of the luminance of the cells of the first group if they had the second
    /// paint, which differs by `step`, to their own.
    pub(super) fn ratio(&self, step: DVec3) -> f64 {
        let exp = |tone: DVec3| f64::from(luminance(tone.exp().as_vec3()));
        let first = || self.tones.iter().zip(&self.other).filter(|(_, other)| !**other).map(|(tone, _)| *tone);
        first().map(|tone| exp(tone + step)).sum::<f64>() / first().map(exp).sum::<f64>()
    }

    /// Returns the normal between the cells of a step.
    pub(super) fn normal_of(&self, step: &Step) -> Vec3 {
        let [first, second] = step.cells.map(|cell| self.normals[cell]);
        (first + second).normalize_or(first)
    }

    pub(super) fn count(&self) -> usize {
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
        let residuals: Vec<DVec3> = self.tones.iter().zip(&shading).map(|(tone, shading)| *tone - *shading).collect();
        let fitted = || residuals.iter().zip(is_fitted).filter(|(_, is_fitted)| **is_fitted).map(|(value, _)| *value);
        let middle = DVec3::from_array([0, 1, 2].map(|c| median(fitted().map(|v| v[c])).unwrap_or(0.0)));
        Some(residuals.into_iter().map(|v| v - middle).collect())
    }

    /// Fits shading and step, and assigns each cell to the paint that it agrees with better, in
    /// turn. Returns the step and the weights of the last fit.
    pub(super) fn assign(&mut self, basis: &ShadingBasis, rounds: usize) -> Option<(DVec3, Vec<f64>)> {
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
    pub(super) fn scale(&self, fit: &TwoPaints) -> DVec3 {
        let of_channel = |c: usize| (0..self.other.len()).map(move |i| self.residual(fit, i, self.other[i])[c]);
        DVec3::from_array([0, 1, 2].map(|c| deviation(of_channel(c)) + MIN_SCALE))
    }

    /// Returns the weights of the cells for the next fit.
    pub(super) fn weights(&self, fit: &TwoPaints, scale: DVec3) -> Vec<f64> {
        let weight = |i: usize| {
            let own = (self.residual(fit, i, self.other[i]) / scale).abs().max_element();
            robust_weight(own)
        };
        (0..self.other.len()).map(weight).collect()
    }

    /// Lists the steps along the border of the groups, where four cells on each side are in the
    /// same group.
    pub(super) fn steps(&self) -> Vec<Step> {
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
                // The border is 1.5 cells beyond each tone.
                let (here, there) = (a + 0.75 * (a - before), b - 0.75 * (after - b));
                let (cells, tones) = if own { ([next, i], [there, here]) } else { ([i, next], [here, there]) };
                steps.push(Step { cells, tones });
            }
        }
        steps
    }

    /// Moves connected parts of a group to the other group unless the step along their border is
    /// about `step`. Returns true if a part moved.
    pub(super) fn join_parts(&mut self, step: DVec3) -> bool {
        let size = self.index.size();
        let (index, other) = (&self.index, &self.other);
        let connected = |second: bool| components(size, false, |at| index[at].is_some_and(|i| other[i] == second));
        let members = |component: Component| component.pixels().filter_map(|at| index[at]).collect();
        let mut parts: Vec<Vec<usize>> = [false, true].into_iter().flat_map(connected).map(members).collect();
        parts.sort_by_key(|members| members[0]);
        let mut part = vec![0; self.other.len()];
        parts.iter().enumerate().for_each(|(p, members)| members.iter().for_each(|i| part[*i] = p));
        let mut heights: Vec<Vec<f64>> = vec![Vec::new(); parts.len()];
        for own in self.steps() {
            let height = own.change().dot(step) / step.length_squared();
            own.cells.iter().for_each(|cell| heights[part[*cell]].push(height));
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
    pub(super) fn second_paint(&self, cells: &Cells, rgb: &Plane<Vec3>, step: DVec3) -> Plane<bool> {
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
pub(super) fn dilated(mut set: Plane<bool>, margin: usize) -> Plane<bool> {
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

/// Returns the weight of a residual, in units of the scale, in the next round of a robust fit.
pub(super) fn robust_weight(residual: f64) -> f64 {
    1.0 / (1.0 + (residual / HALF_WEIGHT).powi(2))
}

/// Returns the standard deviation about zero of normal values with this median absolute value.
pub(super) fn deviation(values: impl Iterator<Item = f64>) -> f64 {
    1.4826 * median(values.map(f64::abs)).unwrap_or(0.0)
}
