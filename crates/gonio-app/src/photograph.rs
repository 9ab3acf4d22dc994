//! A photograph from files or memory: one picture, or the exposures of a bracket.

use std::path::{Path, PathBuf};

use gonio::bracket::{MergeSettings, Merged, Response, merge};
use gonio::picture::{Picture, Plane};
use gonio::remedy::Remedy;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{
    self, BracketOptions, Decoded, Encoding, InputSpace, ReadOptions, divide_by_flat, subtract_black,
};
use serde_json::{Value, json};

use crate::{Problem, Warning, spaces};

/// How much brighter than its time says an exposure may be before the user is told.
const TIME_ERROR: f64 = 0.05;
/// At least so many pixels share the largest value of a float picture that clips.
const CLIPPED_PIXELS: usize = 12;

/// How the files of a photograph are read.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// Values of integer pictures are linear radiance, not sRGB-coded.
    pub linear: bool,
    /// Exposure times of a bracket in seconds, in place of those of the EXIF data.
    pub times: Option<Vec<f64>>,
    /// The camera's curve; without one it is recovered from the bracket.
    pub response: Option<Curve>,
    /// Black level of linear integer files, in their codes.
    pub black_level: Option<f64>,
    /// Picture of an evenly lit surface by the same lens, to divide by.
    pub flat: Option<PathBuf>,
    /// Layer of an OpenEXR file that holds several.
    pub layer: Option<String>,
    /// Colour space of pictures that state none: of files, and of pictures in memory.
    pub colour_space: Option<ColourSpace>,
}

/// A camera's curve from radiance to codes.
#[derive(Clone, Debug, PartialEq)]
pub enum Curve {
    /// The curve of sRGB.
    Srgb,
    /// Codes in proportion to radiance.
    Linear,
    /// A file as [`encode_response`](gonio_io::picture::encode_response) writes it.
    File(PathBuf),
}

/// Source of a photograph.
#[derive(Clone, Debug)]
pub enum Shots {
    /// A picture in memory.
    Here(Picture),
    /// A photograph that was read before.
    Read(Photograph),
    /// A picture as a file would hold it, and how messages call it.
    Bytes(String, Vec<u8>),
    /// A picture, or the exposures of a bracket; at least one.
    Files(Vec<PathBuf>),
}

/// A photograph, ready to be observed.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Linear radiance.
    pub picture: Picture,
    /// Radiance at or above which nothing is known.
    pub clip: Option<f32>,
    /// The section `bracket` of the result.
    pub notes: Option<Value>,
    /// Colour space that the values of the files were in; `None` for a picture in memory in linear
    /// Rec. 709.
    pub space: Option<InputSpace>,
}

/// A merged bracket with what it was merged by.
#[derive(Clone, Debug)]
pub struct MergedBracket {
    /// The picture in linear Rec. 709, and what was used where.
    pub merged: Merged,
    /// Colour space of the files.
    pub space: InputSpace,
    /// The camera's curve.
    pub response: Response,
    /// True if the response was recovered from the bracket itself.
    pub recovered: bool,
    /// Light of each exposure relative to the longest.
    pub amounts: Vec<f64>,
}

