//! Regions of another colour on an object of one colour: paint, stickers, eyes of figures.
//!
//! Chromaticity alone does not identify paint: highlights have the colour of the light, metals have
//! that of their reflections, and shadows, coloured lamps and interreflections change it. A region
//! is therefore ignored only if it passes all tests that distinguish paint from light:
//!
//! 1. It is a compact region behind a sharp step of chromaticity, small compared with the rest,
//!    with similar normals on both sides.
//! 2. At least one channel falls across the step: highlights and other added light raise all
//!    channels. On a surface that may shadow itself, at least one channel also rises, since shadows
//!    lower all channels.
//! 3. Both sides receive the same light: along the whole step, brightness and chromaticity of the
//!    inside follow those of the outside, up to one factor. Reflections in a mirror do not. Without
//!    shading along the step, the region is kept.
//! 4. There are few other such steps elsewhere; reflections of coloured surroundings have many.
//!
//! In ambiguous cases, all pixels are kept: a few painted pixels change the result little, but a
//! reflection mistaken for paint changes it strongly.

use glam::{DVec2, DVec3, Vec3};

use super::cells::{Cells, SurfaceGeometry};
use super::components::{components, fill_holes, neighbours};
use crate::picture::Plane;
use crate::statistics::quantile;

/// Approximate number of cells along the longer side of the object. The picture is analysed in
/// these cells: finer structure is noise or texture.
const CELLS: f64 = 300.0;
/// Change of chromaticity (natural logarithms of R/G and B/G) above which there is a step.
const CHROMA_STEP: f64 = 0.25;
/// Distance from a cell to each of the two cells between which this change is measured, in cells.
const STEP_SPAN: usize = 2;
/// Largest distance between the two sides of a step, in cells: a span on both sides, the smoothing
/// and some blur. Light explains slower changes.
const MAX_STEP_DISTANCE: usize = 8;
/// Half the side, in cells, of the window of the plane fit that extrapolates the outside.
const WINDOW: usize = 4;
/// Smallest number of cells of a region; smaller ones are kept.
const MIN_CELLS: usize = 12;
/// Smallest share of the object that the rest must make up, in one piece.
const MIN_MAIN: f64 = 0.5;
/// Largest share of the object that may be ignored.
const MAX_SHARE: f64 = 0.25;
/// Smallest compactness of a region, `4 pi area / perimeter^2`, one for a disc: less compact
/// regions are fringes.
const MIN_COMPACT: f64 = 0.2;
/// Smallest share of a region's border that lies against the rest of the object, not against its
/// outline or other regions.
const MIN_BORDER: f64 = 0.5;
/// Smallest number of cells of that part of the border.
const MIN_PAIRS: usize = 8;
/// Cosine of the largest angle between the normals of both sides: 15 degrees.
const MIN_NORMAL_COSINE: f32 = 0.966;
/// Smallest change of chromaticity across the step, in natural logarithms.
const MIN_CHANGE: f64 = 0.3;
/// Smallest fall of one channel across the step, in natural logarithms.
const MIN_FALL: f64 = 0.15;
/// Smallest rise of another channel, where one is required, in natural logarithms.
const MIN_RISE: f64 = 0.05;
/// Largest variation along the step of the factor between the sides (median absolute deviation of
/// its logarithm).
const MAX_SPREAD: f64 = 0.1;
/// Largest ratio of this variation to that of the outside.
const MAX_RELATIVE: f64 = 0.5;
/// Smallest variation of the outside along the step (median absolute deviation of its logarithm).
const MIN_SHADING: f64 = 0.01;
/// Smallest chromaticity of a cell at the step that belongs to the region, as a share of the way
/// from the outside to the inside.
const MIXED_SHARE: f64 = 0.2;
/// Largest number of steps elsewhere that light cannot explain, relative to the number of steps
/// around the ignored regions.
const MAX_ELSEWHERE: f64 = 0.3;

