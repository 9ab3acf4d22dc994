//! A photograph from the files that the user names: one picture, or the exposures of a bracket.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::bracket::{MergeSettings, Merged, Response, merge};
use gonio::picture::Picture;
use gonio_io::picture::{BracketOptions, Encoding, ReadOptions, divide_by_flat, subtract_black};
use serde_json::{Value, json};

/// How much brighter than its time says an exposure may be before the user is told.
const TIME_ERROR: f64 = 0.05;
/// At least so many pixels share the largest value of a float picture that clips.
const CLIPPED_PIXELS: usize = 12;

/// Options of reading a photograph.
#[derive(clap::Args)]
pub(crate) struct Reading {
    /// Values of an integer picture are linear radiance, not sRGB-coded; the same as --response
    /// linear for exposures
    #[arg(long, conflicts_with = "response")]
    pub(crate) linear: bool,
    /// Exposure times of the files in seconds, in place of those of their EXIF data
    #[arg(long, value_name = "1/30,1/8,0.5,...", value_parser = parse_times)]
    times: Option<Times>,
    /// The camera's curve: srgb, linear, or a file as --save-response writes; without it, it is
    /// recovered from the exposures
    #[arg(long, value_name = "FILE|srgb|linear")]
    response: Option<String>,
    /// Black level of linear integer files, in their codes (0 to 255 or 65535)
    #[arg(long, value_name = "CODE")]
    black_level: Option<f64>,
    /// Picture of an evenly lit surface by the same lens, to divide by: takes vignetting away
    #[arg(long, value_name = "FILE")]
    flat: Option<PathBuf>,
    /// Layer of an OpenEXR file that holds several
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
}

/// Exposure times in seconds.
#[derive(Clone, Debug)]
struct Times(Vec<f64>);

fn parse_times(text: &str) -> Result<Times, String> {
    let one = |word: &str| -> Option<f64> {
        let (a, b) = word.split_once('/').unwrap_or((word, "1"));
        let time = a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?;
        (time.is_finite() && time > 0.0).then_some(time)
    };
    let times: Option<Vec<f64>> = text.split(',').map(one).collect();
    times.map(Times).ok_or_else(|| "give positive times in seconds with commas between, like 1/30,1/8,0.5".into())
}

/// A photograph, ready to be observed.
pub(crate) struct Photograph {
    pub(crate) picture: Picture,
    /// Radiance at or above which nothing is known.
    pub(crate) clip: Option<f32>,
    /// What the result says of a bracket.
    pub(crate) notes: Option<Value>,
}

/// A merged bracket with what it was merged by.
pub(crate) struct MergedBracket {
    pub(crate) merged: Merged,
    pub(crate) response: Response,
    /// Whether the response was found from the bracket itself.
    pub(crate) recovered: bool,
    /// Light of each exposure relative to the longest.
    pub(crate) amounts: Vec<f64>,
}

/// Reads one picture, or merges several. `clip` is the level that the user gave.
pub(crate) fn read(
    first: &Path,
    more: &[PathBuf],
    options: &Reading,
    clip: Option<f32>,
    warnings: &mut Vec<String>,
) -> Result<Photograph> {
    if more.is_empty() && options.response.is_none() {
        return single(first, options, clip, warnings);
    }
    let paths: Vec<PathBuf> = std::iter::once(first.to_owned()).chain(more.iter().cloned()).collect();
    let bracket = merge_files(&paths, options, warnings)?;
    let notes = json!({ "exposures": bracket.amounts, "recovered_response": bracket.recovered, "report": bracket.merged.report });
    let Merged { picture, clip_level, .. } = bracket.merged;
    Ok(Photograph { picture, clip: clip.or(Some(clip_level)), notes: Some(notes) })
}

/// A picture that is a photograph by itself.
fn single(path: &Path, options: &Reading, clip: Option<f32>, warnings: &mut Vec<String>) -> Result<Photograph> {
    let name = path.display();
    if options.times.is_some() {
        bail!("{name}: --times is for exposures of one scene: give several files, or no times");
    }
    let read = ReadOptions { linear: options.linear, layer: options.layer.clone(), ..ReadOptions::default() };
    let mut decoded = crate::input::photograph(path, &read, warnings)?;
    if let Some(code) = options.black_level {
        let Encoding::Linear { bits } = decoded.encoding else {
            bail!("{name}: --black-level is for linear integer pictures: give it with --linear, or not at all");
        };
        let max = f64::from((1_u32 << bits) - 1);
        check_black(code, max)?;
        subtract_black(&mut decoded, (code / max) as f32);
    }
    let mut level = clip.or(decoded.full_scale);
    if let Some(path) = &options.flat {
        let level_found = level.or_else(|| repeated_maximum(&decoded.picture));
        level = flatten(&mut decoded.picture, path, options, level_found)?;
    }
    Ok(Photograph { picture: decoded.picture, clip: level, notes: None })
}

