//! Hot and dead pixels of sensors, and fireflies of renderers.
//!
//! A pixel is an outlier if, in any channel, it deviates from a robust quadratic through the pixels
//! around it by far more than noise and structure explain. Three criteria keep highlights and sharp
//! reflections. A highlight raises the pixels next to it as well. A picture with many pixels that
//! differ from their neighbours has a higher threshold. If the object reflects sharply, a bright
//! pixel may be the image of a lamp or of the sun. At most two adjacent pixels are outliers; larger
//! groups are structure.

pub(super) mod stencil;

use glam::Vec3;

use super::components::neighbours;
use crate::parallel;
use crate::picture::Plane;
use crate::statistics::median;
use stencil::{NEIGHBOURS, Prediction, Stencil};

/// Deviation that noise explains, in standard deviations.
const NOISE_DEVIATIONS: f64 = 8.0;
/// Deviation that the largest residual of the neighbours explains, in units of that residual.
const STRUCTURE: f64 = 15.0;
/// Residual of the neighbours that noise explains, in standard deviations.
const MAX_OF_NOISE: f64 = 3.0;
/// Smallest noise in steps of a coded picture: its values differ by whole steps or not at all.
const MIN_NOISE_OF_STEP: f64 = 0.3;
/// Smallest noise, relative to the values around a pixel.
const MIN_NOISE: f64 = 1e-4;
/// Smallest noise, relative to the median of the channel.
const MIN_NOISE_OF_MEDIAN: f64 = 5e-4;
/// Smallest ratio of the adjacent pixels to the pixels at a distance of two, next to a highlight.
const HALO: f64 = 1.5;
/// Smallest excess of the adjacent pixels over a quadratic through the pixels at a distance of two,
/// in standard deviations of the noise.
const RIM_OF_NOISE: f64 = 6.0;
/// Smallest excess of the adjacent pixels relative to that of the pixel itself. A lamp in a ball of
/// an orange phenolic, 64 pixels across, has 0.046; hot pixels at four positions of the sample have
/// 0.0003 or less.
const MIN_RING_EXCESS: f64 = 0.01;
/// Smallest score of an outlier: its deviation relative to what noise and structure explain.
const MIN_SCORE: f64 = 2.0;
/// Score below which a pixel is not recorded.
const RECORDED_SCORE: f64 = 0.2;
/// Largest share of outliers. Pixels are ranked by score, and the first pixel beyond this share has
/// the *baseline score*: that of the picture without outliers.
const MAX_SHARE: f64 = 0.003;
/// Smallest rank of the pixel with the baseline score.
const MIN_RANK: usize = 5;
/// Baseline score that noise explains.
const NOISE_SCORE: f64 = 0.7;
/// Smallest ratio of the score of an outlier to the part of the baseline score above the noise.
const OUTLIER_SCORE_RATIO: f64 = 25.0;
/// Smallest number of known pixels among the eight neighbours of an outlier.
const MIN_ADJACENT: usize = 5;
/// Largest number of windows from which the noise is estimated.
const NOISE_WINDOWS: usize = 16_384;
/// Number of brightness classes, each with its own noise.
const NOISE_CLASSES: usize = 8;

/// Smallest structure of a sharp reflection, relative to the brightest channel. Structure is the
/// part of the largest residual of the neighbours that noise does not explain.
const SHARP_STRUCTURE: f64 = 0.3;
/// Residual that noise explains in the test for sharp reflections, in standard deviations.
const SHARP_NOISE: f64 = 4.0;
/// Share of pixels with such structure above which an object reflects sharply. Rendered balls of
/// polished metals and black glass have 0.03 to 0.13, of paints 0, of a grey plastic 0 to 0.03.
const SHARP_SHARE: f64 = 0.015;

/// Pixels that differ from their neighbours.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Outliers {
    /// Indices of the outliers, row-major and ascending.
    pub(super) excluded: Vec<usize>,
    /// Number of pixels that differ as much, but may be highlights or glitter.
    pub(super) kept: usize,
}

/// Score of a pixel and whether it is brighter than its neighbours.
#[derive(Clone, Copy)]
struct Score {
    pixel: usize,
    value: f64,
    bright: bool,
}

