//! Differences between exposures that their times do not explain: wrong times, flicker of the
//! light, and veiling glare.

use super::BracketError;
use super::frame::Frame;
use super::table::Table;
use crate::parallel;
use crate::statistics::median;

/// Factor between brightness and times above which the times are wrong. Nominal times are off by at
/// most 7 %.
const WRONG_TIMES: f64 = 1.25;
/// Range of codes, as a share of the largest, used to compare two exposures.
const MIDDLE: std::ops::Range<f64> = 0.1..0.9;
/// Smallest number of samples for this comparison.
const MIN_SAMPLES: usize = 50;
/// Largest number of pixels for this comparison.
const MAX_PIXELS: usize = 1 << 16;
/// Smallest error of a gain that is corrected.
const MIN_GAIN: f64 = 0.02;
/// Smallest veil that is corrected, as a share of the median radiance.
const MIN_VEIL: f64 = 0.02;
/// Share of the largest veil of a bracket below which a veil is an error of the estimate.
const SMALL_VEIL: f64 = 0.05;
/// Share to which gains of each channel, or a veil, must reduce the median disagreement of two
/// exposures.
const IMPROVED: f64 = 0.7;
/// Number of rounds of robust regression.
const ROUNDS: usize = 12;

/// Differences of an exposure from the next shorter one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Difference {
    /// Logarithm of the brightness over that expected from the times, for each channel.
    log_gain: [f64; 3],
    /// Additional radiance of each channel.
    veil: [f64; 3],
}

impl Difference {
    /// Returns the relative error of the brightness that follows from the shorter exposure.
    fn residual(&self, s: &Sample) -> f64 {
        (s.y - self.veil[s.channel]) / (self.log_gain[s.channel].exp() * s.x) - 1.0
    }
}

/// Radiance of a channel of one pixel, by two exposures.
#[derive(Clone, Copy, Debug)]
struct Sample {
    channel: usize,
    /// By the shorter exposure.
    x: f64,
    /// By the longer exposure.
    y: f64,
}

