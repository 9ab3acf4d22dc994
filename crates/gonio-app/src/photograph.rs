//! Reads a photograph from files or memory: one image, or the exposures of a bracket.

use std::path::{Path, PathBuf};

use gonio::bracket::{MergeSettings, Merged, Response, merge};
use gonio::picture::{Picture, Plane};
use gonio::suggestion::Suggestion;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{
    self, BracketOptions, Decoded, Encoding, InputSpace, ReadOptions, divide_by_flat, repeated_maximum, subtract_black,
};
use gonio_io::result::Bracket;
use serde_json::{Value, json};

use crate::{AppError, Warning, coded_floats, spaces};

/// Relative error of an exposure time above which a warning reports it.
const TIME_ERROR: f64 = 0.05;

/// Options for reading the files of a photograph.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// Interpret the values of integer images as linear radiance, not as sRGB.
    pub linear: bool,
    /// Exposure times of a bracket in seconds, which override the EXIF data.
    pub times: Option<Vec<f64>>,
    /// Response curve of the camera; recovered from the bracket if `None`.
    pub response: Option<Curve>,
    /// Black level of linear integer images, as a code value.
    pub black_level: Option<f64>,
    /// Flat field: image of an evenly lit surface, taken with the same lens.
    pub flat: Option<PathBuf>,
    /// Do not shift the exposures of a bracket so that the scene coincides.
    pub no_align: bool,
    /// Use the times of a bracket without checking or correcting them.
    pub trust_times: bool,
    /// Layer to read from a multi-layer OpenEXR file.
    pub layer: Option<String>,
    /// Colour space of images that state none, in files or in memory.
    pub colour_space: Option<ColourSpace>,
}

/// Response curve of a camera, from radiance to codes.
#[derive(Clone, Debug, PartialEq)]
pub enum Curve {
    /// The curve of sRGB.
    Srgb,
    /// Codes proportional to radiance.
    Linear,
    /// A file as [`encode_response`](gonio_io::picture::encode_response) writes it.
    File(PathBuf),
}

/// Source of a photograph.
#[derive(Clone, Debug)]
pub enum PhotographSource {
    /// A picture in memory.
    Memory(Picture),
    /// Image file in memory: its name for messages, and its bytes.
    Bytes(String, Vec<u8>),
    /// Files of an image or of the exposures of a bracket; at least one.
    Files(Vec<PathBuf>),
}

/// A photograph in memory.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Linear radiance.
    pub picture: Picture,
    /// Radiance at which the camera clips.
    pub clip: Option<f32>,
    /// The section `bracket` of the result.
    pub bracket: Option<Bracket>,
    /// Colour space of the values in the files; `None` for a picture in memory in linear Rec. 709.
    pub space: Option<InputSpace>,
}

/// A merged bracket with the data of its merge.
#[derive(Clone, Debug)]
pub struct MergedBracket {
    /// The merged image in linear Rec. 709, and the source of each pixel.
    pub merged: Merged,
    /// Colour space of the files.
    pub space: InputSpace,
    /// True if the response was recovered from the bracket itself.
    pub recovered: bool,
    /// Relative exposures; the longest is 1.
    pub relative_exposures: Vec<f64>,
}

impl MergedBracket {
    /// Returns the section `bracket` of the result.
    pub fn section(&self) -> Bracket {
        Bracket {
            exposures: self.relative_exposures.clone(),
            recovered_response: self.recovered,
            report: (&self.merged.report).into(),
        }
    }

    /// Returns the section `bracket` and the colour spaces of the files and of the merged image.
    pub fn document(&self) -> Value {
        let InputSpace { name, source, .. } = &self.space;
        let mut document = json!(self.section());
        document["colorspace"] =
            json!({ "input": name, "source": source.words(), "output": ColourSpace::Rec709.name() });
        document
    }
}