/// Detects the outliers among the pixels of `region`, which shows the object and has finite values.
pub(super) fn outliers(rgb: &Plane<Vec3>, region: &Plane<bool>) -> Outliers {
    let Some(detector) = OutlierDetector::new(rgb, region) else { return Outliers::default() };
    let score = |pixel: usize| {
        let Some(range) = detector.range(pixel) else { return Score { pixel, value: 0.0, bright: false } };
        let channels = (0..3).map(|channel| detector.score(pixel, channel, range.map(|end| f64::from(end[channel]))));
        let (value, bright) = channels.fold((0.0, false), |most, next| if next.0 > most.0 { next } else { most });
        Score { pixel, value, bright }
    };
    let mut scored: Vec<Score> = parallel::flat_map_range(region.as_slice().len(), |i| {
        region.as_slice()[i].then(|| score(i)).filter(|score| score.value > RECORDED_SCORE)
    });
    let pixels = region.as_slice().iter().filter(|inside| **inside).count();
    let mut scores: Vec<f64> = scored.iter().map(|score| score.value).collect();
    let rank = ((MAX_SHARE * pixels as f64) as usize).max(MIN_RANK);
    let own = if rank < scores.len() { *scores.select_nth_unstable_by(rank, |a, b| b.total_cmp(a)).1 } else { 0.0 };
    let threshold = MIN_SCORE.max(OUTLIER_SCORE_RATIO * (own - NOISE_SCORE));
    scored.retain(|score| score.value > MIN_SCORE);
    let candidates = scored.len();
    let sharp = scored.iter().any(|score| score.bright) && detector.is_sharp(&scored);
    scored.retain(|score| score.value > threshold && !(sharp && score.bright));
    Outliers { kept: candidates - scored.len(), excluded: scored.into_iter().map(|score| score.pixel).collect() }
}

/// Scores pixels by their difference from their neighbours.
struct OutlierDetector<'a> {
    rgb: &'a Plane<Vec3>,
    region: &'a Plane<bool>,
    /// Stencil of a pixel whose neighbours are all known.
    whole: Stencil,
    /// Noise of each channel.
    noise: Vec<NoiseLevels>,
}

impl<'a> OutlierDetector<'a> {
    /// Estimates the noise of the picture; `None` where no pixel has enough neighbours.
    fn new(rgb: &'a Plane<Vec3>, region: &'a Plane<bool>) -> Option<Self> {
        let whole = Stencil::new(ALL)?;
        let mut detector = Self { rgb, region, whole, noise: Vec::new() };
        let inside: Vec<usize> = (0..region.as_slice().len()).filter(|i| region.as_slice()[*i]).collect();
        let step = inside.len().div_ceil(NOISE_WINDOWS).max(1);
        for channel in 0..3 {
            let sample = |at: usize| {
                let i = inside[at * step];
                let window = detector.window(i, channel);
                let Prediction { level, deviation, .. } = detector.predict(&window)?;
                Some(NoiseSample { level, deviation, step: window.step() })
            };
            let found = parallel::flat_map_range(inside.len().div_ceil(step), sample);
            detector.noise.push(NoiseLevels::new(found)?);
        }
        Some(detector)
    }

    fn window(&self, pixel: usize, channel: usize) -> Window {
        Self::window_of(self.rgb, self.region, pixel, channel)
    }

    /// Returns the values of a channel around a pixel and which of them are in `region`.
    fn window_of(rgb: &Plane<Vec3>, region: &Plane<bool>, pixel: usize, channel: usize) -> Window {
        let (width, height) = rgb.size();
        let (x, y) = (pixel % width, pixel / width);
        let mut window = Window { values: [0.0; 24], known: 0 };
        for (i, (dx, dy)) in NEIGHBOURS.iter().enumerate() {
            let (Some(x), Some(y)) = (x.checked_add_signed(*dx), y.checked_add_signed(*dy)) else { continue };
            if x < width && y < height && region[(x, y)] {
                window.values[i] = f64::from(rgb[(x, y)][channel]);
                window.known |= 1 << i;
            }
        }
        window
    }

