//! One picture of radiance from a bracket.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use super::consistency::{SLACK, disagree, time_errors};
use super::{BracketError, Exposure, Response, check, median};
use crate::picture::{Picture, Plane};

/// Relative error from rounding alone beyond which a pixel counts as coarse.
const COARSE: f64 = 0.02;
/// Most pixels that the median disagreement is taken over.
const MOST_RESIDUALS: usize = 1 << 20;

/// How exposures are merged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergeSettings {
    /// Codes from this part of the largest on are clipped, 0..=1. A file's own clipping is smeared
    /// a little by JPEG.
    pub white: f64,
    /// Largest part of the pixels, 0..=1, that may disagree between exposures before the bracket is
    /// refused.
    pub motion: f64,
}

impl Default for MergeSettings {
    /// The five topmost of 256 codes are clipped; 6 % of the pixels may disagree: at high contrast
    /// JPEG alone makes several per cent.
    fn default() -> Self {
        Self { white: 250.5 / 255.0, motion: 0.06 }
    }
}

/// What is known of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// Its radiance, most of it from this exposure (counted from 0 as they were given).
    From(u8),
    /// Only that some channel is clipped even in the shortest exposure.
    Clipped,
    /// Only that some channel is black in every exposure: its radiance is between 0 and that of the
    /// first code in the longest, and half of that is given.
    Dark,
    /// Nothing: its exposures contradict each other, as where something moved.
    Moved,
}

/// What became of the pixels of a bracket.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MergeReport {
    /// All pixels.
    pub pixels: usize,
    /// Those clipped in every exposure, [`Known::Clipped`].
    pub clipped: usize,
    /// Those black in every exposure, [`Known::Dark`].
    pub dark: usize,
    /// Those left out because their exposures disagree, [`Known::Moved`].
    pub moved: usize,
    /// Known pixels that the rounding of codes alone leaves uncertain by more than 2 %.
    pub coarse: usize,
    /// How many pixels take most of their radiance from each exposure.
    pub from: Vec<usize>,
    /// By which part each exposure is brighter than its time says, relative to the next shorter
    /// one.
    pub time_errors: Vec<f64>,
    /// Median disagreement of the exposures of a sample with its merged value, as a part of that.
    pub residual: f64,
}

/// A merged bracket.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// Radiance, in the units of the response for each unit of the amounts of light. Pixels that
    /// are clipped or have moved hold `clip_level` in all channels.
    pub picture: Picture,
    /// What is known of each pixel.
    pub known: Plane<Known>,
    /// A radiance above that of all known pixels: what holds it is not known.
    pub clip_level: f32,
    /// Counts and disagreements.
    pub report: MergeReport,
}

/// What the codes of one channel say.
pub(super) struct Table {
    /// Logarithm of the exposure.
    log: Vec<f64>,
    exposure: Vec<f64>,
    /// Inverse variance of the exposure for an error of one code, less towards the ends; 0 where a
    /// code says nothing.
    weight: Vec<f64>,
    /// The same without the fading, for what rounding leaves open.
    precision: Vec<f64>,
    /// Lowest and highest logarithm that a code may stand for.
    bounds: Vec<(f64, f64)>,
    /// Codes from this one on are clipped.
    white: u16,
    /// Codes up to this one are black.
    black: u16,
}

impl Table {
    fn new(curve: &[f64], white: f64) -> Self {
        let max = curve.len() - 1;
        let exposure: Vec<f64> = curve.iter().map(|g| g.exp()).collect();
        let white = ((white.clamp(0.0, 1.0) * max as f64).ceil() as usize).clamp(1, max);
        let black = curve.iter().take_while(|g| **g <= curve[0]).count() - 1;
        let slack = (SLACK * max as f64).ceil() as usize;
        let informs = |code: usize| code > black && code < white;
        let precision = |code: usize| {
            let (a, b) = (code.saturating_sub(1), (code + 1).min(max));
            let slope = (exposure[b] - exposure[a]) / (b - a) as f64;
            if informs(code) && slope > 0.0 { slope.powi(-2) } else { 0.0 }
        };
        let precision: Vec<f64> = (0..=max).map(precision).collect();
        let fading = |code: usize| 1.0 - (2.0 * code as f64 / max as f64 - 1.0).abs().powi(12);
        let bounds = |code: usize| {
            let (a, b) = (code.saturating_sub(slack), code + slack);
            let low = if a <= black { f64::NEG_INFINITY } else { curve[a.min(white)] };
            (low, if b >= white { f64::INFINITY } else { curve[b] })
        };
        Self {
            log: curve.to_vec(),
            weight: precision.iter().enumerate().map(|(code, p)| p * fading(code)).collect(),
            precision,
            exposure,
            bounds: (0..=max).map(bounds).collect(),
            white: white as u16,
            black: black as u16,
        }
    }