/// Returns `ln R/G` and `ln B/G`.
fn chroma(tone: DVec3) -> DVec2 {
    DVec2::new(tone.x - tone.y, tone.z - tone.y)
}

impl Cells {
    /// Returns the change across a cell along both axes; an unknown side counts as the cell itself.
    fn changes(&self, (u, v): (usize, usize)) -> Option<[DVec3; 2]> {
        let own = self.tones[(u, v)]?;
        let (width, height) = self.tones.size();
        let at = |u: Option<usize>, v: Option<usize>| {
            let place = (u?, v?);
            if place.0 < width && place.1 < height { self.tones[place] } else { None }
        };
        let both = |a: Option<DVec3>, b: Option<DVec3>| a.unwrap_or(own) - b.unwrap_or(own);
        Some([
            both(at(u.checked_sub(STEP_SPAN), Some(v)), at(Some(u + STEP_SPAN), Some(v))),
            both(at(Some(u), v.checked_sub(STEP_SPAN)), at(Some(u), Some(v + STEP_SPAN))),
        ])
    }

    /// Extrapolates the tones of a labelled region by a plane, from around one of its cells to
    /// another cell.
    fn continued(&self, labels: &Plane<u32>, from: (usize, usize), to: (usize, usize)) -> Option<DVec3> {
        let (width, height) = self.tones.size();
        let (mut gram, mut moments, mut count) = ([[0.0; 3]; 3], [DVec3::ZERO; 3], 0);
        for v in from.1.saturating_sub(WINDOW)..(from.1 + WINDOW + 1).min(height) {
            for u in from.0.saturating_sub(WINDOW)..(from.0 + WINDOW + 1).min(width) {
                let Some(tone) = self.tones[(u, v)].filter(|_| labels[(u, v)] == labels[from]) else { continue };
                let row = [1.0, u as f64 - from.0 as f64, v as f64 - from.1 as f64];
                for i in 0..3 {
                    moments[i] += row[i] * tone;
                    (0..3).for_each(|j| gram[i][j] += row[i] * row[j]);
                }
                count += 1;
            }
        }
        if count < 2 * WINDOW {
            return None;
        }
        let row = [1.0, to.0 as f64 - from.0 as f64, to.1 as f64 - from.1 as f64];
        // Weights of the moments that give the value of the plane at `to`.
        let weights = solve_three(gram, row)?;
        Some((0..3).map(|i| weights[i] * moments[i]).sum())
    }
}

/// Solves three linear equations, unless they are (nearly) singular.
fn solve_three(rows: [[f64; 3]; 3], right: [f64; 3]) -> Option<[f64; 3]> {
    let matrix = glam::DMat3::from_cols_array_2d(&rows);
    let sound = matrix.determinant().abs() > 1e-6 * rows[0][0] * rows[1][1] * rows[2][2];
    sound.then(|| (matrix.inverse() * DVec3::from_array(right)).to_array())
}

