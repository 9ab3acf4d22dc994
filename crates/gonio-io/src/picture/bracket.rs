//! Reads brackets: integer images of one scene and the exposure of each image.

use std::path::{Path, PathBuf};

use gonio::bracket::{Codes, Exposure};
use gonio::picture::{Picture, Plane};
use gonio::suggestion::Suggestion;
use image::DynamicImage;
use image::metadata::Orientation;

use super::space::{Conversion, DeclaredSpace};
use super::{Decoded, Encoding, ExposureSettings, Format, InputSpace, ReadOptions, integer};
use crate::{Error, guard};

/// Largest total number of pixels in a bracket.
const MAX_PIXELS: u64 = 1 << 29;

/// Options for reading a bracket.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BracketOptions {
    /// Exposure time of each file in seconds, instead of EXIF data; all are positive.
    pub times: Option<Vec<f64>>,
    /// Limits of each picture. [`ReadOptions::linear`] has no effect, as codes are not decoded.
    pub read: ReadOptions,
}

/// A bracket read from files.
#[derive(Clone, Debug, PartialEq)]
pub struct Bracket {
    /// Exposures in the order of the files, rotated by their EXIF orientation.
    pub exposures: Vec<Exposure>,
    /// Coverage in 0..=1, if the first file has an alpha channel.
    pub alpha: Option<Plane<f32>>,
    /// Camera settings of each picture.
    pub exposure_settings: Vec<ExposureSettings>,
    /// Whether the codes are linear radiance, because the files are camera raw files.
    pub linear: bool,
    /// Colour space of all files.
    pub input: InputSpace,
    /// Conversion of the merged picture.
    conversion: Conversion,
}

impl Bracket {
    /// Wraps the merged picture for [`Decoded::into_working`]. Its colours are linear in the
    /// primaries of the files. `clip_level` is the radiance at or above which a channel is clipped.
    pub fn decoded(&self, picture: Picture, clip_level: f32) -> Decoded {
        let Self { input, conversion, .. } = self;
        let (encoding, full_scale) = (Encoding::LinearFloat, Some(clip_level));
        Decoded { picture, encoding, full_scale, layer: None, input: input.clone(), conversion: conversion.clone() }
    }
}

/// One file of a bracket.
struct Coded {
    codes: Codes,
    alpha: Option<Plane<f32>>,
    orientation: Orientation,
    shot: ExposureSettings,
    linear: bool,
    space: (Conversion, InputSpace),
}

/// Reads 8- or 16-bit JPEG, PNG and TIFF files as a bracket. With the feature `raw`, also reads
/// camera raw files.
///
/// The amount of light of each is its exposure time times its ISO sensitivity over the square of
/// its f-number. A sensitivity or an f-number that no file states counts as equal for all. With
/// [`BracketOptions::times`], the amount is the given time alone. A single file requires no
/// exposure time.
///
/// # Errors
/// If a file cannot be read, is damaged or contains no integers. If files differ in size, depth or
/// orientation. If exposure times are missing, or if only some files state sensitivity or f-number.
pub fn read_bracket(paths: &[PathBuf], options: &BracketOptions) -> Result<Bracket, Error> {
    let mut files = Vec::new();
    for path in paths {
        let bytes = guard::read_whole(path, options.read.max_bytes())?;
        files.push((path.as_path(), decode_codes(path, &bytes, &options.read)?));
        // Fails before the remaining files are read.
        check_alike(&files)?;
    }
    assemble(files, options)
}

/// Decodes a bracket held in memory, like [`read_bracket`]. The paths are only used in error
/// messages.
///
/// # Errors
/// Like [`read_bracket`].
pub fn decode_bracket(files: &[(&Path, &[u8])], options: &BracketOptions) -> Result<Bracket, Error> {
    let mut decoded = Vec::new();
    for (path, bytes) in files {
        decoded.push((*path, decode_codes(path, bytes, &options.read)?));
        check_alike(&decoded)?;
    }
    assemble(decoded, options)
}