/// Estimates gains and veils, and stores them in the corrections of the frames.
///
/// Returns the relative excess of each exposure's brightness over that expected from its time,
/// relative to the next shorter exposure (0 for the shortest). An excess is the median over samples
/// that are well exposed in both. If the response was `recovered` from these frames, a common
/// factor between neighbours is an error of the response, not of the gains.
///
/// # Errors
/// [`BracketError::Times`] if an excess is larger than 25 %, unless the times are `trusted`;
/// trusted times have no gains.
pub(super) fn correct(
    frames: &mut [Frame<'_>],
    tables: &[Table; 3],
    recovered: bool,
    trusted: bool,
) -> Result<Vec<f64>, BracketError> {
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by(|&a, &b| frames[a].nominal.total_cmp(&frames[b].nominal));
    let mut errors = vec![0.0; frames.len()];
    let mut differences: Vec<Option<Difference>> = Vec::new();
    for pair in order.windows(2) {
        let (a, b) = (&frames[pair[0]], &frames[pair[1]]);
        let difference = difference(a, b, tables);
        if let Some(Difference { log_gain, .. }) = difference {
            let off = median(log_gain).unwrap_or(0.0);
            if off.abs() > WRONG_TIMES.ln() && !trusted {
                let (first, second) = (a.index + 1, b.index + 1);
                let stated = b.nominal / a.nominal;
                return Err(BracketError::Times { first, second, measured: stated * off.exp(), stated });
            }
            errors[pair[1]] = off.exp_m1();
        }
        differences.push(difference);
    }
    if !trusted {
        store(frames, &order, &differences, recovered);
    }
    Ok(errors)
}

/// Stores the products of the gains along the chain of exposures, with a median of 1, and veils.
fn store(frames: &mut [Frame<'_>], order: &[usize], differences: &[Option<Difference>], recovered: bool) {
    for channel in 0..3 {
        let of_pairs: Vec<f64> = differences.iter().map(|d| d.map_or(0.0, |d| d.log_gain[channel])).collect();
        let common = if recovered { median(of_pairs.iter().copied()).unwrap_or(0.0) } else { 0.0 };
        let mut logs = vec![0.0; order.len()];
        for (i, off) in of_pairs.iter().enumerate() {
            let off = if differences[i].is_some() { off - common } else { 0.0 };
            logs[i + 1] = logs[i] + if off.abs() > MIN_GAIN { off } else { 0.0 };
        }
        let middle = median(logs.iter().copied()).unwrap_or(0.0);
        let veils = chained_veils(differences, channel);
        for (i, &at) in order.iter().enumerate() {
            let frame = &mut frames[at];
            frame.correction.gain[channel] = (logs[i] - middle).exp();
            frame.correction.veiling_glare[channel] = veils[i] * frame.nominal;
        }
    }
}

/// Returns the veil of each exposure of a channel, as radiance, the shortest exposure first.
///
/// The veil of a pair is relative to its shorter exposure, which may have a veil itself. A veil
/// adds light, so the smallest veil is zero. After a pair without samples, the veil is zero, too.
/// Veils that are small beside the largest one are errors of the estimate.
fn chained_veils(differences: &[Option<Difference>], channel: usize) -> Vec<f64> {
    let (mut veils, mut gains) = (vec![0.0], vec![1.0]);
    for difference in differences {
        let (veil, gain) = (veils[veils.len() - 1], gains[gains.len() - 1]);
        match difference {
            Some(difference) => {
                let by = difference.log_gain[channel].exp();
                veils.push(by * veil + difference.veil[channel]);
                gains.push(by * gain);
            }
            None => {
                veils.push(0.0);
                gains.push(gain);
            }
        }
    }
    let least = veils.iter().zip(&gains).map(|(veil, gain)| veil / gain).fold(f64::INFINITY, f64::min);
    veils.iter_mut().zip(&gains).for_each(|(veil, gain)| *veil -= gain * least);
    let largest = veils.iter().copied().fold(0.0, f64::max);
    veils.iter_mut().filter(|veil| **veil < SMALL_VEIL * largest).for_each(|veil| *veil = 0.0);
    veils
}

/// Estimates the difference of `b` from the shorter exposure `a`; `None` with too few samples.
fn difference(a: &Frame<'_>, b: &Frame<'_>, tables: &[Table; 3]) -> Option<Difference> {
    let (width, height) = a.size();
    let step = (width * height).div_ceil(MAX_PIXELS).max(1);
    let max = f64::from(a.max());
    let middle = |code: u16| MIDDLE.contains(&(f64::from(code) / max));
    let radiance =
        |frame: &Frame<'_>, codes: [u16; 3], c: usize| tables[c].exposure[usize::from(codes[c])] / frame.nominal;
    let of_pixel = |i: usize| {
        let (of_a, of_b) = (a.at(i)?, b.at(i)?);
        Some([0, 1, 2].map(|c| {
            let sample = Sample { channel: c, x: radiance(a, of_a, c), y: radiance(b, of_b, c) };
            (middle(of_a[c]) && middle(of_b[c])).then_some(sample)
        }))
    };
    let of_pixel = |at: usize| of_pixel(at * step).into_iter().flatten().flatten();
    let samples: Vec<Sample> = parallel::flat_map_range((width * height).div_ceil(step), of_pixel);
    if samples.len() < MIN_SAMPLES {
        return None;
    }
    let ratio = |pairs: &[Sample]| median(pairs.iter().map(|s| (s.y / s.x).ln()));
    let typical = ratio(&samples)?;
    let plain = Difference { log_gain: [typical; 3], veil: [0.0; 3] };
    let (mut coloured, mut veiled) = (plain, plain);
    let mut log_gains = Vec::new();
    for channel in 0..3 {
        let of_channel: Vec<Sample> = samples.iter().filter(|s| s.channel == channel).copied().collect();
        if of_channel.len() < MIN_SAMPLES {
            continue;
        }
        coloured.log_gain[channel] = ratio(&of_channel)?;
        let (gain, veil) = line(&of_channel, coloured.log_gain[channel].exp());
        let brightness = median(of_channel.iter().map(|s| s.x))?;
        if gain > 0.0 && veil.abs() > MIN_VEIL * brightness {
            log_gains.push(gain.ln());
            veiled.veil[channel] = veil;
        }
    }
    // The gain of a veiled exposure is that of the channels with a veil.
    veiled.log_gain = [median(log_gains).unwrap_or(typical); 3];
    // Chroma subsampling of JPEG looks like a gain or a veil of one channel.
    let off = |of: &Difference| median(samples.iter().map(|s| of.residual(s).abs()));
    let mut best = plain;
    for more in [coloured, veiled] {
        if off(&more)? < IMPROVED * off(&best)? {
            best = more;
        }
    }
    Some(best)
}

/// Fits `y = gain x + veil` by robust regression of relative errors.
fn line(samples: &[Sample], gain: f64) -> (f64, f64) {
    let (mut gain, mut veil) = (gain, 0.0);
    for _ in 0..ROUNDS {
        let residual = |s: &Sample| (s.y - gain * s.x - veil) / (gain * s.x);
        let spread = median(samples.iter().map(|s| residual(s).abs())).unwrap_or(0.0).max(1e-4);
        let (mut w, mut wx, mut wy, mut wxx, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for sample in samples {
            let Sample { x, y, .. } = *sample;
            let weight = 1.0 / (1.0 + (residual(sample) / (2.0 * spread)).powi(2)) / (x * x);
            w += weight;
            wx += weight * x;
            wy += weight * y;
            wxx += weight * x * x;
            wxy += weight * x * y;
        }
        let determinant = w * wxx - wx * wx;
        if determinant <= 1e-9 * w * wxx {
            return (gain, 0.0);
        }
        (gain, veil) = ((w * wxy - wx * wy) / determinant, (wxx * wy - wx * wxy) / determinant);
        if gain <= 0.0 {
            return (gain, veil);
        }
    }
    (gain, veil)
}