    /// Returns the second smallest and second largest of the eight values around a pixel in each
    /// channel, since the extremes may be outliers themselves; `None` if too few are known.
    fn range(&self, pixel: usize) -> Option<[Vec3; 2]> {
        let (rgb, region, width) = (self.rgb.as_slice(), self.region.as_slice(), self.rgb.width());
        let (mut lowest, mut low) = (Vec3::INFINITY, Vec3::INFINITY);
        let (mut high, mut highest) = (Vec3::NEG_INFINITY, Vec3::NEG_INFINITY);
        let mut count = 0;
        let mut add = |next: usize| {
            if region[next] {
                let value = rgb[next];
                (lowest, low) = (lowest.min(value), low.min(value.max(lowest)));
                (highest, high) = (highest.max(value), high.max(value.min(highest)));
                count += 1;
            }
        };
        let (size, at) = (self.rgb.size(), (pixel % width, pixel / width));
        let is_inner = at.0 > 0 && at.1 > 0 && at.0 + 1 < size.0 && at.1 + 1 < size.1;
        if is_inner {
            // Most pixels: indices are faster than coordinates.
            let (above, below) = (pixel - width, pixel + width);
            [above - 1, above, above + 1, pixel - 1, pixel + 1, below - 1, below, below + 1].into_iter().for_each(add);
        } else {
            neighbours(at, size, true).for_each(|(x, y)| add(y * width + x));
        }
        (count >= MIN_ADJACENT).then_some([low, high])
    }

    fn predict(&self, window: &Window) -> Option<Prediction> {
        match window.known {
            ALL => Some(self.whole.predict(&window.values)),
            known => Some(Stencil::new(known)?.predict(&window.values)),
        }
    }

    /// Returns the score of a channel, and whether the channel is brighter than its neighbours.
    ///
    /// The score is the difference of the channel from its prediction, relative to what noise and
    /// structure explain. It is zero for a highlight, and for a pixel within the
    /// [range](Self::range) of its neighbours, from `low` to `high`.
    fn score(&self, pixel: usize, channel: usize, [low, high]: [f64; 2]) -> (f64, bool) {
        let own = f64::from(self.rgb.as_slice()[pixel][channel]);
        let margin = 0.25 * (high - low);
        if own <= high + margin && own >= low - margin {
            return (0.0, false);
        }
        let window = self.window(pixel, channel);
        let Some(found) = self.predict(&window) else { return (0.0, false) };
        let noise = self.noise[channel].at(found.level);
        let structure = unexplained(found.largest, MAX_OF_NOISE * noise);
        let score = (own - found.value).abs() / (NOISE_DEVIATIONS * noise + STRUCTURE * structure);
        let bright = own > high;
        let explained = score <= RECORDED_SCORE || window.has_halo(bright) || bright && window.has_rim(own, noise);
        if explained { (0.0, false) } else { (score, bright) }
    }

    /// Whether the picture without the `candidates` has pixel-sized structure in many places.
    ///
    /// The picture of an object with sharp reflections has such structure.
    fn is_sharp(&self, candidates: &[Score]) -> bool {
        let mut region = self.region.clone();
        for candidate in candidates {
            region.as_mut_slice()[candidate.pixel] = false;
        }
        let inside: Vec<usize> = (0..region.as_slice().len()).filter(|i| region.as_slice()[*i]).collect();
        let step = inside.len().div_ceil(NOISE_WINDOWS).max(1);
        let structured = |&pixel: &usize| {
            let (mut structure, mut level) = (0.0, 0.0);
            for channel in 0..3 {
                let window = Self::window_of(self.rgb, &region, pixel, channel);
                if window.known != ALL {
                    return None;
                }
                let found = self.whole.predict(&window.values);
                let noise = self.noise[channel].at(found.level);
                structure = f64::max(structure, unexplained(found.largest, SHARP_NOISE * noise));
                level = f64::max(level, found.level);
            }
            Some(usize::from(structure > SHARP_STRUCTURE * level))
        };
        let found: Vec<usize> =
            parallel::flat_map_range(inside.len().div_ceil(step), |at| structured(&inside[at * step]));
        let (count, total) = (found.iter().sum::<usize>(), found.len());
        count as f64 > SHARP_SHARE * total as f64
    }
}

/// Returns the part of a deviation that another, independent deviation does not explain.
fn unexplained(whole: f64, explained: f64) -> f64 {
    (whole * whole - explained * explained).max(0.0).sqrt()
}

/// All neighbours known.
const ALL: u32 = (1 << 24) - 1;

/// Neighbours two pixels away, one bit each.
const RING: u32 = {
    let (mut ring, mut i) = (0, 0);
    while i < 24 {
        let (x, y) = NEIGHBOURS[i];
        if x.abs() == 2 || y.abs() == 2 {
            ring |= 1 << i;
        }
        i += 1;
    }
    ring
};