fn decode_codes(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Coded, Error> {
    let format = match Format::of(path, bytes)? {
        Format::Png => image::ImageFormat::Png,
        Format::Jpeg => image::ImageFormat::Jpeg,
        Format::Tiff => image::ImageFormat::Tiff,
        #[cfg(feature = "raw")]
        Format::Raw => {
            let raw = super::raw::develop(path, bytes, options)?;
            let (codes, shot) = (raw.codes(), raw.shot);
            let space = (Conversion::None, InputSpace::unconverted("camera", super::SpaceSource::Camera));
            return Ok(Coded { codes, alpha: None, orientation: Orientation::NoTransforms, shot, linear: true, space });
        }
        _ => return Err(not_coded(path)),
    };
    let integer::Loaded { image, samples, orientation, embedded } = integer::load(path, bytes, format, options)?;
    let space = embedded.stated.settle_values(samples.is_grey, Some("merged radiance"), options.colour_space);
    let (codes, alpha) = codes_of(path, image, orientation)?;
    Ok(Coded { codes, alpha, orientation, shot: ExposureSettings::of(bytes), linear: false, space })
}

fn not_coded(path: &Path) -> Error {
    let advice = "use integer images as exposures of one scene";
    Error::unsupported(path, "contains radiance instead of 8- or 16-bit codes", advice)
        .with_suggestion(Suggestion::Separately)
}

fn codes_of(
    path: &Path,
    mut image: DynamicImage,
    orientation: Orientation,
) -> Result<(Codes, Option<Plane<f32>>), Error> {
    image.apply_orientation(orientation);
    let (width, height) = (image.width() as usize, image.height() as usize);
    let has_alpha = image.color().has_alpha();
    let plane = |alpha: Vec<f32>| has_alpha.then(|| Plane::from_vec(width, height, alpha));
    Ok(match image.color().bytes_per_pixel() / image.color().channel_count() {
        1 => {
            let alpha = has_alpha.then(|| image.to_rgba8().pixels().map(|p| f32::from(p.0[3]) / 255.0).collect());
            let codes = image.into_rgb8().pixels().map(|p| p.0).collect();
            (Codes::Eight(Plane::from_vec(width, height, codes)), alpha.and_then(plane))
        }
        2 => {
            let alpha = has_alpha.then(|| image.to_rgba16().pixels().map(|p| f32::from(p.0[3]) / 65535.0).collect());
            let codes = image.into_rgb16().pixels().map(|p| p.0).collect();
            (Codes::Sixteen(Plane::from_vec(width, height, codes)), alpha.and_then(plane))
        }
        _ => return Err(not_coded(path)),
    })
}

/// Checks the last file against the first.
fn check_alike(files: &[(&Path, Coded)]) -> Result<(), Error> {
    let [(first_path, first), .., (path, last)] = files else { return Ok(()) };
    let other = first_path.display();
    let ((w, h), (fw, fh)) = (last.codes.size(), first.codes.size());
    if last.orientation != first.orientation {
        let problem = format!("has another orientation tag than {other}");
        return Err(Error::invalid(path, problem, "use exposures of the same orientation, or remove the tags"));
    }
    if (w, h) != (fw, fh) {
        let problem = format!("has {w}x{h} pixels, but {other} has {fw}x{fh}");
        return Err(Error::invalid(path, problem, "use exposures of the same size"));
    }
    if last.codes.max() != first.codes.max() {
        let bits = |codes: &Codes| u16::BITS - codes.max().leading_zeros();
        let problem = format!("has {} bits per sample, but {other} has {}", bits(&last.codes), bits(&first.codes));
        return Err(Error::invalid(path, problem, "use exposures of the same bit depth"));
    }
    if last.linear != first.linear {
        return Err(Error::invalid(path, format!("has another file type than {other}"), "use only raw files, or none"));
    }
    if last.space != first.space {
        let problem = format!("has the colour space {}, but {other} has {}", last.space.1.name, first.space.1.name);
        return Err(Error::invalid(path, problem, "use exposures of the same colour space"));
    }
    if (w * h) as u64 * files.len() as u64 > MAX_PIXELS {
        let problem =
            format!("is exposure {} of {w}x{h} pixels, which exceeds the total of {MAX_PIXELS} pixels", files.len());
        return Err(Error::limits(path, problem, "scale the exposures down, or use fewer"));
    }
    Ok(())
}

/// Assembles the files with their amounts of light.
fn assemble(files: Vec<(&Path, Coded)>, options: &BracketOptions) -> Result<Bracket, Error> {
    let amounts = amounts(&files, options.times.as_deref())?;
    let (conversion, input) = DeclaredSpace::default().settle(options.read.colour_space);
    let mut bracket =
        Bracket { exposures: Vec::new(), alpha: None, exposure_settings: Vec::new(), linear: false, input, conversion };
    for (i, ((_, file), amount)) in files.into_iter().zip(amounts).enumerate() {
        if i == 0 {
            (bracket.alpha, bracket.linear) = (file.alpha, file.linear);
            (bracket.conversion, bracket.input) = file.space;
        }
        bracket.exposures.push(Exposure { codes: file.codes, amount });
        bracket.exposure_settings.push(file.shot);
    }
    Ok(bracket)
}

fn amounts(files: &[(&Path, Coded)], times: Option<&[f64]>) -> Result<Vec<f64>, Error> {
    let by_hand = |path: &Path, problem: String| {
        Error::invalid(path, problem, "specify the times of all files").with_suggestion(Suggestion::Times)
    };
    if let Some(times) = times {
        if let Some((path, _)) = files.get(times.len()) {
            let problem = format!("has no time: {} times are specified for {} files", times.len(), files.len());
            return Err(Error::invalid(path, problem, "specify one time per file"));
        }
        if let (Some((path, _)), true) = (files.last(), times.len() > files.len()) {
            let problem = format!("is the last of {} files, but {} times are specified", files.len(), times.len());
            return Err(Error::invalid(path, problem, "specify one time per file"));
        }
        return Ok(times.to_vec());
    }
    if files.len() == 1 {
        return Ok(vec![1.0]);
    }
    // A factor that only some files state cannot be assumed to be constant.
    let factor = |what: &str, of: fn(&ExposureSettings) -> Option<f64>| -> Result<Vec<f64>, Error> {
        let values: Vec<_> = files.iter().map(|(_, f)| of(&f.shot)).collect();
        if values.iter().all(Option::is_none) {
            return Ok(vec![1.0; files.len()]);
        }
        let known = |(value, (path, _)): (&Option<f64>, &(&Path, Coded))| {
            value.ok_or_else(|| by_hand(path, format!("has no {what} in its EXIF data, but other exposures do")))
        };
        values.iter().zip(files).map(known).collect()
    };
    let mut amounts = Vec::new();
    for (path, file) in files {
        let missing = || by_hand(path, "has no exposure time in its EXIF data".into());
        amounts.push(file.shot.seconds.ok_or_else(missing)?);
    }
    let (iso, f_number) = (factor("ISO sensitivity", |s| s.iso)?, factor("f-number", |s| s.f_number)?);
    Ok(amounts.iter().zip(iso).zip(f_number).map(|((t, iso), n)| t * iso / (n * n)).collect())
}
