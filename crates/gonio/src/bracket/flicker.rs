//! Differences between exposures that their times do not explain: wrong times, flicker of the
//! light, and veiling glare.

use rayon::prelude::*;

use super::frame::Frame;
use super::table::Table;
use super::{BracketError, median};

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
/// Share to which a veil must reduce the median disagreement of two exposures.
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

/// Estimates gains and veils, and stores them in the corrections of the frames.
///
/// Returns the relative excess of each exposure's brightness over that expected from its time,
/// relative to the next shorter exposure (0 for the shortest): the median over samples that are
/// well exposed in both. If the response was `recovered` from these frames, a common factor between
/// neighbours is an error of the response, not of the gains.
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
    order.sort_by(|&a, &b| frames[a].stated.total_cmp(&frames[b].stated));
    let mut errors = vec![0.0; frames.len()];
    let mut differences: Vec<Option<Difference>> = Vec::new();
    for pair in order.windows(2) {
        let (a, b) = (&frames[pair[0]], &frames[pair[1]]);
        let difference = difference(a, b, tables);
        if let Some(Difference { log_gain, .. }) = difference {
            let off = median(&mut log_gain.to_vec()).unwrap_or(0.0);
            if off.abs() > WRONG_TIMES.ln() && !trusted {
                let (first, second) = (a.index + 1, b.index + 1);
                let said = b.stated / a.stated;
                return Err(BracketError::Times { first, second, seen: said * off.exp(), said });
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

/// Stores the products of the gains along the chain of exposures, with a median of 1, and the veils.
fn store(frames: &mut [Frame<'_>], order: &[usize], differences: &[Option<Difference>], recovered: bool) {
    for channel in 0..3 {
        let of_pairs: Vec<f64> = differences.iter().map(|d| d.map_or(0.0, |d| d.log_gain[channel])).collect();
        let common = if recovered { median(&mut of_pairs.clone()).unwrap_or(0.0) } else { 0.0 };
        let mut logs = vec![0.0; order.len()];
        for (i, off) in of_pairs.iter().enumerate() {
            let off = if differences[i].is_some() { off - common } else { 0.0 };
            logs[i + 1] = logs[i] + if off.abs() > MIN_GAIN { off } else { 0.0 };
        }
        let middle = median(&mut logs.clone()).unwrap_or(0.0);
        // A veil is relative to the shorter exposure, which may have one itself.
        let mut veil = 0.0;
        for (i, &at) in order.iter().enumerate() {
            if let Some(difference) = i.checked_sub(1).and_then(|i| differences[i]) {
                veil = difference.log_gain[channel].exp() * veil + difference.veil[channel];
            }
            let frame = &mut frames[at];
            frame.correction.gain[channel] = (logs[i] - middle).exp();
            frame.correction.veil[channel] = veil * frame.stated;
        }
    }
}

/// Estimates the difference of `b` from the shorter exposure `a`; `None` with too few samples.
fn difference(a: &Frame<'_>, b: &Frame<'_>, tables: &[Table; 3]) -> Option<Difference> {
    let (width, height) = a.size();
    let step = (width * height).div_ceil(MAX_PIXELS).max(1);
    let max = f64::from(a.max());
    let middle = |code: u16| MIDDLE.contains(&(f64::from(code) / max));
    let samples: Vec<(usize, f64, f64)> = (0..width * height)
        .into_par_iter()
        .step_by(step)
        .filter_map(|i| Some((a.at(i)?, b.at(i)?)))
        .flat_map_iter(|(of_a, of_b)| {
            let radiance =
                |frame: &Frame<'_>, codes: [u16; 3], c: usize| tables[c].exposure[usize::from(codes[c])] / frame.stated;
            (0..3)
                .filter(move |&c| middle(of_a[c]) && middle(of_b[c]))
                .map(move |c| (c, radiance(a, of_a, c), radiance(b, of_b, c)))
        })
        .collect();
    if samples.len() < MIN_SAMPLES {
        return None;
    }
    let mut all = Difference { log_gain: [0.0; 3], veil: [0.0; 3] };
    let ratio = |pairs: &[(f64, f64)]| median(&mut pairs.iter().map(|(x, y)| (y / x).ln()).collect::<Vec<_>>());
    let every: Vec<(f64, f64)> = samples.iter().map(|(_, x, y)| (*x, *y)).collect();
    let typical = ratio(&every)?;
    for channel in 0..3 {
        let pairs: Vec<(f64, f64)> = samples.iter().filter(|s| s.0 == channel).map(|s| (s.1, s.2)).collect();
        if pairs.len() < MIN_SAMPLES {
            all.log_gain[channel] = typical;
            continue;
        }
        let plain = ratio(&pairs)?;
        let (gain, veil) = line(&pairs, plain.exp());
        let off = |gain: f64, veil: f64| {
            median(&mut pairs.iter().map(|(x, y)| ((y - veil) / (gain * x) - 1.0).abs()).collect::<Vec<_>>())
        };
        let brightness = median(&mut pairs.iter().map(|(x, _)| *x).collect::<Vec<_>>())?;
        let is_veiled =
            veil.abs() > MIN_VEIL * brightness && gain > 0.0 && off(gain, veil)? < IMPROVED * off(plain.exp(), 0.0)?;
        (all.log_gain[channel], all.veil[channel]) = if is_veiled { (gain.ln(), veil) } else { (plain, 0.0) };
    }
    Some(all)
}

/// Fits `y = gain x + veil` by robust regression of relative errors.
fn line(pairs: &[(f64, f64)], gain: f64) -> (f64, f64) {
    let (mut gain, mut veil) = (gain, 0.0);
    for _ in 0..ROUNDS {
        let residual = |&(x, y): &(f64, f64)| (y - gain * x - veil) / (gain * x);
        let spread = median(&mut pairs.iter().map(|p| residual(p).abs()).collect::<Vec<_>>()).unwrap_or(0.0).max(1e-4);
        let (mut w, mut wx, mut wy, mut wxx, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for pair in pairs {
            let (x, y) = *pair;
            let weight = 1.0 / (1.0 + (residual(pair) / (2.0 * spread)).powi(2)) / (x * x);
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