    pub(super) fn log(&self, code: u16) -> f64 {
        self.log[usize::from(code)]
    }

    pub(super) fn bounds(&self, code: u16) -> (f64, f64) {
        self.bounds[usize::from(code)]
    }

    pub(super) fn is_known(&self, code: u16) -> bool {
        self.weight[usize::from(code)] > 0.0
    }
}

/// One channel of one pixel.
enum Sample {
    /// Radiance, its relative error from rounding, the exposure of most weight and its weight, the
    /// exposures' mean relative disagreement where there are several.
    Value {
        radiance: f64,
        error: f64,
        from: usize,
        disagreement: Option<f64>,
    },
    Clipped,
    Dark(f64),
    Moved,
}

/// Merges a bracket. The result does not depend on the number of threads; it has no alpha channel.
///
/// Each channel of a pixel is the mean of what its exposures say, weighed by inverse variances: the
/// slope of the response and the time make an error of one code an error of radiance. Codes that
/// are clipped or black say nothing.
///
/// # Errors
/// [`BracketError::Times`] and [`BracketError::Motion`] where exposures contradict their times or
/// each other; [`BracketError::NothingKnown`]; what is wrong with sizes, depths and times of the
/// exposures.
pub fn merge(exposures: &[Exposure], response: &Response, settings: &MergeSettings) -> Result<Merged, BracketError> {
    check(exposures)?;
    let response = response.resampled(exposures[0].codes.max());
    let tables = [0, 1, 2].map(|channel| Table::new(response.curve(channel), settings.white));
    let time_errors = time_errors(exposures, &tables)?;
    let (width, height) = exposures[0].codes.size();
    let log_amounts: Vec<f64> = exposures.iter().map(|e| e.amount.ln()).collect();
    // A sample of the pixels tells the median disagreement.
    let step = (width * height).div_ceil(MOST_RESIDUALS).max(1);
    let rows: Vec<Row> = (0..height)
        .into_par_iter()
        .map_init(Vec::new, |codes, y| {
            let mut row = Row::new(width, exposures.len());
            for i in y * width..(y + 1) * width {
                let mut compared = false;
                let samples = [0, 1, 2].map(|channel| {
                    codes.clear();
                    codes.extend(exposures.iter().map(|e: &Exposure| e.codes.at(i)[channel]));
                    let disagree = disagree(codes, &log_amounts, &tables[channel]);
                    compared |= disagree.is_some();
                    if disagree == Some(true) { Sample::Moved } else { sample(codes, exposures, &tables[channel]) }
                });
                row.compared += usize::from(compared);
                row.take(&samples, i.is_multiple_of(step));
            }
            row
        })
        .collect();

    let mut all = Row::new(width * height, exposures.len());
    rows.into_iter().for_each(|row| all.append(row));
    let Row { mut rgb, known, clipped, dark, moved, coarse, compared, from, mut residuals } = all;
    if moved as f64 > settings.motion * compared as f64 {
        return Err(BracketError::Motion { moved, compared });
    }
    if from.iter().all(|&n| n == 0) {
        return Err(BracketError::NothingKnown { clipped, dark });
    }
    let residual = median(&mut residuals).unwrap_or(0.0);
    let report = MergeReport { pixels: width * height, clipped, dark, moved, coarse, from, time_errors, residual };
    let shortest = exposures.iter().map(|e| e.amount).fold(f64::MAX, f64::min);
    let end = tables.iter().map(|t| t.exposure[t.exposure.len() - 1] / shortest).fold(0.0, f64::max) as f32;
    let is_seen = |known: &Known| matches!(known, Known::From(_) | Known::Dark);
    let seen = || rgb.iter().zip(&known).filter(|(_, k)| is_seen(k));
    let clip_level = seen().fold(end, |level, (v, _)| level.max(v.max_element().next_up()));
    for (colour, known) in rgb.iter_mut().zip(&known) {
        if !is_seen(known) {
            *colour = Vec3::splat(clip_level);
        }
    }
    let picture = Picture { rgb: Plane::from_vec(width, height, rgb), alpha: None };
    Ok(Merged { picture, known: Plane::from_vec(width, height, known), clip_level, report })
}