/// Values of one channel around a pixel.
struct Window {
    /// Values of the [`NEIGHBOURS`]; zero where unknown.
    values: [f64; 24],
    /// Known neighbours, one bit each.
    known: u32,
}

impl Window {
    /// Returns the sorted values of the known neighbours whose offset `of` selects.
    fn sorted(&self, of: impl Fn(isize, isize) -> bool) -> Vec<f64> {
        let chosen = NEIGHBOURS.iter().enumerate().filter(|(i, (x, y))| self.known >> i & 1 == 1 && of(*x, *y));
        let mut values: Vec<f64> = chosen.map(|(i, _)| self.values[i]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values
    }

    /// Returns the smallest difference of two values that differ.
    fn step(&self) -> Option<f64> {
        let values = self.sorted(|_, _| true);
        let steps = values.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0);
        steps.min_by(f64::total_cmp)
    }

    /// Whether the adjacent pixels exceed a quadratic through the pixels at a distance of two.
    ///
    /// This is the case around a narrow highlight on a bright surface. The adjacent pixels share a
    /// side with this one, of value `own`; one of them may be an exception.
    fn has_rim(&self, own: f64, noise: f64) -> bool {
        let Some(ring) = Stencil::new(self.known & RING) else { return false };
        let excess = |(i, _): (usize, &(isize, isize))| self.values[i] - ring.at(&self.values, i);
        let near =
            NEIGHBOURS.iter().enumerate().filter(|(i, (x, y))| self.known >> i & 1 == 1 && x.abs() + y.abs() == 1);
        let mut near: Vec<f64> = near.map(excess).collect();
        near.sort_unstable_by(f64::total_cmp);
        let least = f64::max(RIM_OF_NOISE * noise, MIN_RING_EXCESS * (own - ring.at(&self.values, 24)));
        near.len() > 2 && near[1] > least
    }

    /// Whether the adjacent pixels are brighter (or darker) than the pixels at a distance of two.
    ///
    /// This is the case around a highlight. The adjacent pixels share a side with this one; one of
    /// them may be an exception.
    fn has_halo(&self, bright: bool) -> bool {
        let near = self.sorted(|x, y| x.abs() + y.abs() == 1);
        let ring = self.sorted(|x, y| x.abs() == 2 || y.abs() == 2);
        let (Some(middle), true) = (ring.get(ring.len() / 2), near.len() > 1) else { return false };
        if bright { near[1] > HALO * middle } else { HALO * near[near.len() - 2] < *middle }
    }
}

/// Deviations in one window.
#[derive(Clone, Copy)]
struct NoiseSample {
    /// Mean of the values.
    level: f64,
    /// Standard deviation about the quadratic.
    deviation: f64,
    /// Smallest difference of two values that differ.
    step: Option<f64>,
}

/// Noise of a channel as a function of brightness.
struct NoiseLevels {
    /// Largest level of each class and the noise there, ascending.
    classes: Vec<(f64, f64)>,
    /// Smallest noise at any level.
    least: f64,
}

impl NoiseLevels {
    /// Takes the median deviation in each class of brightness; `None` without samples.
    fn new(mut samples: Vec<NoiseSample>) -> Option<Self> {
        samples.sort_unstable_by(|a, b| a.level.total_cmp(&b.level));
        let middle = samples.get(samples.len() / 2)?.level;
        let classes = samples.chunks(samples.len().div_ceil(NOISE_CLASSES)).map(|class| {
            let deviation = median(class.iter().map(|sample| sample.deviation)).unwrap_or(0.0);
            let step = median(class.iter().filter_map(|sample| sample.step)).unwrap_or(0.0);
            (class[class.len() - 1].level, deviation.max(MIN_NOISE_OF_STEP * step))
        });
        Some(Self { classes: classes.collect(), least: MIN_NOISE_OF_MEDIAN * middle.abs() + f64::MIN_POSITIVE })
    }

    /// Returns the noise at a level.
    fn at(&self, level: f64) -> f64 {
        let class = self.classes.iter().find(|(upper, _)| level <= *upper).or(self.classes.last());
        class.map_or(0.0, |(_, noise)| *noise).max(MIN_NOISE * level.abs()).max(self.least)
    }
}

#[cfg(test)]
mod tests;