/// Detects the pixels of another colour that can be ignored safely; `None` without such pixels.
pub(super) fn segment_paint(
    rgb: &Plane<Vec3>,
    usable: &dyn Fn((usize, usize)) -> bool,
    surface: &SurfaceGeometry<'_>,
) -> Option<Plane<bool>> {
    let cells = Cells::of(rgb, usable, surface, (CELLS, true))?;
    let size = cells.tones.size();
    let places = || (0..size.1).flat_map(|v| (0..size.0).map(move |u| (u, v)));
    let stepped = Plane::from_fn(size.0, size.1, |u, v| {
        cells.changes((u, v)).is_some_and(|both| both.iter().any(|change| chroma(*change).length() > CHROMA_STEP))
    });
    if !stepped.as_slice().contains(&true) {
        return None;
    }
    let (labels, sizes) = label(&cells, &stepped);
    let known = cells.tones.as_slice().iter().flatten().count();
    let main = (1..sizes.len()).max_by_key(|at| sizes[*at])?;
    if (sizes[main] as f64) < MIN_MAIN * known as f64 {
        return None;
    }
    let mut taken = stepped.map(|_| false);
    for region in (1..sizes.len()).filter(|at| *at != main && sizes[*at] >= MIN_CELLS) {
        if let Some(step) = Border::of(&cells, &labels, region as u32, main as u32)
            .and_then(|border| border.step(sizes[region], surface.convex))
        {
            grow(&mut taken, &cells, &labels, &stepped, region as u32, &step);
        }
    }
    let taken = fill_holes(&taken);
    let lost = places().filter(|at| taken[*at] && cells.tones[*at].is_some()).count();
    if lost == 0 || lost as f64 > MAX_SHARE * known as f64 {
        return None;
    }
    // Steps where one channel rises and another falls: neither added light nor a shadow explains
    // them.
    let crossing = |at: (usize, usize)| {
        let crosses = |change: &DVec3| change.max_element() > MIN_RISE && change.min_element() < -MIN_RISE;
        cells.changes(at).is_some_and(|both| both.iter().any(|c| chroma(*c).length() > CHROMA_STEP && crosses(c)))
    };
    let near = |(u, v): (usize, usize)| {
        let reach = 2 * STEP_SPAN;
        (v.saturating_sub(reach)..(v + reach + 1).min(size.1))
            .any(|y| (u.saturating_sub(reach)..(u + reach + 1).min(size.0)).any(|x| taken[(x, y)]))
    };
    let (around, elsewhere): (Vec<_>, Vec<_>) = places().filter(|at| stepped[*at]).partition(|at| near(*at));
    let elsewhere = elsewhere.into_iter().filter(|at| crossing(*at)).count();
    if elsewhere as f64 > MAX_ELSEWHERE * around.len() as f64 {
        return None;
    }
    Some(cells.pixels(&taken, rgb.size()))
}

/// Numbers the regions between steps from one and counts the cells of each; zero marks cells of no
/// region.
fn label(cells: &Cells, stepped: &Plane<bool>) -> (Plane<u32>, Vec<usize>) {
    let mut labels = stepped.map(|_| 0_u32);
    let mut sizes = vec![0];
    for region in components(stepped.size(), false, |at| cells.tones[at].is_some() && !stepped[at]) {
        region.pixels().for_each(|at| labels[at] = sizes.len() as u32);
        sizes.push(region.len());
    }
    (labels, sizes)
}

/// A cell on the inner side of a region's border and the cell across the step.
struct Pair {
    inside: DVec3,
    /// Tone of the nearest cell outside.
    outside: DVec3,
    /// Tone of the outside extrapolated to the inner cell.
    continued: DVec3,
}

/// The border of a region against the rest of the object.
struct Border {
    /// Number of cells along the whole border of the region.
    length: usize,
    pairs: Vec<Pair>,
}

/// Chromaticity on both sides of a step.
struct Step {
    inside: DVec2,
    outside: DVec2,
}

impl Border {
    fn of(cells: &Cells, labels: &Plane<u32>, region: u32, main: u32) -> Option<Self> {
        let size = labels.size();
        let (mut length, mut pairs) = (0, Vec::new());
        for at in (0..size.1).flat_map(|v| (0..size.0).map(move |u| (u, v))).filter(|at| labels[*at] == region) {
            if neighbours(at, size, false).count() == 4
                && neighbours(at, size, false).all(|next| labels[next] == region)
            {
                continue;
            }
            length += 1;
            let Some(across) = nearest(labels, at, main) else { continue };
            if cells.normals[at].dot(cells.normals[across]) < MIN_NORMAL_COSINE {
                continue;
            }
            let (Some(inside), Some(outside)) = (cells.tones[at], cells.tones[across]) else { continue };
            let Some(continued) = cells.continued(labels, across, at) else { continue };
            pairs.push(Pair { inside, outside, continued });
        }
        let enough = pairs.len() >= MIN_PAIRS && pairs.len() as f64 >= MIN_BORDER * length as f64;
        enough.then_some(Self { length, pairs })
    }