impl PhotographSource {
    /// Reads the image, or merges the exposures. `clip` is the clip level that the user specified.
    ///
    /// # Errors
    /// If a file cannot be read, or settings do not apply to it.
    pub fn read(
        self,
        reading: &Reading,
        clip: Option<f32>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Photograph, AppError> {
        if let Some(clip) = clip.filter(|clip| clip.is_nan() || *clip <= 0.0) {
            return Err(AppError::new(format!(
                "clip {clip}: is not a positive radiance; specify the radiance at which the camera clips"
            )));
        }
        let paths = match self {
            Self::Memory(picture) => {
                warnings.extend(coded_floats::warning("the image", &picture.rgb).map(Warning::from));
                let Some(space) = reading.colour_space else {
                    return Ok(Photograph { picture, clip, bracket: None, space: None });
                };
                let decoded = Decoded::linear(picture, clip, space).into_working(Path::new("the picture"))?;
                let Decoded { picture, full_scale: clip, input, .. } = decoded;
                warnings.extend(spaces::warnings("the picture", &input, picture.rgb.as_slice().len()));
                return Ok(Photograph { picture, clip, bracket: None, space: Some(input) });
            }
            Self::Bytes(name, bytes) => {
                if reading.response.is_some() {
                    return Err(AppError::of(name, "a response curve applies only to exposures in files"));
                }
                return single(Path::new(&name), Some(&bytes), reading, clip, warnings);
            }
            Self::Files(paths) => paths,
        };
        if let ([path], None) = (&paths[..], &reading.response) {
            return single(path, None, reading, clip, warnings);
        }
        let bracket = merge_files(&paths, reading, warnings)?;
        let section = Some(bracket.section());
        let Merged { picture, clip_level, .. } = bracket.merged;
        // Unknown pixels of the merged bracket have the value `clip_level`.
        let (clip, space) = (Some(clip.map_or(clip_level, |clip| clip.min(clip_level))), Some(bracket.space));
        Ok(Photograph { picture, clip, bracket: section, space })
    }
}

/// Reads an image and adds its warnings.
///
/// # Errors
/// If the image cannot be read.
pub fn read_picture(path: &Path, options: &ReadOptions, warnings: &mut Vec<Warning>) -> Result<Decoded, AppError> {
    let decoded = picture::read(path, options)?;
    warnings.extend(reading_warnings(path, options, &decoded));
    Ok(decoded)
}

/// Decodes an image in memory, whose name determines the format, and adds its warnings.
///
/// # Errors
/// If the image cannot be decoded.
pub fn decode_picture(
    name: &Path,
    bytes: &[u8],
    options: &ReadOptions,
    warnings: &mut Vec<Warning>,
) -> Result<Decoded, AppError> {
    let decoded = picture::decode(name, bytes, options)?;
    warnings.extend(reading_warnings(name, options, &decoded));
    Ok(decoded)
}

fn reading_warnings(path: &Path, options: &ReadOptions, decoded: &Decoded) -> Vec<Warning> {
    let name = path.display();
    let coded = match decoded.encoding {
        Encoding::Srgb { bits } => Some(Warning::new(
            format!(
                "{name}: {bits}-bit image, decoded as sRGB; its highlights are probably clipped and its tone curve is \
                 unknown; use an HDR image for reliable results"
            ),
            vec![Suggestion::Linear],
        )),
        Encoding::Coded { bits } => Some(Warning::new(
            format!(
                "{name}: {bits}-bit image, decoded by the curve in the file ({}); its highlights are probably clipped; \
                 use an HDR image for reliable results",
                decoded.input.source.words()
            ),
            vec![Suggestion::Linear],
        )),
        Encoding::LinearFloat if options.linear => {
            Some(Warning::from(format!("{name}: is already linear; the option for linear values has no effect")))
        }
        _ => None,
    };
    let layered = decoded.layer.as_ref().filter(|_| options.layer.is_none()).map(|layer| {
        let (taken, others) = (&layer.name, layer.others.join(", "));
        let text = format!("{name}: has several layers; gonio uses {taken}, the others are {others}");
        Warning::new(text, vec![Suggestion::Layer])
    });
    let pixels = decoded.picture.rgb.as_slice().len();
    let space = spaces::warnings(&name.to_string(), &decoded.input, pixels);
    coded.into_iter().chain(layered).chain(space).collect()
}

/// Reads a photograph from one image, either from `bytes` or from the file.
fn single(
    path: &Path,
    bytes: Option<&[u8]>,
    reading: &Reading,
    clip: Option<f32>,
    warnings: &mut Vec<Warning>,
) -> Result<Photograph, AppError> {
    if reading.times.is_some() {
        return Err(AppError::of(
            path.display(),
            "exposure times apply only to several exposures; specify more files, or no times",
        ));
    }
    let Reading { linear, colour_space, .. } = *reading;
    let options = ReadOptions { linear, layer: reading.layer.clone(), colour_space, ..ReadOptions::default() };
    // Black level and flat field apply before the colour conversion.
    let mut decoded = match bytes {
        Some(bytes) => picture::decode_unconverted(path, bytes, &options)?,
        None => picture::read_unconverted(path, &options)?,
    };
    let max = largest_code(decoded.encoding);
    if let Some(code) = reading.black_level {
        let Some(max) = max else {
            let problem = "a black level applies only to linear integer images; set the option for linear values, or no black level";
            return Err(AppError::of(path.display(), problem));
        };
        subtract_black(&mut decoded, black_share(code, max)?);
    }
    decoded.full_scale = clip.or(decoded.full_scale);
    if let Some(flat) = &reading.flat {
        if decoded.needs_table() {
            let problem = "a flat field requires linear values, but the ICC profile contains a lookup table; convert the \
                           image to a linear colour space";
            return Err(AppError::of(path.display(), problem));
        }
        // Division by a flat field would hide this clip level.
        let level_found = decoded.full_scale.or_else(|| repeated_maximum(decoded.picture.rgb.as_slice()));
        decoded.full_scale = flatten(&mut decoded.picture, flat, reading, max, level_found)?;
    }
    if decoded.encoding == Encoding::LinearFloat {
        let name = path.display().to_string();
        warnings.extend(coded_floats::warning(&name, &decoded.picture.rgb).map(Warning::from));
    }
    let decoded = decoded.into_working(path)?;
    warnings.extend(reading_warnings(path, &options, &decoded));
    let Decoded { picture, full_scale, input, .. } = decoded;
    Ok(Photograph { picture, clip: full_scale, bracket: None, space: Some(input) })
}

/// Returns the largest code of linear integers.
fn largest_code(encoding: Encoding) -> Option<f64> {
    if let Encoding::Linear { bits } = encoding { Some(2_f64.powi(bits.into()) - 1.0) } else { None }
}

/// Returns a black level as a share of the largest code.
fn black_share(code: f64, max: f64) -> Result<f32, AppError> {
    let share = (code / max) as f32;
    if !(code >= 0.0 && share < 1.0) {
        return Err(AppError::new(format!("black level {code}: must be at least 0 and less than {max}")));
    }
    Ok(share)
}

/// Divides by the flat field in a file, and returns the new clip level. `max` is the largest code
/// of a photograph of linear integers.
fn flatten(
    picture: &mut Picture,
    path: &Path,
    reading: &Reading,
    max: Option<f64>,
    clip: Option<f32>,
) -> Result<Option<f32>, AppError> {
    // The colour space also determines the curve of integer codes.
    let linear = reading.linear || reading.response == Some(Curve::Linear);
    let options = ReadOptions { linear, colour_space: reading.colour_space, ..ReadOptions::default() };
    let mut flat = picture::read_unconverted(path, &options)?;
    if flat.needs_table() {
        let problem = "the ICC profile of the flat field contains a lookup table; convert the image to a linear colour \
                       space";
        return Err(AppError::of(path.display(), problem));
    }
    // Another range of codes indicates another sensor, whose black level is unknown.
    if let (Some(code), Some(max)) = (reading.black_level, max.filter(|_| max == largest_code(flat.encoding))) {
        subtract_black(&mut flat, black_share(code, max)?);
    }
    Ok(divide_by_flat(picture, &flat.picture.rgb, path, clip)?)
}

/// Reads and merges the exposures of a bracket.
///
/// # Errors
/// If a file cannot be read, the exposures do not match, or settings do not apply to them.
pub fn merge_files(
    paths: &[PathBuf],
    reading: &Reading,
    warnings: &mut Vec<Warning>,
) -> Result<MergedBracket, AppError> {
    let names = || match paths {
        [one] => one.display().to_string(),
        [first, rest @ ..] => format!("{} and {} more", first.display(), rest.len()),
        [] => String::new(),
    };
    if reading.layer.is_some() {
        return Err(AppError::new("a layer applies only to OpenEXR files, not to exposures"));
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
    let settings = MergeSettings { align: !reading.no_align, trust_times: reading.trust_times };
    let max = exposures.first().map_or(u16::from(u8::MAX), |e| e.codes.max());
    let black = reading.black_level.unwrap_or(0.0);
    black_share(black, max.into())?;
    let linear = curve == Some(Curve::Linear) || (bracket.linear && curve.is_none());
    if reading.black_level.is_some() && !linear {
        let problem = "applies only to linear exposures; use linear exposures, or specify no black level";
        return Err(AppError::of(format!("black level {black}"), problem));
    }
    let given = match from_file {
        Some(response) => Some(response),
        None if linear => Some(Response::linear(max, black)),
        None => curve.is_some().then(|| Response::srgb(max)),
    };
    let mut merged =
        merge(exposures, given.as_ref(), &settings).map_err(|error| AppError::of_bracket(names(), &error))?;
    merged.picture.alpha = bracket.alpha.clone();
    if let Some(path) = &reading.flat {
        let level = flatten(&mut merged.picture, path, reading, linear.then_some(max.into()), Some(merged.clip_level))?;
        merged.clip_level = level.unwrap_or(merged.clip_level);
    }
    let whole = std::mem::replace(&mut merged.picture, Picture { rgb: Plane::from_vec(0, 0, Vec::new()), alpha: None });
    let decoded = bracket.decoded(whole, merged.clip_level).into_working(paths.first().map_or(Path::new(""), |p| p))?;
    merged.clip_level = decoded.full_scale.unwrap_or(merged.clip_level);
    merged.picture = decoded.picture;
    let report = &merged.report;
    warnings.extend(spaces::warnings(&names(), &decoded.input, report.pixels));
    for ((path, error), correction) in paths.iter().zip(&report.time_errors).zip(&report.corrections) {
        let path = path.display();
        let Some(correction) = correction else {
            let problem = "contradicts the other exposures and is left out; possible causes are motion, a wrong exposure \
                 time, and changed light";
            warnings.push(format!("{path}: {problem}").into());
            continue;
        };
        if error.abs() > TIME_ERROR {
            let (percent, side) = (100.0 * error.abs(), if *error > 0.0 { "brighter" } else { "darker" });
            warnings.push(format!("{path}: {percent:.0} % {side} than its exposure time implies").into());
        }
        if correction.veiling_glare.iter().any(|veil| *veil != 0.0) {
            warnings.push(format!("{path}: contains veiling glare, which gonio subtracts").into());
        }
    }
    for (count, what) in [
        (
            report.inconsistent,
            "differ between exposures; gonio ignores them; possible causes are motion and JPEG artefacts",
        ),
        (report.dark, "are black in all exposures; gonio sets them to half of the smallest measurable radiance"),
    ] {
        if count > 0 {
            warnings.push(format!("{}: {count} of {} pixels {what}", names(), report.pixels).into());
        }
    }
    let longest = exposures.iter().map(|e| e.amount).fold(0.0, f64::max);
    let amounts = exposures.iter().map(|e| e.amount / longest).collect();
    Ok(MergedBracket { merged, space: decoded.input, recovered: given.is_none(), relative_exposures: amounts })
}
