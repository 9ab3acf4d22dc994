//! Merging of the exposures of each pixel.

use glam::Vec3;

use super::MergedPixelStatus;
use super::consistency::disagree;
use super::frame::Frame;
use super::table::Table;
use crate::parallel;

/// Relative error from rounding above which a pixel counts as coarse.
const COARSE: f64 = 0.02;
/// Largest number of pixels from which disagreements are estimated.
const MAX_RESIDUALS: usize = 1 << 20;

/// One channel of one pixel.
enum Sample {
    /// Radiance, its relative error from rounding, and the exposure of largest weight.
    Value {
        radiance: f64,
        error: f64,
        from: usize,
    },
    Clipped,
    Dark(f64),
    Moved,
}

/// Merges the frames of all pixels, row by row from the top.
///
/// `exposures` is the number of exposures of the bracket, of which the frames may be a part.
pub(super) fn merged(frames: &[Frame<'_>], exposures: usize, tables: &[Table; 3]) -> Row {
    let (width, height) = frames[0].size();
    let step = (width * height).div_ceil(MAX_RESIDUALS).max(1);
    let of_row = |y: usize| {
        let mut row = Row::new(width, exposures);
        let mut codes: Vec<(&Frame<'_>, u16)> = Vec::new();
        for i in y * width..(y + 1) * width {
            let mut compared = false;
            let samples = [0, 1, 2].map(|channel| {
                codes.clear();
                codes.extend(frames.iter().filter_map(|frame| Some((frame, frame.at(i)?[channel]))));
                let disagree = disagree(&codes, channel, &tables[channel]);
                compared |= disagree.is_some();
                if disagree == Some(true) {
                    return Sample::Moved;
                }
                let residuals = i.is_multiple_of(step).then_some(&mut row.residuals);
                sample(&codes, (channel, &tables[channel]), residuals)
            });
            row.compared += usize::from(compared);
            row.take(&samples);
        }
        row
    };
    let rows: Vec<Row> = parallel::map_range(height, of_row);
    let mut all = Row::new(width * height, exposures);
    rows.into_iter().for_each(|row| all.append(row));
    all
}

/// Combines the exposures of one channel of a pixel, and collects their disagreements. A pixel that
/// no exposure shows is unknown.
fn sample(
    codes: &[(&Frame<'_>, u16)],
    (channel, table): (usize, &Table),
    residuals: Option<&mut Vec<Vec<f64>>>,
) -> Sample {
    let (mut sum, mut total, mut precision) = (0.0, 0.0, 0.0);
    let mut best = (0, 0.0);
    let of = |&(frame, code): &(&Frame<'_>, u16)| {
        let (code, amount) = (usize::from(code), frame.amount(channel));
        (code, amount, frame.without_veil(table.exposure[code], channel).max(0.0) / amount)
    };
    for pair in codes {
        let (code, amount, radiance) = of(pair);
        let weight = table.weight[code] * amount * amount;
        sum += weight * radiance;
        total += weight;
        precision += table.precision[code] * amount * amount;
        if weight > best.1 {
            best = (pair.0.index, weight);
        }
    }
    if total > 0.0 {
        let radiance = sum / total;
        // The variance of rounding is 1/12.
        let error = (12.0 * precision).powf(-0.5) / radiance;
        let informs = |pair: &&(&Frame<'_>, u16)| table.is_known(pair.1);
        if let Some(residuals) = residuals
            && codes.iter().filter(informs).count() > 1
        {
            for pair in codes.iter().filter(informs) {
                residuals[pair.0.index].push((of(pair).2 / radiance - 1.0).abs());
            }
        }
        return Sample::Value { radiance, error, from: best.0 };
    }
    // No code is informative. A single clipped code decides, since black codes in longer exposures
    // would contradict it.
    if codes.iter().any(|(_, code)| *code >= table.white) {
        return Sample::Clipped;
    }
    let longest = codes.iter().map(|(frame, _)| frame.amount(channel)).fold(0.0, f64::max);
    if longest == 0.0 {
        return Sample::Moved;
    }
    let first = (usize::from(table.black) + 1).min(table.exposure.len() - 1);
    Sample::Dark(0.5 * table.exposure[first] / longest)
}

/// Results of consecutive pixels, with counts.
pub(super) struct Row {
    pub(super) rgb: Vec<Vec3>,
    pub(super) known: Vec<MergedPixelStatus>,
    pub(super) clipped: usize,
    pub(super) dark: usize,
    pub(super) moved: usize,
    pub(super) coarse: usize,
    pub(super) compared: usize,
    pub(super) from: Vec<usize>,
    /// Relative disagreements of each exposure with the merged values.
    pub(super) residuals: Vec<Vec<f64>>,
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
            residuals: vec![Vec::new(); exposures],
        }
    }

    /// Adds one pixel.
    fn take(&mut self, samples: &[Sample; 3]) {
        let value = |sample: &Sample| match *sample {
            Sample::Value { radiance, .. } => radiance as f32,
            Sample::Dark(half) => half as f32,
            Sample::Clipped | Sample::Moved => 0.0,
        };
        self.rgb.push(Vec3::from_array(samples.each_ref().map(value)));
        let any = |of: fn(&Sample) -> bool| samples.iter().any(of);
        self.known.push(if any(|s| matches!(s, Sample::Moved)) {
            self.moved += 1;
            MergedPixelStatus::Inconsistent
        } else if any(|s| matches!(s, Sample::Clipped)) {
            self.clipped += 1;
            MergedPixelStatus::Clipped
        } else if let [Sample::Value { .. }, Sample::Value { from, .. }, Sample::Value { .. }] = samples {
            // Use the exposure of green, which contributes most of the luminance.
            self.coarse += usize::from(any(|s| matches!(s, Sample::Value { error, .. } if *error > COARSE)));
            self.from[*from] += 1;
            MergedPixelStatus::From(*from as u8)
        } else {
            self.dark += 1;
            MergedPixelStatus::Dark
        });
    }

    fn append(&mut self, mut row: Self) {
        self.rgb.append(&mut row.rgb);
        self.known.append(&mut row.known);
        self.residuals.iter_mut().zip(&mut row.residuals).for_each(|(all, row)| all.append(row));
        self.clipped += row.clipped;
        self.dark += row.dark;
        self.moved += row.moved;
        self.coarse += row.coarse;
        self.compared += row.compared;
        self.from.iter_mut().zip(row.from).for_each(|(a, b)| *a += b);
    }
}