/// What the exposures say together of one channel of a pixel.
fn sample(codes: &[u16], exposures: &[Exposure], table: &Table) -> Sample {
    let (mut sum, mut total, mut precision) = (0.0, 0.0, 0.0);
    let mut best = (0, 0.0);
    let values = || codes.iter().zip(exposures).map(|(&code, e)| (usize::from(code), e.amount)).enumerate();
    for (j, (code, amount)) in values() {
        let weight = table.weight[code] * amount * amount;
        sum += weight * table.exposure[code] / amount;
        total += weight;
        precision += table.precision[code] * amount * amount;
        if weight > best.1 {
            best = (j, weight);
        }
    }
    if total > 0.0 {
        let radiance = sum / total;
        // The variance of rounding is 1/12.
        let error = (12.0 * precision).powf(-0.5) / radiance;
        let strays = values()
            .filter(|(_, (code, _))| table.weight[*code] > 0.0)
            .map(|(_, (code, amount))| (table.exposure[code] / amount / radiance - 1.0).abs());
        let count = strays.clone().count();
        let disagreement = (count > 1).then(|| strays.sum::<f64>() / count as f64);
        return Sample::Value { radiance, error, from: best.0, disagreement };
    }
    // Neither here nor there: black in the long exposures would contradict clipped in the short
    // ones.
    if codes.iter().any(|&code| code >= table.white) {
        return Sample::Clipped;
    }
    let longest = exposures.iter().map(|e| e.amount).fold(0.0, f64::max);
    let first = (usize::from(table.black) + 1).min(table.exposure.len() - 1);
    Sample::Dark(0.5 * table.exposure[first] / longest)
}

/// What becomes of some pixels in order, and counts of them.
struct Row {
    rgb: Vec<Vec3>,
    known: Vec<Known>,
    clipped: usize,
    dark: usize,
    moved: usize,
    coarse: usize,
    compared: usize,
    from: Vec<usize>,
    residuals: Vec<f64>,
}

impl Row {
    fn new(pixels: usize, exposures: usize) -> Self {
        Self {
            rgb: Vec::with_capacity(pixels),
            known: Vec::with_capacity(pixels),
            clipped: 0,
            dark: 0,
            moved: 0,
            coarse: 0,
            compared: 0,
            from: vec![0; exposures],
            residuals: Vec::new(),
        }
    }

    /// Takes one more pixel in.
    fn take(&mut self, samples: &[Sample; 3], judge: bool) {
        let value = |sample: &Sample| match *sample {
            Sample::Value { radiance, .. } => radiance as f32,
            Sample::Dark(half) => half as f32,
            Sample::Clipped | Sample::Moved => 0.0,
        };
        self.rgb.push(Vec3::from_array(samples.each_ref().map(value)));
        let any = |of: fn(&Sample) -> bool| samples.iter().any(of);
        self.known.push(if any(|s| matches!(s, Sample::Moved)) {
            self.moved += 1;
            Known::Moved
        } else if any(|s| matches!(s, Sample::Clipped)) {
            self.clipped += 1;
            Known::Clipped
        } else if let [Sample::Value { .. }, Sample::Value { from, .. }, Sample::Value { .. }] = samples {
            // Green says most of the luminance.
            self.coarse += usize::from(any(|s| matches!(s, Sample::Value { error, .. } if *error > COARSE)));
            self.from[*from] += 1;
            Known::From(*from as u8)
        } else {
            self.dark += 1;
            Known::Dark
        });
        if judge {
            self.residuals.extend(samples.iter().filter_map(|s| match s {
                Sample::Value { disagreement, .. } => *disagreement,
                _ => None,
            }));
        }
    }

    fn append(&mut self, mut row: Self) {
        self.rgb.append(&mut row.rgb);
        self.known.append(&mut row.known);
        self.residuals.append(&mut row.residuals);
        self.clipped += row.clipped;
        self.dark += row.dark;
        self.moved += row.moved;
        self.coarse += row.coarse;
        self.compared += row.compared;
        self.from.iter_mut().zip(row.from).for_each(|(a, b)| *a += b);
    }
}