impl Shots {
    /// Reads the picture, or merges the exposures. `clip` is the level that the user gave.
    ///
    /// # Errors
    /// If a file cannot be read, or settings do not go with it.
    pub fn read(
        self,
        reading: &Reading,
        clip: Option<f32>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Photograph, Problem> {
        if let Some(clip) = clip.filter(|clip| clip.is_nan() || *clip <= 0.0) {
            return Err(Problem::new(format!("clip {clip}: give a positive radiance")));
        }
        let paths = match self {
            Self::Here(picture) => match reading.colour_space {
                None => return Ok(Photograph { picture, clip, notes: None, space: None }),
                Some(space) => {
                    let decoded = Decoded::linear(picture, clip, space).into_working(Path::new("the picture"))?;
                    let Decoded { picture, full_scale: clip, input, .. } = decoded;
                    warnings.extend(spaces::warnings("the picture", &input, picture.rgb.as_slice().len()));
                    return Ok(Photograph { picture, clip, notes: None, space: Some(input) });
                }
            },
            Self::Read(photograph) => return Ok(photograph),
            Self::Bytes(name, bytes) => {
                if reading.response.is_some() {
                    return Err(Problem::of(name, "a camera's curve is for exposures in files"));
                }
                return single(Path::new(&name), Some(&bytes), reading, clip, warnings);
            }
            Self::Files(paths) => paths,
        };
        if let ([path], None) = (&paths[..], &reading.response) {
            return single(path, None, reading, clip, warnings);
        }
        let bracket = merge_files(&paths, reading, warnings)?;
        let notes = json!({
            "exposures": bracket.amounts, "recovered_response": bracket.recovered, "report": bracket.merged.report,
        });
        let Merged { picture, clip_level, .. } = bracket.merged;
        let (clip, space) = (clip.or(Some(clip_level)), Some(bracket.space));
        Ok(Photograph { picture, clip, notes: Some(notes), space })
    }
}

/// Reads a picture; adds what is odd about it to the warnings.
///
/// # Errors
/// If it cannot be read.
pub fn read_picture(path: &Path, options: &ReadOptions, warnings: &mut Vec<Warning>) -> Result<Decoded, Problem> {
    let decoded = picture::read(path, options)?;
    warnings.extend(oddities(path, options, &decoded));
    Ok(decoded)
}

/// Decodes a picture in memory, whose name tells the format; adds what is odd about it to the
/// warnings.
///
/// # Errors
/// If it cannot be decoded.
pub fn decode_picture(
    name: &Path,
    bytes: &[u8],
    options: &ReadOptions,
    warnings: &mut Vec<Warning>,
) -> Result<Decoded, Problem> {
    let decoded = picture::decode(name, bytes, options)?;
    warnings.extend(oddities(name, options, &decoded));
    Ok(decoded)
}

fn oddities(path: &Path, options: &ReadOptions, decoded: &Decoded) -> Vec<Warning> {
    let name = path.display();
    let coded = match decoded.encoding {
        Encoding::Srgb { bits } => Some(Warning::new(
            format!(
                "{name}: {bits}-bit sRGB-coded picture, decoded as such; its highlights are probably clipped and its \
                 tone curve unknown: prefer an HDR picture"
            ),
            vec![Remedy::Linear],
        )),
        Encoding::Coded { bits } => Some(Warning::new(
            format!(
                "{name}: {bits}-bit picture, decoded by the curve that it states ({}); its highlights are probably \
                 clipped: prefer an HDR picture",
                decoded.input.source.words()
            ),
            vec![Remedy::Linear],
        )),
        Encoding::LinearFloat if options.linear => {
            Some(Warning::from(format!("{name}: holds linear numbers as it is: to say so changes nothing")))
        }
        _ => None,
    };
    let layered = decoded.layer.as_ref().filter(|_| options.layer.is_none()).map(|layer| {
        let (taken, others) = (&layer.name, layer.others.join(", "));
        let text = format!("{name}: holds several pictures, {taken} was taken; others are {others}");
        Warning::new(text, vec![Remedy::Layer])
    });
    let pixels = decoded.picture.rgb.as_slice().len();
    let space = spaces::warnings(&name.to_string(), &decoded.input, pixels);
    coded.into_iter().chain(layered).chain(space).collect()
}

/// A picture that is a photograph by itself; its bytes, if they are not in the file.
fn single(
    path: &Path,
    bytes: Option<&[u8]>,
    reading: &Reading,
    clip: Option<f32>,
    warnings: &mut Vec<Warning>,
) -> Result<Photograph, Problem> {
    if reading.times.is_some() {
        return Err(Problem::of(
            path.display(),
            "times are for exposures of one scene: give several files, or no times",
        ));
    }
    let Reading { linear, colour_space, .. } = *reading;
    let options = ReadOptions { linear, layer: reading.layer.clone(), colour_space, ..ReadOptions::default() };
    // Corrections act on the channels of the file.
    let mut decoded = match bytes {
        Some(bytes) => picture::decode_unconverted(path, bytes, &options)?,
        None => picture::read_unconverted(path, &options)?,
    };
    if let Some(code) = reading.black_level {
        let Encoding::Linear { bits } = decoded.encoding else {
            let problem = "a black level is for linear integer pictures: say that it is linear, or give none";
            return Err(Problem::of(path.display(), problem));
        };
        let max = f64::from((1_u32 << bits) - 1);
        check_black(code, max)?;
        subtract_black(&mut decoded, (code / max) as f32);
    }
    decoded.full_scale = clip.or(decoded.full_scale);
    if let Some(flat) = &reading.flat {
        if decoded.needs_table() {
            let problem = "a flat field needs linear values, which the table of the ICC profile does not give: \
                           convert the picture to a linear space";
            return Err(Problem::of(path.display(), problem));
        }
        let level_found = decoded.full_scale.or_else(|| repeated_maximum(&decoded.picture));
        decoded.full_scale = flatten(&mut decoded.picture, flat, reading, level_found)?;
    }
    let decoded = decoded.into_working(path)?;
    warnings.extend(oddities(path, &options, &decoded));
    let Decoded { picture, full_scale, input, .. } = decoded;
    Ok(Photograph { picture, clip: full_scale, notes: None, space: Some(input) })
}

/// The largest value where so many pixels share it that it is no coincidence. Division by a flat
/// field would hide it.
fn repeated_maximum(picture: &Picture) -> Option<f32> {
    let values = || picture.rgb.as_slice().iter().filter(|v| v.is_finite()).map(|v| v.max_element());
    let largest = values().fold(0.0, f32::max);
    (largest > 0.0 && values().filter(|v| *v == largest).count() >= CLIPPED_PIXELS).then_some(largest)
}

fn check_black(code: f64, max: f64) -> Result<(), Problem> {
    if !(0.0..max).contains(&code) {
        return Err(Problem::new(format!("black level {code}: give a code from 0 to less than {max}")));
    }
    Ok(())
}

fn flatten(picture: &mut Picture, path: &Path, reading: &Reading, clip: Option<f32>) -> Result<Option<f32>, Problem> {
    let options = ReadOptions { linear: reading.linear, ..ReadOptions::default() };
    let flat = picture::read_unconverted(path, &options)?.picture.rgb;
    Ok(divide_by_flat(picture, &flat, path, clip)?)
}

/// Reads and merges the exposures of a bracket.
///
/// # Errors
/// If a file cannot be read, the exposures do not belong together, or settings do not go with them.
pub fn merge_files(
    paths: &[PathBuf],
    reading: &Reading,
    warnings: &mut Vec<Warning>,
) -> Result<MergedBracket, Problem> {
    let names = || match paths {
        [one] => one.display().to_string(),
        [first, rest @ ..] => format!("{} and {} more", first.display(), rest.len()),
        [] => String::new(),
    };
    if reading.layer.is_some() {
        return Err(Problem::new("a layer is one of an OpenEXR file, not of exposures"));
    }
    let curve = reading.response.clone().or(reading.linear.then_some(Curve::Linear));
    let from_file = match &curve {
        Some(Curve::File(path)) => Some(picture::read_response(path)?),
        _ => None,
    };
    let read = ReadOptions { colour_space: reading.colour_space, ..ReadOptions::default() };
    let options = BracketOptions { times: reading.times.clone(), read };
    let bracket = picture::read_bracket(paths, &options)?;
    let exposures = &bracket.exposures;
    let max = exposures.first().map_or(u16::from(u8::MAX), |e| e.codes.max());
    let black = reading.black_level.unwrap_or(0.0);
    check_black(black, max.into())?;
    let linear = curve == Some(Curve::Linear) || (bracket.linear && curve.is_none());
    if reading.black_level.is_some() && !linear {
        let problem = "it is for linear exposures: say that they are linear, or give none";
        return Err(Problem::of(format!("black level {black}"), problem));
    }
    let recovered = !linear && curve.is_none();
    let response = match from_file {
        Some(response) => response,
        None if linear => Response::linear(max, black),
        None if curve.is_some() => Response::srgb(max),
        None => Response::recover(exposures).map_err(|error| Problem::of(names(), error))?,
    };
    let mut merged =
        merge(exposures, &response, &MergeSettings::default()).map_err(|error| Problem::of(names(), error))?;
    merged.picture.alpha = bracket.alpha.clone();
    if let Some(path) = &reading.flat {
        let level = flatten(&mut merged.picture, path, reading, Some(merged.clip_level))?;
        merged.clip_level = level.unwrap_or(merged.clip_level);
    }
    let whole = std::mem::replace(&mut merged.picture, Picture { rgb: Plane::from_vec(0, 0, Vec::new()), alpha: None });
    let decoded = bracket.decoded(whole, merged.clip_level).into_working(paths.first().map_or(Path::new(""), |p| p))?;
    merged.clip_level = decoded.full_scale.unwrap_or(merged.clip_level);
    merged.picture = decoded.picture;
    let report = &merged.report;
    warnings.extend(spaces::warnings(&names(), &decoded.input, report.pixels));
    for (path, error) in paths.iter().zip(&report.time_errors).filter(|(_, e)| e.abs() > TIME_ERROR) {
        let (percent, side) = (100.0 * error.abs(), if *error > 0.0 { "brighter" } else { "darker" });
        warnings.push(format!("{}: {percent:.0} % {side} than its exposure time says", path.display()).into());
    }
    for (count, what) in [
        (
            report.moved,
            "are left out because the exposures contradict each other there: something moved, or JPEG smeared it",
        ),
        (report.dark, "are black even in the longest exposure and get half of the least that it shows"),
    ] {
        if count > 0 {
            warnings.push(format!("{}: {count} of {} pixels {what}", names(), report.pixels).into());
        }
    }
    let longest = exposures.iter().map(|e| e.amount).fold(0.0, f64::max);
    let amounts = exposures.iter().map(|e| e.amount / longest).collect();
    Ok(MergedBracket { merged, space: decoded.input, response, recovered, amounts })
}