    /// Returns the step if it is a step of paint.
    fn step(&self, area: usize, convex: bool) -> Option<Step> {
        let compact = 4.0 * std::f64::consts::PI * area as f64 / (self.length as f64).powi(2);
        let steps = || self.pairs.iter().map(|p| p.inside - p.continued);
        let channels = [0, 1, 2].map(|c| middle(steps().map(|s| s[c]).collect()));
        let change = DVec3::from_array(channels.map(|(median, _)| median));
        let spread = channels.into_iter().map(|(_, spread)| spread).fold(0.0, f64::max);
        let mean = |v: DVec3| v.element_sum() / 3.0;
        let (_, follows) = middle(steps().map(mean).collect());
        let (_, shading) = middle(self.pairs.iter().map(|p| mean(p.outside)).collect());
        let painted = compact >= MIN_COMPACT
            && chroma(change).length() >= MIN_CHANGE
            && change.min_element() <= -MIN_FALL
            && (convex || change.max_element() >= MIN_RISE)
            && spread <= MAX_SPREAD
            && shading >= MIN_SHADING
            && follows <= MAX_RELATIVE * shading;
        let side = |tone: &dyn Fn(&Pair) -> DVec3| {
            let of = |c: usize| middle(self.pairs.iter().map(|p| chroma(tone(p))[c]).collect()).0;
            DVec2::new(of(0), of(1))
        };
        painted.then(|| Step { inside: side(&|p| p.inside), outside: side(&|p| p.outside) })
    }
}

/// Returns the median and the median absolute deviation from it.
fn middle(mut values: Vec<f64>) -> (f64, f64) {
    let median = quantile(&mut values, 0.5).unwrap_or(0.0);
    values.iter_mut().for_each(|v| *v = (*v - median).abs());
    (median, quantile(&mut values, 0.5).unwrap_or(0.0))
}

/// Returns the cell of a region nearest to another cell, within reach.
fn nearest(labels: &Plane<u32>, (u, v): (usize, usize), region: u32) -> Option<(usize, usize)> {
    let (width, height) = labels.size();
    let across = |x: usize, y: usize| x.abs_diff(u).pow(2) + y.abs_diff(v).pow(2);
    (v.saturating_sub(MAX_STEP_DISTANCE)..(v + MAX_STEP_DISTANCE + 1).min(height))
        .flat_map(|y| {
            (u.saturating_sub(MAX_STEP_DISTANCE)..(u + MAX_STEP_DISTANCE + 1).min(width)).map(move |x| (x, y))
        })
        .filter(|at| labels[*at] == region && across(at.0, at.1) <= MAX_STEP_DISTANCE * MAX_STEP_DISTANCE)
        .min_by_key(|at| across(at.0, at.1))
}

/// Marks a region as taken, with those cells of the step around it that share its colour.
fn grow(taken: &mut Plane<bool>, cells: &Cells, labels: &Plane<u32>, stepped: &Plane<bool>, region: u32, step: &Step) {
    let size = labels.size();
    let way = step.inside - step.outside;
    let mixed = |at: (usize, usize)| {
        cells.tones[at].is_some_and(|tone| (chroma(tone) - step.outside).dot(way) >= MIXED_SHARE * way.length_squared())
    };
    let mut ring: Vec<(usize, usize)> =
        (0..size.1).flat_map(|v| (0..size.0).map(move |u| (u, v))).filter(|at| labels[*at] == region).collect();
    ring.iter().for_each(|at| taken[*at] = true);
    for _ in 0..MAX_STEP_DISTANCE {
        let mut next = Vec::new();
        for at in ring.iter().flat_map(|at| neighbours(*at, size, true)) {
            if !taken[at] && stepped[at] && mixed(at) {
                taken[at] = true;
                next.push(at);
            }
        }
        ring = next;
    }
}

#[cfg(test)]
mod tests;