/// The largest value where so many pixels share it that it is no coincidence. Division by a flat
/// field would hide it.
fn repeated_maximum(picture: &Picture) -> Option<f32> {
    let values = || picture.rgb.as_slice().iter().filter(|v| v.is_finite()).map(|v| v.max_element());
    let largest = values().fold(0.0, f32::max);
    (largest > 0.0 && values().filter(|v| *v == largest).count() >= CLIPPED_PIXELS).then_some(largest)
}

fn check_black(code: f64, max: f64) -> Result<()> {
    if !(0.0..max).contains(&code) {
        bail!("--black-level {code}: give a code from 0 to less than {max}");
    }
    Ok(())
}

fn flatten(picture: &mut Picture, path: &Path, options: &Reading, clip: Option<f32>) -> Result<Option<f32>> {
    let read = ReadOptions { linear: options.linear, ..ReadOptions::default() };
    let flat = gonio_io::picture::read(path, &read)?.picture.rgb;
    Ok(divide_by_flat(picture, &flat, path, clip)?)
}

/// Reads and merges the exposures of a bracket.
pub(crate) fn merge_files(paths: &[PathBuf], options: &Reading, warnings: &mut Vec<String>) -> Result<MergedBracket> {
    let names = || match paths {
        [one] => one.display().to_string(),
        [first, rest @ ..] => format!("{} and {} more", first.display(), rest.len()),
        [] => String::new(),
    };
    if options.layer.is_some() {
        bail!("--layer is for one OpenEXR file, not for exposures");
    }
    let given = match options.response.as_deref() {
        Some(name @ ("srgb" | "linear")) => Some(name),
        Some(_) => None,
        None => options.linear.then_some("linear"),
    };
    let from_file = match options.response.as_deref() {
        Some(path) if given.is_none() => Some(gonio_io::picture::read_response(path)?),
        _ => None,
    };
    let times = options.times.as_ref().map(|times| times.0.clone());
    let bracket = gonio_io::picture::read_bracket(paths, &BracketOptions { times, ..BracketOptions::default() })?;
    let exposures = &bracket.exposures;
    let max = exposures.first().map_or(u16::from(u8::MAX), |e| e.codes.max());
    let black = options.black_level.unwrap_or(0.0);
    check_black(black, max.into())?;
    let linear = given == Some("linear") || (bracket.linear && from_file.is_none() && given.is_none());
    if options.black_level.is_some() && !linear {
        bail!("--black-level {black}: it is for linear exposures: give it with --linear, or not at all");
    }
    let recovered = !linear && given.is_none() && from_file.is_none();
    let response = match from_file {
        Some(response) => response,
        None if linear => Response::linear(max, black),
        None if given.is_some() => Response::srgb(max),
        None => Response::recover(exposures).with_context(names)?,
    };
    let mut merged = merge(exposures, &response, &MergeSettings::default()).with_context(names)?;
    merged.picture.alpha = bracket.alpha;
    if let Some(path) = &options.flat {
        let level = flatten(&mut merged.picture, path, options, Some(merged.clip_level))?;
        merged.clip_level = level.unwrap_or(merged.clip_level);
    }
    let report = &merged.report;
    for (path, error) in paths.iter().zip(&report.time_errors).filter(|(_, e)| e.abs() > TIME_ERROR) {
        let (percent, side) = (100.0 * error.abs(), if *error > 0.0 { "brighter" } else { "darker" });
        warnings.push(format!("{}: {percent:.0} % {side} than its exposure time says", path.display()));
    }
    for (count, what) in [
        (
            report.moved,
            "are left out because the exposures contradict each other there: something moved, or JPEG smeared it",
        ),
        (report.dark, "are black even in the longest exposure and get half of the least that it shows"),
    ] {
        if count > 0 {
            warnings.push(format!("{}: {count} of {} pixels {what}", names(), report.pixels));
        }
    }
    let longest = exposures.iter().map(|e| e.amount).fold(0.0, f64::max);
    let amounts = exposures.iter().map(|e| e.amount / longest).collect();
    Ok(MergedBracket { merged, response, recovered, amounts })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_fractions_or_numbers() {
        assert_eq!(parse_times("1/4, 0.5,2").unwrap().0, [0.25, 0.5, 2.0]);
        for bad in ["", "1/0", "0", "-1", "1,,2", "a", "1/2/3", "nan", "inf"] {
            assert!(parse_times(bad).is_err(), "{bad}");
        }
    }
}
