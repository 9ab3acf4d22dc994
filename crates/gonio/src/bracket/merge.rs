//! Merging of a bracket into one picture of radiance: alignment, response, corrections, and
//! exposures that are inconsistent with the others.

use glam::Vec3;

use super::align::shifts;
use super::flicker::correct;
use super::frame::{ExposureCorrection, Frame};
use super::pixels::{Row, merged};
use super::table::Table;
use super::{BracketError, Exposure, Response, check};
use crate::picture::{Picture, Plane};
use crate::statistics::{median, quantile};

/// Largest share of the exposures that may be left out because they are inconsistent.
const MAX_LEFT_OUT: f64 = 1.0 / 3.0;

/// Share of the largest code at or above which codes are clipped: the topmost five of 256. JPEG
/// compression blurs the clipping of the file itself slightly.
const WHITE: f64 = 250.5 / 255.0;

/// Largest share of the pixels that may disagree between exposures; above it, the bracket is
/// rejected. At high contrast, JPEG alone causes several per cent.
const MOTION: f64 = 0.06;

/// Settings for merging exposures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergeSettings {
    /// Whether to shift the exposures so that the scene coincides.
    pub align: bool,
    /// Whether to use the times without checking or correcting them, and to accept any share of
    /// inconsistent pixels.
    pub trust_times: bool,
}

impl Default for MergeSettings {
    fn default() -> Self {
        Self { align: true, trust_times: false }
    }
}

/// Status of the radiance of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MergedPixelStatus {
    /// The radiance is known, mostly from this exposure (counted from 0 in the given order).
    From(u8),
    /// Some channel is clipped even in the shortest exposure.
    Clipped,
    /// Some channel is black in every exposure: its radiance lies between 0 and that of the first
    /// code in the longest exposure, and half of the latter is stored.
    Dark,
    /// The radiance is unknown: the exposures contradict each other, for example because something
    /// moved, or no aligned exposure shows the pixel.
    Inconsistent,
}

/// Counts of the pixels of a bracket, and disagreements between exposures.
#[derive(Clone, Debug, PartialEq)]
pub struct MergeReport {
    /// Number of pixels.
    pub pixels: usize,
    /// Number of pixels clipped in every exposure, [`MergedPixelStatus::Clipped`].
    pub clipped: usize,
    /// Number of pixels black in every exposure, [`MergedPixelStatus::Dark`].
    pub dark: usize,
    /// Number of pixels whose exposures disagree, [`MergedPixelStatus::Inconsistent`].
    pub inconsistent: usize,
    /// Number of known pixels with an uncertainty of more than 2 % from rounding alone.
    pub quantised: usize,
    /// Number of pixels whose radiance comes mostly from each exposure.
    pub pixels_by_exposure: Vec<usize>,
    /// Relative excess of each exposure's brightness over that expected from its time, relative to
    /// the next shorter exposure that is used; zero for exposures that were left out.
    pub time_errors: Vec<f64>,
    /// Correction of each exposure; `None` for exposures that were left out because they are
    /// inconsistent with the others.
    pub corrections: Vec<Option<ExposureCorrection>>,
    /// Median relative disagreement of each exposure with the merged values; zero for exposures
    /// that were left out.
    pub residuals: Vec<f64>,
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
    pub known: Plane<MergedPixelStatus>,
    /// Radiance above that of all known pixels: pixels with this value are unknown.
    pub clip_level: f32,
    /// Response of the camera, given or recovered.
    pub response: Response,
    /// Counts and disagreements.
    pub report: MergeReport,
}

/// Merges a bracket into a picture without an alpha channel.
///
/// First, the exposures are aligned with the first one by translation, if
/// [`MergeSettings::align`] is set. If `response` is `None`, it is recovered from the bracket. Then
/// gains and veils that the times do not explain are corrected. Each channel of a pixel is the mean
/// of the radiances of its exposures, weighted by inverse variances. These follow from the slope of
/// the response and the time, which convert an error of one code into an error of radiance. Clipped
/// and black codes have no weight.
///
/// If exposures contradict each other, those without which the others agree are left out, at most
/// a third.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// * [`BracketError::Times`] and [`BracketError::Motion`] if too many exposures contradict their
///   times or each other.
/// * Errors of [`Response::recover`] if `response` is `None`.
/// * [`BracketError::NothingKnown`]; errors of the sizes, depths and times of the exposures.
pub fn merge(
    exposures: &[Exposure],
    response: Option<&Response>,
    settings: &MergeSettings,
) -> Result<Merged, BracketError> {
    check(exposures)?;
    let shifts = if settings.align { shifts(exposures) } else { vec![(0, 0); exposures.len()] };
    let bracket = Bracket { exposures, shifts, response };
    let all: Vec<usize> = (0..exposures.len()).collect();
    let error = match bracket.attempt(&all, settings.trust_times) {
        Err(error) if error.is_contradiction() && !settings.trust_times => error,
        result => return result.map(|attempt| bracket.assemble(attempt)),
    };
    let mut kept = all;
    for _ in 0..(MAX_LEFT_OUT * exposures.len() as f64) as usize {
        kept = bracket.without_one(&kept).ok_or_else(|| error.clone())?;
        if let Ok(attempt) = bracket.attempt(&kept, false) {
            return Ok(bracket.assemble(attempt));
        }
    }
    Err(error)
}

