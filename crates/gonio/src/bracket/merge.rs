//! Merging of a bracket into one picture of radiance.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use super::consistency::{disagree, time_errors};
use super::table::Table;
use super::{BracketError, Exposure, Response, check, median};
use crate::picture::{Picture, Plane};

/// Relative error from rounding above which a pixel counts as coarse.
const COARSE: f64 = 0.02;
/// Largest number of pixels from which the median disagreement is estimated.
const MOST_RESIDUALS: usize = 1 << 20;

/// Settings for merging exposures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergeSettings {
    /// Share of the largest code, 0..=1, at or above which codes are clipped. JPEG compression
    /// blurs the clipping of the file itself slightly.
    pub white: f64,
    /// Largest share of the pixels, 0..=1, that may disagree between exposures; above it, the
    /// bracket is rejected.
    pub motion: f64,
}

impl Default for MergeSettings {
    /// Clips the topmost five of 256 codes and accepts disagreement of 6 % of the pixels: at high
    /// contrast, JPEG alone causes several per cent.
    fn default() -> Self {
        Self { white: 250.5 / 255.0, motion: 0.06 }
    }
}

/// Status of the radiance of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// The radiance is known, mostly from this exposure (counted from 0 in the given order).
    From(u8),
    /// Some channel is clipped even in the shortest exposure.
    Clipped,
    /// Some channel is black in every exposure: its radiance lies between 0 and that of the first
    /// code in the longest exposure, and half of the latter is stored.
    Dark,
    /// The radiance is unknown: the exposures contradict each other, for example because something
    /// moved.
    Moved,
}

/// Counts of the pixels of a bracket, and disagreements between exposures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MergeReport {
    /// Number of pixels.
    pub pixels: usize,
    /// Number of pixels clipped in every exposure, [`Known::Clipped`].
    pub clipped: usize,
    /// Number of pixels black in every exposure, [`Known::Dark`].
    pub dark: usize,
    /// Number of pixels whose exposures disagree, [`Known::Moved`].
    pub moved: usize,
    /// Number of known pixels with an uncertainty of more than 2 % from rounding alone.
    pub coarse: usize,
    /// Number of pixels whose radiance comes mostly from each exposure.
    pub from: Vec<usize>,
    /// Relative excess of each exposure's brightness over that expected from its time, relative to
    /// the next shorter exposure.
    pub time_errors: Vec<f64>,
    /// Median relative disagreement of the exposures of a channel with its merged value.
    pub residual: f64,
}

/// A merged bracket.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// Radiance, in units of the response per unit of the amount of light. Pixels that are clipped
    /// or moved contain `clip_level` in all channels.
    pub picture: Picture,
    /// Status of each pixel.
    pub known: Plane<Known>,
    /// Radiance above that of all known pixels: pixels with this value are unknown.
    pub clip_level: f32,
    /// Counts and disagreements.
    pub report: MergeReport,
}

/// One channel of one pixel.
enum Sample {
    /// Radiance, its relative error from rounding, the exposure of largest weight, and the mean
    /// relative disagreement of the exposures if there are several.
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

/// Merges a bracket into a picture without an alpha channel.
///
/// The result does not depend on the number of threads.
///
/// Each channel of a pixel is the mean of the radiances of its exposures, weighted by inverse
/// variances. These follow from the slope of the response and the time, which convert an error of
/// one code into an error of radiance. Clipped and black codes have no weight.
///
/// # Errors
/// [`BracketError::Times`] and [`BracketError::Motion`] if exposures contradict their times or each
/// other; [`BracketError::NothingKnown`]; errors of the sizes, depths and times of the exposures.
pub fn merge(exposures: &[Exposure], response: &Response, settings: &MergeSettings) -> Result<Merged, BracketError> {
    check(exposures)?;
    let response = response.resampled(exposures[0].codes.max());
    let tables = [0, 1, 2].map(|channel| Table::new(response.curve(channel), settings.white));
    let time_errors = time_errors(exposures, &tables)?;
    let (width, height) = exposures[0].codes.size();
    let log_amounts: Vec<f64> = exposures.iter().map(|e| e.amount.ln()).collect();
    // The median disagreement is estimated on a sample of the pixels.
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

/// Combines the exposures of one channel of a pixel.
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
    // No code is informative. A single clipped code decides, since black codes in longer exposures
    // would contradict it.
    if codes.iter().any(|&code| code >= table.white) {
        return Sample::Clipped;
    }
    let longest = exposures.iter().map(|e| e.amount).fold(0.0, f64::max);
    let first = (usize::from(table.black) + 1).min(table.exposure.len() - 1);
    Sample::Dark(0.5 * table.exposure[first] / longest)
}

/// Results of consecutive pixels, with counts.
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

    /// Adds one pixel.
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
            // Use the exposure of green, which contributes most of the luminance.
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