/// The inputs of [`merge()`], with the shifts of the exposures.
struct Bracket<'a> {
    exposures: &'a [Exposure],
    shifts: Vec<(i32, i32)>,
    response: Option<&'a Response>,
}

/// The result of merging some of the exposures.
struct Attempt<'a> {
    frames: Vec<Frame<'a>>,
    response: Response,
    tables: [Table; 3],
    /// Excess of brightness of each frame.
    time_errors: Vec<f64>,
    row: Row,
}

impl Attempt<'_> {
    /// Returns the share of the compared pixels that disagree.
    fn moved(&self) -> f64 {
        self.row.moved as f64 / self.row.compared.max(1) as f64
    }
}

impl<'a> Bracket<'a> {
    /// Merges the exposures `kept`. If they are `trusted`, contradictions are no error.
    fn attempt(&self, kept: &[usize], trusted: bool) -> Result<Attempt<'a>, BracketError> {
        let frame = |&index: &usize| Frame::new(self.exposures, index, self.shifts[index]);
        let mut frames: Vec<Frame<'a>> = kept.iter().map(frame).collect();
        let response = match self.response {
            Some(response) => response.resampled(frames[0].max()),
            None => Response::of_frames(&frames)?,
        };
        let tables = [0, 1, 2].map(|channel| Table::new(response.curve(channel), WHITE));
        let time_errors = correct(&mut frames, &tables, self.response.is_none(), trusted)?;
        let row = merged(&frames, self.exposures.len(), &tables);
        let attempt = Attempt { frames, response, tables, time_errors, row };
        if attempt.moved() > MOTION && !trusted {
            return Err(BracketError::Motion { moved: attempt.row.moved, compared: attempt.row.compared });
        }
        if attempt.row.from.iter().all(|&n| n == 0) {
            return Err(BracketError::NothingKnown { clipped: attempt.row.clipped, dark: attempt.row.dark });
        }
        Ok(attempt)
    }

    /// Leaves out the exposure without which the others contradict each other least.
    ///
    /// Returns the others; `None` if fewer than two would be left, or if no response explains any
    /// part.
    fn without_one(&self, kept: &[usize]) -> Option<Vec<usize>> {
        if kept.len() < 3 {
            return None;
        }
        let part = |out: &usize| {
            let rest: Vec<usize> = kept.iter().copied().filter(|index| index != out).collect();
            let attempt = self.attempt(&rest, true).ok()?;
            // A time that is wrong by 100 % is as bad as motion everywhere.
            let off = attempt.time_errors.iter().map(|e| e.abs()).fold(0.0, f64::max);
            Some((rest, attempt.moved() + off))
        };
        let parts = kept.iter().filter_map(part);
        parts.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(rest, _)| rest)
    }

    fn assemble(&self, attempt: Attempt<'_>) -> Merged {
        let Attempt { frames, response, tables, time_errors: of_frames, row } = attempt;
        let Row { mut rgb, known, clipped, dark, moved, coarse, from, mut residuals, .. } = row;
        let (width, height) = frames[0].size();
        let (mut time_errors, mut corrections) = (vec![0.0; self.exposures.len()], vec![None; self.exposures.len()]);
        for (frame, error) in frames.iter().zip(of_frames) {
            (time_errors[frame.index], corrections[frame.index]) = (error, Some(frame.correction));
        }
        let residual = median(residuals.concat()).unwrap_or(0.0);
        let residuals = residuals.iter_mut().map(|residuals| quantile(residuals, 0.5).unwrap_or(0.0)).collect();
        let pixels = width * height;
        let report = MergeReport {
            pixels,
            clipped,
            dark,
            inconsistent: moved,
            quantised: coarse,
            pixels_by_exposure: from,
            time_errors,
            corrections,
            residuals,
            residual,
        };
        let shortest = |channel: usize| frames.iter().map(|frame| frame.amount(channel)).fold(f64::MAX, f64::min);
        let end = |(channel, table): (usize, &Table)| table.exposure[table.exposure.len() - 1] / shortest(channel);
        let end = tables.iter().enumerate().map(end).fold(0.0, f64::max) as f32;
        let is_seen = |known: &MergedPixelStatus| matches!(known, MergedPixelStatus::From(_) | MergedPixelStatus::Dark);
        let seen = rgb.iter().zip(&known).filter(|(_, k)| is_seen(k));
        let clip_level = seen.fold(end, |level, (v, _)| level.max(v.max_element().next_up()));
        for (colour, known) in rgb.iter_mut().zip(&known) {
            if !is_seen(known) {
                *colour = Vec3::splat(clip_level);
            }
        }
        let picture = Picture { rgb: Plane::from_vec(width, height, rgb), alpha: None };
        Merged { picture, known: Plane::from_vec(width, height, known), clip_level, response, report }
    }
}
